"""Arrays of numbers from numpy's files, without pickles; what a header states is not believed."""

import io
import math
import tokenize
import warnings
import zipfile
import zlib
from pathlib import Path

import numpy as np

from .errors import CaptureError, shown
from .files import read_bytes

LARGEST_FILE = 1 << 26
"""bytes, unpacked; the cameras of ten thousand photos have a tenth of that"""
MAGIC = b"\x93NUMPY"

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_REMEDY = "the file seems cut off or is another program's; export the cameras again"


def read_npy(path: Path) -> np.ndarray:
    """The array of an `.npy` file, as double.

    Raises:
        CaptureError: it cannot be read, is cut off, or holds anything but finite numbers.
    """
    return _array(path, "", read_bytes(path, LARGEST_FILE))


def read_npz(path: Path, wanted: str) -> dict[str, np.ndarray]:
    """The arrays of an `.npz` file whose names begin with `wanted`, by their names, as double.

    Raises:
        CaptureError: as `read_npy`; also if they are too large when unpacked.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path, LARGEST_FILE))) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.startswith(wanted)]
            if sum(entry.file_size for entry in entries) > LARGEST_FILE:
                raise CaptureError(path, "", "it is too large for cameras when unpacked", _REMEDY)
            return {
                (name := entry.filename.removesuffix(".npy")): _array(
                    path, shown(name), archive.read(entry)
                )
                for entry in entries
            }
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise CaptureError(path, "", "it cannot be unpacked", _REMEDY) from error


def _array(path: Path, field: str, content: bytes) -> np.ndarray:
    stream = io.BytesIO(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of files that Python 2 wrote
            shape, by_columns, kind = _HEADERS[np.lib.format.read_magic(stream)](stream)
        array = array_of(content[stream.tell() :], kind, shape, by_columns)
    except (
        ValueError,
        KeyError,
        TypeError,
        OverflowError,
        SyntaxError,
        tokenize.TokenError,  # of a header that Python 2 might have written
    ) as error:
        raise CaptureError(path, field, "this is not an array of numbers", _REMEDY) from error
    if not np.isfinite(array).all():
        raise CaptureError(path, field, "it holds a value that is not a number", _REMEDY)
    return array


def array_of(content: bytes, kind: np.dtype, shape: tuple[int, ...], by_columns: bool) -> np.ndarray:
    """The array, as double, whose numbers bytes begin with.

    Raises:
        ValueError, TypeError, OverflowError: they are no numbers, or fewer than its shape says.
    """
    count = math.prod(shape)
    # Without this an array of any size is set aside before its numbers are missed.
    if kind.kind not in "fiu" or min(shape, default=0) < 0:
        raise ValueError(f"its values are {kind}")
    if count * kind.itemsize > len(content):
        raise ValueError("numbers are missing")
    values = np.frombuffer(content, kind, count).astype(np.float64)
    return values.reshape(shape, order="F" if by_columns else "C")
