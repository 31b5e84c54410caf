"""Sparse points of an OPF project: glTF whose points are in files of bare numbers beside it.

Each node has a `matrix`, column by column, from its points to glTF's world, where +Y is up; OPF's own has
+Z there. Nothing is allocated by the word of a file, and nothing outside the project's folder is opened.
https://github.com/Pix4D/opf-spec (point_cloud.md), https://github.com/Pix4D/pyopf
(opf2colmap/converter.py, `generate_points3D`)
"""

from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..errors import CaptureError, shown
from ..fields import Entry, entries
from ..files import file_below
from ..sparse_points import MOST_POINTS

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""from glTF's world"""
_FLOAT = 5126
_MOST_IN_ALL = 8 * MOST_POINTS
_BYTES = 12
"""of a point"""
_AGAIN = "export the project again, or remove its points"


def read_gltf_points(file: Path, folder: Path) -> np.ndarray:
    """Points [N, 3] double in OPF's world, evenly drawn where there are more than anyone needs.

    Args:
        folder: nothing outside of it is opened.

    Raises:
        CaptureError: the file or its numbers cannot be used.
    """
    content = Entry.of_file(file)
    found = [np.zeros((0, 3))]
    for node in content.objects("nodes"):
        mesh = _item(content, "meshes", node.get("mesh"))
        primitives = entries(file, f"{node.where}, primitives", mesh.get("primitives"))
        for primitive in primitives[:1]:
            attributes = Entry(file, node.where, primitive).within("attributes")
            accessor = _item(content, "accessors", attributes.get("POSITION"))
            points = _positions(node.where, content, accessor, folder)
            matrix = np.eye(4)
            if node.get("matrix") is not None:
                matrix = node.numbers("matrix", 16).reshape(4, 4).T
            with np.errstate(all="ignore"):  # what is no number is left out where all points are
                moved = points @ matrix[:3, :3].T + matrix[:3, 3]
                found.append(moved @ Z_UP[:3, :3].T)
        if sum(map(len, found)) > _MOST_IN_ALL:
            raise CaptureError(file, node.where, "it has more nodes with points than any project", _AGAIN)
    return np.concatenate(found)


def _item(content: Entry, key: str, index: Any) -> Entry:
    values = content.entries(key)
    if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(values):
        raise content.error(key, f"there is no '{shown(index)}' in it", _AGAIN)
    return Entry(content.path, f"{key}[{index}]", values[index])


def _positions(where: str, content: Entry, accessor: Entry, folder: Path) -> np.ndarray:
    """Points [N, 3] as they are stored."""
    file = content.path
    if accessor.get("componentType") != _FLOAT or accessor.get("type") != "VEC3":
        raise CaptureError(file, where, "its points are not triples of single precision", _AGAIN)
    view = _item(content, "bufferViews", accessor.get("bufferView"))
    buffer = _item(content, "buffers", view.get("buffer"))
    count, start = accessor.get("count"), view.get("byteOffset", 0)
    if not all(isinstance(v, int) and 0 <= v < 1 << 40 for v in (count, start)):
        raise CaptureError(file, where, "its points' count or place is not a number", _AGAIN)
    uri = buffer.get("uri")
    data = file_below(folder, file.parent, unquote(uri)) if isinstance(uri, str) else None
    if data is None:
        raise CaptureError(file, "buffers", f"'{shown(uri)}' is not in the project's folder", _AGAIN)
    if start + count * _BYTES > data.stat().st_size:
        raise CaptureError(data, "", f"{file.name} states {count} points in it, it has fewer", _AGAIN)
    if not count:
        return np.zeros((0, 3))
    table = np.memmap(data, "<f4", "r", start, (count, 3))
    return np.array(table[:: max(1, -(-count // MOST_POINTS))], dtype=np.float64)
