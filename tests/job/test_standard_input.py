"""Bytes on a pipe, by a read that waits and by looking first, as Windows needs it."""

import os
import threading

import pytest

from solver.job import standard_input
from solver.job.standard_input import next_bytes


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            pass


def test_what_was_written_is_read_and_the_end_is_empty(pipe):
    ours, theirs = pipe
    os.write(theirs, b"cancel\n")
    assert next_bytes(ours) == b"cancel\n"
    os.close(theirs)
    assert next_bytes(ours) == b""


def test_where_it_looks_first_it_never_reads_before_something_is_there(pipe, monkeypatch):
    ours, theirs = pipe
    counts, reads = iter([0, 0, 0, 4, None]), []
    monkeypatch.setattr(standard_input, "INTERVAL", 0.001)
    real = os.read
    monkeypatch.setattr(os, "read", lambda *a: reads.append(next(counts_left)) or real(*a))
    counts_left = iter(["after the fourth look"])
    threading.Timer(0.05, os.write, (theirs, b"stop")).start()
    assert next_bytes(ours, lambda descriptor: next(counts)) == b"stop"
    assert reads == ["after the fourth look"]
    assert next_bytes(ours, lambda descriptor: next(counts)) == b""
