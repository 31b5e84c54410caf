"""Panoramas as Blender's own panoramic cameras (type Panoramic, Equirectangular), and back.

Their picture's middle is where the camera looks, longitudes run to the right and latitudes up, rad
(Cycles' camera/projection.h, `equirectangular_range_to_direction`; a test compares renders). Blender's
viewport shows such a camera as a perspective one, so no photo belongs behind it.
"""

from __future__ import annotations

import math

import bpy

from ...solver.capture.errors import CaptureError
from ...solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere

PANORAMIC_TYPE = "PANO"
_SAME = 1e-4  # rad; Blender keeps single precision
_RANGES = {
    "longitude_min": -math.pi, "longitude_max": math.pi,
    "latitude_min": -math.pi / 2, "latitude_max": math.pi / 2,
}  # fmt: skip


def make_panoramic(data: bpy.types.Camera) -> None:
    """Let a camera show all directions; a Blender before 5.0 without Cycles has no kinds of panoramas."""
    data.type = PANORAMIC_TYPE
    settings = _settings_of(data)
    if settings is not None:
        settings.panorama_type = EQUIRECTANGULAR.upper()
        for name, value in _RANGES.items():
            setattr(settings, name, value)


def panorama_of(data: bpy.types.Camera, width: int, height: int) -> dict[str, float | str | tuple]:
    """The fields of the solver's `Camera` that tell of a panoramic camera's lens, for a photo of a size.

    Raises:
        CaptureError: it does not show all directions by their longitudes and latitudes.
    """
    settings = _settings_of(data)
    kind = None if settings is None else settings.panorama_type
    if kind != EQUIRECTANGULAR.upper():
        raise CaptureError(
            data.name, "panorama type", f"a panorama of the type {kind or 'unknown'} is not understood",
            "set its panorama type to Equirectangular, if that is how its photo was taken (with Cycles "
            "enabled)",
        )  # fmt: skip
    if any(abs(getattr(settings, name) - value) > _SAME for name, value in _RANGES.items()):
        raise CaptureError(
            data.name, "latitude, longitude", "the panorama does not show all directions",
            "set its latitudes to ±90° and its longitudes to ±180°, and use photos of all around",
        )  # fmt: skip
    lens = dict(zip(("fx", "fy", "cx", "cy"), of_whole_sphere(width, height), strict=True))
    return {**lens, "lens": EQUIRECTANGULAR, "distortion": ()}


def _settings_of(data: bpy.types.Camera) -> bpy.types.bpy_struct | None:
    """Where a camera has its kind of panorama: itself since Blender 5.0, Cycles' settings before."""
    return data if hasattr(data, "panorama_type") else getattr(data, "cycles", None)
