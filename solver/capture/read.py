"""Find the camera file a person meant and read it."""

from __future__ import annotations

from pathlib import Path

from .capture import Capture
from .errors import CaptureError
from .transforms import is_transforms, read_json, read_transforms

_FILES_OF_SPLIT = {
    "train": ("transforms_train.json", "transforms.json"),
    "test": ("transforms_test.json", "transforms_val.json"),
    "val": ("transforms_val.json", "transforms_test.json"),
}


def camera_file(path: Path | str, split: str = "train") -> Path:
    """The camera file meant by a folder or a file's path.

    Raises:
        CaptureError: nothing there.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.exists():
        raise CaptureError(
            path, "", "there is no such file or folder", "check the path of the capture"
        )
    wanted = _FILES_OF_SPLIT.get(split, (f"transforms_{split}.json",))
    for name in wanted:
        if (path / name).is_file():
            return path / name
    if not any(path.iterdir()):
        raise CaptureError(path, "", "the folder is empty", "give a folder with photos and cameras")
    raise CaptureError(
        path, "", f"there is no camera file for '{split}' in this folder",
        f"add {' or '.join(wanted)}, or give the camera file itself",
    )  # fmt: skip


def has_split(path: Path | str, split: str) -> bool:
    """True if the folder (or the camera file's folder) has cameras of a split of their own."""
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    return (folder / f"transforms_{split}.json").is_file()


def read_capture(path: Path | str, split: str = "train") -> Capture:
    """Read a capture from a folder or a camera file.

    Args:
        split: which camera file of a folder: 'train', 'test', …, by conventional names.

    Raises:
        CaptureError: with file, field and remedy.
    """
    file = camera_file(path, split).absolute()
    if is_transforms(content := read_json(file)):
        return read_transforms(file)
    kind = type(content).__name__
    raise CaptureError(
        file, "frames", f"this JSON ({kind}) is no camera file that is known here",
        "give a transforms.json of NeRF-synthetic, instant-ngp or nerfstudio",
    )  # fmt: skip
