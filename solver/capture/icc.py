"""ICC profiles of RGB photos: three curves and a matrix, as phones and cameras embed them.

Display P3, Adobe RGB, ProPhoto and their like are of this kind. Profiles that are tables of colours
alone (printers', scanners') are not, and `read_profile` has None for them.
https://www.color.org/specification/ICC.1-2022-05.pdf, sections 8.4.2 and 10
"""

import struct
from dataclasses import dataclass

import numpy as np

from .colour import rec709_from_chromaticities, rec709_from_colorants, srgb_to_linear

_SAME_CURVE = 2e-3


@dataclass(frozen=True, eq=False)
class Profile:
    """How to get from a photo's codes to linear Rec. 709.

    Attributes:
        curves: [3, 4096] linear light of red, green and blue at codes evenly from 0 to 1.
        matrix: [3, 3] from the photo's linear RGB to Rec. 709; None if they are the same.
    """

    curves: np.ndarray
    matrix: np.ndarray | None

    @property
    def is_srgb(self) -> bool:
        """True if it says what is assumed of photos without a profile."""
        own = srgb_to_linear(np.linspace(0, 1, self.curves.shape[1]))
        return self.matrix is None and np.abs(self.curves - own).max() < _SAME_CURVE

    def linear(self, channel: int, encoded: np.ndarray) -> np.ndarray:
        """Linear light of codes of one channel."""
        curve = self.curves[channel]
        inside = np.interp(encoded, np.linspace(0, 1, len(curve)), curve)
        # Radiances go on as they were at 1.
        slope = (curve[-1] - curve[-2]) * (len(curve) - 1)
        return inside * np.maximum(encoded, 1) ** slope + np.minimum(encoded, 0)


ADOBE_RGB = Profile(
    np.tile(np.linspace(0, 1, 4096) ** (563 / 256), (3, 1)),
    rec709_from_chromaticities((0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)),
)
"""Adobe RGB (1998), which cameras can also name in EXIF alone"""


def read_profile(data: bytes) -> Profile | None:
    """The profile, or None if it is damaged or of another kind than curves and a matrix."""
    try:
        if data[36:40] != b"acsp" or data[16:20] not in (b"RGB ", b"GRAY"):
            return None
        tags = _tags(data)
        if b"kTRC" in tags:
            curves, matrix = [_curve(tags[b"kTRC"])] * 3, None
        else:
            columns = [_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
            curves = [_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC")]
            matrix = rec709_from_colorants(np.stack(columns, axis=1))
    except (KeyError, ValueError, struct.error):
        return None
    curves = np.stack(curves)
    return Profile(curves, matrix) if np.isfinite(curves).all() else None


def profile_unless_srgb(data: bytes) -> Profile | None:
    """The profile, or None if it changes nothing: it is of another kind, or what is assumed without one."""
    profile = read_profile(data)
    return None if profile is None or profile.is_srgb else profile


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack(">I", data[128:132])
    tags = {}
    for index in range(min(count, 100)):
        name, at, size = struct.unpack(">4sII", data[132 + 12 * index : 144 + 12 * index])
        tags[name] = data[at : at + size]
    return tags


def _xyz(tag: bytes) -> np.ndarray:
    if tag[:4] != b"XYZ ":
        raise ValueError("no XYZ")
    return np.array(struct.unpack(">3i", tag[8:20])) / 65536


def _curve(tag: bytes) -> np.ndarray:
    x = np.linspace(0, 1, 4096)
    if tag[:4] == b"curv":
        (count,) = struct.unpack(">I", tag[8:12])
        if count == 0:
            return x
        if count == 1:
            return x ** (struct.unpack(">H", tag[12:14])[0] / 256)
        table = np.frombuffer(tag[12 : 12 + 2 * count], dtype=">u2").astype(np.float64) / 65535
        if len(table) < 2:
            raise ValueError("a cut-off curve")
        return np.interp(x, np.linspace(0, 1, len(table)), table)
    if tag[:4] != b"para":
        raise ValueError("no curve")
    (kind,) = struct.unpack(">H", tag[8:10])
    count = (1, 3, 4, 5, 7)[kind] if kind < 5 else 0
    g, a, b, c, d, e, f = (
        *(value / 65536 for value in struct.unpack(f">{count}i", tag[12 : 12 + 4 * count])),
        *(0.0,) * (7 - count),
    )
    if kind == 0:
        a, b, c, d, e, f = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    elif kind in (1, 2):
        # Below −b/a these two are constant, which the general form has as c = 0.
        c, d, e, f = (0.0, (-b / a if a else 0.0), (c if kind == 2 else 0.0), (c if kind == 2 else 0.0))
    with np.errstate(all="ignore"):
        return np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)
