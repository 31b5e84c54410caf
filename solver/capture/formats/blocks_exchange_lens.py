"""Lenses of BlocksExchange XML, by the two camera models in Bentley's ContextCapture User Guide.

A principal point in pixels counts from the centre of the first one, in mm from the middle of the sensor
along the axes of `CameraOrientation`. `SensorSize` is that of the longer side. In OpenCV's camera axes:

    Perspective   x = X / Z, y = Y / Z
                  x' = x (1 + K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2 x²) + 2 P2 x y
                  y' = y (1 + K1 r² + K2 r⁴ + K3 r⁶) + P2 (r² + 2 y²) + 2 P1 x y
                  u = f x' + Skew y', v = AspectRatio f y'
    Fisheye       θ = 2 / π · angle from the axis, ρ = P0 + P1 θ + P2 θ² + P3 θ³ + P4 θ⁴
                  (u, v) = FisheyeFocalMatrix ρ (x, y) / r; without one it is π / 2 · f for both

so P1 and P2 are OpenCV's p2 and p1 (the guide: "in some other conventions, the roles are reversed"), and a
fisheye's `Distortion` does not count. It is a lens here without P0, which makes a hole of its axis. The
guide's formulas are pictures; a WebODM plugin that writes these files has the roles of P1 and P2, and the
quarter turn that is 1, as they are here.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, shown
from ..fields import number
from ..fisheye_power import of_quarter_turns
from ..intake import Intrinsics

_SIDES = {"right": (1, 0), "left": (-1, 0), "down": (0, 1), "up": (0, -1)}
_BROWN = ("K1", "K2", "K3", "P1", "P2")
_POWERS = {"P0": 0.0, "P1": 1.0, "P2": 0.0, "P3": 0.0, "P4": 0.0}
_QUARTER = math.pi / 2


def value_of(path: Path, where: str, element: Element, name: str, default: float | None = None) -> float:
    """The number in an element below another.

    Args:
        default: instead of one that is not there, or empty.

    Raises:
        CaptureError: no number.
    """
    text = (element.findtext(name) or "").strip()
    if not text:
        if default is not None:
            return default
        raise CaptureError(path, f"{where}, {name}", "it is missing")
    return number(path, f"{where}, {name}", text)


def axes_of(path: Path, group: Element) -> np.ndarray:
    """The rotation [3, 3] from a photogroup's camera axes to OpenCV's.

    Raises:
        CaptureError: axes that there are not.
    """
    stated = (group.findtext("CameraOrientation") or "").strip() or "XRightYDown"
    named = re.fullmatch(r"X(right|left|up|down)Y(right|left|up|down)", stated, re.I)
    matrix = np.zeros((3, 3))
    if named:
        matrix[:2, :2] = np.array([_SIDES[side.lower()] for side in named.groups()]).T
        matrix[2, 2] = round(np.linalg.det(matrix[:2, :2]))
    if not matrix[2, 2]:
        raise CaptureError(
            path, "CameraOrientation", f"'{shown(stated)}' is not known", "choose XRightYDown"
        )
    return matrix


def read_lens(path: Path, group: Element) -> Intrinsics:
    """The lens of a photogroup.

    Raises:
        CaptureError: a model that is not known, or what is no number.
    """
    where = f"photogroup {shown((group.findtext('Name') or '').strip())}".strip()

    def value(name: str, default: float | None = None) -> float:
        return value_of(path, where, group, name, default)

    width, height = (int(value(f"ImageDimensions/{side}")) for side in ("Width", "Height"))

    def pixel() -> float:
        """Its size in mm."""
        size = value("PixelSize", 0.0) or value("SensorSize") / max(width, height, 1)
        if not size > 1e-9:
            raise CaptureError(path, f"{where}, SensorSize", "it is not positive", "correct it")
        return size

    def focal() -> float:
        return value("FocalLengthPixels", 0.0) or value("FocalLength") / pixel()

    centre = np.array([width / 2, height / 2])
    if group.find("PrincipalPoint/xmm") is not None:
        offset = np.array([value(f"PrincipalPoint/{axis}mm") / pixel() for axis in "xy"])
        with np.errstate(all="ignore"):  # what is no number is found where all lenses are checked
            centre = centre + axes_of(path, group)[:2, :2] @ offset
    elif group.find("PrincipalPoint/x") is not None:
        centre = np.array([value(f"PrincipalPoint/{axis}") + 0.5 for axis in "xy"])
    kind = (group.findtext("CameraModelType") or "").strip() or "Perspective"
    if kind.lower() == "fisheye":
        fx, fy, lens = _fisheye(path, where, group, focal)
    elif kind.lower() == "perspective":
        fx = focal()
        fy = fx * value("AspectRatio", 1.0)
        k = _coefficients(path, where, group, "Distortion", dict.fromkeys(_BROWN, 0.0))
        skew = value("Skew", 0.0) / fx if fx else 0.0
        lens = polynomial_lens((k["K1"], k["K2"], k["K3"]), (k["P2"], k["P1"]), skew)
    else:
        raise CaptureError(
            path, f"{where}, CameraModelType", f"the camera model '{shown(kind)}' is not supported",
            "use photos of perspective or fisheye cameras",
        )  # fmt: skip
    return Intrinsics(width, height, fx, fy, float(centre[0]), float(centre[1]), *lens)


def _coefficients(
    path: Path, where: str, group: Element, name: str, known: dict[str, float]
) -> dict[str, float]:
    """A lens's numbers by name.

    Args:
        known: all that there may be, and what they are if they are not given.
    """
    values = dict(known)
    for child in group.iterfind(f"{name}/*"):
        field = f"{name}/{child.tag}"
        # What is not known must at least be nothing: no number of a lens is dropped.
        given = value_of(path, where, group, field, known.get(child.tag, 0.0))
        if child.tag not in known and (given or len(child)):
            raise CaptureError(
                path, f"{where}, {field}", "this coefficient is not known",
                "export it again with " + ", ".join(known),
            )  # fmt: skip
        values[child.tag] = given
    return values


def _fisheye(
    path: Path, where: str, group: Element, focal: Callable[[], float]
) -> tuple[float, float, tuple[str, tuple[float, ...]]]:
    powers = _coefficients(path, where, group, "FisheyeDistortion", _POWERS)
    if group.find("FisheyeFocalMatrix") is None:
        matrix = (_QUARTER * focal(), 0.0), (0.0, _QUARTER * focal())
    else:
        matrix = [
            [
                value_of(path, where, group, f"FisheyeFocalMatrix/M_{row}{column}", standard)
                for column, standard in enumerate(defaults)
            ]
            for row, defaults in enumerate(((None, 0.0), (0.0, None)))
        ]
    p0, *powers = powers.values()
    lens = None if p0 else of_quarter_turns(powers, matrix)
    if lens is None:
        raise CaptureError(
            path, f"{where}, FisheyeDistortion",
            "there is no lens here that is the same as a fisheye with P0 or without P1",
            "export the undistorted photos with their cameras",
        )  # fmt: skip
    return lens
