"""Pix4D's `…_calibrated_camera_parameters.txt`, of PIX4Dmapper's folder `1_initial/params`.

Seven lines of titles, then ten lines for each photo:

    fileName imageWidth imageHeight     DJI_0172.JPG 5472 3648
    camera matrix K [3x3]               three lines
    radial distortion [3x1]             R1 R2 R3
    tangential distortion [2x1]         T1 T2
    camera position t [3x1]
    camera rotation R [3x3]             three lines
    camera model m = K [R|-Rt] X

R takes the world to OpenCV's camera axes. The distortion is that of Pix4D's perspective lens, OpenCV's k1
k2 p1 p2 k3 by other names. Pixels are counted from the corner of the first one: `…_camera_parameters.cam`
has the centre's offset from half the width. Photos in `undistorted_images` have the same K, but no
distortion, which is what `…_pmatrix.txt` is for. Places are counted from `…_offset.xyz`, which is left
aside; +Z is up where `…_wkt.prj` says that the world is a map's, which may have feet.

SURE, ArcGIS and others read this form or write it, too. Other titles are refused: what this file, or
`…_internal_camera_parameters.cam`, has of a fisheye is described nowhere, and none was at hand. Its lens is
known (`opf`), and the program exports its projects as OPF.
https://support.pix4d.com/hc/en-us/articles/202977149 and /202559089; `opf` has the lens's formula
"""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, shown
from ..fields import number, numbers
from ..files import CUT_OFF, read_lines, text_head
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import pinhole_of

NAME = "Pix4D"
PATTERNS = tuple(
    f"{folder}*calibrated_camera_parameters.txt"
    for folder in ("", "params/", "1_initial/params/", "*/1_initial/params/")
)

_TITLES = (
    "filename imagewidth imageheight", "camera matrix k [3x3]", "radial distortion [3x1]",
    "tangential distortion [2x1]", "camera position t [3x1]", "camera rotation r [3x3]",
)  # fmt: skip
_EQUATION = "[r|-rt]"
_ENDING = "calibrated_camera_parameters.txt"
_UNDISTORTED = "undistorted_images"
_LINES = 10  # of a photo


def recognises(file: Path) -> bool:
    """True for text that begins with the first title, and has the last two."""
    head = text_head(file, 1 << 10).lower()
    return head.startswith(b"filename imagewidth imageheight") and b"rotation r [3x3]" in head


def read(path: Path, photos: PhotoFinder) -> Capture:
    lines = (line for line in read_lines(path) if line[1])
    titles = [" ".join(line.lower().split()) for _, line in islice(lines, len(_TITLES))]
    unknown = next((t for t, known in zip(titles, _TITLES, strict=False) if t != known), None)
    if unknown is not None or len(titles) < len(_TITLES):
        raise CaptureError(
            path, shown(unknown or "titles"), "this is not said of a perspective lens",
            "export the project as OPF, of which fisheyes are read, or solve the cameras from the photos",
        )  # fmt: skip
    _, equation = next(lines, ("", ""))
    if _EQUATION not in equation.replace(" ", "").lower():
        raise CaptureError(path, shown(equation), "this is not Pix4D's projection, K [R|-Rt] X", CUT_OFF)
    found = []
    while block := list(islice(lines, _LINES)):
        found.append(_camera(path, block, photos))
    up = (0.0, 0.0, 1.0) if _is_on_map(path) else None
    return assemble(path, NAME, found, photos, up=up)


def _camera(path: Path, block: list[tuple[str, str]], photos: PhotoFinder) -> Found:
    first, stated = block[0]
    name, *size = stated.rsplit(maxsplit=2)
    if len(block) < _LINES or len(size) != 2:
        raise CaptureError(path, first, f"'{shown(stated)}' breaks off", CUT_OFF)
    where, rest = f"{first}, {shown(name)}", iter(block[1:])
    k = _matrix(path, rest, 3, 3)
    radial, tangential, place = (_matrix(path, rest, 1, count)[0] for count in (3, 2, 3))
    pose = rigid(_matrix(path, rest, 3, 3).T, place)
    photo = photos.find(name, beside=path)
    intrinsics = None
    if photos.serves(photo):
        width, height = (int(number(path, where, side)) for side in size)
        if photo is not None and photo.parent.name.lower() == _UNDISTORTED:
            radial, tangential = np.zeros(3), np.zeros(2)
        lens, distortion = polynomial_lens(radial, tangential)
        intrinsics = Intrinsics(width, height, *pinhole_of(path, where, k), lens, distortion)
    return Found(where, name, photo, pose_opengl_from_opencv(pose), intrinsics)


def _matrix(path: Path, lines: Iterator[tuple[str, str]], rows: int, columns: int) -> np.ndarray:
    return np.stack([numbers(path, where, line.split(), columns) for where, line in islice(lines, rows)])


def _is_on_map(path: Path) -> bool:
    """Whether the file beside it that has its system of coordinates says that this is a map's."""
    system = path.with_name(path.name.removesuffix(_ENDING) + "wkt.prj")
    return text_head(system).upper().startswith((b"PROJCS", b"COMPD_CS"))
