"""Low-discrepancy points for the secondary rays: Owen-scrambled Sobol, turned for each primary ray.

All numbers are functions of (seed, step, purpose, key), where the key names a pixel or a sample
along its ray. So an image does not depend on how its pixels are batched, nor on the device.
"""

import copy

import torch
from torch import Tensor

from ..kernels.hashing import uniform
from ..kernels.march import MOST_SAMPLES
from ..kernels.sending import sent

OFFSET, ALLOCATION, ROTATION, NEIGHBOUR, SECONDARY_OFFSET, CHOICE = range(6)
DEPTH, SECONDARY_DEPTH, ROOM_OFFSET, ROOM_DIRECTION = range(6, 10)
PURPOSES = 10


class RandomNumbers:
    """Random numbers of one rendering; `at` makes those of an optimisation step."""

    def __init__(self, seed: int, device: torch.device | str = "cpu", points: int = 1 << 16):
        engine = torch.quasirandom.SobolEngine(2, scramble=True, seed=seed)
        self.points = engine.draw(points).to(device)
        self.seed = seed
        self._streams = self.streams_at(0)

    def uniform(self, purpose: int, keys: Tensor, columns: int = 1) -> Tensor:
        """Independent uniform numbers in [0, 1) of keys [N]: [N], or [N, columns]."""
        values = uniform(keys, self.stream(purpose), columns)
        return values[:, 0] if columns == 1 else values

    def at(self, step: int) -> "RandomNumbers":
        """Those of a step."""
        return self.of(self.streams_at(step))

    def of(self, streams: Tensor) -> "RandomNumbers":
        """Those of streams for all purposes [PURPOSES], which may be another step's when they are drawn."""
        other = copy.copy(self)
        other._streams = streams
        return other

    def streams_at(self, step: int) -> Tensor:
        """The hash's seeds for all purposes at a step [PURPOSES] long, where its kernels look for them."""
        # Odd multipliers keep seeds, steps and purposes apart before they are hashed.
        mixed = self.seed * 0x9E3779B1 + step * 0x85EBCA77
        seeds = [(mixed + purpose * 0xC2B2AE3D) & 0xFFFFFFFF for purpose in range(PURPOSES)]
        return sent(torch.tensor(seeds), self.points.device)

    def stream(self, purpose: int) -> Tensor:
        """The hash's seed for the numbers of a purpose."""
        return self._streams[purpose : purpose + 1]


def sample_keys(ray_keys: Tensor, ray: Tensor, index: Tensor, offsets: Tensor) -> Tensor:
    """Keys [K] of samples at indices `index` [K] of a flat form, on rays `ray` [K], from those of
    the rays [R]."""
    return ray_keys[ray] * MOST_SAMPLES + (index - offsets[ray])
