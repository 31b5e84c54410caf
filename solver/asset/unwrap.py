"""UV coordinates by xatlas, and which texel shows which point of the surface."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
import xatlas

from ..capture.frames import scale_and_rotation

LEAST_CHARTS = 30
"""xatlas grows a chart in time with the square of its triangles: without a limit to their area, a smooth
surface of 40,000 takes four times as long, for 15 % more of the texture in use"""


@dataclass(frozen=True)
class UnwrappedMesh:
    """A mesh with UVs; vertices are doubled along seams.

    Attributes:
        positions, normals: [V, 3] float32, world; normals smooth and outward.
        uvs: [V, 2] float32 in [0, 1], origin at the bottom left.
        faces: [F, 3] int32.
        original: [V] the vertex of the mesh before the seams were cut.
    """

    positions: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray
    faces: np.ndarray
    original: np.ndarray

    def placed(self, matrix: np.ndarray) -> "UnwrappedMesh":
        """The mesh in another world: `matrix` [4, 4] is a similarity from its own to that."""
        if np.array_equal(matrix, np.eye(4)):
            return self
        rotation = scale_and_rotation(matrix)[1]
        positions = self.positions @ matrix[:3, :3].T + matrix[:3, 3]
        return replace(
            self, positions=positions.astype(np.float32),
            normals=(self.normals @ rotation.T).astype(np.float32),
        )  # fmt: skip


def unwrap(mesh: trimesh.Trimesh, normals: np.ndarray, texture_size: int) -> UnwrappedMesh:
    """Cut charts and pack them for a square texture; `normals` [V, 3] belong to the vertices."""
    atlas = xatlas.Atlas()
    # Of area 1: triangles of less than some 1e-7 get no UVs, which in metres those of a cup are.
    shape = (mesh.vertices - mesh.centroid) / np.sqrt(mesh.area)
    atlas.add_mesh(
        shape.astype(np.float32), np.asarray(mesh.faces, dtype=np.uint32),
        np.asarray(normals, dtype=np.float32),
    )  # fmt: skip
    charts, pack = xatlas.ChartOptions(), xatlas.PackOptions()
    charts.max_iterations = 1
    charts.max_chart_area = 1 / LEAST_CHARTS
    pack.resolution, pack.padding, pack.bilinear = texture_size, 4, True
    pack.create_image = False
    atlas.generate(charts, pack)
    original, faces, uvs = atlas[0]
    return UnwrappedMesh(
        positions=np.asarray(mesh.vertices, dtype=np.float32)[original],
        normals=np.asarray(normals, dtype=np.float32)[original],
        uvs=uvs.astype(np.float32), faces=faces.astype(np.int32), original=original,
    )  # fmt: skip


@dataclass(frozen=True)
class Texels:
    """Covered texels of a texture.

    Attributes:
        row, column: [T] row 0 on top.
        face: [T] triangle. barycentric: [T, 3].
    """

    row: np.ndarray
    column: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray

    def only(self, chosen: np.ndarray) -> "Texels":
        """Some of them, by their indices."""
        return Texels(self.row[chosen], self.column[chosen], self.face[chosen], self.barycentric[chosen])

    def interpolate(self, mesh: UnwrappedMesh, values: np.ndarray) -> np.ndarray:
        """Vertex values [V, …] at the texels [T, …]."""
        return np.einsum("tk,tk...->t...", self.barycentric, values[mesh.faces[self.face]])


def rasterise(mesh: UnwrappedMesh, size: int) -> Texels:
    """The texels whose centre lies in a triangle of the UV map, by bounding box, vectorised."""
    corners = mesh.uvs[mesh.faces] * size
    corners[..., 1] = size - corners[..., 1]
    low = np.floor(corners.min(1) - 0.5).astype(np.int64).clip(0, size - 1)
    high = np.ceil(corners.max(1) + 0.5).astype(np.int64).clip(1, size)
    extent = high - low
    counts = extent[:, 0] * extent[:, 1]
    face = np.repeat(np.arange(len(counts)), counts)
    index = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    column = low[face, 0] + index % extent[face, 0]
    row = low[face, 1] + index // extent[face, 0]
    a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
    point = np.stack([column + 0.5, row + 0.5], axis=-1)

    def cross(p, q):
        return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]

    area = cross(b - a, c - a)
    safe = np.where(np.abs(area) < 1e-12, 1.0, area)
    barycentric = np.stack([cross(b - point, c - point), cross(c - point, a - point)], -1)
    barycentric = barycentric / safe[:, None]
    barycentric = np.concatenate([barycentric, 1 - barycentric.sum(1, keepdims=True)], axis=1)
    inside = (barycentric >= -1e-6).all(1) & (np.abs(area) >= 1e-12)
    texel = row[inside] * size + column[inside]
    _, first = np.unique(texel, return_index=True)
    kept = np.flatnonzero(inside)[first]
    return Texels(row[kept], column[kept], face[kept], barycentric[kept].astype(np.float32))
