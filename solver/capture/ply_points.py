"""Positions of a PLY's vertices: the sparse points that camera files name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .errors import CaptureError
from .files import read_bytes

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


def read_ply_points(path: Path) -> np.ndarray:
    """Positions [N, 3] double of a PLY, text or binary, whose vertices come first.

    Raises:
        CaptureError: it cannot be read, or is no such file.
    """
    content = read_bytes(path)
    head, end, body = content[: 1 << 16].partition(b"end_header\n")
    body = content[len(head) + len(end) :]
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    try:
        if lines[0] != ["ply"] or not end:
            raise ValueError("no header")
        order = next(_ORDERS[line[1]] for line in lines if line[:1] == ["format"])
        elements = [i for i, line in enumerate(lines) if line[:1] == ["element"]]
        first = elements[0]
        if lines[first][1] != "vertex":
            raise ValueError("vertices do not come first")
        last = elements[1] if len(elements) > 1 else len(lines)
        fields = [line for line in lines[first:last] if line[:1] == ["property"]]
        kind = np.dtype([(name, (order or "<") + _TYPES[stated]) for _, stated, name in fields])
        count = int(lines[first][2])
        if order:
            rows = np.frombuffer(body, kind, count)
            return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
        columns = [kind.names.index(axis) for axis in "xyz"]
        texts = [line.split() for line in body.decode("ascii").splitlines()[:count]]
        return np.array([[float(row[c]) for c in columns] for row in texts]).reshape(-1, 3)
    except (ValueError, LookupError, TypeError, StopIteration) as error:
        raise CaptureError(
            path, "", "this is not a PLY file with points", "export it again, or remove it"
        ) from error
