"""Cameras in a folder of small files, one a photo, and matrices that these hold as text."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .errors import CaptureError
from .files import CUT_OFF, as_text, read_bytes
from .picture_names import folder_called, numbered, pictures_in

LARGEST_FILE = 1 << 20
"""bytes; a camera has a thousandth of that"""
MOST_FILES = 20_000


@contextmanager
def listing(folder: Path) -> Iterator[None]:
    """For work that lists a folder.

    Raises:
        CaptureError: the folder cannot be read.
    """
    try:
        yield
    except OSError as error:
        raise CaptureError(folder, "", "the folder cannot be read", "check its permissions") from error


def files_in(folder: Path, ending: str) -> list[Path]:
    """Files in a folder whose names end so, in the order of the numbers in their names.

    Hidden ones do not count: on disks of other systems macOS lays ._N.json, which is no JSON, beside
    N.json.

    Raises:
        CaptureError: the folder cannot be read, or holds more than any capture.
    """
    with listing(folder):
        files = [
            file
            for file in folder.iterdir()
            if file.name.endswith(ending) and not file.name.startswith(".") and file.is_file()
        ]
    if len(files) > MOST_FILES:
        raise CaptureError(
            folder, "", f"it holds {len(files)} files {ending}", "leave only the cameras in it"
        )
    return sorted(files, key=lambda file: numbered(file.name))


def rows_of(path: Path) -> list[list[str]]:
    """The words of each line of a small text file that has any.

    Raises:
        CaptureError: it cannot be read, or is larger than any camera.
    """
    lines = as_text(read_bytes(path, LARGEST_FILE)).splitlines()
    return [words for line in lines if (words := line.split())]


def words_of(path: Path) -> list[str]:
    """All words of a small text file; see `rows_of`."""
    return [word for row in rows_of(path) for word in row]


def matrix_of(path: Path, field: str, words: Sequence[str], rows: int, columns: int) -> np.ndarray:
    """A matrix [rows, columns], double, from its numbers row by row. They may be inf or nan, which is what
    programs write of a photo whose pose they do not know.

    Raises:
        CaptureError: these are not as many numbers.
    """
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != rows * columns:
        raise CaptureError(path, field, f"this is not a {rows} × {columns} matrix", CUT_OFF)
    return np.array(values, dtype=np.float64).reshape(rows, columns)


def photo_folder(place: Path, folders: tuple[str, ...]) -> Path:
    """The first of `folders` in `place` with pictures; the first of all, if none has any."""
    there = (folder_called(place, name) for name in folders)
    return next((folder for folder in there if pictures_in(folder)), place / folders[0])
