"""Numbers that a device needs again and again, sent there once."""

from __future__ import annotations

from functools import lru_cache

import torch


@lru_cache(maxsize=64)
def constant_on(
    device: torch.device, values: tuple, dtype: torch.dtype = torch.float32
) -> torch.Tensor:
    """A tensor of (nested tuples of) numbers on a device; it is kept, and not to be changed."""
    return torch.tensor(values, dtype=dtype, device=device)
