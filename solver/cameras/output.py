"""What a solve leaves: cameras as a transforms file, sparse points as a PLY."""

import os
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from ..capture.camera import Camera
from ..capture.formats.transforms import write_transforms
from ..replacing import replace_file
from .folder import SolveFolder


def write_cameras(folder: SolveFolder, photos: Path, cameras: list[Camera]) -> None:
    """Write the transforms file; it is complete once it is there.

    Photos are named relative to the file where one stands below the other, as other programs expect;
    else relative to their own folder. So are pictures of what is to be ignored that lie below that;
    no reader takes others on a file's word.

    Args:
        cameras: with `image_path` below `photos`.
    """
    root = photos.absolute()
    near = folder.root.is_relative_to(root) or root.is_relative_to(folder.root)
    start = folder.root if near else root

    def name(path: Path | None) -> PurePosixPath | None:
        if path is None or not path.is_relative_to(root):
            return None
        return PurePosixPath(Path(os.path.relpath(path, start)).as_posix())

    named = [replace(c, image_path=name(c.image_path), ignored_path=name(c.ignored_path)) for c in cameras]
    part = folder.cameras_path.with_suffix(".part")
    write_transforms(part, named, {"ply_file_path": folder.points_path.name})
    replace_file(part, folder.cameras_path)


def write_points(path: Path, points: np.ndarray, colours: np.ndarray) -> None:
    """Write points [N, 3] with colours [N, 3] uint8 as a binary PLY."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    rows = np.zeros(len(points), dtype=[("position", "<f4", 3), ("colour", "u1", 3)])
    rows["position"], rows["colour"] = points, colours
    path.write_bytes(header.encode("ascii") + rows.tobytes())
