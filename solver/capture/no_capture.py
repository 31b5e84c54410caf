"""What to say where there is no camera file that is known here, or more than one capture."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

from .archives import ARCHIVES
from .errors import CaptureError, listed
from .files import json_head
from .formats.realitycapture_table import is_table_without_lenses
from .picture_names import VIDEOS

_TABLE = "export 'Internal/External camera parameters' from RealityCapture or RealityScan"
_METASHAPE = ("Metashape", "choose File > Export > Export Cameras there")
_PIX4D = ("Pix4D", "export it as OPF, or give its folder 1_initial/params")
PROJECTS = {
    ".psx": _METASHAPE, ".psz": _METASHAPE, ".rcproj": ("RealityCapture", _TABLE),
    ".rsproj": ("RealityScan", _TABLE), ".p4d": _PIX4D,
    ".mg": ("Meshroom", "give its MeshroomCache, or the cameras.sfm in it"),
}  # fmt: skip
"""programs by their projects' extensions, and how one gets the cameras"""


def no_camera_file(file: Path, known: Sequence[str]) -> CaptureError:
    """What to say of a file that no reader recognises.

    Args:
        known: names of the formats that are.
    """
    if (told := _without_cameras(file)) is not None:
        return CaptureError(file, "", f"this is {told[0]}", told[1])
    if zipfile.is_zipfile(file):
        return CaptureError(file, "", "this is an archive", "unpack it and give the folder")
    if file.suffix.lower() in VIDEOS:
        return CaptureError(
            file, "", "a video has no cameras yet", "solve its cameras first, and give their folder"
        )
    return CaptureError(
        file, "", "this is not a known kind of camera file", "give one of " + ", ".join(known)
    )


def several_in(folder: Path, captures: list[Path]) -> CaptureError:
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
    files = sorted(folder.glob("*"))
    archives = (file for file in files if file.suffix.lower() in ARCHIVES)
    archive = next(filter(zipfile.is_zipfile, archives), None)
    # DTU's photos lie in Rectified/scan1, their cameras in Calibration/cal18; those for training in
    # Rectified/scan1_train, theirs in Cameras/train.
    cameras = (
        parent / cameras
        for parent in list(folder.absolute().parents)[:2]
        for cameras in ("Cameras/train", "Calibration/cal18")
    )
    dtu = next(filter(Path.is_dir, cameras), None)
    # A table of points may lie beside photos as text.
    told_of = ((f, _without_cameras(f)) for f in files if f.suffix.lower() != ".txt")
    half = ((file, told) for file, told in told_of if told is not None and file.is_file())
    file, told = next(half, (None, None))
    if archive is not None:
        remedy = f"give {archive.name} itself"
    elif dtu is not None:
        remedy = f"give {dtu}, and this folder as the photos'"
    elif above is not None:
        remedy = f"give {folder.parent}, which has {above.name}"
    elif (folder / "database.db").is_file():
        remedy = "give its model (sparse/0)"
        problem += ", since database.db is COLMAP's list of matches"
    elif told is not None:
        problem += f", since {file.name} is {told[0]}"
        remedy = told[1]
    return CaptureError(folder, "", problem, remedy)


def _without_cameras(file: Path) -> tuple[str, str] | None:
    """What a file is that others may take for one of cameras, and what is to be given instead."""
    extension = file.suffix.lower()
    if extension in PROJECTS:
        program, remedy = PROJECTS[extension]
        return f"a project of {program}", remedy
    if extension == ".json" and b'"projection_type"' in json_head(file):
        give = "give the folder with its odm_report/shots.geojson or opensfm/reconstruction.json"
        return "OpenDroneMap's list of lenses, without poses", give
    if extension == ".abc":
        return "an Alembic file", "give Meshroom's cameras.sfm, or convert it (ConvertSfMFormat)"
    if extension == ".bin" and "sfm_data" in file.name:
        return "OpenMVG's binary form", "convert it to JSON by openMVG_main_ConvertSfM_DataFormat"
    if extension in (".csv", ".txt") and is_table_without_lenses(file):
        return "a table of places without lenses", _TABLE
    return None
