"""Matrices from Python's pickles, which are taken apart and never followed: they may name any function.

`pickletools`, made to print pickles, tells their steps. The few steps that lists of numpy's arrays have are
understood, and nothing is imported, called or made by name.
"""

import pickletools
import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from .errors import CaptureError
from .files import read_bytes
from .npy_files import array_of

_VALUES = {
    "NONE", "BININT", "BININT1", "BININT2", "BINUNICODE", "SHORT_BINUNICODE", "BINBYTES", "SHORT_BINBYTES",
    "GLOBAL",
}  # fmt: skip
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_ARRAYS = {"numpy.core.multiarray _reconstruct", "numpy._core.multiarray _reconstruct"}
"""by what numpy makes an array, before its version 2 and since"""
_NUMBERS = re.compile(r"[<>|=][fiu][248]")
_MOST_STEPS = 1000
"""of a pickle; two matrices have a hundred"""


@dataclass(eq=False)
class _Made:
    """What a pickle would have made: by the name of a function, from arguments, with a state."""

    by: object
    arguments: object
    state: object = None


def matrices_in(path: Path, largest: int) -> list[np.ndarray]:
    """The arrays of numbers that a pickled list or tuple holds, as doubles of their shapes.

    Args:
        largest: bytes that the file may have.

    Raises:
        CaptureError: it cannot be read, is larger, damaged, or holds anything else.
    """
    content = read_bytes(path, largest)
    try:
        values = _held(content)
        if not isinstance(values, (list, tuple)):
            raise ValueError("this is not a list")
        return [_array(value) for value in values]
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        raise CaptureError(path, "", "this is not a pickled list of matrices, or it is damaged") from error


def _held(content: bytes) -> object:
    """What a pickle of protocol 2 to 4 holds. What it names is a text, what that would make a `_Made`."""
    stack, marks, memo = [], [], {}

    def taken(start: int) -> list:
        if start < 0:
            raise ValueError("a step takes more than there is")
        items = stack[start:]
        del stack[start:]
        return items

    for step, value, _ in islice(pickletools.genops(content), _MOST_STEPS):
        match step.name:
            case "PROTO" | "FRAME" | "STOP":
                pass
            case name if name in _VALUES:
                stack.append(value)
            case "NEWTRUE" | "NEWFALSE":
                stack.append(step.name == "NEWTRUE")
            case "MEMOIZE" | "BINPUT" | "LONG_BINPUT":
                memo[len(memo) if value is None else value] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(memo[value])
            case "STACK_GLOBAL":
                stack.append(" ".join(taken(len(stack) - 2)))
            case "MARK":
                marks.append(len(stack))
            case "TUPLE":
                stack.append(tuple(taken(marks.pop())))
            case name if name in _TUPLES:
                stack.append(tuple(taken(len(stack) - _TUPLES[name])))
            case "EMPTY_LIST":
                stack.append([])
            case "APPEND":
                (item,) = taken(len(stack) - 1)
                stack[-1].append(item)
            case "APPENDS":
                items = taken(marks.pop())
                stack[-1].extend(items)
            case "REDUCE":
                stack.append(_Made(*taken(len(stack) - 2)))
            case "BUILD":
                made, state = taken(len(stack) - 2)
                made.state = state
                stack.append(made)
            case name:
                raise ValueError(f"{name} is not a step of a list of arrays")
    if step.name != "STOP":
        raise ValueError("it has more steps than a list of a few arrays")
    return stack[-1]


def _array(value: object) -> np.ndarray:
    """The array, double, that a pickle would have made."""
    match value:
        case _Made(by, _, (_, shape, kind, by_columns, content)) if by in _ARRAYS:
            return array_of(_bytes(content), _type(kind), shape, by_columns)
    raise ValueError("this is not an array")


def _type(value: object) -> np.dtype:
    match value:
        case _Made("numpy dtype", (str(kind), *_), (_, str(order), *_)) if _NUMBERS.fullmatch(order + kind):
            return np.dtype(order + kind)
    raise ValueError("this is not a type of numbers")


def _bytes(value: object) -> bytes:
    """Bytes, which protocol 2 holds as a text."""
    match value:
        case bytes():
            return value
        case _Made("_codecs encode", (str(text), "latin1")):
            return text.encode("latin-1")
    raise ValueError("these are not bytes")
