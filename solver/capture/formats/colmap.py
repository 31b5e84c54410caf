"""COLMAP's sparse models, binary and text: cameras, images, points3D, since COLMAP 3.12 rigs and frames.

Any of the files stands for the model; the others lie beside it. Poses are camera from world with
OpenCV's axes, pixels have their centres at +0.5 as here. Photos are named below a folder that the
model does not name; it is `images` by convention.
"""

import os
from pathlib import Path
from types import ModuleType

import numpy as np

from ..frames import pose_of_opencv
from ..intake import Capture, CaptureError, Found, PhotoFinder, assemble
from . import colmap_binary, colmap_text
from .colmap_model import KINDS, Image, intrinsics_of, pose_matrix

NAME = "COLMAP"
_EXTENSIONS = (".bin", ".txt")
_FOLDERS = (
    "sparse/0/", "sparse/", "", "colmap/sparse/0/", "colmap/sparse/", "dense/sparse/",
    "dense/0/sparse/", "distorted/sparse/0/",
)  # fmt: skip
PATTERNS = tuple(f"{folder}images{extension}" for extension in _EXTENSIONS for folder in _FOLDERS)

_MOST_BESIDE = 200


def recognises(file: Path) -> bool:
    """True for any file of a model: binary by name and sanity, text by comment or structure."""
    return _kind_of(file) is not None


def read(path: Path, photos: PhotoFinder) -> Capture:
    files = _model_files(path)
    sensors = _module(files["cameras"]).read_cameras(files["cameras"])
    images = _module(files["images"]).read_images(files["images"])
    warnings = _larger_models(files["images"], len(images))
    points = None
    if "points3D" in files:
        try:
            points = _module(files["points3D"]).read_points(files["points3D"])
        except CaptureError as error:
            # Photos and poses are whole without them.
            warnings.append(f"{files['points3D'].name}: {error.problem}; its points are left out")
    poses = _Poses(files)
    folder, elsewhere = _photo_folder(path, photos), None
    found = []
    for image in images:
        stated = image.name if folder is None else f"{folder}/{image.name}"
        photo = photos.find(stated) if image.name.strip() else None
        if photo is not None and not _is_of_model(photo, files["images"], photos.folder):
            photo, elsewhere = None, photo
        intrinsics = pose = None
        if photos.serves(photo):
            if image.sensor not in sensors:
                raise CaptureError(
                    files["images"], image.where, f"there is no camera {image.sensor}",
                    "copy or export the whole model again",
                )  # fmt: skip
            intrinsics = intrinsics_of(files["cameras"], sensors[image.sensor])
            pose = pose_of_opencv(poses.of(image))
        found.append(Found(image.where, image.name, photo, pose, intrinsics))
    if elsewhere is not None and not any(item.photo for item in found):
        raise CaptureError(
            files["images"], "photos", f"the only photos there belong to another model, in "
            f"{elsewhere.parent}", f"give {elsewhere.parent.parent}, or add the photos as they were taken",
        )  # fmt: skip
    return assemble(files["images"], NAME, found, photos, points=points, warnings=tuple(warnings))


class _Poses:
    """Camera-from-world poses: the image's own, else that of its rig when the photo was taken."""

    def __init__(self, files: dict[str, Path]):
        self.files = files
        self._rigs_and_frames = None

    def of(self, image: Image) -> np.ndarray:
        """[4, 4], OpenCV's axes; NaN if nobody knows, which `assemble` refuses."""
        own = pose_matrix(image.pose)
        if np.isfinite(own).all() or not {"rigs", "frames"} <= self.files.keys():
            return own
        if self._rigs_and_frames is None:
            rigs, frames = self.files["rigs"], self.files["frames"]
            self._rigs_and_frames = _module(rigs).read_rigs(rigs), _module(frames).read_frames(frames)
        rigs, frames = self._rigs_and_frames
        rig, rig_from_world = frames.get(image.number, (None, None))
        camera_from_rig = rigs.get(rig, {}).get(image.sensor)
        if camera_from_rig is None:
            return own
        return pose_matrix(camera_from_rig) @ pose_matrix(rig_from_world)


def _kind_of(file: Path) -> str | None:
    if file.suffix.lower() == ".bin":
        kind = {kind.lower(): kind for kind in KINDS}.get(file.stem.lower())
        return kind if kind and colmap_binary.is_plausible(file, kind) else None
    return colmap_text.kind_of(file)


def _module(file: Path) -> ModuleType:
    return colmap_binary if file.suffix.lower() == ".bin" else colmap_text


def _model_files(path: Path) -> dict[str, Path]:
    """The model's files by kind: `path` itself, and what lies beside it."""
    own = _kind_of(path)
    files = {} if own is None else {own: path}
    for kind in KINDS:
        # Rigs and frames of another export could belong to another solve.
        suffixes = (path.suffix,) if kind in KINDS[3:] else (path.suffix, *_EXTENSIONS)
        for suffix in suffixes:
            if kind not in files and (beside := path.with_name(kind + suffix)).is_file():
                files[kind] = beside
    needed = [kind for kind in KINDS[:2] if kind not in files]
    if needed:
        texts = sorted(file for file in path.parent.iterdir() if file.suffix.lower() == ".txt")
        for file in texts[:_MOST_BESIDE]:
            if (kind := colmap_text.kind_of(file)) in needed:
                if kind in files:
                    raise CaptureError(
                        path, "", f"{files[kind].name} and {file.name} beside it could both be its "
                        f"{kind}", "leave one of them in the folder",
                    )  # fmt: skip
                files[kind] = file
    for kind in needed:
        if kind not in files:
            raise CaptureError(
                path, "", f"there is no {kind}{path.suffix} beside it", "copy the whole model folder"
            )
    return files


def _photo_folder(path: Path, photos: PhotoFinder) -> Path | None:
    """The folder `images` nearest the model, as far up as photos may lie.

    Copies in other sizes often lie beside it (images_2, images_4), so names alone would not do.
    """
    place = Path(os.path.abspath(path.parent))
    # Gaussian splatting keeps the photos as taken in `input`, in `images` those without distortion.
    names = ("input", "images") if "distorted" in place.parts else ("images",)
    above = [folder for folder in (place, *place.parents) if folder.is_relative_to(photos.folder)]
    for folder in above or [photos.folder]:
        for name in names:
            if (folder / name).is_dir():
                return folder / name
    return None


def _is_of_model(photo: Path, images: Path, folder: Path) -> bool:
    """False for a photo in a workspace within the capture's folder that has a model of its own beside its
    photos, such as `dense` with those without distortion, where that is not this one."""
    workspace = next((place.parent for place in photo.parents if place.name == "images"), None)
    if workspace is None or folder not in workspace.parents or not (workspace / "sparse").is_dir():
        return True
    return Path(os.path.abspath(images)).is_relative_to(workspace)


def largest(file: Path) -> Path:
    """The file like this one of the model with the most photos, of those in numbered folders (sparse/0)."""
    models = _models_beside(file.parent)
    if len(models) < 2:
        return file
    folder = max(models, key=lambda folder: models[folder])
    found = [other for other in folder.iterdir() if other.stem.lower() == file.stem.lower()]
    return found[0] if found and models[folder] > models.get(file.parent, 0) else file


def _larger_models(images: Path, count: int) -> list[str]:
    """A warning if a numbered folder beside this one (sparse/1) has a model of more photos."""
    for folder, many in _models_beside(images.parent).items():
        if many > count:
            return [f"{folder.name} beside {images.parent.name} is a model of more photos ({many} "
                    f"instead of {count})"]  # fmt: skip
    return []


def _models_beside(folder: Path) -> dict[Path, int]:
    """How many photos the models of numbered folders beside a numbered one, and its own, have."""
    if not folder.name.isdigit():
        return {}
    models = {}
    for file in sorted(folder.parent.glob("[0-9]*/images.*")):
        try:
            if file.suffix == ".bin" and colmap_binary.is_plausible(file, "images"):
                models[file.parent] = colmap_binary.count_of(file)
            elif file.suffix == ".txt" and colmap_text.kind_of(file) == "images":
                models[file.parent] = len(colmap_text.read_images(file))
        except CaptureError:
            pass  # it says so itself if it is the one to be read
    return models
