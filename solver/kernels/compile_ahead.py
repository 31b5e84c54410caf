"""Compile the CPU kernels in several processes, each of which does so with one thread, whatever it has.

numba keeps what it compiled on disk, and finds it again as long as a kernel's own file is as it was. That
what it calls in other files is so, too, is seen to here.
"""

from __future__ import annotations

import hashlib
import os
import platform
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import llvmlite.binding
import numba
import torch

from ..apart import ApartError, run_apart
from . import vm_numba
from .backend import on_numba
from .warm_up import GROUPS, compile_kernels, run_groups

MOST_PROCESSES = 4
"""at once; each takes half a gigabyte"""
_MARK = f"kernels-{platform.python_implementation()}-{platform.python_version()}"


def compile_ahead(device: torch.device | str, progress: Callable[[float], None]) -> None:
    """Have all kernels of a device at hand, compiled now if need be.

    Args:
        progress: told the share of the CPU's kernels that is compiled; what it raises ends that.
    """
    if on_numba(torch.empty(0, device=device).device) and not is_compiled():
        _forget()
        _compile_side_by_side(progress)
    compile_kernels(device)
    _note()


def is_compiled() -> bool:
    """True if numba has all kernels on disk as they are now; it compiles one that is not there."""
    try:
        return _mark().read_text(encoding="utf-8") == _fingerprint()
    except OSError:
        return False


def shared_out(seconds: dict[str, float], count: int) -> list[list[str]]:
    """Names of what takes so many seconds, for `count` processes that are to end at about the same time."""
    shares: list[list[str]] = [[] for _ in range(count)]
    taken = [0.0] * count
    for name in sorted(seconds, key=seconds.get, reverse=True):
        least = taken.index(min(taken))
        shares[least].append(name)
        taken[least] += seconds[name]
    return [share for share in shares if share]


def _compile_side_by_side(progress: Callable[[float], None]) -> None:
    count = min(numba.get_num_threads(), MOST_PROCESSES)
    if count < 2:
        return
    shares = shared_out({name: group.seconds for name, group in GROUPS.items()}, count)
    done, is_over = [0.0] * len(shares), threading.Event()

    def compile_share(index: int) -> None:
        def told(part: float) -> None:
            if is_over.is_set():
                raise ApartError("one of them is not to go on")
            done[index] = part * len(shares[index])
            progress(sum(done) / len(GROUPS))

        try:
            run_apart(run_groups, shares[index], progress=told)
        except ApartError:
            pass  # as where memory is short; this process compiles what is missing

    with ThreadPoolExecutor(len(shares)) as pool:
        futures = [pool.submit(compile_share, index) for index in range(len(shares))]
        try:
            for future in futures:
                future.result()
        finally:
            is_over.set()


def _folder() -> Path:
    """Where numba keeps our kernels: beside them, or where they may not be written."""
    return Path(vm_numba.vm_sum.stats.cache_path)


def _mark() -> Path:
    return _folder() / _MARK


def _fingerprint() -> str:
    """What the compiled kernels depend on."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    parts = [f"{file} {file.stat().st_size} {file.stat().st_mtime_ns}" for file in files]
    parts += [numba.__version__, llvmlite.__version__, llvmlite.binding.get_host_cpu_name()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _forget() -> None:
    """Leave numba nothing of kernels that may call what is another now."""
    for file in _folder().glob("*_numba.*.nb[ci]"):
        file.unlink(missing_ok=True)


def _note() -> None:
    try:
        os.makedirs(_folder(), exist_ok=True)
        _mark().write_text(_fingerprint(), encoding="utf-8")
    except OSError:
        pass  # a full disk, say: the next start looks once more
