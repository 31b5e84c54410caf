"""What no photo shows is made of what is next to it.

The underside of what stands on something is in no photo. Nothing holds a field's materials there, and what
they are is noise, which would be the first thing to be seen of the asset when it is turned over.
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import trimesh

from .bake import SurfaceSamples
from .unwrap import Texels, UnwrappedMesh

OWN = 1e-6
"""how much a vertex's own materials count where none shows, to one neighbour's: a part of the mesh of which
no photo shows anything gets the mean of what it has"""
SURE = 1e-3
"""share of a triangle's corners, by how close they are, within which all of them are of one kind"""


def spread_into_unknown(
    mesh: trimesh.Trimesh, samples: SurfaceSamples, known: np.ndarray
) -> SurfaceSamples:
    """The samples at the mesh's V vertices with other materials where they are not `known` [V].

    There they are harmonic: each is the mean of its neighbours, by how close these are, so that the
    materials at the edges of what is known run smoothly into each other. What is known stays as it is.
    """
    unknown = np.flatnonzero(~known)
    if len(unknown) == 0:
        return samples
    first, second = mesh.edges_unique.T
    closeness = 1 / np.maximum(mesh.edges_unique_length, 1e-12)
    count = len(known)
    links = scipy.sparse.coo_array((closeness, (first, second)), shape=(count, count))
    links = (links + links.T).tocsr()[unknown]
    degree = np.maximum(links.sum(axis=1), 1e-12)
    materials = _stacked(samples).astype(np.float64)
    given = links @ (materials * known[:, None]) + OWN * degree[:, None] * materials[unknown]
    system = scipy.sparse.diags_array((1 + OWN) * degree) - links[:, unknown]
    materials[unknown] = scipy.sparse.linalg.spsolve(system.tocsc(), given)
    return _with_materials(samples, materials)


def with_unknown(
    samples: SurfaceSamples, at_vertices: SurfaceSamples, known: np.ndarray,
    mesh: UnwrappedMesh, texels: Texels, tells: Callable[[np.ndarray], np.ndarray],
) -> SurfaceSamples:  # fmt: skip
    """The samples at the texels, with materials that run into those `at_vertices` that are not known.

    Args:
        samples: at the T texels. at_vertices: see `spread_into_unknown`. known: [V] of the same vertices.
        tells: which of some texels, by their indices, are known, in triangles that have both kinds of
            vertices; a box's sides are, though all of its corners look away.
    """
    share = texels.interpolate(mesh, np.float32(known)[mesh.original])
    between = np.flatnonzero((share > SURE) & (share < 1 - SURE))
    share[between[tells(between)]] = 1
    mixed = np.flatnonzero(share < 1 - SURE)
    materials = _stacked(samples)
    around = texels.only(mixed).interpolate(mesh, _stacked(at_vertices)[mesh.original])
    materials[mixed] = around + share[mixed, None] * (materials[mixed] - around)
    return _with_materials(samples, materials)


def _stacked(samples: SurfaceSamples) -> np.ndarray:
    """Albedo, roughness and F0 as [N, 7]; roughness r = √α, as textures have it."""
    return np.concatenate([samples.albedo, np.sqrt(samples.alpha)[:, None], samples.f0], axis=1)


def _with_materials(samples: SurfaceSamples, stacked: np.ndarray) -> SurfaceSamples:
    values = stacked.astype(np.float32)
    return SurfaceSamples(values[:, :3], values[:, 3] ** 2, values[:, 4:], samples.normals)
