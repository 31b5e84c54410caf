"""Polycam's raw data: a folder of small JSON files, one a keyframe, beside a folder of photos.

    keyframes/corrected_cameras/TIME.json with corrected_images/TIME.jpg, or, where Polycam did not
    optimise the poses, keyframes/cameras/TIME.json with images/TIME.jpg

t_00 … t_23 are the rows of a camera-to-world matrix with ARKit's axes: the camera's are OpenGL's, the
world's +Y points up, its unit is the metre. fx fy cx cy are pixels of a photo of width × height.
Any one of the JSON files stands for all of its folder. Photos that Polycam scores as blurred are left
out as nerfstudio does, unless that would be most of them.
"""

from pathlib import Path

from ..camera_folder import files_in
from ..errors import counted
from ..fields import Entry
from ..files import json_holds
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble

NAME = "Polycam"
PATTERNS = (
    "keyframes/corrected_cameras/*.json", "corrected_cameras/*.json",
    "*/keyframes/corrected_cameras/*.json", "keyframes/cameras/*.json", "cameras/*.json",
    "*/keyframes/cameras/*.json",
)  # fmt: skip

_PHOTO_FOLDERS = {"corrected_cameras": "corrected_images", "cameras": "images"}
_SHARP = 25.0
"""blur score from which a photo is sharp, nerfstudio's own limit"""


def recognises(file: Path) -> bool:
    return json_holds(file, "t_00", "fx", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    found, blurred = [], []
    for file in files_in(path.parent, ".json"):
        content = Entry.of_file(file)
        if "t_00" not in content:
            continue
        if _is_blurred(content.get("blur_score")):
            blurred.append(len(found))
        found.append(_camera(content, photos))
    warnings = ()
    if blurred and 2 * len(blurred) < len(found):
        first = found[blurred[0]].stated
        what = f"{len(blurred)} photo|photos that Polycam scores as blurred is|are left out"
        warnings = (f"{counted(what)} ({first} …)",)
        found = [item for index, item in enumerate(found) if index not in set(blurred)]
    return assemble(path, NAME, found, photos, up=(0, 1, 0), metric=True, warnings=warnings)


def _camera(content: Entry, photos: PhotoFinder) -> Found:
    def value(key: str) -> float:
        if key not in content:
            raise content.error(key, "the camera lacks it")
        return content.number(key)

    file = content.path
    pose = [[value(f"t_{row}{column}") for column in range(4)] for row in range(3)]
    folder = _PHOTO_FOLDERS.get(file.parent.name.lower(), "images")
    stated = f"{folder}/{file.stem}.jpg"
    photo = photos.find_in(file.parent.parent / folder, f"{file.stem}.jpg")
    size = (int(value(key)) for key in ("width", "height"))
    intrinsics = Intrinsics(*size, *map(value, ("fx", "fy", "cx", "cy")))
    return Found(f"{file.name}, t_00", stated, photo, pose, intrinsics)


def _is_blurred(score: object) -> bool:
    return isinstance(score, (int, float)) and not isinstance(score, bool) and score < _SHARP
