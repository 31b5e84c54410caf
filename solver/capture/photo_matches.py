"""What photos of known cameras have in common: SIFT features, found and matched with COLMAP.

Features (Lowe 2004, doi:10.1023/B:VISI.0000029664.99615.94) are told as pixels of a pinhole without the
lens's distortion, or of a panorama of all directions, so that all that follows knows no other lenses.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from scipy import ndimage

from ..threads import thread_pool, usable_cores
from .camera import Camera, positions_of
from .colour import linear_to_srgb
from .frames import invert_pose, opencv_from_opengl, pose_opencv_from_opengl
from .lenses import undistort
from .panoramic_lens import EQUIRECTANGULAR, of_whole_sphere
from .photos import Photo

LONGEST, MOST_ENLARGED = 800, 4
"""longer side, in pixels, at which features are found; small photos are enlarged, by so much at most, for
features are sought from some pixels' width on"""
MOST_FEATURES = 2048
NEIGHBOURS = 10
"""photos that each is compared with"""
WIDEST = np.radians(60)
"""angle between directions of view beyond which photos are not compared: features look different then"""
BORDER = 0.01
"""of the picture's longer side: so far around what is hidden nothing is looked at"""
DATABASE = "database.db"
FINDING = 0.7
"""of the time for features and matches, that the first take"""


class Picture(NamedTuple):
    """What features are sought in."""

    grey: np.ndarray  # [H, W] uint8
    hidden: np.ndarray | None = None  # [H, W] bool: what is found there does not count


class Features(NamedTuple):
    """What was found in a photo."""

    places: np.ndarray  # [N, 2] float32, pixels, without the lens's distortion
    descriptors: Any  # pycolmap's
    camera: Any  # pycolmap's: the pinhole or panorama whose pixels they are

    def directions(self, chosen: np.ndarray) -> np.ndarray:
        """Directions [N, 3] of some places in camera axes: +x right, +y down."""
        places = self.places[chosen].astype(np.float64)
        if self.camera.model.name == "EQUIRECTANGULAR":
            fx, fy, cx, cy = of_whole_sphere(*self.camera.params)
            return undistort(EQUIRECTANGULAR, (), *((places - (cx, cy)) / (fx, fy)).T)[0]
        fx, fy, cx, cy = self.camera.params
        flat = (places - (cx, cy)) / (fx, fy)
        return np.concatenate([flat, np.ones((len(flat), 1))], axis=1)

    @property
    def focal(self) -> float:
        """Pixels per radian in the picture's middle."""
        if self.camera.model.name == "EQUIRECTANGULAR":
            return of_whole_sphere(*self.camera.params)[0]
        return float(self.camera.params[:2].mean())


class PairMatches(NamedTuple):
    """What two photos, by their numbers, have in common."""

    first: int
    second: int
    seen: np.ndarray  # [2, N, 3] directions in which each sees it: +x right, +y down
    focal: float  # pixels, of the pictures in which features were sought


def quiet_colmap() -> Any:
    """COLMAP that logs nothing but its end, imported only when it is used; SIGTERM stays whose it was."""
    terminated = signal.getsignal(signal.SIGTERM)
    import pycolmap

    # Its log takes the signal when it is loaded, to print where the process died; for us it is a cancel.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, terminated)
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    return pycolmap


@contextmanager
def opened(colmap: Any, path: Path) -> Iterator[Any]:
    database = colmap.Database.open(path)
    try:
        yield database
    finally:
        database.close()


def add_camera(colmap: Any, database: Any, camera: Any) -> int:
    """Put a camera into a database, alone in a rig; returns the rig's number."""
    camera.camera_id = database.write_camera(camera)
    rig = colmap.Rig(rig_id=camera.camera_id)
    rig.add_ref_sensor(camera.sensor_id)
    return database.write_rig(rig)


def add_photo(colmap: Any, database: Any, name: str, camera: Any, rig: int) -> int:
    """Put a photo that a rig's camera took into a database; returns its number."""
    number = database.write_image(colmap.Image(name=name, camera_id=camera.camera_id))
    frame = colmap.Frame(frame_id=number, rig_id=rig)
    frame.add_data_id(colmap.data_t(camera.sensor_id, number))
    database.write_frame(frame)
    return number


def match_pairs(
    colmap: Any, database: Path, folder: Path, pairs: list[tuple[str, str]], seed: int, **options: Any
) -> None:
    """Match and verify pairs of photos of a database, by name; their list goes into a folder."""
    matching = colmap.FeatureMatchingOptions()
    matching.num_threads, matching.use_gpu = usable_cores(), False
    verification = colmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    listing = folder / "pairs.txt"
    listing.write_text("".join(f"{a} {b}\n" for a, b in pairs), encoding="ascii")
    colmap.match_image_pairs(
        database, matching_options=matching,
        pairing_options=colmap.ImportedPairingOptions(match_list_path=listing),
        verification_options=verification, device=colmap.Device.cpu, **options,
    )  # fmt: skip


def picture_of(photo: Photo) -> Picture:
    """A photo as people see it, about `LONGEST` pixels long; with alpha over white. What it says nothing of
    is hidden."""
    alpha = photo.pixels[..., 3:]
    straight = photo.pixels[..., :3] / np.maximum(alpha, 1e-4)
    shown = np.clip(linear_to_srgb(straight), 0, 1) * alpha + 1 - alpha
    colour = (255 * shown + 0.5).astype(np.uint8)
    return picture_from(colour, None if photo.told is None else hidden_around(~photo.told))


def hidden_around(hidden: np.ndarray) -> np.ndarray:
    """What is hidden [H, W] bool of a picture, and what is so close to it that its edge shows there."""
    return ndimage.maximum_filter(hidden, 2 * round(BORDER * max(hidden.shape)) + 1)


def picture_from(colour: np.ndarray, hidden: np.ndarray | None = None) -> Picture:
    """The same of sRGB [H, W, 3] uint8, with what is `hidden` [H, W] bool of it."""
    height, width = colour.shape[:2]
    factor = min(LONGEST / max(height, width), MOST_ENLARGED)
    size = max(1, round(factor * width)), max(1, round(factor * height))
    grey = np.array(Image.fromarray(colour).convert("L").resize(size, Image.Resampling.LANCZOS))
    if hidden is None:
        return Picture(grey)
    return Picture(grey, np.array(Image.fromarray(hidden).resize(size)))


def neighbours(cameras: list[Camera], most: int = NEIGHBOURS) -> list[tuple[int, int]]:
    """Pairs (i < j) of cameras that look alike from nearby, up to about `most` each."""
    positions = positions_of(cameras)
    axes = np.stack([camera.view_direction for camera in cameras])
    all_around = np.array([camera.is_panoramic for camera in cameras])
    pairs = set()
    for index, (position, axis) in enumerate(zip(positions, axes, strict=True)):
        angle = np.arccos(np.clip(axes @ axis, -1, 1))
        angle[all_around | all_around[index]] = 0
        away = np.linalg.norm(positions - position, axis=1)
        # What two photos have in common is lost by turning away as by walking away.
        cost = away / max(np.median(away), 1e-12) + angle / WIDEST
        cost[index] = np.inf
        near = [int(j) for j in np.argsort(cost)[:most] if angle[j] < WIDEST and j != index]
        pairs |= {(min(index, j), max(index, j)) for j in near}
    return sorted(pairs)


def matched(
    colmap: Any, folder: Path, cameras: list[Camera], pictures: list[Picture],
    pairs: list[tuple[int, int]], progress: Callable[[float], None],
) -> list[Features]:  # fmt: skip
    """Features of all pictures, and a database `DATABASE` of them in an empty folder, with
    the matches of all `pairs` verified: those that some motion of a pinhole explains."""
    colmap.set_random_seed(0)
    features = _features(colmap, cameras, pictures, lambda done: progress(FINDING * done))
    _register(colmap, folder / DATABASE, features)
    _match(colmap, folder, pairs, lambda done: progress(FINDING + (1 - FINDING) * done))
    return features


def posed_model(colmap: Any, cameras: list[Camera], features: list[Features]) -> Any:
    """COLMAP's model of cameras where they are, without points, for the database of `matched`."""
    model = colmap.Reconstruction()
    for index, (camera, found) in enumerate(zip(cameras, features, strict=True)):
        pinhole = found.camera
        image = colmap.Image(name=_name(index), camera_id=pinhole.camera_id)
        image.image_id = _number(index)
        pose = invert_pose(pose_opencv_from_opengl(camera.camera_to_world))
        model.add_camera_with_trivial_rig(pinhole)
        model.add_image_with_trivial_frame(image, colmap.Rigid3d(pose[:3]))
    return model


def image_of(model: Any, index: int) -> Any:
    """COLMAP's image of the photo `index` in a model made by `posed_model`."""
    return model.images[_number(index)]


def verified_matches(colmap: Any, folder: Path, features: list[Features]) -> list[PairMatches]:
    """The matches of a database of `matched`."""
    with opened(colmap, folder / DATABASE) as database:
        ids, geometries = database.read_two_view_geometries()
    return list(_pairs(colmap, ids, geometries, features))


def _pairs(
    colmap: Any, ids: list[int], geometries: list[Any], features: list[Features]
) -> Iterator[PairMatches]:
    for pair, geometry in zip(ids, geometries, strict=True):
        indices = [number - 1 for number in colmap.pair_id_to_image_pair(pair)]
        inliers = np.asarray(geometry.inlier_matches, dtype=np.int64).reshape(-1, 2)
        both = [features[index] for index in indices]
        seen = np.stack([one.directions(side) for one, side in zip(both, inliers.T, strict=True)])
        yield PairMatches(*indices, seen, sum(one.focal for one in both) / 2)


def _features(
    colmap: Any, cameras: list[Camera], pictures: list[Picture], progress: Callable[[float], None]
) -> list[Features]:
    options = colmap.FeatureExtractionOptions()
    options.num_threads, options.use_gpu = 1, False
    options.sift.max_num_features, options.sift.first_octave = MOST_FEATURES, 0

    def find(camera: Camera, picture: Picture) -> Features:
        extractor = colmap.FeatureExtractor.create(options, colmap.Device.cpu)
        keypoints, descriptors = extractor.extract_from_uint8_array(picture.grey)
        places = np.array([(k.x, k.y) for k in keypoints]).reshape(-1, 2)
        height, width = picture.grey.shape
        if picture.hidden is not None:
            column, row = np.minimum(places.astype(int), (width - 1, height - 1)).T
            shown = ~picture.hidden[row, column]
            places, descriptors.data = places[shown], descriptors.data[shown]
        scale = np.array([width / camera.width, height / camera.height])
        if camera.is_panoramic:
            return _of_panorama(colmap, camera, scale, places, descriptors)
        local = opencv_from_opengl(camera.rays(*(places / scale).T)[1] @ camera.camera_to_world[:3, :3])
        # A pinhole has no place for what a fisheye sees beside itself: far outside, it fits no match.
        flat = local[:, :2] / np.maximum(local[:, 2:], 1e-2)
        focal, centre = scale * (camera.fx, camera.fy), scale * (camera.cx, camera.cy)
        pinhole = colmap.Camera(model="PINHOLE", width=width, height=height, params=[*focal, *centre])
        return Features((flat * focal + centre).astype(np.float32), descriptors, pinhole)

    found = []
    with thread_pool() as pool:
        for features in pool.map(find, cameras, pictures):
            found.append(features)
            progress(len(found) / len(pictures))
    return found


def _of_panorama(
    colmap: Any, camera: Camera, scale: np.ndarray, places: np.ndarray, descriptors: Any
) -> Features:
    """Features at places [N, 2] of a panorama's picture, `scale` [2] times as large as its photo, as pixels
    of that of all directions."""
    size = scale * (2 * np.pi * camera.fx, np.pi * camera.fy)
    whole = colmap.Camera(
        model="EQUIRECTANGULAR", width=round(size[0]), height=round(size[1]), params=size.tolist()
    )
    places = places - scale * (camera.cx, camera.cy) + size / 2
    return Features(places.astype(np.float32), descriptors, whole)


def _register(colmap: Any, path: Path, features: list[Features]) -> None:
    """Put all into a new database, each photo with a pinhole of its own."""
    with opened(colmap, path) as database, colmap.DatabaseTransaction(database):
        for index, found in enumerate(features):
            rig = add_camera(colmap, database, found.camera)
            number = add_photo(colmap, database, _name(index), found.camera, rig)
            assert number == _number(index)
            database.write_keypoints(number, found.places)
            database.write_descriptors(number, found.descriptors)


def _match(
    colmap: Any, folder: Path, pairs: list[tuple[int, int]], progress: Callable[[float], None]
) -> None:
    """Matches of all pairs, verified, in blocks of about a second."""
    block = 20 * usable_cores()
    for first in range(0, len(pairs), block):
        progress(first / len(pairs))
        named = [(_name(i), _name(j)) for i, j in pairs[first : first + block]]
        match_pairs(colmap, folder / DATABASE, folder, named, 0)


def _name(index: int) -> str:
    return f"{index:06d}.png"


def _number(index: int) -> int:
    """COLMAP's number of a photo; it counts from one."""
    return index + 1
