"""Ctrl-C and SIGTERM are a cancel, whenever they come and whatever they meet."""

import os
import signal
import subprocess
import sys

import pytest

from solver.job.status import read_status
from tests.cli.command import ROOT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="a child cannot be sent Ctrl-C alone")


def listens():
    """In a child: who runs the tests in the background of a shell has Ctrl-C ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def run(script, prepare=listens):
    return subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60,
        preexec_fn=prepare,
    )  # fmt: skip


MEETS = {
    "a module that is loading": "raise ImportError('initialization failed') from None",
    "an error that is explained": "raise MemoryError from None",
    "nothing": "raise",
    "the end of the work": "return 0",
}


@pytest.mark.parametrize("what", MEETS)
@pytest.mark.parametrize("made_from_text", [False, True])
def test_ctrl_c_is_a_cancel_whatever_it_meets(what, made_from_text):
    press = "os.kill(os.getpid(), signal.SIGINT); time.sleep(5)"
    script = f"""
import os, signal, sys, time
import solver.cli, solver.start
press = lambda: exec({press!r}) if {made_from_text} else [os.kill(os.getpid(), signal.SIGINT), time.sleep(5)]
def run(options):
    try:
        press()
    except KeyboardInterrupt:
        {MEETS[what]}
solver.cli._doctor = run
sys.argv = ["solver", "doctor"]
sys.exit(solver.start.start())
"""
    done = run(script)
    assert done.returncode == 3 and "Traceback" not in done.stderr, done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "module", ["solver.cameras", "numpy", "torch._opaque_base", "solver.preflight.check"]
)
def test_a_signal_while_modules_load_is_a_cancel(module, number, duck):
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "solver", "check", str(duck)], cwd=ROOT,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=listens,
    )  # fmt: skip
    for line in process.stderr:
        if line.rpartition("|")[2].strip() == module:
            break
    process.send_signal(number)
    errors = process.communicate(timeout=60)[1]
    assert process.returncode == 3 and "Traceback" not in errors and "Cancelled." in errors, errors


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_a_loading_module_would_pass_over_is_a_cancel(tmp_path, number):
    """A fixed bug: who pressed Ctrl-C in the wrong moment waited for the whole run, which then was none."""
    (tmp_path / "passes_over.py").write_text(
        f"import os, time\ntry:\n    os.kill(os.getpid(), {int(number)})\n    time.sleep(5)\n"
        "except BaseException:\n    pass\n"
    )
    script = f"""
import sys
import solver.cli, solver.start
sys.path.insert(0, {str(tmp_path)!r})
def run(options):
    import passes_over
    print("went on", flush=True)
    return 0
solver.cli._doctor = run
sys.argv = ["solver", "doctor"]
sys.exit(solver.start.start())
"""
    done = run(script)
    assert done.returncode == 3 and not done.stdout and done.stderr == "Cancelled.\n", done


def test_ctrl_c_after_the_work_changes_nothing():
    script = """
import atexit, os, signal, sys
import solver.cli, solver.start
solver.cli._doctor = lambda options: 0
sys.argv = ["solver", "doctor"]
code = solver.start.start()
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.exit(code)
"""
    done = run(script)
    assert done.returncode == 0 and not done.stderr, done.stderr


def test_ctrl_c_that_a_shell_had_ignored_stays_so():
    script = """
import os, signal
from solver.interrupts import listen
listen()
os.kill(os.getpid(), signal.SIGINT)
"""
    assert run(script, lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)).returncode == 0


def test_ctrl_c_is_a_cancel_also_if_it_took_the_reader_of_the_output():
    script = """
import os, signal, sys, time
import solver.cli, solver.start
def run(options):
    sys.stdout = open(os.dup(1), "w")
    sys.stdout.write("half a line")
    os.close(sys.stdout.fileno())
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5)
solver.cli._doctor = run
sys.argv = ["solver", "doctor"]
sys.exit(solver.start.start())
"""
    done = run(script)
    assert done.returncode == 3 and "Traceback" not in done.stderr, done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["telling the result", "telling the state", "printing"])
def test_a_signal_once_a_job_is_done_changes_nothing(tmp_path, moment, number):
    """A fixed bug: for some milliseconds it made the code that of a cancel, and the state stayed done."""
    script = f"""
import os, sys
import solver.cli, solver.start
from solver.fit import reconstruct
from solver.job.events import EventStream
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from solver.job.status import Heartbeat
def pressing(moment, work):
    def pressed(*arguments, **named):
        if {moment!r} == moment and arguments[-1] in ("result", "done", "the manifest"):
            for _ in range(3):
                os.kill(os.getpid(), {int(number)})
        return work(*arguments, **named)
    return pressed
reconstruct.run_job = lambda *arguments: "the manifest"
EventStream.emit = pressing("telling the result", EventStream.emit)
Heartbeat.update = pressing("telling the state", Heartbeat.update)
solver.cli.print_result = pressing("printing", solver.cli.print_result)
JobFolder.create({str(tmp_path / "job")!r}, JobRequest("nowhere"))
sys.argv = ["solver", "run", {str(tmp_path / "job")!r}]
sys.exit(solver.start.start())
"""
    done = run(script)
    assert done.returncode == 0 and done.stdout == "the manifest\n" and not done.stderr, done
    assert read_status(tmp_path / "job" / "status.json")["state"] == "done"
