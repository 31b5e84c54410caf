"""Numpy's arrays for a renderer."""

import numpy as np
import torch
from torch import Tensor


def floats_on(device: torch.device, *arrays: np.ndarray) -> list[Tensor]:
    """Arrays as float32 tensors of a device."""
    return [torch.from_numpy(np.ascontiguousarray(values)).float().to(device) for values in arrays]
