"""Lenses of Metashape's camera export, which `metashape` reads.

A lens, in pixels from the corner of the picture (manual, appendix "Camera models"):

    x = X / Z, y = Y / Z; of an equidistant fisheye both times θ / r, where θ is the angle from the axis
                          and r = tan θ; of an equisolid one times 2 sin(θ/2) / r
    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + (p1 (r² + 2 x²) + 2 p2 x y) t
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + (p2 (r² + 2 y²) + 2 p1 x y) t
    t  = 1 + p3 r² + p4 r⁴
    u = w / 2 + cx + x' f + x' b1 + y' b2
    v = h / 2 + cy + y' f

so p1 and p2 are OpenCV's p2 and p1. PhotoScan before 1.2 wrote fx, fy, skew and cx, cy from the corner
instead, and p1, p2 in OpenCV's order. A panorama (`spherical`) has no calibration: it shows all directions.
Equisolid fisheyes, since Metashape 2.3, are as two programs have them that read such exports, PlaCamera
(frame_camera_math.cpp) and Fisheye-to-Cubemap, of photos of dual fisheyes.

`corrections` are what "Fit additional corrections" adds, a Fourier series over the picture. No source of
its maker's with the formula was at hand, only one program's without its origin, so they are refused, as any
coefficient that is not known.
"""

import re
from pathlib import Path
from xml.etree.ElementTree import Element

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, shown
from ..fields import number, numbers
from ..intake import Intrinsics
from ..panoramic_lens import EQUIRECTANGULAR, of_whole_sphere

_PANORAMA = "spherical"
_FISHEYES = ("fisheye", "equidistant_fisheye", "equidistant fisheye")
_EQUISOLID = ("equisolid_fisheye", "equisolid fisheye")
_KNOWN = ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4", "b1", "b2")
_NO_LENS = ("resolution", "f")
"""what a panorama's calibration may have: its focal length follows from the width"""
_COEFFICIENT = re.compile(r"[a-z]\d")
_REMEDY = "export the undistorted photos and their cameras"


def kind_of(sensor: Element) -> str:
    return (sensor.get("type") or "frame").strip().lower()


def is_other_panorama(sensor: Element) -> bool:
    """Whether a sensor's photos are panoramas, but not just of all directions: on a cylinder, or with a
    lens's numbers, which change that."""
    kind = kind_of(sensor)
    return kind == "cylindrical" or (
        kind == _PANORAMA
        and any(
            element.tag not in _NO_LENS and not _is_nothing(element)
            for calibration in sensor.iterfind("calibration")
            for element in calibration
        )
    )


def has_rolling_shutter(sensor: Element) -> bool:
    """Whether a sensor's photos were aligned as exposed row by row, from a camera that moves meanwhile."""
    values = (
        item.get("value") or ""
        for item in sensor.iterfind("property")
        if item.get("name") == "rolling_shutter"
    )
    return any(value.strip().lower() not in ("", "0", "false", "no") for value in values)


def _is_nothing(element: Element) -> bool:
    try:
        return float(element.text or 0) == 0
    except ValueError:
        return False


def read_lens(path: Path, sensor: Element) -> Intrinsics:
    """The lens of a sensor, the adjusted calibration before the initial one.

    Raises:
        CaptureError: there is none, it is of a type that no lens here is, or has what is not known.
    """
    label = sensor.get("label") or sensor.get("id") or ""
    where = f"sensor {shown(label)}"
    if kind_of(sensor) == _PANORAMA:
        width, height = _size(path, where, sensor.find("resolution"))
        return Intrinsics(width, height, *of_whole_sphere(width, height), EQUIRECTANGULAR)
    calibrations = sorted(
        sensor.findall("calibration"),
        key=lambda item: ("adjusted", None, "initial").index(item.get("class"))
        if item.get("class") in ("adjusted", "initial") else 1,
    )  # fmt: skip
    if not calibrations:
        raise CaptureError(
            path, where, "it has no calibration", "align the photos and export the cameras again"
        )
    calibration = calibrations[0]
    kind = (calibration.get("type") or kind_of(sensor)).strip().lower()
    if kind not in ("frame", *_FISHEYES, *_EQUISOLID):
        raise CaptureError(
            path, f"{where}, type", f"cameras of the type '{shown(kind)}' are not supported",
            "set the type Frame or a Fisheye in Metashape's Camera Calibration, and align again",
        )  # fmt: skip

    def value(name: str, default: float = 0.0) -> float:
        text = calibration.findtext(name)
        return default if text is None else number(path, f"{where}, {name}", text)

    _check_known(path, where, calibration)
    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size
    width, height = _size(path, where, size)
    old = calibration.find("fx") is not None
    if not old and calibration.find("f") is None:
        raise CaptureError(path, f"{where}, f", "the focal length is missing")
    if old:
        fx, fy, skew = value("fx"), value("fy", value("fx")), value("skew")
        cx, cy = value("cx", 0.5 * width), value("cy", 0.5 * height)
        tangential = value("p1"), value("p2")
    else:
        fx, fy, skew = value("f") + value("b1"), value("f"), value("b2")
        cx, cy = 0.5 * width + value("cx"), 0.5 * height + value("cy")
        tangential = value("p2"), value("p1")
    tangential = (*tangential, value("p3"), value("p4"))
    lens, distortion = polynomial_lens(
        [value(name) for name in ("k1", "k2", "k3", "k4")], tangential, skew / fx if fx else 0.0,
        equidistant=kind in _FISHEYES, equisolid=kind in _EQUISOLID,
    )  # fmt: skip
    return Intrinsics(width, height, fx, fy, cx, cy, lens, distortion)


def _size(path: Path, where: str, resolution: Element | None) -> tuple[int, int]:
    if resolution is None:
        raise CaptureError(path, where, "it has no resolution")
    width, height = (number(path, f"{where}, {side}", resolution.get(side)) for side in ("width", "height"))
    return int(width), int(height)


def _check_known(path: Path, where: str, calibration: Element) -> None:
    """Refuse what would be dropped of a lens: corrections, and coefficients that are not known."""
    for element in calibration.iterfind("corrections"):
        text = element.findtext("coeffs") or "".join(element.itertext())
        if text.strip() and numbers(path, f"{where}, corrections", text).any():
            raise CaptureError(
                path, f"{where}, corrections", "the lens has additional corrections, which are not read",
                f"optimize the cameras without 'Fit additional corrections', or {_REMEDY}",
            )  # fmt: skip
    for element in calibration:
        name = element.tag if isinstance(element.tag, str) else ""
        field, unknown = f"{where}, {name}", _COEFFICIENT.fullmatch(name) and name not in _KNOWN
        if unknown and number(path, field, element.text or "0"):
            raise CaptureError(path, field, "this coefficient is not known", _REMEDY)
