"""Events: round trip, damage, threads, a parent that hung up, libraries that print."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.job.events import EventStream, clock, parse_event, read_events

ROOT = Path(__file__).resolve().parents[2]
values = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()


@given(data=st.dictionaries(st.text().filter(lambda k: k not in ("v", "t", "ev", "self", "kind")), values))
def test_an_event_comes_back_as_it_was_sent(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("events") / "events.jsonl"
    stream = EventStream(path)
    stream.emit("metric", **data)
    stream.close()
    (event,) = read_events(path)
    assert event.kind == "metric" and event.time > 0
    expected = {k: None if isinstance(v, float) and math.isinf(v) else v for k, v in data.items()}
    assert {k: v for k, v in event.data.items() if k != "v"} == expected
    assert event.data["v"] == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no file that is always full")
def test_the_parent_hears_of_a_disk_that_is_full(tmp_path):
    """A fixed bug: the sentence about it went to the full disk alone."""
    script = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
from solver.session import session
with session(Path("/dev/full"), Path({str(tmp_path / "status.json")!r}), Path({str(tmp_path / "cancel")!r}), True, True):
    pass
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert [parse_event(line).kind for line in run.stdout.splitlines()] == ["hello"]
    heard = io.StringIO()
    stream = EventStream(tmp_path / "events.jsonl", heard)
    stream._file = open("/dev/full", "w")  # noqa: SIM115
    with pytest.raises(OSError, match="space"):
        stream.emit("error", code=2, message="free space")
    assert parse_event(heard.getvalue()).data["message"] == "free space"


def test_the_parent_gets_the_very_lines_of_the_file(tmp_path):
    parent = io.StringIO()
    stream = EventStream(tmp_path / "events.jsonl", parent)
    stream.emit("stage", name="fit", index=3, count=6)
    stream.emit("warning", text="Photo ‘größe 1.png’\nis dark\u2028and small")
    stream.close()
    text = (tmp_path / "events.jsonl").read_text(encoding="utf-8")
    assert parent.getvalue() == text and text.count("\n") == 2
    assert [json.loads(line)["ev"] for line in text.split("\n")[:2]] == ["stage", "warning"]
    events = read_events(tmp_path / "events.jsonl")
    assert events[1].data["text"] == "Photo ‘größe 1.png’\nis dark\u2028and small"


def test_a_number_that_is_not_finite_does_not_end_the_job(tmp_path):
    stream = EventStream(tmp_path / "events.jsonl")
    stream.emit("metric", name="psnr", value=float("nan"), step=3)
    stream.close()
    (event,) = read_events(tmp_path / "events.jsonl")
    assert event.data["value"] is None and event.data["step"] == 3


def test_a_parent_that_hung_up_does_not_end_the_job(tmp_path):
    read, write = os.pipe()
    os.close(read)
    stream = EventStream(tmp_path / "events.jsonl", os.fdopen(write, "w"))
    for step in range(3):
        stream.emit("checkpoint", step=step)
    stream.close()
    events = read_events(tmp_path / "events.jsonl")
    assert [event.data["step"] for event in events] == [0, 1, 2]


def test_events_of_many_threads_do_not_mix(tmp_path):
    stream = EventStream(tmp_path / "events.jsonl", io.StringIO())

    def work(name):
        for step in range(200):
            stream.emit("metric", name=name, value=0.5, step=step)

    threads = [threading.Thread(target=work, args=(f"thread {n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    stream.close()
    events = read_events(tmp_path / "events.jsonl")
    assert len(events) == 800 and {event.kind for event in events} == {"metric"}


@pytest.mark.parametrize(
    ("number", "refused"), [(errno.EACCES, True), (errno.EINVAL, False)], ids=["held", "no locks"]
)
def test_windows_locks_a_byte_beyond_what_is_written_and_read(tmp_path, monkeypatch, number, refused):
    path, locked = tmp_path / "events.jsonl", []

    def lock(descriptor, mode, count):
        locked.append((os.lseek(descriptor, 0, os.SEEK_CUR), count))
        raise OSError(number, "from Windows")

    with monkeypatch.context() as windows:
        windows.setattr(os, "name", "nt")
        windows.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=lock, LK_NBLCK=2))
        if refused:
            with pytest.raises(BlockingIOError):
                EventStream(path)
        else:
            stream = EventStream(path)
            stream.emit("metric", step=1)
            stream.close()
    ((place, count),) = locked
    assert count == 1 and 10**9 < place < 2**31 - 1, "its position has 31 bits"
    assert [event.data["step"] for event in read_events(path)] == ([] if refused else [1])
    assert path.stat().st_size < 100


@given(line=st.text())
def test_any_line_is_an_event_or_a_log_line(line):
    event = parse_event(line)
    assert event.kind != "log" or event.data == {"text": line.rstrip("\n")} or "ev" in line


def test_lines_that_are_no_events_become_log_lines():
    deep = "[" * 100_000
    for line in (
        "Downloading weights…",
        "{",
        "3",
        "null",
        '{"v": 1}',
        '{"ev": "x", "t": "y"}',
        deep,
    ):
        assert parse_event(line).kind == "log", line[:20]
        assert parse_event(line).data["text"] == line


def test_half_a_line_is_no_event_until_the_rest_is_written(tmp_path):
    path = tmp_path / "events.jsonl"
    path.write_text('{"v":1,"t":1,"ev":"hello"}\n{"v":1,"t":2,"ev":"sta', encoding="utf-8")
    assert [event.kind for event in read_events(path)] == ["hello"]
    with path.open("a", encoding="utf-8") as file:
        file.write('ge","name":"fit"}\nnoise\n')
    assert [event.kind for event in read_events(path)] == ["hello", "stage", "log"]


def test_a_missing_file_has_no_events(tmp_path):
    assert read_events(tmp_path / "none.jsonl") == []


def test_half_a_line_of_a_killed_process_does_not_swallow_the_next_event(tmp_path):
    path = tmp_path / "events.jsonl"
    path.write_text('{"v":1,"t":1,"ev":"hello"}\n{"v":1,"t":2,"ev":"pro', encoding="utf-8")
    stream = EventStream(path)
    stream.emit("hello", version="2")
    stream.close()
    events = read_events(path)
    assert [event.kind for event in events] == ["hello", "log", "hello"]


def test_what_libraries_print_never_reaches_the_event_stream(tmp_path):
    program = f"""
import os, sys
sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
from solver.job.events import EventStream
from solver.streams import take_stdout_for_events
stream = take_stdout_for_events()
out = EventStream(Path({str(tmp_path / "events.jsonl")!r}), stream)
print("a library's banner", flush=True)
os.write(1, b"printed by C code\\n")
out.emit("hello", version="1")
"""
    answer = subprocess.run(
        [sys.executable, "-I", "-c", program], capture_output=True, text=True, check=True
    )
    assert [json.loads(line)["ev"] for line in answer.stdout.splitlines()] == ["hello"]
    assert "banner" in answer.stderr and "C code" in answer.stderr


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0:00"), (65.9, "1:05"), (3600, "1:00:00"), (7384, "2:03:04"), (-3, "0:00")],
)
def test_time_left_reads_like_a_clock(seconds, text):
    assert clock(seconds) == text
