"""The axes along which an object's shape is simplest: a field in a box that is turned so does most with its
components.

A VM field is a sum of planes times lines along the box's axes, so what lies along them, edges and rows of
things, takes few of its components, and what lies across takes many. How many is a matter of singular
values: of the best approximation with `RANK` pairs of a plane and a line, the error is the sum of the other
ones' squares (Eckart & Young 1936, doi:10.1007/BF02288367). Files of photogrammetry have worlds that are
turned anyhow; this is what that costs, and so the box is turned (docs/decisions/0043).
"""

from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor, wait
from contextlib import closing
from threading import Event

import numpy as np
import scipy.optimize
from scipy import ndimage
from scipy.spatial.transform import Rotation

from ..threads import mapped_ahead, usable_cores
from .visual_hull import signed_distance

RANK = 4
"""pairs of a plane and a line; with 2 or 8 the same axes are found"""
NODES = 32
"""of a grid on which shapes are compared, per axis, over the sphere around the object"""
ROOM = 1.05
"""that sphere's radius, over the object's"""
RAMP = 2.0
"""nodes that the surface is wide, to either side: shapes change smoothly with turns"""
SMALL = 1e-3
"""share of a shape's energy that is added to errors: much smaller ones are all the same"""
DIRECTIONS = 7
"""of a lattice of turns, per axis of their Rodrigues vectors: about 15° apart"""
BEST, TURNED = 4, 0.12
"""turns of the lattice that are refined; and by how much at first, rad"""
TRIALS = 60
"""of each of them, at most"""
ON_LATTICE, PAUSE = 0.5, 0.1
"""share of the time that the lattice takes; and seconds after which it is told again how far the rest is"""
WORTH = 0.1
"""by how much the logarithm of the error has to fall"""


def simplest_axes(
    occupied: np.ndarray, progress: Callable[[float], None] = lambda done: None
) -> np.ndarray | None:
    """Unit rows [3, 3], a rotation: axes along which a shape is simplest; of the 24 rotations that have the
    same axes, the one that turns least. None: those of its grid are as good.

    Args:
        occupied: [K, K, K] bool, cubic cells of the shape.
        progress: called with the share done; may raise to stop.
    """
    if not occupied.any():
        return None
    shape = _Shape(occupied)
    lattice = different_turns(DIRECTIONS)
    cores, errors = usable_cores(), []
    with ThreadPoolExecutor(cores) as pool:
        with closing(mapped_ahead(pool, shape.log_error, lattice.as_matrix(), 2 * cores)) as found:
            for error in found:
                errors.append(error)
                progress(ON_LATTICE * len(errors) / len(lattice))
        chosen = lattice[np.argsort(errors, kind="stable")[:BEST]]
        refined = _all_refined(
            shape, chosen, pool, lambda done: progress(ON_LATTICE + (1 - ON_LATTICE) * done)
        )
    error, turn = min(refined, key=lambda found: found[0])
    if shape.log_error(np.eye(3)) - error < WORTH:
        return None
    same = Rotation.create_group("O") * turn
    return same[np.argmin(same.magnitude())].as_matrix()


def different_turns(count: int) -> Rotation:
    """A lattice of rotations no two of which differ by one that takes axes to axes, but at the end of
    what there are; about `count`³.

    Their Rodrigues vectors, axis · tan(angle/2), fill a cube with cut corners (Frank 1988,
    doi:10.1007/BF02649700); the middle is no turn, where `count` is odd.
    """
    reach = np.sqrt(2) - 1
    ticks = np.linspace(-reach, reach, count)
    vectors = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    vectors = vectors[np.abs(vectors).sum(axis=1) <= 1]
    return Rotation.from_quat(np.column_stack([vectors, np.ones(len(vectors))]))


def _all_refined(
    shape: "_Shape", starts: Rotation, pool: Executor, progress: Callable[[float], None]
) -> list[tuple[float, Rotation]]:
    """The least error near each of some turns, and the turn that has it."""
    tried, over = [0] * len(starts), Event()

    def error_of(turn: Rotation, number: int) -> float:
        if over.is_set():
            raise CancelledError
        tried[number] += 1
        return shape.log_error(turn.as_matrix())

    running = [
        pool.submit(_refined, start, lambda turn, n=number: error_of(turn, n))
        for number, start in enumerate(starts)
    ]
    try:
        # Told by this thread: whoever listens counts on that, and may raise.
        while wait(running, PAUSE).not_done:
            progress(min(1.0, sum(tried) / (TRIALS * len(starts))))
    finally:
        over.set()
    return [future.result() for future in running]


def _refined(start: Rotation, error_of: Callable[[Rotation], float]) -> tuple[float, Rotation]:
    """The least error near a turn, and the turn that has it."""
    first = np.vstack([np.zeros(3), TURNED * np.eye(3)])
    found = scipy.optimize.minimize(
        lambda vector: error_of(Rotation.from_rotvec(vector) * start), first[0], method="Nelder-Mead",
        options={"initial_simplex": first, "xatol": 3e-3, "fatol": 1e-3, "maxfev": TRIALS},
    )  # fmt: skip
    return found.fun, Rotation.from_rotvec(found.x) * start


class _Shape:
    """A shape that is looked at along any axes."""

    def __init__(self, occupied: np.ndarray):
        cells = np.argwhere(occupied)
        middle = (cells.min(0) + cells.max(0)) / 2
        radius = ROOM * (np.linalg.norm(cells - middle, axis=1).max() + 1)
        around = int(np.ceil(RAMP * 2 * radius / NODES)) + 1
        # Beyond, it is as far away as the ramp is wide, or further.
        self._distance = signed_distance(np.pad(occupied, around)).astype(np.float32)
        self._middle = middle + around
        ticks = ((np.arange(NODES) + 0.5) / NODES * 2 - 1) * radius
        nodes = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
        self._nodes, self._spacing = nodes.reshape(-1, 3), 2 * radius / NODES

    def log_error(self, axes: np.ndarray) -> float:
        """Logarithm of the share of the shape's energy that `RANK` components miss, in the mean of the
        three axes [3, 3] that lines may lie along."""
        at = (self._nodes @ axes + self._middle).T
        distance = ndimage.map_coordinates(self._distance, at, order=1, mode="nearest", output=np.float32)
        ramp = RAMP + np.clip(-distance / self._spacing, -RAMP, RAMP)
        ramp = ramp.reshape((NODES,) * 3)
        # A single cell is lost in its distances' smoothing.
        energy = max(float((ramp.astype(np.float64) ** 2).sum()), np.finfo(float).tiny)
        missed = [
            float(np.linalg.eigvalsh((rows @ rows.T).astype(np.float64))[:-RANK].sum())
            for rows in (np.moveaxis(ramp, axis, 0).reshape(NODES, -1) for axis in range(3))
        ]
        return float(np.mean(np.log(np.divide(missed, energy) + SMALL)))
