"""Stray Scanner: `odometry.csv` with `camera_matrix.csv`, beside frames of the video `rgb.mp4`.

A line of the odometry has a frame's number, place and rotation, a quaternion: camera to world, in metres,
with OpenCV's camera axes and ARKit's world, whose +Y is up. Newer versions have fx fy cx cy on each line;
the matrix is the last frame's. Both are in pixels of the video as it was stored, lying on its side.

A video is no photos, so its frames have to be extracted, and then nothing but their numbers says whose
pose is theirs. Programs count frames from 0 or 1 and leave some out: pictures are taken only where that
is told by the numbers, for a shift by one frame would blur what is reconstructed, and nobody would know
why.
https://github.com/strayrobots/scanner (docs/format.md, OdometryEncoder.swift)
"""

import re
from pathlib import Path

import numpy as np

from ..camera_folder import LARGEST_FILE
from ..errors import CaptureError, shown
from ..fields import check_quaternion, number, numbers
from ..files import as_text, read_bytes, read_lines, text_head
from ..frames import pose_opengl_from_opencv, rigid, rotation_from_quaternion
from ..image_header import image_size
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..picture_names import pictures_in
from ..pinhole import OFF_CENTRE, pinhole_of

NAME = "Stray Scanner"
PATTERNS = ("odometry.csv", "*/odometry.csv")

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_LENS = ("fx", "fy", "cx", "cy")
_MATRIX = "camera_matrix.csv"
_PHOTO_FOLDERS = ("rgb", "frames", "images", "color", "rgb_frames")
_LOST = 5
"""frames that a video may lack, or have more, at its end"""
_EXTRACT = (
    "extract all its frames into a folder rgb (ffmpeg -noautorotate -i rgb.mp4 -fps_mode passthrough "
    "-q:v 2 -start_number {first} rgb/%06d.jpg), or solve the cameras from rgb.mp4 itself"
)
_REMEDY = "copy the recording from the phone again"


def recognises(file: Path) -> bool:
    """True for a table that begins with the columns of a frame and its pose."""
    columns = b",".join(name.encode() for name in ("timestamp", "frame", *_POSE))
    return text_head(file).replace(b" ", b"").lower().startswith(columns)


def read(path: Path, photos: PhotoFinder) -> Capture:
    rows = _rows(path)
    pictures = _pictures(path, list(rows), photos)
    found = []
    for frame, (where, row) in rows.items():
        photo = pictures.get(frame)
        if pictures and photo is None:
            continue  # a frame that is not wanted
        intrinsics = None if photo is None else _intrinsics(path, where, row, photo)
        stated = f"{_PHOTO_FOLDERS[0]}/{frame:06d}"
        found.append(Found(where, stated, photo, _pose(path, where, row), intrinsics))
    return assemble(path, NAME, found, photos, up=(0, 1, 0), metric=True)


def _rows(path: Path) -> dict[int, tuple[str, dict[str, str]]]:
    """The lines of the table by their frames' numbers, each with where it is and its columns."""
    lines = ((where, line.split(",")) for where, line in read_lines(path) if line)
    titles = [title.strip().lower() for title in next(lines, ("", []))[1]]
    rows: dict[int, tuple[str, dict[str, str]]] = {}
    for where, words in lines:
        row = dict(zip(titles, map(str.strip, words), strict=False))
        frame = row.get("frame", "")
        if not (frame.isascii() and frame.isdigit() and len(frame) < 9) or int(frame) in rows:
            raise CaptureError(path, where, f"'{shown(frame)}' is not a new frame", _REMEDY)
        rows[int(frame)] = where, row
    return rows


def _pose(path: Path, where: str, row: dict[str, str]) -> np.ndarray:
    """Camera to world [4, 4] with OpenGL's axes."""
    x, y, z, *quaternion = (number(path, f"{where}, {name}", row.get(name)) for name in _POSE)
    check_quaternion(path, where, quaternion, _REMEDY)
    return pose_opengl_from_opencv(rigid(rotation_from_quaternion(np.roll(quaternion, 1)), (x, y, z)))


def _intrinsics(path: Path, where: str, row: dict[str, str], photo: Path) -> Intrinsics:
    """The lens of a frame, for the size of its picture: nothing states the video's."""
    if row.get("distortion_center_x"):
        raise CaptureError(
            path, f"{where}, distortion_center_x", "its lens has a table of distortion, which is not read",
            "solve the cameras from rgb.mp4 itself",
        )  # fmt: skip
    if row.get("fx"):
        fx, fy, cx, cy = (number(path, f"{where}, {name}", row.get(name)) for name in _LENS)
    else:
        file = path.with_name(_MATRIX)
        k = numbers(file, "", as_text(read_bytes(file, LARGEST_FILE)), 9).reshape(3, 3)
        fx, fy, cx, cy = pinhole_of(file, "", k)
    width, height = image_size(photo)
    if abs(2 * cx / width - 1) > OFF_CENTRE or abs(2 * cy / height - 1) > OFF_CENTRE:
        raise CaptureError(
            photo, "", f"the picture, of {width} × {height} pixels, was turned or scaled down: the lens's "
            f"centre is at ({cx:.6g}, {cy:.6g}) ({path.name}, {where})", _EXTRACT.format(first=0),
        )  # fmt: skip
    return Intrinsics(width, height, fx, fy, cx, cy)


def _pictures(path: Path, frames: list[int], photos: PhotoFinder) -> dict[int, Path]:
    """Pictures of frames by the frames' numbers; none where they are not wanted and not there."""
    first, last = min(frames, default=0), max(frames, default=0)
    extract = _EXTRACT.format(first=first)
    folders = [photos.folder] + [path.absolute().parent / name for name in _PHOTO_FOLDERS]
    within = (folder for folder in folders if folder.is_relative_to(photos.folder))
    folder = next(filter(pictures_in, within), None)
    if folder is None:
        if not photos.wanted:
            return {}
        raise CaptureError(path, "photos", "a recording's photos are in its video", extract)
    named = ((re.search(r"\d+$", file.stem), file) for file in pictures_in(folder))
    pictures = {int(match[0]): file for match, file in named if match is not None}
    if set(pictures) == {frame + 1 for frame in frames}:
        return {frame - 1: file for frame, file in pictures.items()}  # counted from 1
    in_one_run = max(pictures, default=0) - min(pictures, default=0) + 1 == len(pictures)
    all_there = abs(len(pictures) - len(frames)) <= _LOST
    # Where lines are missing from the table, a video's frames may be counted with or without them.
    without_gaps = last - first + 1 == len(frames)
    chosen = not in_one_run and set(pictures) <= set(frames)
    in_step = in_one_run and without_gaps and all_there and min(pictures, default=0) == first
    if first in pictures and (chosen or in_step):
        return pictures
    raise CaptureError(
        folder, "photos", f"its {len(pictures)} numbered pictures may be any of {len(frames)} frames",
        f"{extract}; of them, keep the first and as many others as you like",
    )  # fmt: skip
