"""Find the camera file a person meant and read it, whatever program wrote it."""

import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType

from .archives import check_unpacked
from .capture import Capture
from .errors import CaptureError, shown
from .files import check_readable
from .formats import co3d, colmap, meshroom, nerfactor
from .ignored import check_given
from .image_header import EXTENSIONS as PICTURES
from .no_capture import PROJECTS, no_camera_file, nothing_in, several_in
from .photo_finder import MIN_PHOTOS, MODEL_FOLDERS, PhotoFinder, capture_folder, folder_with_photos
from .picture_names import JOBS_FOLDER, pictures_below

_NAMES = (
    "transforms colmap metashape realitycapture meshroom openmvg opensfm opendronemap blocks_exchange "
    "opf pix4d polycam record3d scanner_app stray_scanner bundler visualsfm neus sdfstudio neilf "
    "gaussians llff mvsnet dtu middlebury pose_folder nerfies nero nerfactor kapture lit_objects "
    "camera_dictionary bop co3d"
)
FORMATS = tuple(import_module(f"{__package__}.formats.{name}") for name in _NAMES.split())
"""readers, the likeliest first"""
_EXTENSIONS = {reader: {Path(pattern).suffix for pattern in reader.PATTERNS} for reader in FORMATS}
CAMERA_FILES = tuple(sorted({*PROJECTS}.union(*_EXTENSIONS.values()) - {""}))
"""extensions of camera files, for file dialogs and drops; and of projects, to tell what to export"""

_FILES_OF_SPLIT = {
    "train": ("transforms_train.json", "transforms.json"),
    "test": ("transforms_test.json", "transforms_val.json"),
    "val": ("transforms_val.json", "transforms_test.json"),
}
_SPLITS = ("train", "test", "val", "validation")
"""folders of one capture's photos that are for different uses"""
_AROUND = tuple(
    f"{folders}{name}"
    for folders in ("*/", "*/*/")
    for name in (
        *_FILES_OF_SPLIT["train"], "cams/00000000_cam.txt", "intrinsics.txt",
        "intrinsic/intrinsic_color.txt", "scene_camera.json", "K.txt",
    )
)  # fmt: skip
"""of a folder around a capture's, as archives have it"""
_DEEPEST, _MOST_TRIED = 3, 2000
_FAULTS = (ArithmeticError, LookupError, TypeError, ValueError, MemoryError, RecursionError)
_SIDECAR = ".xmp"
"""of files that lie beside photos, in as many folders as these, as NeRFactor's do"""
_HELD_OUT = re.compile(r"(?<![a-z])(test|val|validation|eval)(?![a-z])", re.I)
"""in names of files that are for others than the training photos: those come last"""


def camera_file(path: Path | str, split: str = "train") -> Path:
    """The camera file meant by a folder or a file's path.

    A folder is searched for files by their conventional names, then for any file that a reader
    recognises by what is in it.

    Raises:
        CaptureError: nothing there, or half of an archive.
    """
    path = Path(path)
    check_unpacked(path)
    if path.is_file():
        return path
    if not path.exists():
        raise CaptureError(path, "", "there is no such file or folder", "check the path")
    wanted = _FILES_OF_SPLIT.get(split, (f"transforms_{split}.json",))
    for name in wanted:
        if (path / name).is_file():
            return path / name
    try:
        empty = not any(path.iterdir())
    except OSError as error:
        raise CaptureError(
            path, "", f"it cannot be read ({error.strerror})", "check its permissions"
        ) from error
    if empty:
        raise CaptureError(path, "", "the folder is empty", "give a folder with photos and cameras")
    if split == "train" and (file := _search(path)) is not None:
        _check_alone(path, file)
        # Who names a project means its largest model, who names the folder of a model means that.
        return colmap.largest(file) if file.parent != path and reader_of(file) is colmap else file
    if split == "train":
        if (above := path.absolute().with_name(co3d.FILE)).is_file():
            return above  # this is one of its sequences
        raise nothing_in(path, _FILES_OF_SPLIT["train"])
    raise CaptureError(
        path, "", f"there is no camera file for '{split}' in this folder", f"add {' or '.join(wanted)}"
    )


def held_out_file(path: Path | str) -> Path | None:
    """The camera file of photos held out from a capture; None if there is none, or it is the capture.

    Args:
        path: the capture's folder or camera file.
    """
    path = Path(path)
    file = (path if path.is_dir() else path.parent) / "transforms_test.json"
    return file if file.is_file() and not (path.is_file() and file.samefile(path)) else None


def read_capture(
    path: Path | str, split: str = "train", photos: Path | None = None, masks: Path | None = None,
    trusted: bool = False, fewest: int = MIN_PHOTOS, wanted: bool = True, ignored: Path | None = None,
) -> Capture:  # fmt: skip
    """Read a capture from a folder or a camera file.

    Args:
        split: which camera file of a folder: 'train', 'test', …, by conventional names.
        photos: where the photos are, if not below the capture's folder.
        masks: where their masks are, if not in a folder `masks` there.
        trusted: this program wrote the file; it may name photos anywhere by absolute paths.
        fewest: cameras that there must be; those of pictures to be made may be fewer than a capture's.
        wanted: leave out cameras without photos; else all are meant for pictures that are to be made, and
            photos are asked for their size at most.
        ignored: a folder of pictures that are white where photos are to be ignored, or one for all photos.

    Raises:
        CaptureError: with file, field and remedy.
    """
    file = camera_file(path, split).absolute()
    reader = reader_of(file)
    if reader is None:
        check_readable(file)
        raise no_camera_file(file, [known.NAME for known in FORMATS])
    check_given(*(None if given is None else Path(given) for given in (photos, masks, ignored)))
    if photos is not None:
        folder = Path(photos)
    else:
        folder = Path(path) if Path(path).is_dir() else capture_folder(file)
    how = {"masks": masks, "anywhere": trusted, "fewest": fewest, "wanted": wanted, "ignored": ignored}
    finder = PhotoFinder(folder, **how)
    if photos is None and MODEL_FOLDERS.fullmatch(finder.folder.name) and not finder.pictures():
        # The folder of the model was given, not that of the capture.
        finder = PhotoFinder(capture_folder(file), **how)
    try:
        return _read(reader, file, finder)
    except CaptureError:
        # A folder that is called as a model's may be the capture's own, beside others of its kind.
        own = finder.folder if photos is not None else folder_with_photos(file)
        if own != finder.folder:
            with suppress(CaptureError):
                return _read(reader, file, PhotoFinder(own, **how))
        raise


def _read(reader: ModuleType, file: Path, finder: PhotoFinder) -> Capture:
    try:
        return reader.read(file, finder)
    except _FAULTS as error:
        if isinstance(error, CaptureError):
            raise
        # A reader must foresee what a file can hold; where one does not, nobody sees a traceback.
        why = shown(str(error)) or type(error).__name__  # a MemoryError says nothing
        raise CaptureError(file, "", f"it cannot be read as {reader.NAME} ({why})") from error


def reader_of(file: Path) -> ModuleType | None:
    """The reader that recognises a file, those for its extension first; None if there is none."""
    extension = file.suffix.lower()
    ordered = sorted(FORMATS, key=lambda reader: extension not in _EXTENSIONS[reader])
    return next((reader for reader in ordered if reader.recognises(file)), None)


def _search(folder: Path) -> Path | None:
    for reader in FORMATS:
        there = (file for pattern in reader.PATTERNS for file in sorted(folder.glob(pattern)))
        files = (file for file in there if file.is_file() and reader.recognises(file))
        file = meshroom.last_solved(files) if reader is meshroom else next(files, None)
        if file is not None:
            return file
    for pattern in _AROUND:
        there = sorted(folder.glob(pattern))
        files = [
            file
            for file in there
            if JOBS_FOLDER not in file.relative_to(folder).parts and reader_of(file) is not None
        ]
        if len(files) > 1:
            raise several_in(folder, [file.parent for file in files])
        if files:
            return files[0]
    tried = 0
    for depth in range(_DEEPEST + 1):
        there = sorted(folder.glob("/".join(["*"] * (depth + 1))))
        for file in sorted(there, key=lambda file: _HELD_OUT.search(file.name) is not None):
            inside = file.relative_to(folder).parts
            if file.suffix.lower() in PICTURES or JOBS_FOLDER in inside or not file.is_file():
                continue
            tried += 1
            if tried > _MOST_TRIED:
                return None
            if reader_of(file) is not None:
                return file
    return None


def _check_alone(folder: Path, file: Path) -> None:
    """Make sure that a file found in one of a folder's folders is not one of several captures' there."""
    inside = file.relative_to(folder).parts
    if len(inside) < 2 or file.suffix.lower() == _SIDECAR or reader_of(file) is nerfactor:
        return
    alike = (other.joinpath(*inside[1:]) for other in sorted(folder.iterdir()))
    captures = [
        folder / found.relative_to(folder).parts[0]
        for found in alike
        if found.is_file() and reader_of(found) is not None
    ]
    captures = [c for c in captures if c.name.lower() not in _SPLITS and any(pictures_below(c))]
    if len(captures) > 1:
        raise several_in(folder, captures)
