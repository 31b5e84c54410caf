"""RealityCapture's and RealityScan's tables of cameras, in CSV.

"Internal/External camera parameters" has columns name, x, y, alt, heading or yaw, pitch, roll, f, px, py,
k1 … k4, t1, t2; in degrees. With all angles 0 a camera looks down with north on top; heading turns it
clockwise as seen from above, pitch 90° lifts the view to the horizon.

"OpenCV-compliant Internal/External Camera Parameters" has name, tx, ty, tz, R00 … R22, f_pix, px_pix,
py_pix, k1, k2, t2, t1, k3, k4: rotation and translation from the world to OpenCV's camera axes, lengths in
pixels, and a sentence about all that in the name of its last column.

Which lens model a table has it does not say (`realitycapture_lens`).
"""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..brown_lens import polynomial_lens
from ..fields import number, pose_of_world
from ..files import as_text, head_of, read_text
from ..frames import rigid, rotation_about
from ..image_header import image_size
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble
from .realitycapture_lens import CHOOSE_BROWN, brown_lens

UP = (0.0, 0.0, 1.0)

_SAME_COLUMNS = {"yaw": "heading", "f_35mm": "f", "px_norm": "px", "py_norm": "py", "z": "alt"}
_ANGLES = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
_CELLS = tuple(f"r{row}{column}" for row in range(3) for column in range(3))
_MATRIX = ("name", "tx", "ty", "tz", *_CELLS, "f_pix", "px_pix", "py_pix")
_RADIAL, _TANGENTIAL = ("k1", "k2", "k3", "k4"), ("t2", "t1")
_KNOWN = {*_ANGLES, *_MATRIX, *_RADIAL, *_TANGENTIAL, "px", "py"}
_PLACES = (["name", "x", "y"], ["name", "x/lon", "y/lat"])
"""columns that RealityCapture's tables without lenses begin with"""
_SEPARATORS = (",", ";", "\t")
"""of columns; after all but the comma, Excel writes decimals with a comma where people do"""
_MOST_OFF = 0.1
"""of a photo's size that a principal point may be from its centre; of half the size it is half of it"""
_MOST_DEGREES = (180.0, 90.0)
_FARTHEST, _STEEPEST = 1000.0, 10.0
"""times their extent that cameras may be from the origin, and that their altitudes may differ, before x and
y are longitudes and latitudes: altitudes are in metres, of which a degree has a hundred thousand"""


def is_table(file: Path) -> bool:
    """True for a table with the columns of either kind."""
    return _table_of(as_text(head_of(file))) is not None


def is_table_without_lenses(file: Path) -> bool:
    """True for RealityCapture's other tables, of places or of places and angles, which have no lenses."""
    lines = as_text(head_of(file)).splitlines()[:5]
    headers = (_names(line.split(separator)) for line in lines for separator in _SEPARATORS)
    return any(names[:3] in _PLACES for names in headers) and not is_table(file)


def _table_of(head: str) -> tuple[dict[str, int], str] | None:
    """Columns and their separator, by the line that names them; None if this is no table of cameras.

    RealityCapture may put `#cameras 12` before it; Excel saves tables again with other separators.
    """
    for line in head.splitlines()[:5]:
        for separator in _SEPARATORS:
            if (columns := _columns(line.split(separator))) is not None:
                return columns, separator
    return None


def _columns(header: list[str]) -> dict[str, int] | None:
    found: dict[str, int] = {}
    for index, name in enumerate(_names(header)):
        if name in _KNOWN:
            found.setdefault(name, index)
    complete = any(all(name in found for name in needed) for needed in (_ANGLES, _MATRIX))
    return found if complete else None


def _names(header: list[str]) -> list[str]:
    """Columns as they are called here, without what is said of them behind a blank."""
    words = (name.strip().strip('"').lstrip("#").split() for name in header)
    names = (parts[0].lower() if parts else "" for parts in words)
    return [_SAME_COLUMNS.get(name, name) for name in names]


def read_table(path: Path, name: str, photos: PhotoFinder) -> Capture:
    """Read a table of cameras.

    Args:
        name: of the format.

    Raises:
        CaptureError: anything that cannot be used.
    """
    text = read_text(path)
    table = _table_of(text[:65536])
    if table is None:
        raise CaptureError(
            path, "line 1", "the columns of RealityCapture's table are missing",
            "export 'Internal/External camera parameters' again",
        )  # fmt: skip
    columns, separator = table
    make = _from_angles if all(column in columns for column in _ANGLES) else _from_matrix
    found, coefficients = [], []
    try:
        rows = list(enumerate(csv.reader(text.splitlines(), delimiter=separator), 1))
    except csv.Error as error:
        raise CaptureError(path, "", f"this is not a table ({error})") from error
    for line, row in rows:
        if not row or not row[0].strip() or row[0].lstrip().startswith("#"):
            continue
        if _columns(row) is not None:
            continue
        where = f"line {line}"
        if len(row) <= max(columns.values()):
            raise CaptureError(path, where, "the line is cut off")

        def value(name: str, row: list[str] = row, where: str = where) -> float:
            if name not in columns:
                return 0.0
            text = row[columns[name]]
            if separator != ",":
                text = text.replace(",", ".")
            return number(path, f"{where}, {name}", text)

        stated = row[columns["name"]].strip()
        photo = photos.find(stated, beside=path)
        found.append(make(path, where, stated, photo, value))
        if photo is not None:
            coefficients.append([value(name) for name in (*_RADIAL, *_TANGENTIAL)])
    # Of photos that were straightened, all are 0.
    k1, *others = np.any(coefficients, axis=0) if coefficients else (False,)
    if "k2" in columns and k1 and not any(others):
        raise CaptureError(
            path, "k1", "k1 alone is not 0, as in the division model, which is not supported", CHOOSE_BROWN
        )
    if make is _from_angles:
        _check_no_degrees(path, found)
    return assemble(path, name, found, photos, up=UP)


Value = Callable[[str], float]
"""a row's number in a column; 0 where the table has no such column"""


def _from_angles(path: Path, where: str, stated: str, photo: Path | None, value: Value) -> Found:
    intrinsics = None
    if photo is not None:
        radial = [value(name) for name in _RADIAL]
        intrinsics = brown_lens(
            photo, value("f"), value("px"), value("py"), radial, value("t1"), value("t2")
        )
    rotation = _rotation(value("heading"), value("pitch"), value("roll"))
    pose = rigid(rotation, (value("x"), value("y"), value("alt")))
    return Found(where, stated, photo, pose, intrinsics)


def _from_matrix(path: Path, where: str, stated: str, photo: Path | None, value: Value) -> Found:
    intrinsics = None
    if photo is not None:
        (width, height), focal = image_size(photo), value("f_pix")
        cx, cy = value("px_pix"), value("py_pix")
        if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > _MOST_OFF:
            raise CaptureError(
                path, f"{where}, px_pix",
                f"{cx:g}, {cy:g} is not the centre of {photo.name}, which has {width} × {height} pixels",
                "give the photos in the size in which they were aligned",
            )  # fmt: skip
        lens, distortion = polynomial_lens(*_numbers(value, _RADIAL, _TANGENTIAL))
        intrinsics = Intrinsics(width, height, focal, focal, cx, cy, lens, distortion)
    rotation, translation = _numbers(value, _CELLS, ("tx", "ty", "tz"))
    from_world = np.column_stack([np.reshape(rotation, (3, 3)), translation])
    pose = pose_of_world(path, f"{where}, R00", from_world)
    return Found(where, stated, photo, pose, intrinsics)


def _numbers(value: Value, *columns: tuple[str, ...]) -> list[list[float]]:
    return [[value(name) for name in names] for names in columns]


def _rotation(heading: float, pitch: float, roll: float) -> np.ndarray:
    """Camera to world [3, 3] with OpenGL's camera axes, of angles in degrees."""
    return rotation_about(2, -heading) @ rotation_about(0, pitch) @ rotation_about(1, roll)


def _check_no_degrees(path: Path, found: list[Found]) -> None:
    """Refuse longitudes and latitudes, which are no lengths, and beside which angles mean nothing."""
    if not found:
        return
    places = np.stack([one.camera_to_world[:3, 3] for one in found])
    east, north, up = np.ptp(places, axis=0)
    far = np.abs(places[:, :2].mean(0)).max() > _FARTHEST * max(east, north) > 0
    steep = up > _STEEPEST * max(east, north)
    if far and steep and (np.abs(places[:, :2]) <= _MOST_DEGREES).all():
        raise CaptureError(
            path, "x, y", "they are longitudes and latitudes in degrees",
            "export in a local Euclidean or a projected coordinate system, in metres",
        )  # fmt: skip
