"""Compile the CPU kernels in several processes, each of which does so with one thread, whatever it has."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import numba
import torch

from ..apart import ApartError, run_apart
from . import kept
from .backend import on_numba
from .warm_up import GROUPS, compile_kernels, run_groups

MOST_PROCESSES = 4
"""at once; each takes half a gigabyte"""
TURN = 0.2
"""seconds after which Ctrl-C is heard, where it does not interrupt a wait"""


def compile_ahead(device: torch.device | str, progress: Callable[[float], None]) -> None:
    """Have all kernels of a device at hand, compiled now if need be.

    Args:
        progress: told the share of the CPU's kernels that is compiled; what it raises ends that.
    """
    if not on_numba(torch.empty(0, device=device).device):
        compile_kernels(device)
        return
    kept.forget_outdated()
    if not kept.is_complete():
        _compile_side_by_side(progress)
    compile_kernels(device)
    kept.mark(kept.ALL)


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
        run_groups(list(GROUPS), progress)
        return
    shares = shared_out({name: group.seconds for name, group in GROUPS.items()}, count)
    done, is_over = [0.0] * len(shares), threading.Event()

    def compile_share(index: int) -> None:
        def told(part: float) -> None:
            if is_over.is_set():
                raise ApartError("another is not to go on")
            done[index] = part * len(shares[index])
            progress(sum(done) / len(GROUPS))

        try:
            run_apart(run_groups, shares[index], progress=told)
        except ApartError:
            pass  # as where memory is short; this process compiles what is missing
        except Exception:
            is_over.set()
            raise

    with ThreadPoolExecutor(len(shares)) as pool:
        futures = [pool.submit(compile_share, index) for index in range(len(shares))]
        try:
            while wait(futures, TURN).not_done:
                continue
        finally:
            is_over.set()
        for future in futures:
            future.result()
