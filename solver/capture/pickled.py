"""Matrices from Python's pickles, without doing what these say: they may name any function to be called."""

from __future__ import annotations

import io
import pickle
import re
from pathlib import Path

import numpy as np

from .errors import CaptureError
from .files import read_bytes

_NUMBERS = re.compile(r"[fiu][248]")


def matrices_in(path: Path, largest: int) -> list[np.ndarray]:
    """The arrays of numbers that a pickled list or tuple holds, as doubles of their shapes.

    Args:
        largest: bytes that the file may have.

    Raises:
        CaptureError: it cannot be read, is larger, damaged, or holds anything else.
    """
    content = read_bytes(path, largest)
    try:
        values = _Numbers(io.BytesIO(content)).load()
        if not isinstance(values, (list, tuple)):
            raise pickle.UnpicklingError("this is no list")
        return [value.array().astype(np.float64) for value in values]
    except Exception as error:  # what a damaged pickle raises has no common type
        raise CaptureError(
            path, "", "this is no pickled list of matrices, or a damaged one",
            "export the cameras again",
        ) from error  # fmt: skip


class _Numbers(pickle._Unpickler):
    """Reads lists of arrays; lists in lists could be of any size by naming each other.

    Everything that a pickle may name is one of the classes below, which only keep what they are given. This
    is the reader in Python, for that in C sets aside as much memory as a damaged file asks for.
    """

    dispatch = dict(pickle._Unpickler.dispatch)
    del dispatch[pickle.BYTEARRAY8[0]]  # so does this

    def find_class(self, module: str, name: str) -> object:
        module = module.replace("numpy._core", "numpy.core")  # its name since 2.0
        try:
            return _NAMED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"{module}.{name} is no matrix") from None


class _Type:
    """Stands for `numpy.dtype`."""

    def __init__(self, name: str = "", *_: object):
        self.name, self.byte_order = name, "|"

    def __setstate__(self, state: tuple) -> None:
        self.byte_order = state[1]


class _Array:
    """Stands for `numpy.ndarray`."""

    state: tuple = ()

    def __setstate__(self, state: tuple) -> None:
        self.state = state

    def array(self) -> np.ndarray:
        """What it stands for, if it is of numbers and as long as its shape says."""
        _, shape, type_, is_fortran, content = self.state
        if not _NUMBERS.fullmatch(type_.name):
            raise pickle.UnpicklingError(f"{type_.name} is no type of a matrix")
        flat = np.frombuffer(content, np.dtype(type_.byte_order + type_.name))
        return flat.reshape(shape, order="F" if is_fortran else "C")


def _encode(text: str, _: str) -> bytes:
    """Stands for `codecs.encode`, by which old pickles hold bytes."""
    return text.encode("latin-1")


_NAMED = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Type,
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("_codecs", "encode"): _encode,
}
