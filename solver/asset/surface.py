"""The surface of a density field: marching cubes, clean-up, decimation."""

from collections.abc import Callable
from typing import Protocol

import fast_simplification
import numpy as np
import skimage.measure
import trimesh

from .errors import EmptySurfaceError
from .settings import AssetSettings

EMPTY = 1e-3
"""share of a surface's extinction that is taken for that of places where nothing can be"""
SHRINK, GROW = 0.5, 0.53
"""of the way to its neighbours' middle, that a vertex goes and then comes back"""
DUST_SHARE = 1e-3
"""of the largest part's area, below which a part is a few cells that nobody misses"""


class SurfaceField(Protocol):
    """What the asset needs of a field. World units, linear Rec.709."""

    edge: float  # of its box, a cube
    voxel: float  # edge of those that the density is made of
    surrounded: bool  # photos show what is around the object, and nothing says which is which

    def density(self, points: np.ndarray) -> np.ndarray:
        """Extinction [N] per world unit at points [N, 3] float32."""

    def raw_density(self, count: int) -> np.ndarray:
        """Raw density [K, K, K] float32 at K nodes per axis, from face to face of the box; −∞ where
        nothing can be. The extinction grows with it; it is linear along the edges of voxels."""

    def from_box(self, box_points: np.ndarray) -> np.ndarray:
        """World points [N, 3] of box units, of which its edges are one."""

    def raw_level(self, extinction: float) -> float:
        """The raw density that has an extinction per world unit."""

    def normals(self, points: np.ndarray) -> np.ndarray:
        """Unit outward normals [N, 3]."""

    def seen(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """[N] true where photos show the surface at points [N, 3] with outward normals [N, 3]."""

    def known(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """[N] true where they tell what it is made of, likewise."""

    def materials(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Albedo [N, 3], GGX α [N], F0 [N, 3]."""

    def diffuse_response(self, points: np.ndarray, normals: np.ndarray, f0: np.ndarray) -> np.ndarray:
        """Diffuse radiance [N, 3] that surfaces of an albedo of 1 send; all [N, 3]."""


def extract_surface(field: SurfaceField, level: float, settings: AssetSettings) -> trimesh.Trimesh:
    """The decimated isosurface of extinction `level` in world coordinates, normals outward.

    Raises:
        EmptySurfaceError: nothing is there.
    """
    mesh = marching_cubes(field, settings.cells, level)
    if field.surrounded:
        mesh = cut_unseen(mesh, field, settings.unseen_share)
        mesh = drop_floaters(mesh, settings.shred_share)
    else:
        mesh = drop_floaters(mesh, settings.floater_share, field.known)
    return decimate(smooth(mesh, settings.smoothing), settings.triangles)


def marching_cubes(field: SurfaceField, cells: int, level: float) -> trimesh.Trimesh:
    """Isosurface of the density at `level` in the field's box (Lewiner et al. 2003).

    Runs on the raw density, on the field's own voxels, each cut into as many as `cells` per axis allow:
    along the edges of such a grid it is linear, so every vertex lies where the field has the level.
    Anything else makes thin parts thinner (docs/decisions/0003).
    """
    voxels = round(field.edge / field.voxel)
    if cells > voxels:
        cells -= cells % voxels
    raw, raw_level = field.raw_density(cells + 1), field.raw_level(level)
    if not (raw > raw_level).any():
        raise EmptySurfaceError
    empty = field.raw_level(EMPTY * level)
    # One layer of empty nodes all round closes surfaces that touch the box's border.
    values = np.pad(raw, 1, constant_values=empty)
    values[np.isneginf(values)] = empty
    vertices, faces, _, _ = skimage.measure.marching_cubes(values, raw_level)
    vertices = field.from_box((vertices - 1) / cells)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def cut_unseen(mesh: trimesh.Trimesh, field: SurfaceField, share: float) -> trimesh.Trimesh:
    """Cut off patches that no photo shows, where they are larger than `share` of all that photos show.

    Behind what photos of a room show, a field may be anything; with masks, their hull closes it.
    """
    vertex_seen = field.seen(np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals))
    seen = vertex_seen[mesh.faces].any(axis=1)
    if not seen.any():
        return mesh
    areas, kept = mesh.area_faces, seen.copy()
    most = share * areas[seen].sum()
    neighbours = mesh.face_adjacency[~seen[mesh.face_adjacency].any(axis=1)]
    unseen = trimesh.graph.connected_components(neighbours, nodes=np.flatnonzero(~seen), min_len=1)
    for patch in unseen:
        kept[patch] = areas[patch].sum() <= most
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    return mesh


def drop_floaters(
    mesh: trimesh.Trimesh, share: float, known: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
) -> trimesh.Trimesh:
    """Keep connected parts with at least `share` of the largest part's area, facing outward.

    Closed parts whose volume is negative are the inner walls of hollow bodies; nobody sees them. An open
    part, of which something was cut off, has no volume.

    Args:
        known: see `SurfaceField`; smaller parts stay, too, where photos show most of them: within masks
            those are what is left of something thin.
    """
    parts = mesh.split(only_watertight=False)
    if len(parts) <= 1:
        return mesh
    largest = max(part.area for part in parts)
    kept = [part for part in parts if part.area >= share * largest]
    if known is not None:
        small = [part for part in parts if DUST_SHARE * largest <= part.area < share * largest]
        kept += [part for part, shown in zip(small, _shares(small, known), strict=True) if shown > 0.5]
    kept = [part for part in kept if part.volume > 0 or not part.is_watertight]
    return trimesh.util.concatenate(kept) if kept else mesh


def _shares(
    parts: list[trimesh.Trimesh], known: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> list[float]:
    if not parts:
        return []
    vertices, normals = (
        np.concatenate([getattr(part, values) for part in parts])
        for values in ("vertices", "vertex_normals")
    )
    ends = np.cumsum([len(part.vertices) for part in parts])[:-1]
    return [part.mean() for part in np.split(known(vertices, normals), ends)]


def smooth(mesh: trimesh.Trimesh, rounds: int) -> trimesh.Trimesh:
    """The mesh, in place, without what waves from vertex to vertex, and as large as before (Taubin 1995,
    doi:10.1145/218380.218473): marching cubes leaves ripples of its cells (docs/decisions/0003)."""
    # trimesh's own drags what four faces share towards the origin, and borders along themselves.
    edges = np.r_[mesh.edges_unique, mesh.edges_unique[:, ::-1]]
    shares = 1 / np.bincount(edges[:, 0])[edges[:, 0]]
    middles = trimesh.graph.edges_to_coo(edges, len(mesh.vertices), shares)
    return trimesh.smoothing.filter_taubin(mesh, SHRINK, GROW, 2 * rounds, middles)


def decimate(mesh: trimesh.Trimesh, triangles: int) -> trimesh.Trimesh:
    """Quadric decimation to about `triangles` (Garland & Heckbert 1997), without the flaps of two triangles
    on the same corners that it leaves."""
    if len(mesh.faces) <= triangles:
        return mesh
    vertices, faces = fast_simplification.simplify(
        np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.int32),
        target_count=triangles,
    )  # fmt: skip
    simple = trimesh.Trimesh(vertices, faces, process=False)
    simple.update_faces(simple.nondegenerate_faces())
    corners = np.sort(simple.faces, axis=1)
    simple.update_faces(trimesh.grouping.group_rows(corners, require_count=1))
    simple.remove_unreferenced_vertices()
    return simple
