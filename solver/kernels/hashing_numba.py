"""The hash on the CPU; `hashing.uniform_torch` is the plain twin."""

import numba
import numpy as np


@numba.njit(inline="always")
def _mix_one(x):
    x = x & 0xFFFFFFFF
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & 0xFFFFFFFF
    x = ((x ^ (x >> 15)) * 0x846CA68B) & 0xFFFFFFFF
    return x ^ (x >> 16)


@numba.njit(inline="always")
def unit_number(key, seed):
    """The number of one key; column c of `uniform` is that of seed + c."""
    state = _mix_one(seed)
    state = _mix_one(state ^ ((key >> 32) & 0xFFFFFFFF))
    state = _mix_one(state ^ (key & 0xFFFFFFFF))
    return np.float32((state >> 8) * (1.0 / 16777216.0))


@numba.njit(cache=True, nogil=True)
def uniform(keys, seed, out):
    """Numbers [N, columns] of keys [N]."""
    for n in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[n, column] = unit_number(keys[n], seed + column)
