"""What changes over a fit, as functions of the fraction of it that is done."""

import dataclasses
import math

from ..render.image import image_settings
from ..render.scene import RenderSettings
from .settings import FieldSettings, FitSettings, LightSettings, Settings

PROBE_TURNS = 20
"""how often in a fit probes look around anew"""
EARLY_TURNS = 10.0
"""how much more often in its beginning, when the surface still moves"""
LEAST_ROWS = 8
"""rows of a map of the light, in widths of what it is blurred by"""


def probe_turn(fraction: float) -> int:
    """How often probes are to have been renewed by a fraction of the fit, less one."""
    return int(PROBE_TURNS * math.log1p(EARLY_TURNS * fraction) / math.log1p(EARLY_TURNS))


def smoothing_width(field: FieldSettings, fraction: float) -> float:
    """The normals' smoothing at a fraction of the fit, as a share of the box's edge.

    Wide first, so that a bumpy hull reflects like the shape it stands for.
    """
    return _between(field.smoothing, fraction)


def step_width(field: FieldSettings, fraction: float) -> float:
    """The smoothing of the density's steps at a fraction of the fit, as a share of the box's edge."""
    return _between(field.step_smoothing, fraction)


def steepness(field: FieldSettings, fraction: float) -> float:
    """How many times as steep as at first the density is at a fraction of the fit."""
    return field.steepening ** (1 - _left_of_fade(field.steepening_span, fraction))


def light_step_width(light: LightSettings, height: int, fraction: float) -> float:
    """The smoothing of the steps of a light of `height` rows at a fraction of the fit, texels; at its end
    it is a tenth of the first."""
    if fraction >= light.step_smoothing_end:
        return 0.0
    widest = blur_width(light.step_smoothing, height)
    return widest * 0.1 ** (fraction / light.step_smoothing_end)


def blur_width(texels: float, height: int) -> float:
    """What a map of the light of `height` rows is blurred by, texels: a small one not around itself."""
    return min(texels, height / LEAST_ROWS)


def _between(ends: tuple[float, float], fraction: float) -> float:
    first, last = ends
    if min(first, last) <= 0:
        return first + (last - first) * fraction
    return last * (first / last) ** (1 - fraction)


def neural_share(fit: FitSettings, fraction: float) -> float:
    """Share of g at a fraction of the fit; at 1, what the finished field is to be rendered with."""
    return fit.neural_start * _left_of_fade(fit.neural_fade, fraction)


def emission_share(fit: FitSettings, fraction: float) -> float:
    """Share of emission of a fit that started as a fog."""
    return _left_of_fade(fit.emission_fade, fraction) if fit.emission_fade[1] > 0 else 0.0


def _left_of_fade(ends: tuple[float, float], fraction: float) -> float:
    """What is left at a fraction of the fit of what is blended out between two: from 1 to 0."""
    first, last = ends
    return 1 - min(max((fraction - first) / max(last - first, 1e-6), 0), 1)


def pixel_grid(settings: Settings, fraction: float) -> int:
    """Primary rays through a pixel at a fraction of the fit, across or down."""
    return settings.render.pixel_grid if fraction >= settings.fit.pixel_grid_start else 1


def picture_settings(
    settings: Settings, rays: int = 64, fraction: float = 1.0, neural: float | None = None,
    emission: float = 0.0,
) -> RenderSettings:  # fmt: skip
    """Render settings of whole pictures at a fraction of the fit.

    Args:
        rays: secondary rays a pixel.
        neural: share of the neural term; None: as it is at that fraction.
        emission: share of emission, which pictures of a fit on its way have (`ChunkLoss.emission`).
    """
    neural = neural_share(settings.fit, fraction) if neural is None else neural
    render = dataclasses.replace(settings.render, pixel_grid=pixel_grid(settings, fraction))
    pictures = image_settings(render, rays, neural)
    return dataclasses.replace(pictures, emission=emission)
