"""What is known of a scene beside its photos: normals, albedo, F0 and roughness of each pixel."""

from pathlib import Path

import numpy as np

from ..brdf.microfacet import DIELECTRIC_F0
from ..capture.camera import Camera
from ..capture.decoding import decode, no_colours
from ..capture.photos import read_exr, read_exr_channels, read_image, srgb_to_linear


def true_normals(camera: Camera) -> np.ndarray | None:
    """World normals [H, W, 3] that lie beside a camera's photo, of any length; None if there are none.

    NAME_normal.exr has them as they are, or as (n + 1)/2: then nothing is negative. NAME_normal.png has
    128 for 0 in 8 bits, as Shiny Blender's (Verbin et al. 2022, doi:10.1109/CVPR52688.2022.00541), and
    32768 in 16.

    Raises:
        CaptureError: it cannot be read.
    """
    path = _beside(camera, "_normal.exr")
    if path.is_file():
        values = read_exr(path)[0]
        return values if (values < -1e-3).any() else values * 2 - 1
    path = path.with_suffix(".png")
    if not path.is_file():
        return None
    decoded = decode(path)
    if decoded.pixels.shape[2] < 3:
        raise no_colours(path, decoded)
    half = (decoded.largest + 1) // 2
    return (decoded.pixels[..., :3].astype(np.float32) - half) / (half - 1)


def true_roughness(camera: Camera) -> np.ndarray | None:
    """Blender's roughness r = √α [H, W]; None if there is none."""
    roughness = _map(camera, "_roughness")
    return None if roughness is None else roughness[..., 0]


def true_albedo_and_f0(camera: Camera) -> tuple[np.ndarray, np.ndarray] | None:
    """Linear [H, W, 3] each, of a base colour b with metalness m: b(1 − m) and 0.04(1 − m) + b·m; None if
    there is no base colour."""
    base = _map(camera, "_albedo")
    if base is None:
        return None
    if _beside(camera, "_albedo.png").is_file():
        base = srgb_to_linear(base)
    base, metallic = base[..., :3], _map(camera, "_metallic")
    metallic = np.zeros_like(base[..., :1]) if metallic is None else metallic[..., :1]
    return base * (1 - metallic), DIELECTRIC_F0 * (1 - metallic) + base * metallic


def _map(camera: Camera, ending: str) -> np.ndarray | None:
    """A truth map [H, W, C] as it is stored, PNG scaled to [0, 1]; None if there is none."""
    path = _beside(camera, f"{ending}.exr")
    if path.is_file():
        return read_exr_channels(path)
    path = path.with_suffix(".png")
    return read_image(path) if path.is_file() else None


def _beside(camera: Camera, ending: str) -> Path:
    return camera.image_path.with_name(camera.image_path.stem + ending)
