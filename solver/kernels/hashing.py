"""Uniform numbers as a hash of integers: the same on every device, in any order, in any batch.

Three rounds of Wellons' 32-bit hash "lowbias32" (https://nullprogram.com/blog/2018/07/31/) over
seed, the key's upper and its lower half. Good enough for sampling; not for secrets.
"""

from __future__ import annotations

import numba
import numpy as np
import torch

from .backend import on_numba

_MASK = 0xFFFFFFFF
_TO_UNIT = 1.0 / (1 << 24)


def uniform(keys: torch.Tensor, seed: int, columns: int) -> torch.Tensor:
    """Uniform numbers in [0, 1) [N, columns] float32 of non-negative integer keys [N] long."""
    if on_numba(keys.device):
        out = torch.empty(len(keys), columns)
        _uniform(keys.contiguous().numpy(), seed & _MASK, out.numpy())
        return out
    return uniform_torch(keys, seed, columns)


def uniform_torch(keys: torch.Tensor, seed: int, columns: int) -> torch.Tensor:
    """Plain torch twin of `uniform`: bit for bit the same."""
    column = torch.arange(columns, device=keys.device)
    state = _mix(column + (seed & _MASK))
    state = _mix(state ^ ((keys[:, None] >> 32) & _MASK))
    state = _mix(state ^ (keys[:, None] & _MASK))
    return (state >> 8).to(torch.float32) * _TO_UNIT


def _mix(x: torch.Tensor) -> torch.Tensor:
    x = x & _MASK
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & _MASK
    x = ((x ^ (x >> 15)) * 0x846CA68B) & _MASK
    return x ^ (x >> 16)


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
def _uniform(keys, seed, out):
    for n in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[n, column] = unit_number(keys[n], seed + column)
