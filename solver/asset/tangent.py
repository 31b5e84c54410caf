"""Tangent frames of a UV-mapped mesh and tangent-space normals in them.

Per-vertex tangents are the angle-weighted mean of the triangles' ∂position/∂u, the bitangent is
sign · n × t of the interpolated vectors, not renormalised: as MikkTSpace (Mikkelsen 2008), which
Blender and glTF viewers use to decode.
"""

import numpy as np

from ..capture.frames import unit
from .unwrap import Texels, UnwrappedMesh


def vertex_tangents(mesh: UnwrappedMesh) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangents [V, 3] and bitangent signs [V]."""
    p, t = mesh.positions[mesh.faces].astype(np.float64), mesh.uvs[mesh.faces].astype(np.float64)
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    d1, d2 = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    tangent = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) * np.sign(area)[:, None]
    tangents = np.zeros((len(mesh.positions), 3))
    signs = np.zeros(len(mesh.positions))
    for k in range(3):
        vertex = mesh.faces[:, k]
        normal = mesh.normals[vertex].astype(np.float64)
        flat = unit(tangent - (tangent * normal).sum(1, keepdims=True) * normal, 1e-20)
        a, b = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        a -= (a * normal).sum(1, keepdims=True) * normal
        b -= (b * normal).sum(1, keepdims=True) * normal
        cosine = (a * b).sum(1) / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-20)
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(tangents, vertex, flat * angle[:, None])
        np.add.at(signs, vertex, np.sign(area) * angle)
    lost = np.linalg.norm(tangents, axis=1) < 1e-12
    tangents[lost] = np.cross(mesh.normals[lost], (0.3, 0.5, 0.8))
    tangents = unit(tangents, 1e-20)
    return tangents.astype(np.float32), np.where(signs < 0, -1.0, 1.0).astype(np.float32)


def texel_frames(mesh: UnwrappedMesh, texels: Texels) -> np.ndarray:
    """Rows tangent, bitangent, normal [T, 3, 3] at the texels, as a renderer interpolates them."""
    tangents, signs = vertex_tangents(mesh)
    tangent = texels.interpolate(mesh, tangents)
    normal = texels.interpolate(mesh, mesh.normals)
    sign = signs[mesh.faces[texels.face, 0]][:, None]
    return np.stack([tangent, sign * np.cross(normal, tangent), normal], axis=1)


def encode_normals(normals: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Tangent-space normals [T, 3] as colours in [0, 1] (+Y up) of world normals [T, 3]."""
    # The frame is not orthonormal: decoding multiplies by it, so encoding must invert it.
    local = np.linalg.solve(np.swapaxes(frames, 1, 2).astype(np.float64), normals[..., None])[..., 0]
    return unit(local, 1e-12) * 0.5 + 0.5
