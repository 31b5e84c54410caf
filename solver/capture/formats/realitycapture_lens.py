"""The lens of RealityCapture and RealityScan ("RealityCapture XMP Camera Math").

With s the longer side of the photo in pixels:

    x = X / Z, y = Y / Z
    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + t1 (r² + 2 x²) + 2 t2 x y
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + t2 (r² + 2 y²) + 2 t1 x y
    u = w / 2 + s (f / 36 x' + skew y' + px)
    v = h / 2 + s (f / 36 aspect y' + py)

so t1 and t2 are OpenCV's p2 and p1. The division model is another formula, and not read: as it is
described, x' = x / (1 + k1 r²), a wide lens whose lines bend outwards has k1 > 0, but in files k1 < 0.
Its own database of lenses has −0.3143 for a GoPro of 15 mm. With Fitzgibbon's formula (`closed_lenses`) in
units of the focal length that is a fisheye between a stereographic lens (−1/4) and an equisolid one (−3/8).
In units of half the photo's longer side it would be nearly the same for such a lens, though not for
others, and no file with points was at hand that tells. The models `rationalP2D1` and `rationalP2D1T2`,
which it knows, too, are described nowhere.
"""

from pathlib import Path

from ..brown_lens import polynomial_lens
from ..image_header import image_size
from ..intake import Intrinsics

CHOOSE_BROWN = (
    "set Brown as distortion model in the alignment settings, update the cameras, export them again"
)
"""what to do about cameras of the division model"""


def brown_lens(
    photo: Path, focal: float, px: float, py: float, radial: list[float], t1: float, t2: float,
    skew: float = 0.0, aspect: float = 1.0,
) -> Intrinsics:  # fmt: skip
    """The lens on a photo as it is now: all lengths are in terms of its longer side."""
    width, height = image_size(photo)
    longer = max(width, height)
    fx = focal / 36 * longer
    lens, distortion = polynomial_lens(radial, (t2, t1), skew * longer / fx if fx else 0.0)
    return Intrinsics(
        width, height, fx, fx * aspect, 0.5 * width + px * longer, 0.5 * height + py * longer,
        lens, distortion,
    )  # fmt: skip
