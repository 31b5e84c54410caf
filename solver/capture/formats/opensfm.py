"""OpenSfM's `reconstruction.json`, which OpenDroneMap and WebODM write as `opensfm/reconstruction.json`.

A list of reconstructions that share no world; the largest is read. A shot, called by its photo's name, has
the rotation (an axis times an angle) and translation from the world to OpenCV's camera axes. Shots of a
rig repeat their pose; where one does not, it is its camera's in the rig after the rig's in the world.

Lengths in a picture are counted in its longer side from its middle, with y down: the middle of the pixels,
(w − 1) / 2 in OpenSfM's count from the centre of the first one, is w / 2 here. With x = X / Z, y = Y / Z,
or of a fisheye (x, y) as long as the angle θ from the axis (`camera_projections_functions.h`,
`camera_distortions_functions.h`, `camera_instances.h`; the manual's formulas leave squares out):

    perspective, radial, simple_radial    (x, y) (1 + k1 r² + k2 r⁴)
    brown                                 OpenCV's k1 k2 p1 p2 k3
    fisheye, fisheye_opencv               (x, y) (1 + k1 θ² + … + k4 θ⁸)
    fisheye62, fisheye624                 (x, y) (1 + k1 θ² + … + k6 θ¹²), plus OpenCV's tangential terms
                                          and the prism's s0 θ² + s1 θ⁴, s2 θ² + s3 θ⁴, all of (x, y)
    dual                                  as perspective, of (x, y) between the perspective one and the
                                          fisheye's: `transition` is 1 for the one, 0 for the other
    spherical, equirectangular            azimuth and elevation, in turns, of a panorama
    u = focal_x x' + c_x, v = focal_y y' + c_y

The world has metres with +X east, +Y north and +Z up from `reference_lla` on; without GPS that is 0, 0, 0,
the scale is anyone's, and +Z is up as well as OpenSfM could tell (doc/source/geometry.rst).
"""

from pathlib import Path

import numpy as np

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, counted, shown
from ..fields import Entry, pose_of_world
from ..files import text_head
from ..frames import rigid, rotation_from_quaternion
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..panoramic_lens import EQUIRECTANGULAR, in_turns
from ..sparse_points import SparsePoints

NAME = "OpenSfM reconstruction.json"
PATTERNS = (
    "reconstruction.json", "opensfm/reconstruction.json", "*/reconstruction.json",
    "*/opensfm/reconstruction.json",
)  # fmt: skip

_UP = (0.0, 0.0, 1.0)
_PANORAMAS = ("spherical", "equirectangular")
"""one lens, the second its older name"""
_PLAIN = ("k1", "k2")
_WIDE = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s0", "s1", "s2", "s3")
_NUMBERS = {
    "perspective": _PLAIN,
    "simple_radial": _PLAIN[:1],
    "radial": _PLAIN,
    "brown": ("k1", "k2", "k3", "p1", "p2"),
    "fisheye": _PLAIN,
    "fisheye_opencv": _WIDE[:4],
    "fisheye62": _WIDE[:8],
    "fisheye624": _WIDE,
    "dual": _PLAIN,
}
"""what a lens has beside its focal length"""
_ONE_FOCAL = ("perspective", "fisheye", "dual")
"""lenses with square pixels and the axis in the middle"""


def recognises(file: Path) -> bool:
    """True for a list that begins with cameras and shots, also if it is cut off.

    OpenDroneMap's `cameras.json` has lenses alone, and is no list.
    """
    head = text_head(file, 1 << 20)
    return head[:1] == b"[" and b'"cameras"' in head and b'"shots"' in head


def read(path: Path, photos: PhotoFinder) -> Capture:
    scenes = Entry.listed(path)
    if not scenes:
        raise CaptureError(path, "", "there is no reconstruction in it", "solve the photos again")
    all_shots = [scene.inner("shots", {}) for scene in scenes]
    scene, shots = max(zip(scenes, all_shots, strict=True), key=lambda pair: len(pair[1]))
    cameras = scene.inner("cameras", {})
    # They have changed with OpenSfM's versions, and matter only where a shot does not say it all.
    has_all = all(isinstance(s, dict) and s.get("rotation") for s in shots.values())
    rigs = {} if has_all else _rigs(scene)
    lenses = {}
    found, lost = [], []
    for name in shots:
        shot = shots.inner(name)
        from_world = _pose(shot) if shot.get("rotation") else rigs.get(name)
        if from_world is None:
            lost.append(name)
            continue
        key = shot.get("camera")
        if not isinstance(key, str) or key not in cameras:
            raise shot.error("camera", "its camera is missing")
        stated = f"images/{name}"  # where OpenSfM and OpenDroneMap have their photos
        photo = photos.find(stated, beside=path)
        if photos.serves(photo) and key not in lenses:
            lenses[key] = intrinsics_of(cameras.inner(key))
        pose = pose_of_world(path, shot.where, from_world)
        found.append(Found(shot.where, stated, photo, pose, lenses.get(key)))
    warnings = ()
    if len(scenes) > 1:
        others = sum(map(len, all_shots)) - len(shots)
        warnings = (f"{path.name}: of {len(scenes)} reconstructions only the largest is read; "
                    + counted(f"{others} photo|photos is|are in others"),)  # fmt: skip
    return assemble(
        path, NAME, found, photos, points=_points(scene), up=_UP, metric=_is_placed(scene),
        warnings=warnings, lost=(lost, shots.where, "give the file that a reconstruction has written"),
    )  # fmt: skip


def rotation_of(shot: Entry) -> np.ndarray:
    """A rotation [3, 3] from an axis times an angle in radians; what is none is found by `rigid_pose`."""
    axis = shot.numbers("rotation", 3)
    with np.errstate(all="ignore"):
        half = np.linalg.norm(axis) / 2
        quaternion = (np.cos(half), *(0.5 * np.sinc(half / np.pi) * axis))
        return rotation_from_quaternion(np.array(quaternion))


def _pose(entry: Entry) -> np.ndarray:
    # OpenSfM takes a missing translation for none.
    place = entry.numbers("translation", 3) if "translation" in entry else np.zeros(3)
    return rigid(rotation_of(entry), place)


def _rigs(scene: Entry) -> dict[str, np.ndarray]:
    """World-to-camera matrices [4, 4] of the photos of rigs."""

    def called(key: str) -> dict[str, Entry]:
        objects = scene.inner(key, {})
        return {name: objects.inner(name) for name in objects}

    inner = {key: _pose(entry) for key, entry in called("rig_cameras").items()}
    found = {}
    for entry in called("rig_instances").values():
        for name, key in entry.inner("rig_camera_ids", {}).items():
            if isinstance(key, str) and key in inner and entry.get("rotation"):
                found[name] = inner[key] @ _pose(entry)
    return found


def intrinsics_of(entry: Entry) -> Intrinsics:
    """A lens as OpenSfM states it.

    Raises:
        CaptureError: there is none like it here, or what is no number.
    """
    kind = entry.get("projection_type", "perspective")
    if not isinstance(kind, str) or kind not in (*_NUMBERS, *_PANORAMAS):
        raise entry.error(
            "projection_type", f"the lens model '{shown(kind)}' is not supported",
            "use one of " + ", ".join((*_NUMBERS, *_PANORAMAS)),
        )  # fmt: skip

    def value(name: str, default: float = 0.0) -> float:
        return entry.number(name) if name in entry else default

    width, height = int(entry.number("width")), int(entry.number("height"))
    longer = max(width, height)
    if kind in _PANORAMAS:
        return Intrinsics(width, height, *in_turns(width, height), EQUIRECTANGULAR)
    if kind in _ONE_FOCAL:
        fx = fy = entry.number("focal") * longer
        cx, cy = width / 2, height / 2
    else:
        fx, fy = entry.number("focal_x") * longer, entry.number("focal_y") * longer
        cx, cy = width / 2 + value("c_x") * longer, height / 2 + value("c_y") * longer
    k = {name: value(name) for name in _NUMBERS[kind]}
    equidistant = kind.startswith("fisheye")
    if kind == "dual":
        share = value("transition", 0.5)
        if share not in (0.0, 1.0):
            raise _no_lens(entry, f"'dual' with a transition of {share:g}")
        equidistant = share == 0
    lens = _lens(k, equidistant)
    if lens is None:
        raise _no_lens(entry, f"'{kind}' with k5 or k6, s1 or s3 beside tangential terms or a prism")
    return Intrinsics(width, height, fx, fy, cx, cy, *lens)


def _lens(k: dict[str, float], equidistant: bool) -> tuple[str, tuple[float, ...]] | None:
    """The lens that is just this polynomial; None if there is none."""
    k1, k2, k3, k4, k5, k6, p1, p2, s0, s1, s2, s3 = (k.get(name, 0.0) for name in _WIDE)
    if not any((k5, k6, s0, s1, s2, s3)):
        return polynomial_lens((k1, k2, k3, k4), (p1, p2), equidistant=equidistant)
    if not any((k5, k6, s1, s3)):
        return "thin_prism_fisheye", (k1, k2, p1, p2, k3, k4, s0, s2)
    if not any((p1, p2, s0, s1, s2, s3)):
        # Beside k1 … k6 that one bends the image, not the direction; here nothing is bent.
        return "rad_tan_thin_prism_fisheye", (k1, k2, k3, k4, k5, k6) + (0.0,) * 6
    return None


def _no_lens(entry: Entry, what: str) -> CaptureError:
    return entry.error(
        "projection_type", f"there is no lens here that is the same as {what}",
        "solve the photos again with the lens 'brown', or 'fisheye_opencv' for a fisheye",
    )  # fmt: skip


def _points(scene: Entry) -> np.ndarray:
    stated, points = scene.inner("points", {}), SparsePoints()
    for key in stated:
        points.add(*stated.inner(key).numbers("coordinates", 3))
    return points.array()


def _is_placed(scene: Entry) -> bool:
    """True if photos had GPS, so that the world has metres."""
    place = scene.inner("reference_lla", {})
    return any(place.number(k) for k in ("latitude", "longitude", "altitude") if k in place)
