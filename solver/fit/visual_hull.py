"""The visual hull of photos with masks: where the optimisation starts, and how big the box is."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage
from torch import Tensor

from ..capture.camera import Camera
from ..capture.errors import listed
from ..field.field import MicrofacetField
from ..kernels.vm_torch import LINE_AXES, PLANE_AXES
from ..threads import mapped_ahead, usable_cores
from .seen_space import cell_centres

SEEN_BY = 0.2
"""share of the photos that see any part of the object. What stands before a camera, or in a corner of the
box, so that the others don't see it, lies inside all their masks, as it were"""


NOTHING_IN_COMMON = "no point in the region lies inside the masks of all photos"
FINER, MUCH_SMALLER = 4, 0.8
"""times that the hull's box is looked for within itself, while an edge gets shorter by this factor"""
CELLS_A_THREAD = 20_000
"""at least, of those carved side by side"""
SWEEPS = 2
THIN_CELLS = 2
"""cells around the hull within which it is not too thin for its cells' centres, but ends"""
BELONG_TOGETHER = (
    "check that masks show the object white and all else black and belong to their cameras, or enlarge the "
    "region box"
)


def not_all_masked(without: list[str], count: int) -> str:
    """What to tell of the photos `without` a mask, by name, among `count`, of which others have one."""
    return (
        f"no mask for {len(without)} of {count} photos ({listed(without)}), so the masks of the others "
        "are not used either; add the missing ones"
    )


def carve(
    cameras: list[Camera], masks: Iterable[np.ndarray], region: np.ndarray, cells: int,
    fewest: float = 0.0, whole_cells: bool = False, within: np.ndarray | None = None, spare: int = 0,
) -> np.ndarray:  # fmt: skip
    """Boolean grid [K, K, K] of cell centres of `region` [2, 3] that no mask shows as background.

    A cell outside a photo's frame is not carved by it. Laurentini 1994, doi:10.1109/34.273735.

    Args:
        masks: booleans [H, W] of the whole frame, of any size.
        fewest: share of the photos in whose frame a cell has to be.
        whole_cells: a cell stays if any part of it may, not just its centre: nothing is too thin.
        within: [K, K, K] the only cells that may stay; None: all. spare: pixels by which masks are
            taken for wider, with `whole_cells`.
    """
    points = cell_centres(region, cells)
    reach = 0.5 * float(np.linalg.norm((region[1] - region[0]) / cells)) if whole_cells else 0.0
    alive = np.arange(len(points)) if within is None else np.flatnonzero(within)
    times_seen = np.zeros(len(points), dtype=np.int32)

    def may_stay(camera: Camera, mask: np.ndarray, beside: np.ndarray | None, some: np.ndarray):
        """Which of `some` cells a photo leaves; counts those in its frame."""
        at, seen, depths = camera.pixels_of(points[some], mask.shape)
        times_seen[some] += seen
        covered = np.ones(len(some), dtype=bool)
        if beside is None:
            covered[seen] = mask[at]
        else:
            depths = camera.depths_of_scale(points[some[seen]], depths)
            per_unit = max(camera.fx, camera.fy) * mask.shape[1] / camera.width / depths
            covered[seen] = (beside[at] <= np.round(reach * per_unit) + spare) & (beside[at] >= 0)
        return some[covered]

    with ThreadPoolExecutor(usable_cores()) as pool:
        with_distances = ((mask, None) for mask in masks)
        if whole_cells:
            with_distances = mapped_ahead(pool, _and_distances, zip(masks, cameras, strict=True))
        for camera, (mask, beside) in zip(cameras, with_distances, strict=True):
            parts = np.array_split(alive, max(1, min(usable_cores(), len(alive) // CELLS_A_THREAD)))
            kept = pool.map(partial(may_stay, camera, mask, beside), parts)
            alive = np.concatenate(list(kept))
    hull = np.zeros(len(points), dtype=bool)
    hull[alive] = times_seen[alive] >= fewest * len(cameras)
    return hull.reshape(cells, cells, cells)


def _and_distances(masked: tuple[np.ndarray, Camera]) -> tuple[np.ndarray, np.ndarray]:
    """A camera's mask, and how many pixels the nearest that it shows is away from each, along rows or
    columns; of a panorama also around the sphere."""
    mask, camera = masked
    if not camera.is_panoramic:
        return mask, ndimage.distance_transform_cdt(~mask, "chessboard")
    aside = mask.shape[1] // 2
    wrapped = np.pad(~mask, ((0, 0), (aside, aside)), mode="wrap")
    distances = ndimage.distance_transform_cdt(wrapped, "chessboard")
    return mask, distances[:, aside : aside + mask.shape[1]]


def whole_hull(
    cameras: list[Camera], masks: Callable[[], Iterable[np.ndarray]], region: np.ndarray, cells: int
) -> tuple[np.ndarray, np.ndarray]:
    """The hull's cells [K, K, K] by their centres, with those of parts that are thinner than a cell; and
    all cells that any part of the object may lie in."""
    within = None
    if cells % 2 == 0:
        # Most of the box is empty, which an eighth of the cells tell; two pixels are lost in rounding.
        coarse = carve(cameras, masks(), region, cells // 2, whole_cells=True, spare=2)
        within = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    reached = carve(cameras, masks(), region, cells, SEEN_BY, whole_cells=True, within=within)
    hull = carve(cameras, masks(), region, cells, within=reached)
    near = ndimage.binary_dilation(hull, np.ones((3, 3, 3)), THIN_CELLS) if hull.any() else hull
    return hull | (reached & ~near), reached


def hull_box(
    cameras: list[Camera], masks: Callable[[], Iterable[np.ndarray]], region: np.ndarray, cells: int,
    wide: bool = True,
) -> np.ndarray | None:  # fmt: skip
    """World box [2, 3] around the hull within a region; None if masks have nothing in common there.

    Args:
        wide: the region may be much larger, and is looked through with fewer cells first.
    """
    for finer in range(FINER):
        count = cells // 2 if wide and not finer else cells
        hull = carve(cameras, masks(), region, count, SEEN_BY, whole_cells=True)
        if not hull.any():
            return None
        box = bounding_box(hull, region)
        # Once more within what is left, where cells are finer, as long as that tells more.
        smaller = ((box[1] - box[0]) < MUCH_SMALLER * (region[1] - region[0])).any()
        region = box
        if not smaller:
            break
    return region


def bounding_box(hull: np.ndarray, region: np.ndarray) -> np.ndarray:
    """World box [2, 3] around the occupied cells of a grid over `region`."""
    edge = (region[1] - region[0]) / np.array(hull.shape)
    (spans,) = ndimage.find_objects(hull.astype(np.int8))
    return region[0] + edge * [[span.start for span in spans], [span.stop for span in spans]]


def signed_distance(hull: np.ndarray) -> np.ndarray:
    """Distance in cells to the hull's boundary, negative inside."""
    outside = ndimage.distance_transform_edt(~hull)
    inside = ndimage.distance_transform_edt(hull)
    distance = np.where(hull, 0.5 - inside, outside - 0.5)
    return ndimage.gaussian_filter(distance, 1.0).astype(np.float32)


def start_from_hull(
    field: MicrofacetField, distance: Tensor, slope: float, lowest: float, highest: float
) -> None:
    """Set the field's raw density to a ramp across the hull.

    Args:
        distance: [K, K, K] signed distance in world units over the field's box, negative inside.
        slope: raw density gained per world unit of depth.
        lowest, highest: raw density far outside and deep inside.
    """
    ticks = torch.linspace(-1, 1, field.size)
    nodes = torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), dim=-1)
    ramp = (-distance * slope).clamp(lowest, highest)[None, None]
    # grid_sample orders coordinates (z, y, x) for a grid indexed [x, y, z].
    target = F.grid_sample(ramp, nodes.flip(-1)[None], align_corners=False, padding_mode="border")[0, 0]
    planes, lines = decompose(target, field.density_planes.shape[-1])
    with torch.no_grad():
        field.density_planes.copy_(planes)
        field.density_lines.copy_(lines)


def decompose(target: Tensor, components: int) -> tuple[Tensor, Tensor]:
    """VM factors [3, G, G, C], [3, G, C] of a volume [G, G, G], by singular values.

    Each of the three pairs takes a third, so that all have a share in what is learned later; then in
    turn the best approximation of what the other two leave over (block coordinate descent; for one
    pair Eckart & Young 1936 is exact).

    Components beyond the grid's size have planes of 0 and lines of others, so that they can still learn.
    """
    size = target.shape[0]
    used = min(components, size)
    orders = [(*plane, line) for plane, line in zip(PLANE_AXES, LINE_AXES, strict=True)]
    planes, lines = target.new_zeros(3, size, size, components), target.new_zeros(3, size, components)
    parts = [target / 3] * 3
    for _ in range(SWEEPS):
        for k, order in enumerate(orders):
            left = target - sum(parts[other] for other in range(3) if other != k)
            matrix = left.permute(order).reshape(size * size, size)
            _, vectors = torch.linalg.eigh((matrix.T @ matrix).double())
            vectors = vectors[:, -used:].flip(1).to(target.dtype)
            scores = matrix @ vectors
            # Plane and line of a component are to be equally large in the mean square.
            balance = (scores.norm(dim=0) / size**0.5).clamp(min=1e-6).sqrt()
            planes[k, ..., :used] = (scores / balance).view(size, size, -1)
            lines[k] = (vectors * balance)[:, torch.arange(components) % used]
            back = [order.index(axis) for axis in range(3)]
            parts[k] = (scores @ vectors.T).view(size, size, size).permute(back)
    return planes, lines
