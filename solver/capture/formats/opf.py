"""Pix4D's Open Photogrammetry Format, `project.opf`, as PIX4Dmatic, PIX4Dmapper and PIX4Dcloud export it.

The project lists files of JSON: its camera lists (which photo has which identity), its input cameras (how
large a sensor's photos are) and its calibration. There `position` is a camera's place, `orientation_deg`
are omega, phi, kappa: Rx(ω) Ry(φ) Rz(κ) takes camera axes +X right, +Y up, the view along −Z, which are
OpenGL's, to the world. A rig's cameras have poses of their own. Pixels are counted from the corner of the
first one. R1 R2 R3 T1 T2 are OpenCV's k1 k2 k3 p1 p2, as Pix4D's own example projects points.

The world is a map's, +Z up, counted from among the cameras; or a site's own (an engineering CRS), whose
up is not known. Its unit is a metre or a foot, so none is claimed.

A fisheye's `polynomial` is p0 … of an angle θ of which a quarter turn is 1, with p0 = 0 and p1 = 1: the
image of a point to the right (X) and below (Y) is ρ(θ) (X, Y) / √(X² + Y²) times the matrix `affine`.
https://pix4d.github.io/opf-spec, https://github.com/Pix4D/pyopf (examples/compute_reprojection_error.py),
Pix4D's paper "Camera internals for fisheye lens" and articles/202559089 of its support
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..brown_lens import polynomial_lens
from ..capture import Capture
from ..errors import CaptureError, counted, shown
from ..fields import entries, mapping, number, numbers
from ..files import file_below, json_head, read_json
from ..fisheye_power import of_quarter_turns
from ..intake import Found, Intrinsics, assemble, without_pose
from ..photo_finder import PhotoFinder
from .opf_points import read_gltf_points

NAME = "OPF"
EXTENSIONS = (".opf",)
PATTERNS = ("*.opf", "*/*.opf")

_AGAIN = "export the project again"
_KNOWN = re.compile(r"1\.\d+")
"""versions; those before 1.0 have other fields"""
_LOCAL = re.compile(r"ENG(INEERING)?CRS|LOCAL_CS", re.I)
_UNDISTORTED = "undistort"
"""where opf_undistort writes photos, below those that they were made of"""
_CALIBRATION, _POINTS = "application/opf-calibrated-cameras+json", "model/gltf+json"
"""formats of resources"""
_PAGE = re.compile(r"#page=(\d+)$")


def recognises(file: Path) -> bool:
    """True for JSON that calls itself a project in this format, also if it is cut off."""
    return b"opf-project+json" in json_head(file)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the calibrated cameras of a project; others are left out with a warning."""
    items = entries(path, "items", mapping(path, "", read_json(path)).get("items"))
    calibrations = list(_resources(path, items, _CALIBRATION))
    if len(calibrations) != 1:
        raise CaptureError(
            path, "items", f"there are {len(calibrations) or 'no'} calibrations in it",
            "export a project with one, after its cameras are calibrated",
        )  # fmt: skip
    file, calibration = calibrations[0]
    uris = _uris(path, items)
    sizes, taken = _input_cameras(path, items)
    sensors = _by_id(file, "sensors", calibration)
    cameras = _by_id(file, "cameras", calibration)
    lenses: dict[tuple[int, bool], Intrinsics] = {}
    found, moving = [], 0
    for identity, (where, camera) in cameras.items():
        if identity not in uris:
            raise CaptureError(file, f"{where}.id", "no camera list has this camera", _AGAIN)
        photo = _photo(path, uris[identity], photos)
        sensor = _identity(file, f"{where}.sensor_id", camera.get("sensor_id"))
        straight = photo is not None and photo.parent.name.lower() == _UNDISTORTED
        if photos.serves(photo) and (sensor, straight) not in lenses:
            if sensor not in sensors or sensor not in sizes:
                raise CaptureError(file, f"{where}.sensor_id", "there is no such sensor", _AGAIN)
            lens = _lens(file, *sensors[sensor], sizes[sensor])
            lenses[sensor, straight] = _without_distortion(lens) if straight else lens
        moving += "rolling_shutter" in camera and any(
            numbers(file, f"{where}.rolling_shutter", camera["rolling_shutter"], 3)
        )
        pose = _pose(file, where, camera)
        found.append(Found(where, uris[identity], photo, pose, lenses.get((sensor, straight))))
    lost = [uris.get(identity, str(identity)) for identity in taken if identity not in cameras]
    warnings = without_pose(
        path,
        "calibration",
        lost,
        len(found) + len(lost),
        "calibrate its cameras, and export it again",
    )
    if moving:
        what = counted(f"{moving} camera|cameras moved while its|their photo|photos was|were")
        warnings += (f"{file.name}: {what} read out (rolling shutter); that is not used",)
    up = None if _is_local(path, items) else (0.0, 0.0, 1.0)
    points, problems = _points(path, items)
    return assemble(path, NAME, found, photos, points=points, up=up, warnings=warnings + problems)


def _points(path: Path, items: list) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """The calibration's sparse points [N, 3], and what is wrong with them; a fit does without."""
    for item in items:
        resources = mapping(path, "items", item).get("resources") or ()
        uris = {str(one.get("format")): one.get("uri") for one in resources}
        uri = uris.get(_POINTS)
        if _CALIBRATION not in uris or not isinstance(uri, str):
            continue
        if (file := _in_project(path, uri)) is not None:
            try:
                return read_gltf_points(file, path.absolute().parent), ()
            except CaptureError as error:
                return None, (str(error),)
    return None, ()


def _resources(path: Path, items: list, form: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Files of one format in a project, and what they hold.

    Raises:
        CaptureError: one is missing, outside of the project's folder, or of a version that is not known.
    """
    for index, item in enumerate(items):
        field = f"items[{index}].resources"
        for resource in entries(path, field, mapping(path, field, item).get("resources")):
            resource = mapping(path, field, resource)
            uri = resource.get("uri")
            if resource.get("format") != form:
                continue
            if not isinstance(uri, str) or "\0" in uri:
                raise CaptureError(path, field, f"'{shown(uri)}' names no file", _AGAIN)
            file = _in_project(path, uri)
            if file is None:
                raise CaptureError(
                    path, field, f"'{shown(uri)}' is not in its folder",
                    "copy the whole project, or export it again",
                )  # fmt: skip
            content = mapping(file, "", read_json(file))
            if not _KNOWN.fullmatch(version := str(content.get("version"))):
                raise CaptureError(
                    file, "version", f"'{shown(version)}' is not known, only 1.0",
                    "export the project with a newer program, or convert it by opf_convert of pyopf",
                )  # fmt: skip
            yield file, content


def _in_project(path: Path, uri: str) -> Path | None:
    """The file that a URI of a project names; None if there is none in its folder."""
    folder = path.absolute().parent
    return file_below(folder, folder, unquote(uri))


def _uris(path: Path, items: list) -> dict[int, str]:
    """What camera lists call the file of each camera, by identity."""
    uris = {}
    for file, content in _resources(path, items, "application/opf-camera-list+json"):
        for identity, (where, camera) in _by_id(file, "cameras", content).items():
            if not isinstance(camera.get("uri"), str):
                raise CaptureError(file, f"{where}.uri", "the camera names no photo", _AGAIN)
            uris[identity] = camera["uri"]
    return uris


def _input_cameras(path: Path, items: list) -> tuple[dict[int, np.ndarray], list[int]]:
    """Width and height in pixels of each sensor's photos, and the identities of all cameras."""
    sizes, taken = {}, []
    for file, content in _resources(path, items, "application/opf-input-cameras+json"):
        for identity, (where, sensor) in _by_id(file, "sensors", content).items():
            size = sensor.get("image_size_px")
            sizes[identity] = numbers(file, f"{where}.image_size_px", size, 2)
        for index, capture in enumerate(entries(file, "captures", content.get("captures"))):
            field = f"captures[{index}]"
            taken += _by_id(file, "cameras", mapping(file, field, capture), f"{field}.")
    return sizes, taken


def _by_id(file: Path, key: str, content: dict, at: str = "") -> dict[int, tuple[str, dict]]:
    """The objects of a list by their identities, each with the field that it is."""
    found = {}
    for index, value in enumerate(entries(file, f"{at}{key}", content.get(key))):
        where = f"{at}{key}[{index}]"
        value = mapping(file, where, value)
        found[_identity(file, f"{where}.id", value.get("id"))] = where, value
    return found


def _identity(file: Path, field: str, value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise CaptureError(file, field, f"'{shown(value)}' is not an identity", _AGAIN)
    return value


def _photo(path: Path, uri: str, photos: PhotoFinder) -> Path | None:
    """The photo that a URI names, with or without %20 for a blank.

    Raises:
        CaptureError: it is not the first page of a file.
    """
    page = _PAGE.search(uri)
    if page is not None and page[1].strip("0"):
        raise CaptureError(
            path, shown(uri), "photos on later pages of a file are not read",
            "save each page as a TIFF of its own",
        )  # fmt: skip
    stated = _PAGE.sub("", uri).removeprefix("file://")
    return photos.find(unquote(stated), beside=path) or photos.find(stated, beside=path)


def _lens(file: Path, where: str, sensor: dict, size: np.ndarray) -> Intrinsics:
    field = f"{where}.internals"
    internals = mapping(file, field, sensor.get("internals"))
    kind = internals.get("type")
    if kind == "fisheye":
        return _fisheye(file, field, internals, size)
    if kind != "perspective":
        raise CaptureError(
            file, f"{field}.type", f"lenses called '{shown(kind)}' are not supported",
            "calibrate the cameras with a perspective lens, or solve them from the photos",
        )  # fmt: skip
    focal = number(file, f"{field}.focal_length_px", internals.get("focal_length_px"))
    cx, cy, *radial, p1, p2 = (
        float(value)
        for key, count in (
            ("principal_point_px", 2), ("radial_distortion", 3), ("tangential_distortion", 2)
        )
        for value in numbers(file, f"{field}.{key}", internals.get(key), count)
    )  # fmt: skip
    lens, distortion = polynomial_lens(radial, (p1, p2))
    return Intrinsics(*map(int, size), focal, focal, cx, cy, lens, distortion)


def _fisheye(file: Path, field: str, internals: dict, size: np.ndarray) -> Intrinsics:
    """The lens of a fisheye.

    Raises:
        CaptureError: it has no image on its axis, or is not normalised as its programs do.
    """
    cx, cy = numbers(file, f"{field}.principal_point_px", internals.get("principal_point_px"), 2)
    affine = numbers(file, f"{field}.affine", internals.get("affine"), 4).reshape(2, 2).tolist()
    powers = numbers(file, f"{field}.polynomial", internals.get("polynomial")).tolist()
    lens = None
    if powers[:2] == [0, 1] and not any(powers[5:]):
        lens = of_quarter_turns([*powers[1:5], 0, 0, 0][:4], affine)
    if lens is None:
        raise CaptureError(
            file, f"{field}.polynomial", "only polynomials that begin with 0, 1 and end with the 4th "
            "power are supported", "export the undistorted photos, or solve the cameras from the photos",
        )  # fmt: skip
    fx, fy, (name, distortion) = lens
    return Intrinsics(*map(int, size), fx, fy, float(cx), float(cy), name, distortion)


def _without_distortion(lens: Intrinsics) -> Intrinsics:
    """The lens of a photo that opf_undistort made."""
    return replace(lens, lens="pinhole", distortion=())


def _pose(file: Path, where: str, camera: dict) -> np.ndarray:
    """Camera to world [4, 4] with OpenGL's axes."""
    angles = numbers(file, f"{where}.orientation_deg", camera.get("orientation_deg"), 3)
    (so, sp, sk), (co, cp, ck) = np.sin(np.radians(angles)), np.cos(np.radians(angles))
    pose = np.eye(4)
    pose[:3, :3] = (
        (cp * ck, -cp * sk, sp),
        (co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp),
        (so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp),
    )
    pose[:3, 3] = numbers(file, f"{where}.position", camera.get("position"), 3)
    return pose


def _is_local(path: Path, items: list) -> bool:
    """True unless the project says that its world is a map's."""
    for file, content in _resources(path, items, "application/opf-scene-reference-frame+json"):
        crs = mapping(file, "crs", content.get("crs"))
        return _LOCAL.search(str(crs.get("definition"))) is not None
    return True
