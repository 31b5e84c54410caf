"""Eight channels at once: tuples of eight numbers, which LLVM keeps in one vector register.

A loop over channels that reads and writes rows of the same arrays stays scalar, since the compiler can't
know that the rows differ. Written out, nothing is in its way (docs/decisions/0005).
"""

from __future__ import annotations

from .compiling import inlined

LANES = 8


@inlined
def load(row, at):
    """Eight numbers of a row."""
    return (
        row[at], row[at + 1], row[at + 2], row[at + 3],
        row[at + 4], row[at + 5], row[at + 6], row[at + 7],
    )  # fmt: skip


@inlined
def add_to(row, at, a):
    """row += a."""
    row[at] += a[0]
    row[at + 1] += a[1]
    row[at + 2] += a[2]
    row[at + 3] += a[3]
    row[at + 4] += a[4]
    row[at + 5] += a[5]
    row[at + 6] += a[6]
    row[at + 7] += a[7]


@inlined
def scaled(w, a):
    """w · a, w a number."""
    return (
        w * a[0], w * a[1], w * a[2], w * a[3], w * a[4], w * a[5], w * a[6], w * a[7],
    )  # fmt: skip


@inlined
def blend(v, a, w, b):
    """v · a + w · b, v and w numbers."""
    return (
        v * a[0] + w * b[0], v * a[1] + w * b[1], v * a[2] + w * b[2], v * a[3] + w * b[3],
        v * a[4] + w * b[4], v * a[5] + w * b[5], v * a[6] + w * b[6], v * a[7] + w * b[7],
    )  # fmt: skip


@inlined
def added(a, b):
    """a + b."""
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3],
        a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
    )  # fmt: skip


@inlined
def multiplied(a, b):
    """a · b, number by number."""
    return (
        a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3],
        a[4] * b[4], a[5] * b[5], a[6] * b[6], a[7] * b[7],
    )  # fmt: skip
