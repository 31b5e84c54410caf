"""Which of a ray's density samples are shaded, and how what they show becomes what the ray sees."""

from dataclasses import dataclass

import torch
from torch import Tensor

from ..kernels.backend import fast_on_numba
from ..kernels.drawing import draw_depths
from ..kernels.flat_form import indices_of
from ..kernels.seen import seen

LEAST_OPACITY = 1e-3
"""rays that are more transparent than this are not shaded"""
LEAST_WEIGHT = 1e-12
"""of what was drawn, for its gradient"""


@dataclass(frozen=True)
class Depths:
    """K chosen samples of R rays: a ray sees opacity · Σ share · value."""

    index: Tensor  # [K] long, ascending
    ray: Tensor  # [K] long
    share: Tensor  # [K] of the ray's opacity; sums to 1 over a ray
    mass: Tensor  # [K] of the pixel that the sample stands for, no gradient
    opacity: Tensor  # [R]
    weights: Tensor | None = None  # [S] they were drawn by; None: shares have a gradient
    others: float = 0.0  # how much a share's gradient of these counts (see `random_depths`)

    def gather(self, values: Tensor) -> Tensor:
        """What the rays see [R, C], premultiplied, of what the samples show [K, C]."""
        if self.weights is not None and fast_on_numba(values):
            return seen(
                values, self.weights.contiguous(), self.opacity, self.index, self.ray, self.share,
                LEAST_WEIGHT, self.others,
            )  # fmt: skip
        rays = len(self.opacity)

        def over_rays(values):
            return values.new_zeros(rays, values.shape[1]).index_add(0, self.ray, values)

        share = self.share[:, None]
        shown = values * share
        mean = over_rays(shown)
        if self.weights is not None and self.others > 0:
            logarithm = _log_of(self.weights, self.index) - _log_of(self.opacity, self.ray)
            slope = (logarithm - logarithm.detach()) * self.others
            with torch.no_grad():
                difference = shown - mean[self.ray] * share
            mean = mean + over_rays(difference * slope[:, None])
        return mean * self.opacity[:, None]


def all_depths(weights: Tensor, ray: Tensor, opacity: Tensor, min_weight: float) -> Depths:
    """All samples [S] heavier than `min_weight`; they make up for the others of their `ray` [S]."""
    index, real = indices_of(weights.detach() > min_weight)
    kept, heavy = ray[index], weights.index_select(0, index)
    if real is not None:
        heavy = heavy * real
    fixed, opacity = heavy.detach(), opacity.detach()
    total = torch.zeros_like(opacity).index_add(0, kept, fixed)
    # Weights keep their own gradient; only the scale between heavy and all samples is fixed.
    missing = (opacity / total.clamp(min=1e-6)).clamp(max=2.0)
    share = heavy * missing[kept] / opacity[kept].clamp(min=1e-6)
    return Depths(index, kept, share, fixed, opacity)


def random_depths(weights: Tensor, offsets: Tensor, opacity: Tensor, u: Tensor) -> Depths:
    """D samples of every ray, drawn independently with probabilities q = weight/opacity.

    A sample that is drawn n times stands for n/D of the opacity, which is right in the mean. So is the
    gradient: Σ L ∂q = Σ (L − L̄) q ∂ log q for any L̄ that knows nothing of the sample; L̄ is the mean of
    what the ray's other samples show, which takes nearly all of the variance away, since neighbours
    on a surface look alike. (Stratified draws would know of each other: measured, twice the
    gradient.) With one draw there are no others, and only the opacity has a gradient.

    Args:
        weights: [S] in flat form; those of ray r are `offsets[r]:offsets[r + 1]`.
        opacity: [R], their sum. u: [R, D] uniform in [0, 1).
    """
    depths = u.shape[1]
    with torch.no_grad():
        index, chosen, times = draw_depths(weights, offsets, opacity, u, LEAST_OPACITY)
        share = times / depths
        mass = share * opacity.detach()[chosen]
    others = depths / (depths - 1) if depths > 1 else 0.0
    return Depths(index, chosen, share, mass, opacity, weights, others)


def _log_of(values: Tensor, index: Tensor) -> Tensor:
    """Logarithms of values [N] at `index` [K]."""
    # Not values[index], whose gradient is slow on a card where an index comes often.
    return values.index_select(0, index).clamp(min=LEAST_WEIGHT).log()
