"""The film behind a camera that moves: which of its pictures belongs to which frame of the scene.

A film is a video or a numbered sequence of pictures, as Blender's tracker has it (a movie clip) or as an
image behind the camera. How Blender counts is in its `movieclip.cc` and `image.cc`.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bpy.types import CameraBackgroundImage, Context, Image, ImageUser, MovieClip, Object, Scene

from .cameras import FILMS, photo_path


@dataclass(frozen=True)
class Shot:
    """A film behind a camera.

    Attributes:
        file: the video, or one picture of the sequence.
        is_video: what `file` is.
        frames: those of the scene that have a picture, and in which the tracker knows the camera, in order.
        offset: added to a frame of the scene, it is the number in the picture's name, or that of the
            video's frame, counted from 0.
        size: width and height that Blender takes the film for, pixels.
        clip: the tracker's, which knows the lens; None for an image.
    """

    file: Path
    is_video: bool
    frames: Sequence[int]
    offset: int
    size: tuple[int, int]
    clip: MovieClip | None = None

    def picture(self, frame: int) -> Path:
        """The sequence's file of a frame of the scene."""
        head, number, tail = _numbered(self.file)
        return self.file.with_name(f"{head}{frame + self.offset:0{len(number)}d}{tail}")


def shot_of(item: Object, scene: Scene) -> Shot | None:
    """The film behind a camera object, or that of its Camera Solver; None if there is none."""
    film = _film_of(item, scene)
    if isinstance(film, MovieClip):
        return _of_clip(film, item, scene)
    return film and _of_image(film.image, film.image_user)


def shot_camera(context: Context) -> Object | None:
    """The camera with a film behind it that a person means: the active object, else the scene's camera.

    Panels ask whenever they are drawn.
    """
    for item in (context.view_layer.objects.active, context.scene.camera):
        if item is not None and _film_of(item, context.scene) is not None:
            return item
    return None


def _film_of(item: Object, scene: Scene) -> MovieClip | CameraBackgroundImage | None:
    if item.type != "CAMERA":
        return None
    for background in item.data.background_images:
        if background.source == "MOVIE_CLIP":
            clip = scene.active_clip if background.use_camera_clip else background.clip
            if clip is not None:
                return clip
        elif background.image is not None and background.image.source in FILMS:
            return background
    return next(_solved_clips(item, scene), None)


def _of_clip(clip: MovieClip, item: Object, scene: Scene) -> Shot:
    file, is_video = photo_path(clip), clip.source == "MOVIE"
    first = 0 if is_video else int(_numbered(file)[1] or 0)
    frames = range(clip.frame_start, clip.frame_start + clip.frame_duration)
    if clip in _solved_clips(item, scene):
        # Elsewhere than where it has solved it, the tracker makes the camera up from the nearest.
        objects = clip.tracking.objects
        views = next((o.reconstruction.cameras for o in objects if o.is_camera), ())
        solved = {view.frame + clip.frame_start - 1 for view in views}
        frames = [frame for frame in frames if frame in solved] if solved else frames
    offset = first - clip.frame_start + clip.frame_offset
    return Shot(file, is_video, frames, offset, tuple(clip.size), clip)


def _of_image(image: Image, user: ImageUser) -> Shot:
    is_video = image.source == "MOVIE"
    frames = range(user.frame_start, user.frame_start + user.frame_duration)
    # Blender's first picture has number 1.
    offset = 1 - user.frame_start + user.frame_offset - (1 if is_video else 0)
    return Shot(photo_path(image), is_video, frames, offset, tuple(image.size))


def _solved_clips(item: Object, scene: Scene) -> Iterator[MovieClip]:
    for constraint in item.constraints:
        if constraint.type == "CAMERA_SOLVER" and constraint.enabled:
            clip = scene.active_clip if constraint.use_active_clip else constraint.clip
            if clip is not None:
                yield clip


def _numbered(file: Path) -> tuple[str, str, str]:
    found = re.fullmatch(r"(.*?)(\d*)(\D*)", file.stem, re.DOTALL)
    return found[1], found[2], found[3] + file.suffix
