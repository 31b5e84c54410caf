"""The heartbeat: throttled, whole, and telling a live process from a reused pid."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from solver.job import status
from solver.job.status import Heartbeat, process_is_alive, process_start_time, read_status


@pytest.fixture
def child():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield process
    process.kill()
    process.wait()
    process.stdin.close()


def test_the_heartbeat_says_who_works_and_how_far(tmp_path):
    Heartbeat(tmp_path / "status.json").update("running", 3, 100, 12.5)
    content = json.loads((tmp_path / "status.json").read_text())
    assert content["pid"] == os.getpid() and abs(content["time"] - time.time()) < 5
    assert {k: content[k] for k in ("state", "step", "steps", "seconds_left")} == {
        "state": "running", "step": 3, "steps": 100, "seconds_left": 12.5,
    }  # fmt: skip


def test_the_file_is_written_once_a_second_and_whenever_the_state_changes(tmp_path, monkeypatch):
    clock = [1000.0]
    monkeypatch.setattr(status.time, "monotonic", lambda: clock[0])
    heartbeat = Heartbeat(tmp_path / "status.json")
    heartbeat.update("running", 1)
    clock[0] += 0.5
    heartbeat.update("running", 2)
    assert read_status(tmp_path / "status.json")["step"] == 1
    heartbeat.update("finishing", 3)
    assert read_status(tmp_path / "status.json")["step"] == 3
    clock[0] += 1.1
    heartbeat.update("finishing", 4)
    assert read_status(tmp_path / "status.json")["step"] == 4


def test_a_beat_renews_the_time_and_nothing_else(tmp_path, monkeypatch):
    clock = [1000.0]
    # Only here: who is patient with a file on Windows must see time go on.
    monkeypatch.setattr(status, "time", SimpleNamespace(monotonic=lambda: clock[0], time=lambda: clock[0]))
    path = tmp_path / "status.json"
    heartbeat = Heartbeat(path)
    heartbeat.beat()
    assert not path.exists(), "nothing has begun"
    heartbeat.update("running", 7, 100, 5.0)
    first = read_status(path)
    clock[0] += 20
    heartbeat.beat()
    assert read_status(path) == first | {"time": 1020.0}
    path.unlink()
    path.mkdir()
    clock[0] += 20
    heartbeat.beat()  # a file that cannot be written does not end the job


def test_a_status_that_another_program_holds_on_windows_is_written_by_a_later_beat(tmp_path, monkeypatch):
    clock, held = [1000.0], []
    monkeypatch.setattr(status.time, "monotonic", lambda: clock[0])
    write = status.write_json_atomic

    def written(path, content):
        if held:
            raise PermissionError(13, "Access is denied", str(path))
        write(path, content)

    monkeypatch.setattr(status, "write_json_atomic", written)
    heartbeat = Heartbeat(tmp_path / "status.json")
    heartbeat.update("preparing")
    held.append("by a sync client")
    heartbeat.update("running", 5)
    held.clear()
    clock[0] += 1.1
    heartbeat.beat()
    content = read_status(tmp_path / "status.json")
    assert (content["state"], content["step"]) == ("running", 5)


@pytest.mark.parametrize("text", ["", "{", "[]", "null"])
def test_a_damaged_status_is_none(tmp_path, text):
    (tmp_path / "status.json").write_text(text)
    assert read_status(tmp_path / "status.json") == {}
    assert not process_is_alive({})


def test_this_process_is_alive_until_it_says_that_it_ended(tmp_path):
    path = tmp_path / "status.json"
    heartbeat = Heartbeat(path)
    for state in ("preparing", "running", "finishing"):
        heartbeat.update(state)
        assert process_is_alive(read_status(path)), state
    for state in ("done", "cancelled", "failed"):
        heartbeat.update(state)
        assert not process_is_alive(read_status(path)), state


def test_a_killed_process_is_not_alive(child):
    entry = {"pid": child.pid, "started": process_start_time(child.pid), "state": "running"}
    entry["time"] = time.time() - 100
    if entry["started"] is not None:
        assert process_is_alive(entry)
    child.kill()
    child.wait()
    assert not process_is_alive(entry)


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="start times are read in /proc")
def test_another_process_with_the_same_number_is_not_taken_for_it(child):
    started = process_start_time(child.pid)
    assert process_is_alive({"pid": child.pid, "started": started, "state": "running"})
    assert not process_is_alive({"pid": child.pid, "started": started - 1, "state": "running"})


def test_where_start_times_are_unknown_a_fresh_heartbeat_counts_as_life(monkeypatch):
    monkeypatch.setattr(status, "process_start_time", lambda pid: None)
    monkeypatch.setattr(status.Path, "exists", lambda path: False)
    here = {"pid": os.getpid(), "state": "running"}
    assert process_is_alive(here | {"time": time.time() - 5})
    assert not process_is_alive(here | {"time": time.time() - 60})


def test_where_start_times_are_unknown_a_process_that_is_gone_is_not_waited_for(child, monkeypatch):
    """On Windows and macOS a job that was killed can be resumed at once."""
    monkeypatch.setattr(status, "process_start_time", lambda pid: None)
    monkeypatch.setattr(status.Path, "exists", lambda path: False)
    entry = {"pid": child.pid, "state": "running", "time": time.time()}
    assert process_is_alive(entry)
    child.kill()
    child.wait()
    assert not process_is_alive(entry)


@pytest.mark.parametrize(
    ("handle", "error", "waited", "gone"),
    [(0, 87, None, True), (0, 5, None, False), (8, 0, 0, True), (8, 0, 258, False)],
)
def test_windows_is_asked_whether_a_process_is_gone(monkeypatch, handle, error, waited, gone):
    closed = []
    kernel32 = SimpleNamespace(
        OpenProcess=Mock(return_value=handle or None),
        WaitForSingleObject=lambda process, milliseconds: waited,
        CloseHandle=lambda process: closed.append(process.value),
    )
    monkeypatch.setattr(ctypes, "WinDLL", lambda name, use_last_error: kernel32, raising=False)
    monkeypatch.setattr(ctypes, "get_last_error", lambda: error, raising=False)
    monkeypatch.setattr(sys, "platform", "win32")
    assert status.is_gone(1234) == gone
    assert closed == ([handle] if handle else [])


def test_on_another_machine_a_fresh_heartbeat_is_life_whatever_the_pid(tmp_path):
    Heartbeat(tmp_path / "status.json").update("running")
    here = read_status(tmp_path / "status.json")
    assert process_is_alive(here)
    there = here | {"machine": "render-node-7", "pid": 1 << 22}
    assert process_is_alive(there)
    assert not process_is_alive(there | {"time": time.time() - 60})
    assert not process_is_alive(here | {"pid": 1 << 22})
