"""How the CPU kernels are compiled: to fast arithmetic, and without a way out of loops.

A division by zero is what it is in numpy. Python's check is an exit from each loop that divides, and loops
with exits are not vectorised. What a kernel calls is compiled once for all its callers, so all have to be
compiled alike.
"""

import numba

_ARITHMETIC = {"fastmath": True, "error_model": "numpy"}

kernel = numba.njit(parallel=True, cache=True, nogil=True, **_ARITHMETIC)
"""decorates what Python calls and threads may share"""
serial_kernel = numba.njit(cache=True, nogil=True, **_ARITHMETIC)
"""decorates what Python calls and one thread does"""
function = numba.njit(nogil=True, **_ARITHMETIC)
"""decorates what kernels call"""
inlined = numba.njit(inline="always", **_ARITHMETIC)
"""decorates what is put into kernels where they call it, before the compiler sees them"""
