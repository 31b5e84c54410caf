"""Compiling in several processes: all is found again, and nothing of kernels that were other ones."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from solver.kernels import kept
from solver.kernels.compile_ahead import compile_ahead, shared_out
from solver.kernels.warm_up import GROUPS

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
from solver.kernels import compile_ahead, kept, warm_up

class Enough(Exception):
    pass

def names():
    return " ".join(file.name for file in kept.folder().glob("*_numba.*.nbi"))

def stop(done):
    raise Enough

if __name__ == "__main__":
    compile_ahead.GROUPS = {name: warm_up.GROUPS[name] for name in ("choices", "rest")}
    compile_ahead.compile_kernels = lambda device: None  # which would compile all
    told = []
    assert not kept.is_complete() and not names()
    try:
        compile_ahead.compile_ahead("cpu", stop)
        raise SystemExit("nobody was asked whether to go on")
    except Enough:
        assert not kept.is_complete()
    compile_ahead.compile_ahead("cpu", told.append)
    assert "drawing_numba.choose" in names() and "hashing_numba.uniform" in names(), names()
    assert kept.is_complete() and told[-1] == 1.0
    compile_ahead.compile_ahead("cpu", stop)  # there is nothing to do
    kept.mark(kept.SOME)  # as a cancelled one leaves it
    kept.forget_outdated()
    assert names() and not kept.is_complete()
    others = kept.folder() / "vm_numba.vm_sum-1.py27.nbi"
    others.touch()
    kept.sources = lambda: "what a kernel calls is another now"
    assert not kept.is_complete()
    kept.forget_outdated()
    assert names() == others.name and not kept.is_complete()
    print("all is well")
"""


def test_kernels_are_compiled_side_by_side_once_and_anew_when_they_have_changed(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_NUM_THREADS": "2",
        "PYTHONPATH": str(ROOT),
    }  # fmt: skip
    result = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, timeout=600
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "all is well"


def test_on_one_core_it_is_told_what_is_compiled_too(monkeypatch):
    """A fixed bug: for minutes nothing was told."""
    monkeypatch.setattr("numba.get_num_threads", lambda: 1)
    monkeypatch.setattr(kept, "is_complete", lambda: False)
    for name in ("mark", "forget_outdated"):
        monkeypatch.setattr(kept, name, lambda *_: None)
    for name in GROUPS:
        monkeypatch.setitem(GROUPS, name, SimpleNamespace(run=lambda: None))
    monkeypatch.setattr("solver.kernels.compile_ahead.compile_kernels", lambda device: None)
    told = []
    compile_ahead("cpu", told.append)
    assert len(told) == len(GROUPS) and told == sorted(told) and told[-1] == 1


@pytest.mark.parametrize("count", [1, 2, 3, 20])
def test_processes_end_at_about_the_same_time(count):
    seconds = {name: group.seconds for name, group in GROUPS.items()}
    shares = shared_out(seconds, count)
    assert sorted(sum(shares, [])) == sorted(GROUPS) and len(shares) <= count
    longest = max(sum(seconds[name] for name in share) for share in shares)
    assert longest <= max(sum(seconds.values()) / count * 4 / 3, max(seconds.values()))
