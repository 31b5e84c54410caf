"""What the command line takes: texts to values. All raise ArgumentTypeError with what is wrong."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def placement(text: str) -> tuple[float, ...]:
    """x, y, z, scale and degrees, the last two 1 and 0 where they are not given."""
    values = tuple(number(part) for part in text.split(","))
    if not 3 <= len(values) <= 5:
        raise argparse.ArgumentTypeError("write it as X,Y,Z or X,Y,Z,SCALE or X,Y,Z,SCALE,DEGREES")
    if len(values) > 3 and values[3] <= 0:
        raise argparse.ArgumentTypeError("SCALE must be positive")
    return (*values, *(1.0, 0.0)[len(values) - 3 :])


def seconds(text: str) -> float:
    """Seconds, more than none."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be a positive number of seconds")
    return value


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """What reads whole numbers between these two."""

    def whole(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"must be a whole number from {least} to {most}")
        return int(text)

    return whole


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is no number")
    return value
