"""A finished result on disk: where it is, whether it is whole, its mesh. No bpy in here."""

import os
from pathlib import Path

import numpy as np

from ...solver.job.folder import JobFolder
from ...solver.job.request import JobError, is_similarity

TEXTURES = ("albedo", "f0", "roughness", "normal")
PORTABLE_TEXTURES = ("base_colour", "metallic")
"""for what knows F0 as a metal's colour alone; results of before have none"""


def job_of_result(folder: Path) -> JobFolder:
    """The job that a folder is, is part of (JOB/result), or was exported from: then a job of nothing
    but its result."""
    job = JobFolder(os.path.abspath(folder))  # paths are compared
    if job.is_complete() or not (job.root / "manifest.json").is_file():
        return job
    around = JobFolder(job.root.parent)
    if job.root == around.result_dir:
        return around
    job.result_dir, job.manifest_path = job.root, job.root / "manifest.json"
    return job


def read_manifest(job: JobFolder) -> dict:
    """The manifest of a job's result.

    Raises:
        JobError: there is no complete result, the manifest lacks something, or a file is missing.
    """
    manifest = job.manifest()
    try:
        files = [manifest["mesh"], manifest["environment"]["file"]]
        textures = [manifest["textures"][name] for name in textures_of(manifest)]
        files += [texture["file"] for texture in textures]
        spaces = [texture["colour_space"] for texture in textures]
        scale = float(manifest["textures"]["f0"]["scale"])
        origin = [float(value) for value in manifest.get("origin", (0, 0, 0))]
        if not is_similarity(manifest.get("placement", np.eye(4).tolist())):
            raise ValueError("placement")
        if not all(isinstance(text, str) for text in files + spaces):
            raise TypeError("a name is not text")
        if not (np.isfinite([scale, *origin]).all() and scale > 0 and len(origin) == 3):
            raise ValueError("scale or origin")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise JobError(f"{job.manifest_path}: it is incomplete ({error}); run the job again.") from error
    missing = [name for name in files if not (job.result_dir / name).is_file()]
    if missing:
        raise JobError(f"{job.result_dir}: {missing[0]} is missing; copy the whole job folder.")
    return manifest


def textures_of(manifest: dict) -> tuple[str, ...]:
    """Names of the textures that a result has or has to have."""
    portable = all(name in manifest["textures"] for name in PORTABLE_TEXTURES)
    return TEXTURES + PORTABLE_TEXTURES if portable else TEXTURES


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions, normals [V, 3], UVs [V, 2] and triangles [F, 3] of the solver's mesh.ply.

    Raises:
        JobError: the file is cut off or of another layout.
    """
    data = path.read_bytes()
    header, marker, body = data.partition(b"end_header\n")
    words = [line.split() for line in header.decode("ascii", "replace").splitlines()]
    counts = {w[1]: int(w[2]) for w in words if len(w) == 3 and w[0] == "element" and w[2].isdigit()}
    names = [w[2] for w in words if len(w) == 3 and w[0] == "property"]
    vertices, triangles = counts.get("vertex", 0), counts.get("face", 0)
    if marker and names == "x y z nx ny nz s t".split() and len(body) == vertices * 32 + triangles * 13:
        vertex = np.frombuffer(body, "<f4", vertices * 8).reshape(-1, 8)
        face = np.frombuffer(body, [("n", "u1"), ("v", "<i4", 3)], triangles, vertices * 32)
        corners = np.ascontiguousarray(face["v"])
        # A negative number is a huge one without its sign.
        are_there = corners.size and corners.view("<u4").max() < vertices
        if are_there and (face["n"] == 3).all() and np.isfinite(vertex).all():
            return vertex[:, :3], vertex[:, 3:6], vertex[:, 6:], corners
    raise JobError(f"{path}: the mesh is damaged or from another program; run the job again.")
