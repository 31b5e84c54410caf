"""What to say where there is no camera file that is known here, or more than one capture."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

from .archives import ARCHIVES
from .errors import CaptureError, listed
from .files import json_head
from .formats.realitycapture_table import is_table_without_lenses
from .picture_names import VIDEOS

_LENSES_ALONE = (
    "OpenDroneMap's lenses, without poses",
    "give the folder with its odm_report/shots.geojson or opensfm/reconstruction.json",
)
"""what a cameras.json that is no capture is, and what is to be given instead"""
_PLACES_ALONE = (
    "a table of places without lenses",
    "export 'Internal/External camera parameters' from RealityCapture or RealityScan",
)


def no_camera_file(file: Path, known: Sequence[str]) -> CaptureError:
    """What to say of a file that no reader recognises.

    Args:
        known: names of the formats that are.
    """
    if zipfile.is_zipfile(file):
        return CaptureError(file, "", "this is an archive", "unpack it and give the folder")
    if _has_lenses_alone(file):
        return CaptureError(file, "", f"these are {_LENSES_ALONE[0]}", _LENSES_ALONE[1])
    if is_table_without_lenses(file):
        return CaptureError(file, "", f"this is {_PLACES_ALONE[0]}", _PLACES_ALONE[1])
    if file.suffix.lower() in VIDEOS:
        return CaptureError(
            file, "", "a video has no cameras yet", "solve its cameras first, and give their folder"
        )
    return CaptureError(
        file, "", "this is not a known kind of camera file", "give one of " + ", ".join(known)
    )


def several_in(folder: Path, captures: list[Path]) -> CaptureError:
    """What to say of a folder around several captures."""
    names = [str(capture.relative_to(folder)) for capture in captures]
    return CaptureError(
        folder, "", f"it holds several captures ({listed(names)})", "give the folder of one of them"
    )


def nothing_in(folder: Path, usual: Sequence[str]) -> CaptureError:
    """What to say of a folder without a camera file that is known here.

    Args:
        usual: what the likeliest files are called.
    """
    remedy = "give the camera file itself, or solve the cameras from the photos"
    problem = "there is no camera file in this folder"
    above = next((file for name in usual if (file := folder.parent / name).is_file()), None)
    files = (file for file in sorted(folder.glob("*")) if file.suffix.lower() in ARCHIVES)
    archive = next(filter(zipfile.is_zipfile, files), None)
    # DTU's photos lie in Rectified/scan1, their cameras in Calibration/cal18; those for training in
    # Rectified/scan1_train, theirs in Cameras/train.
    cameras = (
        parent / cameras
        for parent in list(folder.absolute().parents)[:2]
        for cameras in ("Cameras/train", "Calibration/cal18")
    )
    dtu = next(filter(Path.is_dir, cameras), None)
    table = next(filter(is_table_without_lenses, sorted(folder.glob("*.csv"))), None)
    if archive is not None:
        remedy = f"give {archive.name} itself"
    elif dtu is not None:
        remedy = f"give {dtu}, and this folder as the photos'"
    elif above is not None:
        remedy = f"give {folder.parent}, which has {above.name}"
    elif (folder / "database.db").is_file():
        remedy = "give its model (sparse/0)"
        problem += ", since database.db is COLMAP's list of matches"
    elif _has_lenses_alone(folder / "cameras.json"):
        problem += f", since cameras.json is {_LENSES_ALONE[0]}"
        remedy = _LENSES_ALONE[1]
    elif table is not None:
        problem += f", since {table.name} is {_PLACES_ALONE[0]}"
        remedy = _PLACES_ALONE[1]
    return CaptureError(folder, "", problem, remedy)


def _has_lenses_alone(file: Path) -> bool:
    return b'"projection_type"' in json_head(file)
