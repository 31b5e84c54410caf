"""Exposure and white balance of each photo, found along with the rest where a person asks for it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ..asset.photo_detail import View
from ..capture.camera import Camera
from ..capture.photos import Photo
from ..metrics.scale import LeastSquaresFactor
from ..render.image import RenderedView
from .adam import Adam, beginning_with
from .chunk import SURROUNDED
from .losses import SATURATED

CHANNELS = {"gain": 1, "white_balance": 3}
RATE = 0.01  # of the logarithms, at the start of the fit
PULL = 1e-3  # of (log gain)²: what photos do not tell stays as it was shot


class Exposures:
    """A gain for each photo, by which radiance is multiplied before it is compared with the photo.

    Their product over all photos is held at 1, so that it cannot trade places with the light.

    Args:
        photos: how many. channels: 1 (exposure) or 3 (white balance as well).
    """

    def __init__(self, photos: int, channels: int, device="cpu"):
        self.log_gain = torch.zeros(photos, channels, device=device)
        self.log_gain.requires_grad_()
        self.optimiser = Adam([{"params": [self.log_gain], "base": RATE}])

    def step(self, gradients: list[Tensor | None], factor: float) -> None:
        """Move by the sum of the chunks' gradients [P, C]; `factor` scales the rate."""
        found = [gradient for gradient in gradients if gradient is not None]
        if not found:
            return
        self.optimiser.param_groups[0]["lr"] = RATE * factor
        seen = (sum(found) != 0).any(-1, keepdim=True)
        self.log_gain.grad = sum(found) + torch.where(seen, 2 * PULL * self.log_gain.detach(), 0.0)
        self.optimiser.step()
        with torch.no_grad():
            self.log_gain -= self.log_gain.mean(0)

    def state(self) -> dict[str, Tensor]:
        """For a checkpoint."""
        return {"log_gain": self.log_gain.detach()} | {
            f"optimiser.{key}": value for key, value in self.optimiser.state().items()
        }

    def restore(self, tensors: dict[str, Tensor]) -> None:
        with torch.no_grad():
            self.log_gain.copy_(tensors["log_gain"])
        self.optimiser.restore(beginning_with("optimiser.", tensors))


def photo_views(cameras: Sequence[Camera], photos: Sequence[Photo], log_gain: Tensor | None) -> list[View]:
    """Photos as the asset looks at them, of cameras in the scene's world.

    Args:
        log_gain: [P, 1 or 3] logarithms of the photos' exposures; None: all are alike.
    """
    gains = np.ones((len(photos), 3)) if log_gain is None else log_gain.exp().cpu().numpy()
    return [
        View(camera, _of_what_counts(photo), photo.is_hdr, gain)
        for camera, photo, gain in zip(cameras, photos, gains, strict=True)
    ]


def _of_what_counts(photo: Photo) -> np.ndarray:
    """Pixels [H, W, 4], nothing at all where the photo says nothing."""
    return photo.pixels if photo.told is None else photo.pixels * photo.told[..., None]


def brought_to(view: RenderedView, photo: Photo, background: str, kind: str) -> RenderedView:
    """A view at the exposure of a photo, by least squares where the photo is not saturated.

    Args:
        background: with one of `SURROUNDED` the photo shows that, too.
        kind: `fit.exposure`; 'fixed' leaves the view as it is.
    """
    if kind == "fixed":
        return view
    shown = view.surrounded if background in SURROUNDED else view.radiance
    told = (photo.pixels[..., :3] < SATURATED).all(-1) & (photo.cover > 0.5)
    factor = LeastSquaresFactor()
    factor.add(shown, photo.pixels[..., :3], told.astype(np.float64))
    gain = factor.value if kind == "white_balance" else factor.common
    return dataclasses.replace(view, radiance=view.radiance * gain, surrounded=view.surrounded * gain)


def exposures_for(kind: str, photos: int, device="cpu") -> Exposures | None:
    """What `fit.exposure` asks for; None for 'fixed'."""
    if kind == "fixed":
        return None
    return Exposures(photos, CHANNELS[kind], device)
