"""Points of a PLY file, with numpy alone. Its header is not trusted: nothing is allocated by its word."""

import warnings
from pathlib import Path

import numpy as np

from .errors import CaptureError, shown
from .files import read_bytes

LARGEST_FILE = 1 << 30
"""bytes; tens of millions of points"""
MOST_POINTS = 1_000_000
"""points that are kept, evenly drawn: they only say where the surroundings are"""

_LARGEST_HEADER, _MOST_PROPERTIES = 1 << 16, 1000
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip


def read_ply_points(path: Path) -> np.ndarray:
    """Points [N, 3] double in the file's own frame and unit; ASCII or binary, of any byte order.

    Raises:
        CaptureError: it cannot be read, is cut off, or has no points with x, y and z.
    """
    content = read_bytes(path, LARGEST_FILE)
    head, ending, _ = content[:_LARGEST_HEADER].partition(b"end_header")
    at = content.find(b"\n", len(head)) + 1
    if head[:3] not in (b"ply", b"PLY") or not ending or at == 0:
        raise _refused(path, "header", "this is not a PLY file, or its header is cut off")
    order, count, types = _header(path, head.decode("ascii", "replace"))
    names = [name for name, _ in types]
    if any(names.count(axis) != 1 for axis in "xyz"):
        raise _refused(path, "vertex", "its points have no x, y and z")
    if order is None:
        points = _from_text(path, content, at, count, names)
    else:
        # Numbered fields, as other properties may bear a name twice.
        record = np.dtype([(str(i), order + kind) for i, (_, kind) in enumerate(types)])
        if count * record.itemsize > len(content) - at:
            raise _cut_off(path, count)
        table = np.frombuffer(content, record, count, at)[:: _stride(count)]
        points = np.stack([table[str(names.index(axis))] for axis in "xyz"], axis=-1)
    return points.astype(np.float64)


def _header(path: Path, text: str) -> tuple[str | None, int, list[tuple[str, str]]]:
    """Byte order (None for text), count of points, and (name, type) of their properties."""
    order, count, types, element = "", 0, [], None
    for line in text.splitlines()[1:]:
        words = line.split()
        match words:
            case ["format", kind, _]:
                order = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}.get(kind, "")
            case ["element", "vertex", number] if element is None:
                element = "vertex"
                if not number.isdecimal() or len(number) > 12:
                    raise _refused(path, "element vertex", f"'{shown(number)}' is not a count")
                count = int(number)
            case ["element", name, *_]:
                if element is None:
                    raise _refused(path, f"element {shown(name)}", "its points are not the first")
                element = "other"
            case ["property", kind, name] if element == "vertex":
                if kind not in _TYPES or len(types) >= _MOST_PROPERTIES:
                    raise _refused(path, f"property {shown(name)}", "its type is unknown")
                types.append((name, _TYPES[kind]))
            case ["property", *_] if element == "vertex":
                raise _refused(path, "property", "its points hold lists")
    if order == "":
        raise _refused(path, "format", "it states no known format")
    return order, count, types


def _from_text(path: Path, content: bytes, at: int, count: int, names: list[str]) -> np.ndarray:
    # Every number takes a digit and a blank, so a count beyond that is a lie.
    if count * len(names) * 2 > len(content) - at + 1:
        raise _cut_off(path, count)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy warns of what the count shows below
        try:
            text = content[at:].decode("ascii", "replace")
            # All of it: asked for a count that is not there, numpy makes values up.
            values = np.fromstring(text, dtype=np.float64, sep=" ")[: count * len(names)]
        except ValueError:
            values = np.zeros(0)
    if len(values) != count * len(names):
        raise _cut_off(path, count)
    table = values.reshape(count, len(names))[:: _stride(count)]
    return table[:, [names.index(axis) for axis in "xyz"]]


def _stride(count: int) -> int:
    return max(1, -(-count // MOST_POINTS))


def _cut_off(path: Path, count: int) -> CaptureError:
    return _refused(path, "vertex", f"it states {count} points and has fewer")


def _refused(path: Path, field: str, problem: str) -> CaptureError:
    return CaptureError(path, field, problem, "export the points again, or remove them")
