"""Numbers of the processor's that a device needs."""

from functools import lru_cache

import torch


# A graph (`fit.replay`) reads those that were there when it was made, for no more steps than there is room.
@lru_cache(maxsize=1024)
def constant_on(device: torch.device, values: tuple, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    """A tensor of (nested tuples of) numbers on a device; it is kept, and not to be changed."""
    return torch.tensor(values, dtype=dtype, device=device)


def sent(tensor: torch.Tensor, device: torch.device | str) -> torch.Tensor:
    """A tensor of the processor's on a device, without waiting where that is safe.

    CUDA has taken over what lies in ordinary memory when it is told to go on; Metal may read it later, when
    it is something else.
    """
    return tensor.to(device, non_blocking=torch.device(device).type == "cuda")
