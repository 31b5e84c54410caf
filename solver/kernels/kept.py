"""What numba keeps on disk of the CPU's kernels, and whether that is of their sources as they are now.

numba compares a kernel's own file with what it was, not the files of what it calls. So a mark beside what
it keeps says of which sources that is, and of others nothing is left to be found.
"""

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite.binding
import numba

_PYTHON = f"py{sys.version_info.major}{sys.version_info.minor}"
"""as numba has it in the names of its files"""
ALL, SOME = "all", "some"
"""of the kernels are kept"""


@cache
def sources() -> str:
    """A hash of the kernels' files, as they were when this process first asked."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    parts = [f"{file.name} {file.stat().st_size} {file.stat().st_mtime_ns}" for file in files]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def forget_outdated() -> None:
    """Leave numba nothing of kernels that may call what is another now; another Python has its own."""
    if _marked()[:1] == [sources()]:
        return
    for file in folder().glob(f"*_numba.*.{_PYTHON}*.nb[ci]"):
        with suppress(OSError):  # somebody has it open
            file.unlink()
    mark(SOME)


def is_complete() -> bool:
    """True if all kernels were kept once, of the sources as they are."""
    return _marked() == [sources(), ALL]


def mark(what: str) -> None:
    """Say of which sources `ALL` or `SOME` kernels are kept."""
    with suppress(OSError):  # a full disk, say: the next process looks once more
        os.makedirs(folder(), exist_ok=True)
        _mark().write_text(f"{sources()} {what}", encoding="utf-8")


def folder() -> Path:
    """Where numba keeps our kernels: beside them, or elsewhere if that may not be written."""
    from .vm_numba import vm_sum

    return Path(vm_sum.stats.cache_path)


def _mark() -> Path:
    # numba keeps those of different processors side by side.
    what = f"{numba.__version__} {llvmlite.binding.get_host_cpu_name()}"
    return folder() / f"kernels-{_PYTHON}-{what.replace(' ', '-')}"


def _marked() -> list[str]:
    try:
        return _mark().read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError):
        return []
