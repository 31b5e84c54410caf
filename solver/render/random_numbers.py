"""Low-discrepancy points for the secondary rays: Owen-scrambled Sobol, rotated per sample."""

from __future__ import annotations

import torch


class SobolRotations:
    """The first N points of one scrambled Sobol set, shifted on the torus for every sample.

    The shift covers all of [0, 1)^2 (Cranley & Patterson 1976), so that a sample with one ray is
    unbiased, too. Same seed, same numbers, on every device.
    """

    def __init__(self, seed: int, device: torch.device | str = "cpu", points: int = 1024):
        engine = torch.quasirandom.SobolEngine(2, scramble=True, seed=seed)
        self.points = engine.draw(points).to(device)
        self.generator = torch.Generator(device="cpu").manual_seed(seed)
        self.device = device

    def uniform(self, *shape: int) -> torch.Tensor:
        """Independent uniform numbers in [0, 1)."""
        return torch.rand(*shape, generator=self.generator).to(self.device)

    def draw(self, sample: torch.Tensor, index: torch.Tensor, samples: int) -> torch.Tensor:
        """Points [K, 2] for ray number `index` [K] of sample `sample` [K] out of `samples`."""
        shift = self.uniform(samples, 2)
        points = self.points[index % len(self.points)] + shift[sample]
        return points - points.floor()
