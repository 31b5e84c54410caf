"""What a running job hears: cancel on stdin, by file and by signal; the end of its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from solver.job.control import Control

if os.name != "nt":
    import fcntl
    import termios

ROOT = Path(__file__).resolve().parents[2]
WORK = """
import sys, time
sys.path.insert(0, {root!r})
from pathlib import Path
from solver.job.control import Control
control = Control(Path({cancel!r}), has_parent={has_parent})
control.start()
print("up", flush=True)
end = time.monotonic() + {seconds}
while time.monotonic() < end and not control.should_stop:
    {work}
print("cancelled", control.cancelled, "parent gone", control.parent_gone, flush=True)
sys.exit(3 if control.should_stop else 0)
"""
WRITE_A_BAR = 'time.sleep(0.01); sys.stderr.write("bar"); sys.stderr.flush()'


@pytest.fixture
def start(tmp_path):
    """Start a job that works for `seconds`, or until it hears that it should stop."""
    children = []

    def run(seconds=20.0, stdin=subprocess.PIPE, work="time.sleep(0.01)", has_parent=True, **options):
        program = WORK.format(
            root=str(ROOT), cancel=str(tmp_path / "cancel"), seconds=seconds, work=work,
            has_parent=has_parent,
        )  # fmt: skip
        child = subprocess.Popen(
            [sys.executable, "-I", "-u", "-c", program],
            stdin=stdin, stdout=subprocess.PIPE, text=True, **options,
        )  # fmt: skip
        children.append(child)
        assert child.stdout.readline() == "up\n"
        return child

    yield run
    for child in children:
        child.kill()
        child.wait()
        for stream in (child.stdin, child.stdout):
            if stream is not None and not stream.closed:
                stream.close()


def ending(child):
    """Seconds until it ended, its last line, its exit code."""
    asked = time.monotonic()
    text = child.stdout.read().strip()
    return time.monotonic() - asked, text, child.wait(10)


def test_a_folder_that_is_away_for_a_moment_ends_neither_heartbeat_nor_cancel(tmp_path, monkeypatch):
    """As on a network drive."""
    beats, away, exists = [], [True], Path.exists

    def answer(path):
        if away and path.name == "cancel":
            raise OSError(5, "Input/output error", str(path))
        return exists(path)

    monkeypatch.setattr(Path, "exists", answer)
    monkeypatch.setattr(Control, "INTERVAL", 0.01)
    control = Control(tmp_path / "cancel", has_parent=False)
    control.start(lambda: beats.append(1))
    try:
        end = time.monotonic() + 5
        while len(beats) < 3 and time.monotonic() < end:
            time.sleep(0.01)
        assert len(beats) >= 3 and not control.should_stop
        (tmp_path / "cancel").touch()
        away.clear()
        while not control.should_stop and time.monotonic() < end:
            time.sleep(0.01)
        assert control.cancelled
    finally:
        control.stop()


def test_ctrl_break_cancels_as_farms_on_windows_ask(tmp_path, monkeypatch):
    if os.name != "nt":  # a stand-in
        monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
    control = Control(tmp_path / "cancel", has_parent=False)
    control.start()
    try:
        signal.raise_signal(signal.SIGBREAK)
        assert control.should_stop
    finally:
        control.stop()


@pytest.mark.parametrize("line", ['{"cmd": "cancel"}', "cancel", '  {"cmd":"cancel","why":"é"}'])
def test_a_line_on_stdin_cancels(start, line):
    child = start()
    child.stdin.write(line + "\n")
    child.stdin.flush()
    seconds, text, code = ending(child)
    assert (text, code) == ("cancelled True parent gone False", 3)
    assert seconds < 2


def test_a_line_in_two_pieces_after_noise_cancels(start):
    child = start()
    child.stdin.write('{"cmd": "sing"}\nnull\n[]\n{"cmd": "can')
    child.stdin.flush()
    time.sleep(0.2)
    assert child.poll() is None
    child.stdin.write('cel"}\n')
    child.stdin.flush()
    assert ending(child)[1:] == ("cancelled True parent gone False", 3)


def test_a_cancel_file_cancels_a_job_without_a_parent(start, tmp_path):
    child = start(stdin=subprocess.DEVNULL)
    (tmp_path / "cancel").touch()
    seconds, text, code = ending(child)
    assert (text, code) == ("cancelled True parent gone False", 3)
    assert seconds < 2


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM to catch")
def test_a_termination_signal_cancels(start):
    child = start(stdin=subprocess.DEVNULL)
    child.send_signal(signal.SIGTERM)
    assert ending(child)[1:] == ("cancelled True parent gone False", 3)


def test_the_end_of_stdin_means_that_the_parent_is_gone(start):
    child = start()
    time.sleep(0.2)
    child.stdin.close()
    seconds, text, code = ending(child)
    assert (text, code) == ("cancelled False parent gone True", 3)
    assert seconds < 2


def test_without_a_parent_a_job_that_does_not_listen_ends_within_two_seconds(start):
    child = start(work="control.__dict__.get('never')")
    child2 = start(work="time.sleep(20)")
    time.sleep(0.2)
    for busy in (child2, child):
        busy.stdin.close()
        seconds, _, code = ending(busy)
        assert seconds < 2 and code == 3


def test_a_stdin_that_is_at_its_end_from_the_start_is_no_parent(start):
    for stdin in (subprocess.DEVNULL, subprocess.PIPE):
        read = write = None
        if stdin == subprocess.PIPE:
            read, write = os.pipe()
            os.close(write)
            stdin = read
        child = start(seconds=0.5, stdin=stdin)
        if read is not None:
            os.close(read)
        assert ending(child)[1:] == ("cancelled False parent gone False", 0)


def pipe_that_ends_after(text):
    """The reading end of a pipe with `text` in it and nobody who could write more."""
    read, write = os.pipe()
    os.write(write, text.encode())
    os.close(write)
    return read


def test_a_list_that_ends_at_once_is_no_parent_either(start):
    stdin = pipe_that_ends_after('capture two\ncapture three\n"four"\n')
    child = start(seconds=0.5, stdin=stdin)
    os.close(stdin)
    assert ending(child)[1:] == ("cancelled False parent gone False", 0)


def test_a_job_without_a_parent_leaves_its_stdin_alone(start):
    lines = 'capture two\n{"cmd": "cancel"}\n'
    stdin = pipe_that_ends_after(lines)
    child = start(seconds=0.5, stdin=stdin, has_parent=False)
    assert ending(child)[1:] == ("cancelled False parent gone False", 0)
    assert os.read(stdin, 999) == lines.encode()
    os.close(stdin)


def own_terminal():
    """In a child: stdin is its terminal, whose end it is told of also if the tests run under nohup."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGHUP")
def test_a_terminal_that_is_closed_cancels_and_the_bar_that_writes_there_does_not_fail(start):
    terminal, theirs = os.openpty()
    child = start(
        stdin=theirs, stderr=theirs, start_new_session=True, work=WRITE_A_BAR, preexec_fn=own_terminal
    )
    os.close(theirs)
    assert b"bar" in os.read(terminal, 999)
    os.close(terminal)
    assert ending(child)[1:] == ("cancelled True parent gone False", 3)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGHUP")
def test_a_job_that_nohup_started_outlives_its_terminal(start):
    ignore = lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)  # noqa: E731
    child = start(seconds=0.5, stdin=subprocess.DEVNULL, preexec_fn=ignore)
    child.send_signal(signal.SIGHUP)
    assert ending(child)[1:] == ("cancelled False parent gone False", 0)


@pytest.mark.skipif(os.name == "nt", reason="a child cannot be sent Ctrl-C alone")
@pytest.mark.parametrize("before", [signal.SIG_DFL, signal.SIG_IGN], ids=["heard", "ignored"])
def test_ctrl_c_asks_for_a_checkpoint_and_a_second_one_ends_at_once(start, before):
    prepare = lambda: signal.signal(signal.SIGINT, before)  # noqa: E731
    child = start(preexec_fn=prepare)
    child.send_signal(signal.SIGINT)
    assert ending(child)[1:] == ("cancelled True parent gone False", 3)
    deaf = start(work='print("busy", flush=True); time.sleep(20)', preexec_fn=prepare)
    assert deaf.stdout.readline() == "busy\n"
    deaf.send_signal(signal.SIGINT)
    time.sleep(0.2)
    assert deaf.poll() is None
    deaf.send_signal(signal.SIGINT)
    seconds, _, code = ending(deaf)
    assert seconds < 2 and code not in (0, 3)


def test_a_job_says_that_it_is_alive_while_its_work_says_nothing_and_signals_are_given_back(
    tmp_path,
):
    before, beats = signal.getsignal(signal.SIGINT), []
    control = Control(tmp_path / "cancel")
    control.start(lambda: beats.append(time.monotonic()))
    assert signal.getsignal(signal.SIGINT) != before
    end = time.monotonic() + 5
    while len(beats) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    control.stop()
    assert len(beats) >= 2 and signal.getsignal(signal.SIGINT) == before
