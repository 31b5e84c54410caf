"""Values of camera files, as a reader may use them: anything else is refused by the field's name."""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .errors import CaptureError, shown
from .files import read_json
from .frames import pose_of_opencv, rigid

SOLVE_AGAIN = "solve or export the cameras again"
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.I)


def number(path: Path, field: str, value: Any) -> float:
    """A finite number from a number or its text.

    Raises:
        CaptureError: anything else.
    """
    try:
        if isinstance(value, (int, float, str)) and not isinstance(value, bool):
            found = float(value)
            if math.isfinite(found):
                return found
    except (ValueError, OverflowError):
        pass
    raise CaptureError(path, field, f"'{shown(value)}' is not a number", "correct the value")


def numbers(path: Path, field: str, values: Any, count: int | None = None) -> np.ndarray:
    """Finite numbers [N] double, from a list or from text with blanks or commas between them.

    Args:
        count: how many there must be, if that is known.

    Raises:
        CaptureError: anything else.
    """
    if isinstance(values, str):
        words = values.split()
        if (len(words) == count or count is None and len(words) > 1) and any(
            _DECIMAL_COMMA.fullmatch(word) for word in words
        ):
            raise CaptureError(
                path, field, f"'{shown(values)}' has decimal commas", "export it with decimal points"
            )
        values = values.replace(",", " ").split()
    if not isinstance(values, (list, tuple)) or (count is not None and len(values) != count):
        wanted = "numbers" if count is None else f"{count} numbers"
        words = isinstance(values, list) and all(isinstance(value, str) for value in values)
        text = shown(" ".join(values) if words else values)
        raise CaptureError(path, field, f"'{text}' is not {wanted}")
    return np.array([number(path, field, value) for value in values], dtype=np.float64)


def entries(path: Path, field: str, value: Any) -> list:
    """The value itself, if it is a list; an absent or empty value is an empty list.

    Raises:
        CaptureError: anything else.
    """
    if value in (None, "", {}):
        return []
    if not isinstance(value, list):
        raise CaptureError(path, field, f"'{shown(value)}' is not a list")
    return value


class Entry(dict):
    """A JSON object of a camera file that knows its place in it, so that errors name the field.

    Its methods take a key; what is not there is null to them.

    Args:
        where: its place; empty for all of the file.

    Raises:
        CaptureError: it is no object; in the methods, a value is not what is asked for.
    """

    __slots__ = ("path", "where")

    def __init__(self, path: Path, where: str, value: Any):
        if not isinstance(value, dict):
            raise CaptureError(path, where, f"'{shown(value)}' is not an object")
        super().__init__(value)
        self.path, self.where = path, where

    @classmethod
    def of_file(cls, path: Path) -> "Entry":
        """All of a JSON file."""
        return cls(path, "", read_json(path))

    @classmethod
    def listed(cls, path: Path) -> "list[Entry]":
        """The objects of a JSON file that is a list of them."""
        return [cls(path, f"[{i}]", value) for i, value in enumerate(entries(path, "", read_json(path)))]

    def field(self, key: str) -> str:
        """The place of a value."""
        return f"{self.where}.{shown(key)}" if self.where else shown(key)

    def error(self, key: str, problem: str, remedy: str = "export it again") -> CaptureError:
        return CaptureError(self.path, self.field(key), problem, remedy)

    def number(self, key: str) -> float:
        return number(self.path, self.field(key), self.get(key))

    def optional(self, key: str, default: float | None = None) -> float | None:
        """A finite number; the default where it is null or missing."""
        return default if self.get(key) is None else self.number(key)

    def numbers(self, key: str, count: int | None = None) -> np.ndarray:
        """Finite numbers [N]."""
        return numbers(self.path, self.field(key), self.get(key), count)

    def matrix(self, key: str, shape: tuple[int, int]) -> np.ndarray:
        """The upper left part [rows, columns] of a matrix that may have a row or a column more."""
        stated, (rows, columns) = self.get(key), shape
        if isinstance(stated, list) and rows <= len(stated) <= 4:
            values = [numbers(self.path, self.field(key), row) for row in stated[:rows]]
            if all(columns <= len(row) <= 4 for row in values):
                return np.stack([row[:columns] for row in values])
        raise self.error(key, f"this is not a {rows} × {columns} matrix")

    def name(self, key: str, problem: str, remedy: str = "export it again") -> str:
        """A text that may be a file's name."""
        value = self.get(key)
        if not isinstance(value, str) or not value or "\0" in value:
            raise self.error(key, problem, remedy)
        return value

    def entries(self, key: str) -> list:
        """The values of a list, as the function of this name has them."""
        return entries(self.path, self.field(key), self.get(key))

    def objects(self, key: str) -> "Iterator[Entry]":
        """The objects of a list, one by one."""
        field = self.field(key)
        for index, value in enumerate(self.entries(key)):
            yield Entry(self.path, f"{field}[{index}]", value)

    def inner(self, key: str, default: Any = None) -> "Entry":
        """An object in this one; the default if there is none."""
        return Entry(self.path, self.field(key), default if self.get(key) is None else self[key])

    def within(self, key: str) -> "Entry":
        """An object in this one whose values are called as if they were this one's."""
        return Entry(self.path, self.where, self.get(key))


def rigid_pose(path: Path, field: str, value: Any) -> np.ndarray:
    """A rigid [4, 4] double from a [4, 4] or [3, 4] matrix; a uniform scale of its axes is dropped.

    Raises:
        CaptureError: no such matrix, or one that is singular, sheared or mirrors the world.
    """
    matrix = _pose_matrix(value)
    if matrix is None:
        problem = "a pose must be a 4 × 4 matrix of numbers"
    elif not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e12:
        problem = "the pose holds a value that is not a number"
    else:
        u, scale, vt = np.linalg.svd(matrix[:3, :3])
        if scale[2] < 1e-6 * max(scale[0], 1e-12):
            problem = "the pose's rotation is singular"
        elif scale[0] > 1.02 * scale[2]:
            problem = "the pose's axes are not at right angles"
        elif np.linalg.det(matrix[:3, :3]) < 0:
            problem = "the pose mirrors the world"
        else:
            return rigid(u @ vt, matrix[:3, 3])
    raise CaptureError(path, field, problem, SOLVE_AGAIN)


def pose_of_world(path: Path, field: str, from_world: Any) -> np.ndarray:
    """Camera to world [4, 4], OpenGL axes, of a matrix from the world to OpenCV's; see `rigid_pose`."""
    return pose_of_opencv(rigid_pose(path, field, from_world))


def check_quaternion(path: Path, field: str, quaternion: Sequence[float], remedy: str) -> None:
    """Make sure that four numbers, in whatever order, are about a unit quaternion.

    Raises:
        CaptureError: they are not.
    """
    if not 0.5 < np.linalg.norm(quaternion) < 2:
        raise CaptureError(path, field, "its quaternion is not a rotation", remedy)


def is_no_pose(value: Any) -> bool:
    """True for what programs write where they could not align a photo: null, or a matrix of the right
    shape that holds what is no number, or zeros alone."""
    if value is None:
        return True
    matrix = _pose_matrix(value)
    return matrix is not None and not (np.isfinite(matrix).all() and matrix[:3].any())


def _pose_matrix(value: Any) -> np.ndarray | None:
    """A double [4, 4] or [3, 4], whatever its numbers are; None for anything else."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return matrix if matrix.shape in ((4, 4), (3, 4)) else None
