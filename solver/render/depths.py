"""Which of a ray's density samples are shaded, and how what they show becomes what the ray sees."""

from __future__ import annotations

from dataclasses import dataclass

import torch

LEAST_OPACITY = 1e-3
"""rays that are more transparent than this are not shaded"""


@dataclass(frozen=True)
class Depths:
    """K chosen samples of R rays: a ray sees opacity · Σ share · value."""

    index: torch.Tensor  # [K] long, ascending
    ray: torch.Tensor  # [K] long
    share: torch.Tensor  # [K] of the ray's opacity; sums to 1 over a ray
    mass: torch.Tensor  # [K] of the pixel that the sample stands for, no gradient
    opacity: torch.Tensor  # [R]
    slope: torch.Tensor | None = None  # [K] zero, with the gradient of the share's logarithm

    def gather(self, values: torch.Tensor) -> torch.Tensor:
        """What the rays see [R, …], premultiplied, of what the samples show [K, …]."""
        shape = (-1,) + (1,) * (values.dim() - 1)
        rays = len(self.opacity)

        def over_rays(values):
            return values.new_zeros(rays, *values.shape[1:]).index_add(0, self.ray, values)

        seen = over_rays(values * self.share.view(shape))
        if self.slope is not None:
            with torch.no_grad():
                difference = (values - seen[self.ray]) * self.share.view(shape)
            seen = seen + over_rays(difference * self.slope.view(shape))
        return seen * self.opacity.view(shape)


def all_depths(
    weights: torch.Tensor, ray: torch.Tensor, opacity: torch.Tensor, min_weight: float
) -> Depths:
    """All samples [S] heavier than `min_weight`; they make up for the others of their `ray` [S]."""
    index = (weights.detach() > min_weight).nonzero()[:, 0]
    kept, heavy = ray[index], weights[index]
    fixed = heavy.detach()
    total = torch.zeros_like(opacity.detach()).index_add(0, kept, fixed)
    # Weights keep their own gradient; only the scale between heavy and all samples is fixed.
    missing = (opacity.detach() / total.clamp(min=1e-6)).clamp(max=2.0)
    share = heavy * missing[kept] / opacity.detach()[kept].clamp(min=1e-6)
    return Depths(index, kept, share, fixed, opacity.detach())


def random_depths(
    weights: torch.Tensor, offsets: torch.Tensor, ray: torch.Tensor, opacity: torch.Tensor,
    depths: int, u: torch.Tensor,
) -> Depths:  # fmt: skip
    """`depths` samples of every ray, by systematic sampling of its weights.

    A sample of weight w is chosen n times, E[n] = depths · w / opacity, so opacity · Σ n/depths · L
    has the right expectation. So has its gradient: with q = w/opacity, Σ L ∂q = Σ (L − L̄) q ∂ log q
    for any L̄; L̄ is the mean of what the ray's other chosen samples show, which takes nearly all of
    the variance away, since neighbours on a surface look alike. With one depth there is no other one,
    and only the opacity has a gradient.

    Args:
        weights: [S] in flat form; those of ray r are `offsets[r]:offsets[r + 1]`.
        opacity: [R], their sum. u: [R] uniform in [0, 1).
    """
    with torch.no_grad():
        fixed, total = weights.detach().double(), opacity.detach()
        running = torch.nn.functional.pad(fixed.cumsum(0), (1, 0))
        start, end = running[offsets[:-1]], running[offsets[1:]]
        scale = torch.where(total > LEAST_OPACITY, depths / (end - start).clamp(min=1e-12), 0.0)
        below = ((running[:-1] - start[ray]) * scale[ray] + u[ray]).floor()
        above = ((running[1:] - start[ray]) * scale[ray] + u[ray]).floor()
        times = above - below
        index = (times > 0).nonzero()[:, 0]
        chosen = ray[index]
        share = (times[index] / depths).float()
        mass = share * total[chosen]
    slope = None
    if depths > 1:
        logarithm = weights[index].clamp(min=1e-12).log() - opacity[chosen].clamp(min=1e-12).log()
        slope = (logarithm - logarithm.detach()) * (depths / (depths - 1))
    return Depths(index, chosen, share, mass, opacity, slope)
