"""The command line as tests run it, and a reconstruction that is as small as can be."""

import argparse
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DUCK = ROOT / "samples" / "duck"
MANUAL = (ROOT / "docs" / "manual.md").read_text(encoding="utf-8")
TINY = [
    "--set", "fit.steps=24", "--set", "fit.rays=128", "--set", "field.sizes=24,32",
    "--set", "field.size_starts=0,0.5", "--set", "light.heights=16,32",
    "--set", "field.hull_cells=48", "--set", "field.occupancy_cells=32", "--set", "asset.cells=48",
    "--set", "asset.triangles=2000", "--set", "asset.texture_size=128",
    "--set", "fit.checkpoint_every=0.5", "--set", "render.secondary_rays=4",
]  # fmt: skip


def solver(*arguments, **options):
    command = [sys.executable, "-m", "solver", *map(str, arguments)]
    return subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=600,
        **options,
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
