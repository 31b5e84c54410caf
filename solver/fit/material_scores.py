"""Errors of materials against their truth beside photos (docs/metrics.md)."""

from collections.abc import Iterator

import numpy as np

from ..brdf.microfacet import principled_albedo
from ..capture.camera import Camera
from ..metrics.material import weighted_mae
from ..metrics.scale import LeastSquaresFactor
from ..render.image import RenderedView
from .truth import true_albedo_and_f0, true_roughness

BLACK = 1e-3
"""linear; a true albedo that is nowhere above it is none"""
ALBEDOS = {"albedo_mae": principled_albedo, "own_albedo_mae": lambda albedo, f0: albedo}
"""scores of an albedo: of what Principled would have, as its truth is, and of the fit's own"""


class MaterialScores:
    """Errors of materials where their truth lies beside a photo.

    Albedos are known up to one factor per channel for all views, so they are scored when all have been
    taken in; where it is metal all over, none is scored and there is no factor: one of zero would make any
    albedo right.
    """

    def __init__(self):
        self._factors = {name: LeastSquaresFactor() for name in ALBEDOS}
        self._brightest = 0.0
        self._albedos: list[tuple[Camera, dict[str, np.ndarray], np.ndarray]] = []

    def add(self, camera: Camera, view: RenderedView, cover: np.ndarray) -> dict[str, float]:
        """Take in a view, each pixel by its photo's `cover` [H, W]; returns roughness_mae and f0_mae."""
        scores = {}
        roughness, truth = true_roughness(camera), true_albedo_and_f0(camera)
        if roughness is not None:
            scores["roughness_mae"] = weighted_mae(np.sqrt(view.alpha), roughness, cover)
        if truth is not None:
            albedo, f0 = truth
            scores["f0_mae"] = weighted_mae(view.f0, f0, cover)
            # Kept until the last view, so only where the photo shows the object.
            seen = cover > 0
            fitted = {name: term(view.albedo[seen], view.f0[seen]) for name, term in ALBEDOS.items()}
            for name, factor in self._factors.items():
                factor.add(fitted[name], albedo[seen], cover[seen])
            self._brightest = max(self._brightest, float((albedo * cover[..., None]).max()))
            self._albedos.append((camera, fitted, cover))
        return scores

    @property
    def albedo_factor(self) -> np.ndarray | None:
        """The least-squares factor [3] of all views' albedos; None: there is no true albedo."""
        return None if self._brightest < BLACK else self._factors["albedo_mae"].value

    def albedo_errors(self) -> Iterator[tuple[str, dict[str, float]]]:
        """Name and `ALBEDOS` of every view that has a true albedo."""
        if self.albedo_factor is None:
            return
        for camera, fitted, cover in self._albedos:
            seen = cover > 0
            truth = true_albedo_and_f0(camera)[0][seen]
            errors = {
                name: weighted_mae(albedo * self._factors[name].value, truth, cover[seen])
                for name, albedo in fitted.items()
            }
            yield camera.name, errors
