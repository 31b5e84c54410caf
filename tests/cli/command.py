"""The command line as tests run it, and a reconstruction that is as small as can be."""

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba

from solver.start import start
from tests.conftest import SIDE_BY_SIDE

ROOT = Path(__file__).resolve().parents[2]
DUCK = ROOT / "samples" / "duck"
MANUAL = (ROOT / "docs" / "manual.md").read_text(encoding="utf-8")
TINY = [
    "--set", "fit.steps=24", "--set", "fit.rays=128", "--set", "field.sizes=24,32",
    "--set", "field.size_starts=0,0.5", "--set", "light.heights=16,32",
    "--set", "field.hull_cells=48", "--set", "field.occupancy_cells=32", "--set", "asset.cells=48",
    "--set", "asset.triangles=2000", "--set", "asset.texture_size=128",
    "--set", "fit.checkpoint_every=0.5", "--set", "render.secondary_rays=4",
    "--set", "render.pixel_grid=1", "--set", "field.turn_box=no",
]  # fmt: skip
LOADED = ["solver.cli", "solver.fit.reconstruct", "solver.fit.evaluate", "solver.preflight.check", __name__]
"""what most commands import, which takes longer than what tests have them do"""


def solver(*arguments):
    """The exit code of a command and what it wrote, from a process of its own.

    Where processes can be forked, it is one of those that have the solver's modules loaded already:
    `tests/cli/test_loaded.py` holds them against a Python that has just begun.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return fresh_solver(*arguments)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LOADED)
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in ("stdout", "stderr")]
        process = context.Process(target=_run, args=(list(map(str, arguments)), *files))
        process.start()
        process.join(600)
        if process.exitcode is None:
            process.kill()
            raise TimeoutError(f"python -m solver {' '.join(map(str, arguments))}")
        texts = [file.read_text() for file in files]
    return subprocess.CompletedProcess(arguments, process.exitcode, *texts)


def _run(arguments, out, errors):
    """In a forked process: what `python -m solver` does, its standard streams being a device and two files."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, path in ((1, out), (2, errors)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)
    sys.stderr = open(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    sys.argv = ["solver", *arguments]
    if SIDE_BY_SIDE:
        numba.set_num_threads(1)
    sys.exit(start())


def fresh_solver(*arguments):
    """As `solver`, from a Python that has just begun."""
    command = [sys.executable, "-m", "solver", *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=600
    )


def wait_for(condition, process, seconds=300):
    until = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, f"the solver ended with {process.returncode}"
        assert time.monotonic() < until
        time.sleep(0.05)


def commands_of(parser):
    """The parsers of all commands by their names."""
    (commands,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return commands.choices


def check_help(command):
    """Every option and argument of a parser has a text, and one that can be formatted."""
    silent = [action.dest for action in command._actions if not (action.help or "").strip()]
    assert silent == []
    assert "%(" not in command.format_help()
