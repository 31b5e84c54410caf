"""A scene's cameras as other programs would have exported them: COLMAP, Metashape, Meshroom.

The world is another one (turned, scaled, moved), photos have other names, and paths are those of another
machine. For `captures.py`; the tests of the readers have their own writers.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image  # noqa: F401  before pycolmap, whose zlib would replace its own
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.frames import invert_pose, pose_opencv_from_opengl
from solver.capture.placement import placed


def another_world(seed: int) -> np.ndarray:
    """A similarity [4, 4] as structure from motion leaves one: any turn, a scale, a shift."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.uniform(0.3, 6) * Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = rng.normal(size=3) * 5
    return matrix


def scrambled(capture: Capture, folder: Path, seed: int) -> Capture:
    """The capture in another world, its photos copied to `folder` under other names, out of order."""
    rng = np.random.default_rng(seed)
    capture = placed(capture, another_world(seed))
    numbers = rng.permutation(9000)[: len(capture.cameras)] + 1000
    folder.mkdir(parents=True)
    cameras = []
    for camera, number in zip(capture.cameras, numbers, strict=True):
        photo = folder / f"DSC_{number}{camera.image_path.suffix}"
        shutil.copy(camera.image_path, photo)
        cameras.append(replace(camera, name=photo.stem, image_path=photo))
    order = rng.permutation(len(cameras))
    return replace(capture, cameras=tuple(cameras[i] for i in order))


def write_colmap(cameras: tuple[Camera, ...], folder: Path) -> None:
    """sparse/0 in binary, written by COLMAP itself."""
    import pycolmap

    model, first = pycolmap.Reconstruction(), cameras[0]
    lens = pycolmap.Camera(
        model="PINHOLE", width=first.width, height=first.height,
        params=[first.fx, first.fy, first.cx, first.cy], camera_id=1,
    )  # fmt: skip
    model.add_camera_with_trivial_rig(lens)
    for number, camera in enumerate(cameras, 1):
        world_to_camera = invert_pose(pose_opencv_from_opengl(camera.camera_to_world))
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(world_to_camera[:3, :3]), world_to_camera[:3, 3])
        image = pycolmap.Image(name=camera.image_path.name, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    target = folder / "sparse" / "0"
    target.mkdir(parents=True)
    model.write_binary(target)


def write_metashape(cameras: tuple[Camera, ...], folder: Path) -> None:
    """cameras.xml, as File › Export › Export Cameras writes it."""
    first = cameras[0]
    size = f'<resolution width="{first.width}" height="{first.height}"/>'
    lens = (
        f'<calibration type="frame" class="adjusted">{size}<f>{first.fx!r}</f>'
        f"<cx>{first.cx - first.width / 2!r}</cx><cy>{first.cy - first.height / 2!r}</cy></calibration>"
    )
    entries = []
    for number, camera in enumerate(cameras):
        matrix = pose_opencv_from_opengl(camera.camera_to_world)
        numbers = " ".join(repr(float(value)) for value in matrix.ravel())
        entries.append(
            f'<camera id="{number}" sensor_id="0" component_id="0" label="{camera.name}">'
            f"<transform>{numbers}</transform><orientation>1</orientation></camera>"
        )
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="Chunk 1" '
        f'enabled="true"><sensors next_id="1"><sensor id="0" label="unknown" type="frame">{size}{lens}'
        '</sensor></sensors><components next_id="1" active_id="0"><component id="0" label="1"/>'
        f'</components><cameras next_id="{len(cameras)}">{"".join(entries)}</cameras></chunk></document>\n',
        encoding="utf-8",
    )


def write_meshroom(cameras: tuple[Camera, ...], folder: Path) -> None:
    """cameras.sfm of version 1.2.6, as the node StructureFromMotion writes it."""
    first = cameras[0]

    def texts(values: np.ndarray) -> list[str]:
        return [repr(float(value)) for value in values]

    lens = {
        "intrinsicId": "1", "width": str(first.width), "height": str(first.height),
        "sensorWidth": "36", "sensorHeight": repr(36 * first.height / first.width),
        "type": "pinhole", "focalLength": repr(first.fx * 36 / first.width), "pixelRatio": "1",
        "principalPoint": texts([first.cx - first.width / 2, first.cy - first.height / 2]),
        "distortionParams": "", "locked": "0",
    }  # fmt: skip
    views, poses = [], []
    for number, camera in enumerate(cameras):
        key = str(100 + number)
        views.append(
            {"viewId": key, "poseId": key, "intrinsicId": "1", "width": lens["width"],
             "height": lens["height"], "path": f"D:\\scans\\object\\photos\\{camera.image_path.name}"}
        )  # fmt: skip
        matrix = pose_opencv_from_opengl(camera.camera_to_world)
        # Eigen runs down the columns of the world-to-camera rotation, which are these rows.
        transform = {"rotation": texts(matrix[:3, :3].ravel()), "center": texts(matrix[:3, 3])}
        poses.append({"poseId": key, "pose": {"transform": transform, "locked": "0"}})
    content = {"version": ["1", "2", "6"], "views": views, "intrinsics": [lens], "poses": poses}
    (folder / "cameras.sfm").write_text(json.dumps(content), encoding="utf-8")


WRITERS: dict[str, Callable[[tuple[Camera, ...], Path], None]] = {
    "COLMAP": write_colmap, "Metashape": write_metashape, "Meshroom": write_meshroom,
}  # fmt: skip


def write_project(program: str, capture: Capture, folder: Path, seed: int) -> np.ndarray:
    """Write a project; returns the similarity [4, 4] from the capture's world to the project's.

    Raises:
        ValueError: cameras have a lens with distortion, or several; projects would be without.
    """
    if len({(c.lens, c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in capture.cameras}) > 1:
        raise ValueError("a project has one camera for all photos")
    if capture.cameras[0].lens != "pinhole":
        raise ValueError(f"a project has no lens {capture.cameras[0].lens}")
    moved = scrambled(capture, folder / "photos", seed)
    WRITERS[program](moved.cameras, folder)
    return another_world(seed)
