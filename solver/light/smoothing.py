"""Blurs on the light's map: of its steps, and of what photos leave open of it."""

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from ..field.smoothing import LEAST_STEP_SIGMA, gaussian
from ..kernels.backend import fast_on_numba, kernels
from ..kernels.sending import sent
from .environment import EnvironmentMap

LEAST_RADIANCE = 1e-30
"""as dark as a light gets, so that its logarithm stays a number"""


def map_smoothing(sigma: float) -> Callable[[Tensor], Tensor] | None:
    """What blurs a map [C, H, 2H], or a change of one, by a Gaussian of `sigma` texels, around its seam and
    up to its poles, without gradient; None below a third.

    Rough reflections tell only what light is in the mean. Adam's steps are as large for each texel, so that
    the rectangles of the first rays stay in it as a woven pattern (docs/decisions/0035).
    """
    if sigma < LEAST_STEP_SIGMA:
        return None
    taps = gaussian(sigma)
    return lambda change: _blurred(change, taps)


@torch.no_grad()
def _blurred(maps: Tensor, taps: Tensor) -> Tensor:
    """Maps [C, H, 2H] with odd, symmetric taps along both axes."""
    if fast_on_numba(maps):
        out = torch.empty_like(maps, memory_format=torch.contiguous_format)
        kernels("map_blur", maps.device).blur(maps.contiguous(), taps, out)
        return out
    reach, kernel = len(taps) // 2, sent(taps, maps.device)
    values = F.pad(maps[:, None], (reach, reach, 0, 0), mode="circular")
    values = F.pad(F.conv2d(values, kernel.view(1, 1, 1, -1)), (0, 0, reach, reach), mode="replicate")
    return F.conv2d(values, kernel.view(1, 1, -1, 1))[:, 0]


@torch.no_grad()
def draw_together(light: EnvironmentMap, sigma: float, share: Tensor) -> None:
    """Move the logarithm of a light, in place, by a share of its way to its blur by `sigma` texels, and
    keep the energy around each texel, which a mean of logarithms would lower.

    Args:
        share: [H, 2H], or of no shape; from 0, nothing, to 1, all the way.
    """
    smooth = map_smoothing(sigma)
    if smooth is None:
        return

    def around() -> Tensor:
        return smooth(light.radiance()).clamp(min=LEAST_RADIANCE)

    logarithm = light.log_radiance.detach()
    before = around()
    logarithm.lerp_(smooth(logarithm), share.expand_as(logarithm))
    logarithm.add_((before / around()).log())


@torch.no_grad()
def draw_colours_together(light: EnvironmentMap, sigma: float, share: Tensor) -> None:
    """Move the colours of a light, in place, by a share of their way to the colour of the energy within
    `sigma` texels around. The brightness of each texel, the mean of its channels, stays, and so does the
    energy of each channel around: halfway between logarithms there would be less of the rarer colours.

    Args:
        share: see `draw_together`.
    """
    smooth = map_smoothing(sigma)
    if smooth is None:
        return
    radiance = light.radiance().clamp(min=LEAST_RADIANCE)
    around = smooth(radiance).clamp(min=LEAST_RADIANCE)
    brightness = radiance.mean(0, keepdim=True)
    colour, wanted = (r / r.mean(0, keepdim=True) for r in (radiance, around))
    drawn = brightness * colour.lerp(wanted, share.expand_as(colour))
    light.log_radiance.copy_(drawn.clamp(min=LEAST_RADIANCE).log())
