"""How many threads there may be, and how they wait."""

import os


def let_idle_threads_sleep() -> None:
    """Idle OpenMP threads sleep instead of spinning, unless the person set it otherwise.

    Call before torch and numba are imported: their OpenMP runtimes read this once.

    torch and numba bring an OpenMP runtime each. Threads of one that spin while they wait take the
    cores from the other, and from Blender: with two fits at once on two cores, a step took five
    times as long.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "0")


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
