"""What a person has applied to a result's mesh (Ctrl+A): one that is installed again gets it, too."""

from itertools import product

import numpy as np
from bpy.types import Mesh
from mathutils import Matrix

AS_BUILT = "nmf_as_built"
"""on a mesh, of some outer vertices: number, x, y, z as the result has them"""
FITS = 1e-4
"""how far off a vertex may be, over the mesh's size"""


def remember_built(mesh: Mesh) -> None:
    """Keep where some vertices are, before anything is applied."""
    places = _places(mesh)
    chosen = np.unique((places @ np.array([*product((-1, 0, 1), repeat=3)]).T).argmax(0))
    mesh[AS_BUILT] = np.c_[chosen, places[chosen]].ravel().tolist()


def apply_as_to(earlier: Mesh, mesh: Mesh) -> None:
    """Apply to a mesh what was applied to an earlier one as a whole, whatever a person has sculpted of less
    than half of it; its faces go on looking outwards."""
    built, places = np.reshape(earlier.get(AS_BUILT, ()), (-1, 4)), _places(earlier)
    chosen = built[:, 0].astype(int)
    if len(built) < 5 or chosen.max() >= len(places):
        return
    before, now = np.c_[built[:, 1:], np.ones(len(built))], places[chosen]
    kept = np.flatnonzero(np.isfinite(now).all(1))
    while len(kept) > max(4, len(built) // 2):
        a, b = before[kept], now[kept]
        allowed = FITS * np.ptp(b, axis=0).max()
        matrix, _, rank, _ = np.linalg.lstsq(a, b, rcond=None)
        off = np.abs(a @ matrix - b).max(1)
        if off.max() > allowed:
            kept = np.delete(kept, off.argmax())
            continue
        if rank == 4 and np.abs(a[:, :3] - b).max() > allowed:
            motion = Matrix((*matrix.T.tolist(), (0, 0, 0, 1)))
            mesh.transform(motion)
            if motion.determinant() < 0:
                mesh.flip_normals()
        return


def _places(mesh: Mesh) -> np.ndarray:
    places = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", places)
    return places.reshape(-1, 3)
