"""Cameras of MVSNet and of all that take over its layout: BlendedMVS, DTU, Tanks and Temples for networks.

    cams/00000000_cam.txt   beside images/00000000.jpg or, in BlendedMVS, blended_images/00000000.jpg

A file has the word `extrinsic` before a 4 × 4 matrix from the world to the camera, with OpenCV's axes, the
word `intrinsic` before a 3 × 3 matrix in pixels, of which the first one's centre is (0.5, 0.5), and two to
four numbers about depths, which are of no use here. Any one of the files stands for all of its folder.
pair.txt, which says what to compare with what, is left alone, and so are BlendedMVS' photos
`00000000_masked.jpg`, which show the same once more.

DTU's photos for training are called `rect_001_3_r5000.png`, counted from 1, for each of seven lights; those
of light 3 are taken, as MVSNet's validation does. The photos' size is not stated, and the cameras for
training are those of the network's depth maps, a quarter of that; the lens's centre tells.
https://github.com/YoYo000/MVSNet#file-formats, preprocess.py and homography_warping.py (`get_pixel_grids`);
https://github.com/YoYo000/BlendedMVS#dataset-structure; https://github.com/donydchen/matchnerf/issues/3
"""

from pathlib import Path

from ..camera_folder import LARGEST_FILE, files_in, matrix_of, photo_folder, words_of
from ..fields import is_no_pose, pose_of_world
from ..files import head_of, text_head
from ..image_header import image_size
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import is_for_another_size, pinhole_of

NAME = "MVSNet"
PATTERNS = ("cams*/*_cam.txt", "[Cc]ameras/*_cam.txt", "*_cam.txt")

_PHOTO_FOLDERS = ("images", "blended_images", "image", "rgb")
_DTU_PHOTO = "rect_{:03d}_3_r5000"
_FOR_CUT = "train"
"""folder of DTU's cameras for photos of 640 × 512 pixels, in that of those for photos of 1600 × 1200"""
_SMALLER = 4
"""how many times smaller a network's depth maps are than its photos"""


def recognises(file: Path) -> bool:
    begins = text_head(file)[:9].lower() == b"extrinsic"
    return begins and b"intrinsic" in head_of(file, LARGEST_FILE)[9:].lower()


def read(path: Path, photos: PhotoFinder) -> Capture:
    files = [
        file
        for file in files_in(path.parent, path.suffix)
        if file.stem.endswith("_cam") or recognises(file)
    ]
    folder = photo_folder(path.absolute().parent.parent, _PHOTO_FOLDERS)
    cameras = [_camera(file, folder, photos) for file in files]
    found = [camera for camera in cameras if camera.camera_to_world is not None]
    lost = [camera.stated for camera in cameras if camera.camera_to_world is None]
    return assemble(path, NAME, found, photos, lost=(lost, "extrinsic"))


def _camera(file: Path, folder: Path, photos: PhotoFinder) -> Found:
    words = words_of(file)
    titles = [word.lower() for word in words]
    middle = titles.index("intrinsic") if "intrinsic" in titles else len(words)
    extrinsic = matrix_of(file, "extrinsic", words[1:middle], 4, 4)
    matrix = matrix_of(file, "intrinsic", words[middle + 1 : middle + 10], 3, 3)
    number = file.stem.removesuffix("_cam")
    photo = _photo(folder, number, photos)
    pose = intrinsics = None
    if not is_no_pose(extrinsic):
        pose = pose_of_world(file, "extrinsic", extrinsic)
        if photo is not None:
            lens = pinhole_of(file, "intrinsic", matrix)
            intrinsics = Intrinsics(*_size_meant(file, photo, *lens[2:]), *lens)
    return Found(f"{file.name}, extrinsic", f"{folder.name}/{number}", photo, pose, intrinsics)


def _photo(folder: Path, number: str, photos: PhotoFinder) -> Path | None:
    photo = photos.find_in(folder, number)
    if photo is None and number.isascii() and number.isdigit():
        photo = photos.find(_DTU_PHOTO.format(int(number) + 1))
    return photo


def _size_meant(file: Path, photo: Path, cx: float, cy: float) -> tuple[int, int]:
    """Width and height of the picture that the lens is for: the photo's, or a quarter of them.

    The centre of a lens is off the middle by some percent of the picture, so it tells one from the other,
    but of any other size only that it is another, and only if that is a fifth larger or smaller.
    """
    width, height = image_size(photo)
    if not is_for_another_size((width, height), cx, cy):
        return width, height
    if not is_for_another_size((width, height), _SMALLER * cx, _SMALLER * cy):
        return round(width / _SMALLER), round(height / _SMALLER)
    remedy = "give the photos that the cameras are for"
    if (cut := file.with_name(_FOR_CUT)).is_dir():
        remedy += f", or {cut} for those that DTU's photos for training were cut to"
    raise CaptureError(
        file, "intrinsic", f"its centre ({cx:.6g}, {cy:.6g}) is that of photos of another size than "
        f"{photo.name}, which has {width} × {height} pixels", remedy,
    )  # fmt: skip
