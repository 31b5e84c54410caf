"""3D Scanner App's raw data: `frame_00000.json` beside `frame_00000.jpg`, and depth maps.

`cameraPoseARFrame` has the rows of a camera-to-world matrix [4, 4] with ARKit's axes: the camera's are
OpenGL's, the world's +Y points up, its unit is the metre. `intrinsics` has the rows of a matrix [3, 3] in
pixels of the photo. Most frames have a depth map only; those are no photos, and not missed.
Any one of the JSON files stands for all of its folder.
"""

from pathlib import Path

from ..camera_folder import files_in
from ..fields import Entry
from ..files import json_holds
from ..intake import Capture, CaptureError, Found, PhotoFinder, assemble
from ..pinhole import lens_on, pinhole_of

NAME = "3D Scanner App"
PATTERNS = ("frame_*.json", "*/frame_*.json")


def recognises(file: Path) -> bool:
    return json_holds(file, "cameraPoseARFrame", "intrinsics", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    found = []
    for file in files_in(path.parent, ".json"):
        photo = photos.find_in(file.parent, f"{file.stem}.jpg")
        if photo is not None and recognises(file):
            found.append(_camera(file, photo))
    if not found:
        raise CaptureError(
            path.parent, "photos", "no frame has a photo beside it",
            "export 'All Data', with images, from 3D Scanner App",
        )  # fmt: skip
    return assemble(path, NAME, found, photos, up=(0, 1, 0), metric=True)


def _camera(file: Path, photo: Path) -> Found:
    content = Entry.of_file(file)
    pose = content.numbers("cameraPoseARFrame", 16).reshape(4, 4)
    k = content.numbers("intrinsics", 9).reshape(3, 3)
    lens = lens_on(photo, *pinhole_of(file, "intrinsics", k))
    return Found(f"{file.name}, cameraPoseARFrame", photo.name, photo, pose, lens)
