"""How threads wait. Call before torch and numba are imported: their OpenMP runtimes read this once."""

import os


def let_idle_threads_sleep() -> None:
    """Idle OpenMP threads sleep instead of spinning, unless the person set it otherwise.

    torch and numba bring an OpenMP runtime each. Threads of one that spin while they wait take the
    cores from the other, and from Blender: with two fits at once on two cores, a step took five
    times as long.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "0")
