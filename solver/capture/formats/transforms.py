"""`transforms.json`: the camera file of NeRF-synthetic, instant-ngp and nerfstudio.

All three give camera-to-world matrices with OpenGL camera axes. Intrinsics come as `fl_x` (pixels),
`camera_angle_x` or instant-ngp's `x_fov`, for all frames or for each, and so does the lens's distortion.
nerfstudio's `applied_transform` says how the poses were moved before writing; the world is taken as
written, and so are the sparse points of `ply_file_path`, which were moved with it. Of its lists of frames
by their use that for training counts, `train_filenames`. Synthetic4Relight's photos are in layers, NAME_rgb
and NAME_mask of a frame NAME.
"""

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..errors import CaptureError, counted, shown
from ..fields import Entry, is_no_pose, rigid_pose
from ..files import json_head
from ..frames import pose_opengl_from_opencv
from ..image_header import image_size
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..panoramic_lens import EQUIRECTANGULAR
from ..picture_names import parts_of
from ..pinhole import pinhole_of, size_meant
from ..ply_points import read_ply_points
from ..upright import estimate_up
from .transforms_lens import focal_lengths_of_panorama, lens_entries, read_lens

NAME = "transforms.json"
PATTERNS = ("transforms_train.json", "transforms.json")

SURE = math.cos(math.radians(20))
"""cosine of the angle up to which people's idea of level and the file's up are one"""
POSSIBLE = math.cos(math.radians(60))
"""… and up to which +Z is believed to be up where a file says nothing of it: cameras that look down from
one side leave their slope open, but hardly lie on their sides"""
_LAYERS = ("_rgb", "_rgba")
_ANGLES = {"camera_angle_x", "camera_angle_y", "x_fov", "y_fov"}


def recognises(file: Path) -> bool:
    """True for JSON with frames, also if it is cut off."""
    head = json_head(file)
    if b'"viewId"' in head or b'"sfm_data_version"' in head:
        return False  # Meshroom's and OpenMVG's JSON, whatever the file is called
    if b'"camtoworld"' in head and b'"rgb_path"' in head:
        return False  # SDFStudio's
    return bool(head) and (b'"frames"' in head or file.name.lower().startswith("transforms"))


def read(path: Path, photos: PhotoFinder) -> Capture:
    content = Entry.of_file(path)
    if "frames" not in content or "views" in content or "poses" in content:
        raise content.error("frames", "there is no list of frames", "give a transforms.json")
    frames = list(content.objects("frames"))
    if not frames:
        raise content.error("frames", "the list of frames is empty")
    found, lost = [], []
    kept = _for_training(content, frames, photos)
    for frame in frames:
        where = frame.field("transform_matrix")
        stated = frame.name("file_path", "the frame names no photo", "add the photo's path")
        if kept and tuple(parts_of(stated)) not in kept:
            continue
        pose = frame.get("transform_matrix")
        if is_no_pose(pose):
            lost.append(stated)
            continue
        if content.get("from_na") is True:  # NeuS2's own, with OpenCV's axes
            pose = pose_opengl_from_opencv(rigid_pose(path, where, pose))
        photo = photos.find(stated, beside=path)
        intrinsics = mask = None
        if photo is None:  # Synthetic4Relight's are in layers
            photo = next(filter(None, (photos.find(stated + end, path) for end in _LAYERS)), None)
            mask = photo and photos.find(f"{stated}_mask", path)
        if photos.serves(photo):
            intrinsics = _intrinsics(_values(content, frame), photo)
        if photo is not None and mask is None:
            mask = photos.mask_of(photo, frame.get("mask_path") or frame.get("fg_mask_path"), path)
        found.append(
            Found(where, stated, photo, pose, intrinsics, mask,
                  photos.picture_at(frame.get("ignored_path"), path),
                  frame.get("ignored_is_black") is True)
        )  # fmt: skip
    warnings, others = (), len(frames) - len(found) - len(lost)
    if others:
        left = counted(f"{others} photo|photos")
        warnings = (f"{path.name}: {left} for validation or tests left out (train_filenames)",)
    points, problems = _points(path, content.get("ply_file_path"), photos)
    found, of_all = _without_lens_masks(path, found)
    applied = content.get("applied_transform")
    capture = assemble(
        path, NAME, found, photos, points=points, up=_up(applied), warnings=warnings + problems + of_all,
        lost=(lost, "transform_matrix"),
    )  # fmt: skip
    capture = _as_held(capture, turned=applied is not None)
    aim = capture.region.mean(0)
    depths = [c.view_direction @ (aim - c.position) for c in capture.cameras if not c.is_panoramic]
    if np.median([*depths, 0]) >= 0 or photos.anywhere:
        return capture
    told = (f"{path.name}: its cameras look away from one another; if transform_matrix has OpenCV's "
            "axes, negate its second and third columns")  # fmt: skip
    return replace(capture, warnings=(*capture.warnings, told))


def _for_training(content: Entry, frames: list[Entry], photos: PhotoFinder) -> set[tuple[str, ...]]:
    """Parts of the paths of frames that nerfstudio lists for training; none if it lists too few."""

    def parts(names: list) -> set[tuple[str, ...]]:
        return {tuple(parts_of(name)) for name in names if isinstance(name, str)}

    stated = content.get("train_filenames")
    kept = parts([frame.get("file_path") for frame in frames]) & parts(
        stated if isinstance(stated, list) else []
    )
    return kept if photos.wanted and len(kept) >= photos.fewest else set()


def write_transforms(path: Path, cameras: list[Camera], extra: dict[str, Any] | None = None) -> None:
    """Write cameras as a transforms file with intrinsics per frame; read back by `read`.

    Photos are named by the cameras' paths: where these are absolute, the file may stand anywhere on
    this machine.

    Args:
        extra: what else the file says, beside its frames.
    """
    frames = []
    for camera in cameras:
        frame: dict[str, Any] = {
            "file_path": str(camera.image_path),
            "name": camera.name,
            "transform_matrix": camera.camera_to_world.tolist(),
            "w": camera.width, "h": camera.height,
            "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
            **lens_entries(camera),
        }  # fmt: skip
        if camera.mask_path is not None:
            frame["mask_path"] = str(camera.mask_path)
        if camera.ignored_path is not None:
            frame["ignored_path"] = str(camera.ignored_path)
            frame["ignored_is_black"] = camera.ignored_is_black
        frames.append(frame)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {**(extra or {}), "frames": frames}
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def _points(path: Path, stated: Any, photos: PhotoFinder) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Sparse points [N, 3] of the world as written, and what is to be said about their file."""
    if not isinstance(stated, str) or not stated or "\0" in stated:
        return None, ()
    file = Path(os.path.normpath(path.parent / stated.replace("\\", "/")))
    inside = any(file.is_relative_to(folder) for folder in (path.parent, photos.folder))
    try:
        if not (inside or photos.anywhere) or not file.is_file():
            return None, (f"{path.name}: the points '{shown(stated)}' do not exist",)
        return read_ply_points(file), ()
    except CaptureError as error:
        return None, (str(error),)  # a fit does without them
    except (OSError, ValueError):
        return None, (f"{path.name}: '{shown(stated)}' is not a file name",)


def _up(applied_transform: Any) -> tuple[float, float, float] | None:
    """The world's direction up: +Z, or what was COLMAP's −Y where `applied_transform` turned that.

    nerfstudio turns COLMAP's world, in which the first photos' up is about −Y, by negating an axis;
    programs whose world has an up are only permuted so that it becomes +Z. None: nothing was turned.
    """
    try:
        rotation = np.array(applied_transform, dtype=np.float64)[:3, :3]
    except (TypeError, ValueError, OverflowError, IndexError):
        return 0.0, 0.0, 1.0
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        return 0.0, 0.0, 1.0
    if np.allclose(rotation, np.eye(3), atol=1e-6):
        return None
    return tuple((-rotation[:, 1] + 0.0).tolist()) if (rotation < -1e-3).any() else (0.0, 0.0, 1.0)


def _as_held(capture: Capture, turned: bool) -> Capture:
    """A capture whose up is how its cameras are held, where they disagree with the stated one.

    What nerfstudio turned to +Z may have been the first photo's up, or no up at all; and not all who write
    such files turn anything: ARKit's +Y stays up in those of NeRFCapture and nerfstudio's Record3D.

    Args:
        turned: the world was turned; else one of its axes is up where cameras are held about so.
    """
    if capture.up is None:
        return capture
    held = estimate_up(list(capture.cameras))
    if held @ capture.up > (SURE if turned else POSSIBLE):
        return capture
    nearest = np.abs(held).argmax()
    axis = np.sign(held[nearest]) * np.eye(3)[nearest]
    return replace(capture, up=held if turned or held @ axis < SURE else axis)


def _without_lens_masks(path: Path, found: list[Found]) -> tuple[list[Found], tuple[str, ...]]:
    """Cameras that ignore what is black in masks that all of a lens share, and what is to be said of these.

    No object looks the same from everywhere: nerfstudio names one picture for all frames, or for all of one
    camera of several, where the lens or a crop hides the same corners in each, and those it leaves out
    ("Black corresponds to regions to ignore", its data conventions). Frames of one pose, as photos of one
    view under several lights, may share an object's mask.
    """
    poses: dict[Path | None, set[str]] = {}
    for item in found:
        if item.photo is not None:
            poses.setdefault(item.mask, set()).add(str(item.camera_to_world))
    masks = [mask for mask in poses if mask is not None and mask.is_file()]
    of_lenses = masks and len(masks) == len(poses) and all(len(poses[mask]) > 1 for mask in masks)
    if len(found) < 3 or not (of_lenses or len(masks) == len(poses) == 1):
        return found, ()
    which = f"all frames share one mask, {masks[0].name}"
    if len(masks) > 1:
        which = f"frames share {len(masks)} masks, such as {masks[0].name}"
    return [_ignoring_its_mask(item) for item in found], (
        f"{path.name}: {which}; what hides the same corners of each photo "
        "does not show the object, so what is black in it is ignored",
    )


def _ignoring_its_mask(item: Found) -> Found:
    if item.ignored is not None:
        return replace(item, mask=None)
    return replace(item, mask=None, ignored=item.mask, ignored_is_black=True)


def _values(content: dict, frame: Entry) -> Entry:
    """A frame's own values, then the file's. How wide its own view is goes before the file's lens."""
    own = {key: value for key, value in frame.items() if value not in (None, "")}
    if "intrinsic_matrix" in own:  # NeuS2's
        lens = frame.matrix("intrinsic_matrix", (3, 3))
        lens = pinhole_of(frame.path, frame.field("intrinsic_matrix"), lens)
        own = {**dict(zip(("fl_x", "fl_y", "cx", "cy"), lens, strict=True)), **own}
    hidden = {"fl_x", "fl_y", *_ANGLES} if own.keys() & _ANGLES else ()
    shared = {key: value for key, value in content.items() if key not in hidden}
    return Entry(frame.path, frame.where, {**shared, **own})


def _intrinsics(values: Entry, image: Path | None) -> Intrinsics:
    """Size, focal lengths, principal point and lens of a frame, its own values first."""
    width, height, cx, cy = map(values.optional, ("w", "h", "cx", "cy"))
    if width is None or height is None:
        if image is None:
            raise values.error(
                "w", "neither the picture's size nor a photo of that size is there",
                "add w and h, in pixels",
            )  # fmt: skip
        width, height = image_size(image)
        if cx is not None and cy is not None:
            width, height = size_meant((width, height), cx, cy)
    width, height = int(width), int(height)
    if width < 1 or height < 1:
        raise values.error("w", "the photo has no size", "correct w and h")
    lens, distortion = read_lens(values)
    fx, fy = values.optional("fl_x"), values.optional("fl_y")
    if lens == EQUIRECTANGULAR:
        fx, fy = focal_lengths_of_panorama(values, width, height)
    elif fx is None:
        fx = _from_angle(values, "x", width)
        fy = _from_angle(values, "y", height) if fy is None else fy
    if fx is None and fy is None:
        raise values.error(
            "camera_angle_x",
            "neither the frame nor the file gives camera_angle_x or fl_x",
            "add the horizontal field of view in radians as camera_angle_x",
        )
    fx, fy = (fy if fx is None else fx), (fx if fy is None else fy)
    if fx <= 0 or fy <= 0:
        raise values.error("fl_x", "a focal length must be positive", "correct it")
    return Intrinsics(
        width, height, fx, fy, width / 2 if cx is None else cx, height / 2 if cy is None else cy,
        lens, distortion,
    )  # fmt: skip


def _from_angle(values: Entry, axis: str, pixels: int) -> float | None:
    """The focal length along an axis, in pixels, of the field of view over so many pixels; None if none is
    stated. `x_fov` is in degrees, `camera_angle_x` in radians (instant-ngp, nerf_loader.cu)."""
    for key, unit, remedy in (
        (f"{axis}_fov", math.radians(1), "give 0 to 180 degrees"),
        (f"camera_angle_{axis}", 1.0, "give 0 to 3.14 radians"),
    ):
        angle = values.optional(key)
        if angle is not None:
            if not 0 < angle * unit < math.pi:
                raise CaptureError(values.path, key, f"{angle} is not a field of view", remedy)
            return 0.5 * pixels / math.tan(0.5 * angle * unit)
    return None
