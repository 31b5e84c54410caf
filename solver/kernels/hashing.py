"""Uniform numbers as a hash of integers: the same on every device, in any order, in any batch.

Three rounds of Wellons' 32-bit hash "lowbias32" (https://nullprogram.com/blog/2018/07/31/) over
seed, the key's upper and its lower half. Good enough for sampling; not for secrets.
"""

import torch
from torch import Tensor

from .backend import has_kernels, kernels, on_warp

_MASK = 0xFFFFFFFF
_TO_UNIT = 1.0 / (1 << 24)


Stream = int | Tensor
"""a seed of the hash, 32 bits; where it lies in a card's memory, [1] long"""


def uniform(keys: Tensor, seed: Stream, columns: int) -> Tensor:
    """Uniform numbers in [0, 1) [N, columns] float32 of non-negative integer keys [N] long."""
    if not has_kernels(keys.device):
        return uniform_torch(keys, seed, columns)
    out = torch.empty(len(keys), columns, device=keys.device)
    seed = stream_for(keys.device, seed)
    kernels("hashing", keys.device).uniform(keys.contiguous(), seed, out)
    return out


def stream_for(device: torch.device, seed: Stream) -> Stream:
    """A stream as a device's kernels take it: in memory for those in Warp, else a number."""
    if not on_warp(device):
        return int(seed) & _MASK
    return seed if isinstance(seed, Tensor) else torch.tensor([seed & _MASK], device=device)


def uniform_torch(keys: Tensor, seed: Stream, columns: int) -> Tensor:
    """Plain torch twin of `uniform`: bit for bit the same."""
    column = torch.arange(columns, device=keys.device)
    state = _mix(column + (seed & _MASK))
    state = _mix(state ^ ((keys[:, None] >> 32) & _MASK))
    state = _mix(state ^ (keys[:, None] & _MASK))
    return (state >> 8).to(torch.float32) * _TO_UNIT


def _mix(x: Tensor) -> Tensor:
    x = x & _MASK
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & _MASK
    x = ((x ^ (x >> 15)) * 0x846CA68B) & _MASK
    return x ^ (x >> 16)
