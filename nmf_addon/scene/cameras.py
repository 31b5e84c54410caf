"""Solver cameras to Blender cameras and back. Both have OpenGL axes, so poses carry over as they are."""

import os
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Image, MovieClip, Object, Scene
from mathutils import Matrix

from ...solver.capture.camera import Camera
from ...solver.capture.errors import CaptureError
from ...solver.capture.image_header import UnknownSize, image_size
from .images import stored_path
from .panoramic_camera import PANORAMIC_TYPE, make_panoramic, panorama_of

SENSOR_WIDTH = 36.0  # mm; only its ratio to the focal length matters
LENS, DISTORTION, ASPECT, MASK = "nmf_lens", "nmf_distortion", "nmf_fy_over_fx", "nmf_mask"
MASK_FILES = "nmf_mask_files"
"""where the mask lay when the camera was imported, for a photo that is no longer beside it"""
IGNORED, IGNORED_FILES, IGNORED_IS_BLACK = ("nmf_ignored", "nmf_ignored_files", "nmf_ignored_is_black")
"""the same of what is to be ignored of the photo; and whether that is black there"""
SIZE = "nmf_size"
"""the camera's width and height, pixels; its photo's may be swapped in the file (EXIF orientation)"""
FILMS = ("SEQUENCE", "MOVIE")
"""sources of images that show another picture in every frame (see `shot`)"""
UNDISTORTED = "nmf_undistorted"
"""mark of an image that shows another one upright and without its lens' distortion"""


def add_camera(camera: Camera, image: Image | None, frame: float = 0.0) -> Object:
    """A camera object with the photo as background, which is off for a panorama; linked to nothing yet.

    Args:
        frame: see `fit_photos`.
    """
    data = bpy.data.cameras.new(camera.name)
    _fit_sensor(data, camera, frame)
    data.display_size = 0.2
    if image is not None:
        data.show_background_images = not camera.is_panoramic
        keep_behind(data, image, not camera.is_panoramic)
    data[SIZE] = [camera.width, camera.height]
    data[LENS] = camera.lens
    data[DISTORTION] = list(camera.distortion) or [0.0]
    data[ASPECT] = aspect_of(camera)
    if camera.mask_path is not None:
        _keep(data, MASK, MASK_FILES, camera.mask_path, camera.image_path)
    if camera.ignored_path is not None:
        _keep(data, IGNORED, IGNORED_FILES, camera.ignored_path, camera.image_path)
        data[IGNORED_IS_BLACK] = camera.ignored_is_black
    item = bpy.data.objects.new(camera.name, data)
    item.matrix_world = Matrix(camera.camera_to_world.tolist())
    # A view locked to the camera would take it along, and its photo would be of somewhere else.
    item.lock_location = item.lock_rotation = item.lock_scale = (True, True, True)
    return item


def _keep(data: bpy.types.Camera, name: str, files: str, mask: Path, photo: Path) -> None:
    data[name] = _beside(mask, photo)
    data[files] = sorted({stored_path(mask), str(mask)})


def _beside(mask: Path, photo: Path) -> str:
    """A mask as seen from its photo's folder, so that both may move."""
    try:
        return os.path.relpath(mask, photo.parent)
    except ValueError:  # another drive
        return str(mask)


def _mask_of(data: bpy.types.Camera, photo: Path, name: str, files: str) -> Path | None:
    """The mask of a photo: beside that, or where both lay before the photo was packed and unpacked."""
    if not data.get(name):
        return None
    beside = Path(os.path.normpath(photo.parent / data[name]))
    before = [Path(bpy.path.abspath(path, library=data.library)) for path in data.get(files, ())]
    return next((path for path in (beside, *before) if path.is_file()), beside)


def aspect_of(camera: Camera) -> float:
    """Width over height of a pixel; 1 of a panorama, whose rows and columns are angles."""
    return 1.0 if camera.is_panoramic else camera.fy / camera.fx


def _fit_sensor(data: bpy.types.Camera, camera: Camera, frame: float) -> None:
    """Intrinsics of a camera, such that the scene lies under its photo in a frame (see `fit_photos`)."""
    if camera.is_panoramic:
        make_panoramic(data, camera)
        return
    aspect = aspect_of(camera)
    tall = camera.height / aspect  # in widths of a pixel
    upright = camera.width < frame * tall
    data.sensor_fit = "VERTICAL" if upright else "HORIZONTAL"
    data.sensor_width, data.sensor_height = SENSOR_WIDTH, SENSOR_WIDTH * tall / camera.width
    data.lens = camera.fx * SENSOR_WIDTH / camera.width
    across = tall if upright else camera.width
    data.shift_x = (0.5 * camera.width - camera.cx) / across
    data.shift_y = (camera.cy - 0.5 * camera.height) / (across * aspect)


def frame_of(scene: Scene) -> float:
    """Width over height of what a scene renders."""
    render = scene.render
    width = render.resolution_x * render.pixel_aspect_x
    return width / (render.resolution_y * render.pixel_aspect_y)


def fit_photos(scene: Scene) -> None:
    """Let the scene lie under the photos of imported cameras again, after its render has got another shape.

    Blender fits a photo into the frame as a whole, so its camera needs the side of its sensor fitted that
    the frame is the narrower along.
    """
    frame = frame_of(scene)
    for item in scene.objects:
        if item.type != "CAMERA" or LENS not in item.data or item.data.library:
            continue
        with suppress(CaptureError):  # its photo has gone
            _fit_sensor(item.data, to_solver(item, Matrix.Identity(4)), frame)


def show_behind(data: bpy.types.Camera, picture: Image) -> None:
    """Of the pictures behind a camera, show one; the others are kept but off."""
    for background in data.background_images:
        background.show_background_image = background.image == picture
    data.show_background_images = True


def copy_behind(data: bpy.types.Camera) -> Image | None:
    """The undistorted copy among the pictures behind a camera."""
    images = (background.image for background in data.background_images)
    return next((image for image in images if image and image.get(UNDISTORTED)), None)


def keep_behind(data: bpy.types.Camera, picture: Image, is_shown: bool = False) -> None:
    """Add a picture to those behind a camera."""
    background = data.background_images.new()
    background.image = picture
    background.alpha = 1.0
    background.display_depth = "BACK"
    background.frame_method = "FIT"
    background.show_background_image = is_shown


def photo_of(item: Object) -> Image | None:
    """The photo among the background images of a camera object; a film is none."""
    for background in item.data.background_images:
        image = background.image
        if image is not None and image.source not in FILMS and not image.get(UNDISTORTED):
            return image
    return None


def size_of(item: Object) -> tuple[int, int]:
    """Width and height in pixels of a camera object with a photo.

    What our import left, if the photo is still of that size, upright or on its side, as far as can be read
    here; else the photo's own, for which Blender has to decode it.

    Raises:
        UnknownSize: it is a camera raw photo, and our import did not make the camera.
    """
    photo = photo_of(item)
    left = tuple(int(side) for side in item.data.get(SIZE, ()))
    try:
        lies = image_size(photo_path(photo))
    except UnknownSize:
        if left:
            return left
        raise
    except CaptureError:
        return tuple(photo.size)
    return left if left in (lies, lies[::-1]) else tuple(photo.size)


def photo_path(photo: Image | MovieClip) -> Path:
    """Where a photo or a film lies, also that of a linked camera; without '..', as the solver tells it."""
    return Path(os.path.normpath(bpy.path.abspath(photo.filepath, library=photo.library)))


def to_solver(item: Object, to_capture: Matrix) -> Camera:
    """The solver's camera of a camera object with a photo.

    Works for cameras of any origin (other importers, trackers, Alembic): intrinsics are read from
    the camera's data, distortion from properties that our own import leaves.

    Args:
        to_capture: world to capture space.

    Raises:
        CaptureError: no photo, the photo cannot be loaded, or the camera is neither a perspective one nor
            an equirectangular panorama.
    """
    image = photo_of(item)
    if image is None:
        raise CaptureError(
            item.name, "background image", "the camera has no photo", "add it as a background image"
        )
    path = photo_path(image)
    width, height = size_of(item) if path.is_file() else (0, 0)
    if width == 0:
        what, way_out = "the photo does not exist", "relink the background image"
        if image.packed_file is not None:
            what = "the photo is packed into the .blend"
            way_out = "unpack it (File > External Data)"
        if not image.filepath:
            path, what = image.name, "the image is not saved to a file"
            way_out = "save it in the Image Editor (Image > Save As)"
        raise CaptureError(path, f"photo of {item.name}", what, way_out)
    return camera_of(
        item.data, to_capture @ item.matrix_world, name=item.name, image_path=path, width=width,
        height=height, mask_path=_mask_of(item.data, path, MASK, MASK_FILES),
        ignored_path=_mask_of(item.data, path, IGNORED, IGNORED_FILES),
        ignored_is_black=bool(item.data.get(IGNORED_IS_BLACK, False)),
    )  # fmt: skip


def camera_of(
    data: bpy.types.Camera, pose: Matrix, width: int, height: int, aspect: float | None = None, **others
) -> Camera:
    """The solver's camera of what Blender's says, for a photo of a size in pixels.

    Args:
        pose: camera to capture space.
        aspect: width over height of a pixel; None: what our import left in `data`, or 1.
        others: further fields of `Camera`, such as its name; what they say goes before what our import left
            in `data`.

    Raises:
        CaptureError: it is neither a perspective camera nor an equirectangular panorama.
    """
    if data.type == PANORAMIC_TYPE:
        return Camera(
            camera_to_world=np.array(pose.normalized()), width=width, height=height,
            **(others | panorama_of(data, width, height)),
        )  # fmt: skip
    if data.type != "PERSP":
        raise CaptureError(
            data.name, "type", f"cameras of the type {data.type.title()} are not supported",
            "set its lens type to Perspective or Panoramic, if that is how its photo was taken",
        )  # fmt: skip
    aspect = float(data.get(ASPECT, 1.0)) if aspect is None else aspect
    # Blender measures in widths of a pixel, also along a column of them.
    fit, tall = data.sensor_fit, height / aspect
    across = width if fit == "HORIZONTAL" or (fit == "AUTO" and width >= tall) else tall
    sensor = data.sensor_height if fit == "VERTICAL" else data.sensor_width
    fx = data.lens * across / sensor
    lens = str(data.get(LENS, "pinhole"))
    left = {"lens": lens, "distortion": tuple(data.get(DISTORTION, ())) if lens != "pinhole" else ()}
    return Camera(
        camera_to_world=np.array(pose.normalized()), width=width, height=height, fx=fx,
        fy=fx * aspect, cx=0.5 * width - data.shift_x * across,
        cy=0.5 * height + data.shift_y * across * aspect, **(left | others),
    )  # fmt: skip
