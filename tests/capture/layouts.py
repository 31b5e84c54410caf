"""Captures in the layouts of networks for multi-view stereo, of sparse voxel fields, and of ScanNet."""

import shutil
from pathlib import Path

import numpy as np

from solver.capture.frames import pose_opencv_from_opengl
from tests.capture.programs import numbers

DUCK = Path(__file__).parents[2] / "samples" / "duck"
DEPTHS = "425.0 2.5"


def rows(matrix):
    return "\n".join(numbers(row) for row in matrix)


def matrix_of(fx, fy, cx, cy, size=3):
    matrix = np.eye(size)
    matrix[:2, :3] = (fx, 0, cx), (0, fy, cy)
    return matrix


def write(file, text):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def write_mvsnet(folder, poses, lens, cams="cams", depths=DEPTHS, name="{:08d}_cam.txt"):
    """`poses` camera to world [N, 4, 4] with OpenCV's axes, `lens` fx fy cx cy."""
    for index, pose in enumerate(poses):
        extrinsic, intrinsic = rows(np.linalg.inv(pose)), rows(matrix_of(*lens))
        write(
            folder / cams / name.format(index),
            f"extrinsic\n{extrinsic}\n\nintrinsic\n{intrinsic}\n\n{depths}\n",
        )
    write(folder / cams / "pair.txt", f"{len(poses)}\n0\n2 1 2346.4 2 2036.5\n")
    return folder


def write_poses(folder, stems, poses, lens, lens_file="intrinsics.txt", lens_text=None):
    """`poses` camera to world [N, 4, 4] with OpenCV's axes, `lens` fx fy cx cy."""
    for stem, pose in zip(stems, poses, strict=True):
        write(folder / "pose" / f"{stem}.txt", rows(pose) + "\n")
    write(folder / lens_file, rows(matrix_of(*lens, 4)) if lens_text is None else lens_text)
    return folder


def rewritten(capture, folder, layout):
    """A capture of one lens in another layout: 'MVSNet', 'NSVF' or 'ScanNet'."""
    first = capture.cameras[0]
    lens = first.fx, first.fy, first.cx, first.cy
    poses = pose_opencv_from_opengl(np.stack([c.camera_to_world for c in capture.cameras]))
    place, form = {
        "MVSNet": ("images", "{:08d}"), "NSVF": ("rgb", "0_train_{:04d}"), "ScanNet": ("color", "{}")
    }[layout]  # fmt: skip
    stems = [form.format(index) for index in range(len(poses))]
    if layout == "MVSNet":
        write_mvsnet(folder, poses, lens)
    else:
        lens_file = "intrinsics.txt" if layout == "NSVF" else "intrinsic/intrinsic_color.txt"
        write_poses(folder, stems, poses, lens, lens_file)
    (folder / place).mkdir()
    for stem, camera in zip(stems, capture.cameras, strict=True):
        shutil.copy(camera.image_path, folder / place / f"{stem}{camera.image_path.suffix}")
    return folder


def check_same_cameras(capture, original):
    """Poses, lenses and the pixels of points are the same in both, camera by camera."""
    assert len(capture.cameras) == len(original.cameras)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    for camera, other in zip(capture.cameras, original.cameras, strict=True):
        np.testing.assert_allclose(camera.camera_to_world, other.camera_to_world, atol=1e-6)
        np.testing.assert_allclose(camera.project(points)[0], other.project(points)[0], atol=1e-6)
        assert (camera.width, camera.height) == (other.width, other.height)
        assert camera.image_path.read_bytes() == other.image_path.read_bytes()
