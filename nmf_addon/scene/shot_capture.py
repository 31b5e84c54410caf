"""A capture of a camera that moves: one camera for each picture of the film behind it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from bpy.types import Collection, Context, Object, Scene

from ...solver.cameras.folder import FEWEST_PHOTOS
from ...solver.capture.camera import Camera
from ...solver.capture.capture import evenly_taken
from ...solver.capture.errors import CaptureError, counted
from ...solver.capture.formats.transforms import write_transforms
from ...solver.capture.image_header import image_size
from .cameras import camera_of
from .clip_lens import lens_of
from .evaluated import evaluated
from .import_captures import import_captures
from .shot import Shot

STANDS_STILL = 1e-6
"""difference of two cameras' matrices up to which they are one view"""


def pictures_of(shot: Shot, frames: Sequence[int], count: int) -> dict[int, Path]:
    """Pictures of a sequence by their frames of the scene: so many at most, evenly over `frames`.

    Raises:
        CaptureError: hardly any are there.
    """
    there = [frame for frame in frames if shot.picture(frame).is_file()]
    if len(there) < FEWEST_PHOTOS:
        raise CaptureError(
            shot.file, "frames",
            "only " + counted(f"{len(there)} of the {len(frames)} pictures of the sequence exists|exist"),
            "relink it, or choose other frames",
        )  # fmt: skip
    chosen = (there[place] for place in evenly_taken(len(there), count))
    return {frame: shot.picture(frame) for frame in chosen}


def photos_in(shot: Shot, folder: Path) -> dict[int, Path]:
    """What `solver frames` has taken from a video, by their frames of the scene; those of the shot."""
    photos = sorted(path for path in folder.iterdir() if path.stem.startswith("frame_"))
    found = {int(path.stem.rpartition("_")[2]) - shot.offset: path for path in photos}
    return {frame: path for frame, path in found.items() if frame in shot.frames}


def capture_shot(
    context: Context, item: Object, shot: Shot, photos: dict[int, Path], file: Path
) -> Collection:
    """Make a capture of a camera and its photos, where it stands in the scene.

    Args:
        photos: by their frames of the scene.
        file: where its cameras are written to; a new `transforms_train.json`.

    Raises:
        CaptureError: the camera stands still, or a photo cannot be read.
    """
    cameras = cameras_along(context, item, shot, photos)
    if len(cameras) < FEWEST_PHOTOS:
        raise CaptureError(
            item.name, "motion", "the camera hardly moves over these frames",
            "choose other frames, or track the camera first",
        )  # fmt: skip
    write_transforms(file, cameras)
    folder = next(iter(photos.values())).parent
    return import_captures(context, [file], photos=folder, as_they_stand=True)[0]


def cameras_along(context: Context, item: Object, shot: Shot, photos: dict[int, Path]) -> list[Camera]:
    """The camera object at the frames of its photos, in the world, without those where it has not moved on.

    The scene stays at its frame.

    Raises:
        CaptureError: a photo cannot be read, or lies on its side for what was tracked.
    """
    scene, before = context.scene, context.scene.frame_current_final
    aspect = _aspect(shot, scene)
    lens, distortion = ("pinhole", ()) if shot.clip is None else lens_of(shot.clip)
    progress = context.window_manager
    progress.progress_begin(0, len(photos))
    cameras: list[Camera] = []
    try:
        with evaluated(item):
            for number, (frame, path) in enumerate(sorted(photos.items())):
                progress.progress_update(number)
                scene.frame_set(frame)
                seen = item.evaluated_get(context.evaluated_depsgraph_get())
                width, height = _size(path, shot)
                camera = camera_of(
                    seen.data, seen.matrix_world, width, height, aspect=aspect,
                    name=path.stem, image_path=path, lens=lens, distortion=distortion,
                )  # fmt: skip
                if not cameras or _has_moved(cameras[-1], camera):
                    cameras.append(camera)
    finally:
        progress.progress_end()
        scene.frame_set(int(before // 1), subframe=before % 1)
    return cameras


def _size(path: Path, shot: Shot) -> tuple[int, int]:
    width, height = image_size(path)
    if shot.is_video and (width - height) * (shot.size[0] - shot.size[1]) < 0:
        raise CaptureError(
            path, "size", f"it is {width} × {height} pixels, but Blender says {shot.size[0]} × "
            f"{shot.size[1]} of {shot.file.name}", "convert the video so that it is stored upright",
        )  # fmt: skip
    return width, height


def _aspect(shot: Shot, scene: Scene) -> float:
    """Width over height of a picture's pixels."""
    if shot.is_video:
        return 1.0  # its frames are taken with square ones
    if shot.clip is not None:
        return shot.clip.tracking.camera.pixel_aspect
    return scene.render.pixel_aspect_x / scene.render.pixel_aspect_y


def _has_moved(before: Camera, camera: Camera) -> bool:
    return not np.allclose(
        before.camera_to_world, camera.camera_to_world, rtol=STANDS_STILL, atol=STANDS_STILL
    )
