"""Sparse points as a reader comes by them: a file may hold more than anyone needs."""

from array import array

import numpy as np

MOST_POINTS = 500_000
"""from twice as many on, every second is dropped; they only tell where the object is"""


class SparsePoints:
    """Points one by one, of which every 2ⁿ-th is kept when there are too many."""

    def __init__(self):
        self._kept, self._stride, self._seen = array("d"), 1, 0

    def add(self, x: float, y: float, z: float) -> None:
        if self._seen % self._stride == 0:
            self._kept.extend((x, y, z))
            if len(self._kept) >= 6 * MOST_POINTS:
                self._kept = array("d", self.array()[::2].tobytes())
                self._stride *= 2
        self._seen += 1

    def array(self) -> np.ndarray:
        """[N, 3] double, world."""
        return np.array(self._kept, dtype=np.float64).reshape(-1, 3)
