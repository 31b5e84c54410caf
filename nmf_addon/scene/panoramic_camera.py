"""Panoramas as Blender's own panoramic cameras (type Panoramic, Equirectangular), and back.

Their picture's middle is where the camera looks, longitudes run to the right and latitudes up, rad
(Cycles' camera/projection.h, `equirectangular_range_to_direction`; a test compares renders). Blender's
viewport shows such a camera as a perspective one, so no photo belongs behind it.
"""

import bpy

from ...solver.capture.camera import Camera
from ...solver.capture.errors import CaptureError
from ...solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere, shows_whole_sphere

PANORAMIC_TYPE = "PANO"
_SAME = 1e-5
"""of a picture's side by which it shows all directions; Blender keeps single precision"""


def make_panoramic(data: bpy.types.Camera, camera: Camera) -> None:
    """Let a camera show what a panorama does; before 5.0, without Cycles, Blender has no kinds of them."""
    data.type = PANORAMIC_TYPE
    settings = _settings_of(data)
    if settings is not None:
        settings.panorama_type = EQUIRECTANGULAR.upper()
        settings.longitude_min = -camera.cx / camera.fx
        settings.longitude_max = (camera.width - camera.cx) / camera.fx
        settings.latitude_min = (camera.cy - camera.height) / camera.fy
        settings.latitude_max = camera.cy / camera.fy


def panorama_of(data: bpy.types.Camera, width: int, height: int) -> dict[str, float | str | tuple]:
    """The fields of the solver's `Camera` that tell of a panoramic camera's lens, for a photo of a size.

    Raises:
        CaptureError: it is no panorama of longitudes and latitudes, or one of none.
    """
    settings = _settings_of(data)
    kind = None if settings is None else settings.panorama_type
    if kind != EQUIRECTANGULAR.upper():
        raise CaptureError(
            data.name, "panorama type", f"panoramas of the type {kind or 'unknown'} are not supported",
            "set its panorama type to Equirectangular, if that is how its photo was taken (with Cycles "
            "enabled)",
        )  # fmt: skip
    across = settings.longitude_max - settings.longitude_min
    down = settings.latitude_max - settings.latitude_min
    if min(across, down) <= 0:
        raise CaptureError(
            data.name, "longitude, latitude", "the panorama's minimum is not below its maximum",
            "set its longitudes and latitudes to those that the photo shows",
        )  # fmt: skip
    fx, fy = width / across, height / down
    lens = fx, fy, -settings.longitude_min * fx, settings.latitude_max * fy
    if shows_whole_sphere(width, height, *lens, share=_SAME):
        lens = of_whole_sphere(width, height)
    named = dict(zip(("fx", "fy", "cx", "cy"), lens, strict=True))
    return {**named, "lens": EQUIRECTANGULAR, "distortion": ()}


def _settings_of(data: bpy.types.Camera) -> bpy.types.bpy_struct | None:
    """Where a camera has its kind of panorama: itself since Blender 5.0, Cycles' settings before."""
    return data if hasattr(data, "panorama_type") else getattr(data, "cycles", None)
