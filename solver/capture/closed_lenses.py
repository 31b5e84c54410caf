"""Lens models with an inverse in closed form: `fov`, `division`, `eucm`, `visualsfm`.

Coordinates, NaN and masks are as in `lenses`; distances from the axis are r (ideal) and d (image).

    fov        ω     d = atan(2 r tan(ω/2)) / ω        Devernay and Faugeras 2001
    division   k     r = d / (1 + k d²)                Fitzgibbon 2001
    eucm       α β   x / (α √(β(x² + y²) + z²) + (1 − α) z)    Khomutenko et al. 2016
    visualsfm  c     r = d (1 + c d²)                  VisualSFM, in units of the focal length

`division` with k < 0 and `eucm` see behind themselves, as the formulas do.
"""

import math

import numpy as np

from .lens_solve import WIDEST, Numbers, Pair, invert_growing, scaled_to

CLOSED = ("fov", "division", "eucm", "visualsfm")
_FLAT = 1e-8  # radians; the square of it is lost beside 1
_SLACK = 1 + 1e-9  # what comes back from the fold itself is still seen


def is_usable(lens: str, distortion: Numbers) -> bool:
    if lens == "fov":
        return abs(distortion[0]) < 3.14
    if lens == "eucm":
        return 0 <= distortion[0] <= 1 and distortion[1] > 0
    return True


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    with np.errstate(all="ignore"):
        if lens == "division":
            scale = _division_scale(distortion[0], across, z)
        elif lens == "eucm":
            scale = _eucm_scale(*distortion[:2], across, z)
        else:
            ideal = np.where(z > 0, across / z, 0.0)
            if lens == "fov":
                image, seen = _fov_image(distortion[0], ideal), True
            else:
                slope = distortion[0]
                image, seen = invert_growing(
                    lambda d: (d * (1 + slope * d * d), 1 + 3 * slope * d * d), ideal,
                    _visualsfm_limit(slope),
                )  # fmt: skip
            on_axis = _fov_image(distortion[0], 1e-9) / 1e-9 if lens == "fov" else 1.0
            scale = np.where((z > 0) & seen, scaled_to(image, ideal, on_axis) / z, np.nan)
    return x * scale, y * scale


def undistort(lens: str, distortion: Numbers, x: np.ndarray, y: np.ndarray) -> Pair:
    radius = np.hypot(x, y)
    if lens == "fov":
        omega = abs(distortion[0])
        if omega < _FLAT:
            return np.stack([x, y, np.ones_like(x)], axis=-1), np.ones(x.shape, dtype=bool)
        opening = 2 * math.tan(omega / 2)
        widest = math.atan(WIDEST * opening)
        angle = np.minimum(radius * omega, widest)
        scale = scaled_to(np.tan(angle) / opening, radius, omega / opening)
        return np.stack([x * scale, y * scale, np.ones_like(x)], axis=-1), radius * omega <= widest
    limit = {
        "division": lambda k: k**-0.5 if k > 0 else np.inf,
        "visualsfm": _visualsfm_limit,
        "eucm": _eucm_limit,
    }[lens](*distortion)
    met = radius <= limit * _SLACK
    inward = np.minimum(1, limit / np.maximum(radius, 1e-12))
    x, y, squared = x * inward, y * inward, np.square(radius * inward)
    if lens == "division":
        return np.stack([x, y, 1 + distortion[0] * squared], axis=-1), met
    if lens == "visualsfm":
        scale = 1 + distortion[0] * squared
        return np.stack([x * scale, y * scale, np.ones_like(x)], axis=-1), met
    alpha, beta = distortion[:2]
    root = np.sqrt(np.maximum(1 - (2 * alpha - 1) * beta * squared, 0))
    depth = (1 - alpha**2 * beta * squared) / np.maximum(alpha * root + 1 - alpha, 1e-12)
    return np.stack([x, y, depth], axis=-1), met


def _fov_image(omega: float, ideal: np.ndarray) -> np.ndarray:
    omega = abs(omega)
    return ideal if omega < _FLAT else np.arctan(ideal * 2 * math.tan(omega / 2)) / omega


def _visualsfm_limit(slope: float) -> float:
    """Image radius from which d (1 + c d²) falls."""
    return (-3 * slope) ** -0.5 if slope < 0 else np.inf


def _division_scale(k: float, across: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Image radius over distance from the axis; the smaller root of k ρ d² − z d + ρ = 0."""
    square = z * z - 4 * k * across * across
    root = np.sqrt(np.maximum(square, 0))
    # For z < 0 (only k < 0 sees there) z + root cancels; its conjugate does not.
    scale = np.where(z > 0, 2 / (z + root), (root - z) / (-2 * k * across * across))
    seen = (square >= -1e-9 * z * z) & (z > 0) if k >= 0 else (z > 0) | (across > 1e-12)
    return np.where(seen, scale, np.nan)


def _eucm_limit(alpha: float, beta: float) -> float:
    """Image radius beyond which there is no direction."""
    return ((2 * alpha - 1) * beta) ** -0.5 if alpha > 0.5 else np.inf


def _eucm_scale(alpha: float, beta: float, across: np.ndarray, z: np.ndarray) -> np.ndarray:
    depth = alpha * np.sqrt(beta * across * across + z * z) + (1 - alpha) * z
    if alpha > 0.5:
        # Where the radius stops growing, its slope in the angle is 0.
        behind = math.atan2(math.sqrt(2 * alpha - 1), (1 - alpha) * math.sqrt(beta))
    else:
        # Where the radius grows without bounds.
        behind = math.atan2(math.sqrt(1 - 2 * alpha), alpha * math.sqrt(beta))
    angle = np.arctan2(across, z)
    seen = (angle <= (math.pi - behind) * _SLACK) & (depth > 0)
    return np.where(seen, 1 / depth, np.nan)
