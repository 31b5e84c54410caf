"""A real Blender with the extension installed from its zip, and a stand-in for the solver."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REAL_BLENDER = os.environ.get("NMF_REAL_BLENDER", "")
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "blender")]


def pytest_collection_modifyitems(items):
    """Leave all tests here out where there is no real Blender."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.real_blender)
            if not Path(REAL_BLENDER).is_file():
                item.add_marker(
                    pytest.mark.skip("no real Blender: NMF_REAL_BLENDER is not the path of real-blender.sh")
                )


@pytest.fixture(scope="session")
def screenshots(tmp_path_factory):
    """The folder of screenshots, which stay in NMF_GUI_OUT if that is set."""
    out = Path(os.environ.get("NMF_GUI_OUT") or tmp_path_factory.mktemp("screenshots"))
    out.mkdir(parents=True, exist_ok=True)
    return out


@pytest.fixture(scope="session")
def blender(tmp_path_factory, screenshots):
    """Runs the real Blender with the extension installed, and sees that no Python error is told: a function of
    real-blender.sh's arguments and environment variables; returns what was printed."""
    folder = tmp_path_factory.mktemp("blender")
    program = ["bash", REAL_BLENDER, "--user", str(folder / "user")]
    build = ["--command", "extension", "build", "--source-dir", str(ROOT), "--output-dir"]

    def run(*words, seconds=120, code=0, **variables):
        answer = subprocess.run(
            [*program, *words], capture_output=True, text=True, errors="replace",
            env=run.environment(**variables), timeout=seconds, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        told = answer.stdout + answer.stderr
        assert answer.returncode == code, told[-6000:]
        assert "Traceback" not in told, told[-6000:]
        return told

    def environment(**variables):
        return {
            **os.environ, "RB_BIND": f"{ROOT}:{screenshots}:{folder}", "NMF_GUI_OUT": str(screenshots),
            "NMF_SOLVER_PYTHON": "/usr/bin/python3", "RB_TIMEOUT": "300",
            "NMF_SOLVER_BOOTSTRAP": str(ROOT / "tests" / "blender" / "fake_solver.py"), **variables,
        }  # fmt: skip

    run.program, run.environment = program, environment
    run("headless", "--", *build, str(folder))
    archive = str(next(folder.glob("*.zip")))
    run("extension", "--", "install-file", "--repo", "user_default", "--enable", archive)
    return run


@pytest.fixture(scope="session")
def begin_blender(blender):
    """Starts that Blender in a group of processes of its own, which hears Ctrl-C: a function of the same
    arguments; returns the process, whose stdout has all that is printed."""

    def begin(*words, **variables):
        return subprocess.Popen(
            [*blender.program, *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True,
            env=blender.environment(**variables),
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )  # fmt: skip

    return begin


@pytest.fixture(scope="session")
def in_window(blender, screenshots):
    """Runs a script of this folder in a window of the real Blender: a function of the script's name, the name
    of the last screenshot, and environment variables."""

    def window(script, last_shot, **variables):
        steps = Path(__file__).with_name(script)
        blender("gui", str(steps), str(screenshots / last_shot), seconds=360, **variables)

    return window
