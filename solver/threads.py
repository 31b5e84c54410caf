"""How many threads there may be, and how they wait; and in what pages memory comes."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")

MOST_AHEAD = 8


def prepare_runtimes() -> None:
    """What torch and numba read once; call it before they are imported. What the person set stays.

    Idle OpenMP threads sleep instead of spinning. torch and numba bring an OpenMP runtime each. Threads of
    one that spin while they wait take the cores from the other, and from Blender: with two fits at once
    on two cores, a step took five times as long.

    numpy's and scipy's products of matrices, which are small here, stay on one core: OpenBLAS makes them
    three times as slow on two.

    On Linux, torch asks for huge pages for large tensors. Steps look up grids all over; with common pages
    a step takes 1.07 times as long.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "0")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_pool(most: int | None = None) -> ThreadPoolExecutor:
    """A pool of as many threads as there are cores, but no more than `most`."""
    return ThreadPoolExecutor(min(most or usable_cores(), usable_cores()))


def mapped_ahead(
    pool: Executor, function: Callable[[Item], Result], items: Iterable[Item], ahead: int = MOST_AHEAD
) -> Iterator[Result]:
    """Results of a function of items in their order, some of them made `ahead`: not all, which a pool's own
    `map` would, for they may be more than memory holds."""
    under_way: deque[Future[Result]] = deque()
    try:
        for item in items:
            under_way.append(pool.submit(function, item))
            if len(under_way) > ahead:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()
    finally:
        for future in under_way:
            future.cancel()
