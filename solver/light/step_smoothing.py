"""Steps of the light that are smooth on the sphere's map, for the fit's beginning."""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F

from ..field.smoothing import LEAST_STEP_SIGMA, gaussian
from ..kernels.sending import sent


def map_step_smoothing(sigma: float) -> Callable[[torch.Tensor], torch.Tensor] | None:
    """What blurs a change of a map [3, H, 2H] by a Gaussian of `sigma` texels, around its seam and up to
    its poles; None below a third.

    Rough reflections tell only what light is in the mean. Adam's steps are as large for each texel, so that
    the rectangles of the first rays stay in it as a woven pattern (docs/decisions/0035).
    """
    if sigma < LEAST_STEP_SIGMA:
        return None
    taps = gaussian(sigma)
    reach = len(taps) // 2

    def smooth(change: torch.Tensor) -> torch.Tensor:
        kernel = sent(taps, change.device)
        values = F.pad(change[:, None], (reach, reach, 0, 0), mode="circular")
        values = F.pad(
            F.conv2d(values, kernel.view(1, 1, 1, -1)), (0, 0, reach, reach), mode="replicate"
        )
        return F.conv2d(values, kernel.view(1, 1, -1, 1))[:, 0]

    return smooth
