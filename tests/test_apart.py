"""Work in a process of its own."""

import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from solver.apart import PIECE, ApartError, run_apart
from solver.job.status import is_gone


def double(value, progress):
    progress(0.5)
    time.sleep(0.5)
    return 2 * value, os.getpid()


def echo(value, progress):
    return value[::-1]


def fail(progress):
    raise ValueError("no such thing")


def die(progress):
    os._exit(3)


def die_but_for_the_pipe(progress):
    """Its end of the pipe stays open, as on Windows that of a process that died while it started does."""
    if os.fork() == 0:
        time.sleep(20)
    os._exit(3)


def sleep(file, progress):
    file.write_text(str(os.getpid()))
    time.sleep(60)


def test_a_result_comes_from_another_process_and_progress_is_told():
    told = []
    value, process = run_apart(double, 21, progress=told.append)
    assert value == 42 and process != os.getpid()
    assert told[-1] == 0.5


@pytest.mark.parametrize("count", [0, PIECE - 1, 3 * PIECE + 1])
def test_what_is_longer_than_a_piece_goes_both_ways(count):
    content = bytes(range(256)) * (count // 256 + 1)
    assert run_apart(echo, content[:count], progress=lambda done: None) == content[:count][::-1]


@pytest.mark.parametrize(
    ("work", "message"), [(fail, "ValueError: no such thing"), (die, "ended with code 3")]
)
def test_an_error_or_a_death_is_told(work, message):
    with pytest.raises(ApartError, match=message):
        run_apart(work, progress=lambda done: None)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="shown by a process that was forked")
def test_a_death_is_told_whoever_holds_the_pipe():
    began = time.monotonic()
    with pytest.raises(ApartError, match="ended with code 3"):
        run_apart(die_but_for_the_pipe, progress=lambda done: None)
    assert time.monotonic() - began < 15


def test_what_progress_raises_ends_the_process(tmp_path):
    file = tmp_path / "process"

    def stop(done):
        if file.is_file() and file.read_text():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_apart(sleep, file, progress=stop)
    assert is_gone(int(file.read_text()))


def test_a_process_that_dies_before_it_has_read_its_work_is_told_of(tmp_path):
    """As one does whose main module cannot be imported; what it was to read is more than a pipe holds."""
    script = tmp_path / "script.py"
    script.write_text(
        "from solver.apart import ApartError, run_apart\n"
        "from tests.test_apart import double\n"
        "if __name__ == '__mp_main__':\n"
        "    raise SystemExit(7)\n"
        "try:\n"
        "    run_apart(double, 'x' * 10**7, progress=lambda done: None)\n"
        "except ApartError as error:\n"
        "    print(error)\n"
    )
    command, root = [sys.executable, str(script)], Path(__file__).parents[1]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.stdout == "the process ended with code 7\n", done.stderr


def test_a_process_ends_with_a_parent_that_is_killed(tmp_path):
    """Or it would go on for nobody, and hold what the parent's own parent waits for."""
    script = tmp_path / "parent.py"
    script.write_text(
        "from pathlib import Path\nfrom solver.apart import run_apart\n"
        "from tests.test_apart import sleep\n"
        "if __name__ == '__main__':\n"
        f"    run_apart(sleep, Path({str(tmp_path / 'who')!r}), progress=lambda done: None)\n"
    )
    root = str(Path(__file__).resolve().parents[1])
    parent = subprocess.Popen([sys.executable, script], env={**os.environ, "PYTHONPATH": root})
    end = time.monotonic() + 60
    while not (tmp_path / "who").exists() or not (tmp_path / "who").read_text():
        assert time.monotonic() < end and parent.poll() is None
        time.sleep(0.05)
    child = int((tmp_path / "who").read_text())
    parent.kill()
    parent.wait()
    end = time.monotonic() + 10
    while is_running(child):
        assert time.monotonic() < end, "it goes on"
        time.sleep(0.05)


def is_running(number):
    """Not a process that has ended, of which nobody has taken note yet."""
    if is_gone(number):
        return False
    try:
        return "\nState:\tZ" not in Path(f"/proc/{number}/status").read_text()
    except ProcessLookupError:
        return False
    except FileNotFoundError:  # no Linux, or it ended between the two
        return not Path("/proc").exists()


def test_that_no_process_can_be_started_is_told_as_the_others_failures_are(monkeypatch):
    def full(self):
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr(multiprocessing.context.SpawnProcess, "start", full)
    with pytest.raises(ApartError, match="no process could be started: .*Cannot allocate memory"):
        run_apart(sleep, Path("nowhere"), progress=lambda done: None)
