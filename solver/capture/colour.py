"""Colour: the curves of sRGB and of HDR video, and primaries other than Rec. 709's.

Matrices act on linear RGB columns. White points are adapted by Bradford's transform, as ICC does.
"""

from collections.abc import Sequence

import numpy as np

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""chromaticities x y of red, green, blue and white; the white is D65"""
_D65 = REC709[6:8]
PRIMARIES = {
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
}
"""chromaticities of Rec. 2020 and Display P3 by their numbers in ITU-T H.273, tables 2 and 3"""
WHITE_D50 = np.array([0.9642, 1.0, 0.8249])
"""XYZ of the white of ICC's connection space"""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_SAME = 1e-3
"""matrices that differ less than that from the identity are roundings of it"""


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Inverse of the sRGB transfer function (IEC 61966-2-1)."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """The sRGB transfer function, without clipping above 1."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def linear_from_hlg(signal: np.ndarray) -> np.ndarray:
    """Light of the scene from hybrid log-gamma [0, 1]; 1 is diffuse white, the brightest is 3.8.

    The inverse of the camera's curve (ITU-R BT.2100-2, table 5); diffuse white is at 75 % (BT.2408).
    """
    return _hlg_scene_light(signal) / _hlg_scene_light(np.float64(0.75))


def linear_from_pq(signal: np.ndarray) -> np.ndarray:
    """Light of the screen from perceptual quantisation [0, 1] (ITU-R BT.2100-2, table 4).

    1 is diffuse white, 203 of the 10,000 cd/m² that there are at most (BT.2408).
    """
    root = np.maximum(signal, 0) ** (32 / 2523)
    share = np.maximum(root - 107 / 128, 0) / (2413 / 128 - 2392 / 128 * root)
    return 10_000 / 203 * share ** (8192 / 1305)


def rec709_from_chromaticities(chromaticities: tuple[float, ...]) -> np.ndarray | None:
    """The matrix [3, 3] to linear Rec. 709, or None if these are its own primaries.

    Args:
        chromaticities: x y of red, green, blue and white, as OpenEXR has them.

    Raises:
        ValueError: no colours have these chromaticities.
    """
    white = np.asarray(chromaticities, dtype=np.float64)[6:8]
    return _beyond_rounding(
        np.linalg.inv(xyz_from_rgb(REC709))
        @ adaptation(_xyz(white), _xyz(_D65))
        @ xyz_from_rgb(chromaticities)
    )


def rec709_from_primaries(number: int | None) -> np.ndarray | None:
    """The matrix [3, 3] from primaries that ITU-T H.273 gives a number to linear Rec. 709, or None if they
    are its own or not known."""
    chromaticities = PRIMARIES.get(number)
    return None if chromaticities is None else rec709_from_chromaticities(chromaticities)


def rec709_from_colorants(colorants: np.ndarray) -> np.ndarray | None:
    """The matrix [3, 3] to linear Rec. 709, or None if these are its own primaries.

    Args:
        colorants: [3, 3] columns XYZ of red, green and blue, adapted to D50 as in an ICC profile.

    Raises:
        ValueError: no colours have these coordinates.
    """
    own = adaptation(_xyz(_D65), WHITE_D50) @ xyz_from_rgb(REC709)
    if not np.isfinite(colorants).all() or abs(np.linalg.det(colorants)) < 1e-6:
        raise ValueError("its primaries span no colours")
    return _beyond_rounding(np.linalg.inv(own) @ colorants)


def xyz_from_rgb(chromaticities: tuple[float, ...]) -> np.ndarray:
    """The matrix [3, 3] from linear RGB to XYZ, with Y = 1 for white.

    Raises:
        ValueError: no colours have these chromaticities.
    """
    values = np.asarray(chromaticities, dtype=np.float64).reshape(4, 2)
    if not np.isfinite(values).all() or np.abs(values).max() > 10 or abs(values[3, 1]) < 1e-3:
        raise ValueError("its chromaticities are impossible")
    primaries = np.stack([values[:3, 0], values[:3, 1], 1 - values[:3].sum(axis=1)])
    if abs(np.linalg.det(primaries)) < 1e-6:
        raise ValueError("its chromaticities are impossible")
    return primaries * np.linalg.solve(primaries, _xyz(values[3]))


def adaptation(white: np.ndarray, new_white: np.ndarray) -> np.ndarray:
    """Bradford's matrix [3, 3] that takes XYZ seen under one white [3] to another."""
    gains = (_BRADFORD @ new_white) / (_BRADFORD @ white)
    return np.linalg.inv(_BRADFORD) @ (gains[:, None] * _BRADFORD)


def _hlg_scene_light(signal: np.ndarray) -> np.ndarray:
    a = 0.17883277
    b, c = 1 - 4 * a, 0.5 - a * np.log(4 * a)
    bright = (np.exp((np.maximum(signal, 0.5) - c) / a) + b) / 12
    return np.where(signal <= 0.5, signal**2 / 3, bright)


def _xyz(white: Sequence[float]) -> np.ndarray:
    """XYZ [3] of chromaticities x y, with Y = 1."""
    x, y = white
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _beyond_rounding(matrix: np.ndarray) -> np.ndarray | None:
    if not np.isfinite(matrix).all():
        raise ValueError("its chromaticities are impossible")
    return None if np.abs(matrix - np.eye(3)).max() < _SAME else matrix
