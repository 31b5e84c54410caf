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
from urllib.parse import unquote

import numpy as np

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, counted, shown
from ..fields import Entry
from ..files import file_below, json_head
from ..fisheye_power import of_quarter_turns
from ..frames import rigid, rotation_from_omega_phi_kappa
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from .opf_points import read_gltf_points

NAME = "OPF"
PATTERNS = ("*.opf", "*/*.opf")

_AGAIN = "export the project again"
_KNOWN = re.compile(r"1\.\d+")
"""versions; those before 1.0 have other fields"""
_LOCAL = re.compile(r"ENG(INEERING)?CRS|LOCAL_CS", re.I)
_UNDISTORTED = "undistort"
"""where opf_undistort writes photos, which have no distortion, below those that they were made of"""
_CALIBRATION, _POINTS = "application/opf-calibrated-cameras+json", "model/gltf+json"
"""formats of resources"""
_PAGE = re.compile(r"#page=(\d+)$")


def recognises(file: Path) -> bool:
    return b"opf-project+json" in json_head(file)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the calibrated cameras of a project; others are left out with a warning."""
    items = list(Entry.of_file(path).objects("items"))
    calibrations = list(_resources(path, items, _CALIBRATION))
    if len(calibrations) != 1:
        raise CaptureError(
            path, "items", f"there are {len(calibrations) or 'no'} calibrations in it",
            "export a project with one, after its cameras are calibrated",
        )  # fmt: skip
    calibration = calibrations[0]
    uris = _uris(path, items)
    sizes, taken = _input_cameras(path, items)
    sensors, cameras = _by_id(calibration, "sensors"), _by_id(calibration, "cameras")
    lenses: dict[tuple[int, bool], Intrinsics] = {}
    found, moving = [], 0
    for identity, camera in cameras.items():
        if identity not in uris:
            raise camera.error("id", "no camera list has this camera", _AGAIN)
        photo = _photo(path, uris[identity], photos)
        sensor = _identity(camera, "sensor_id")
        straight = photo is not None and photo.parent.name.lower() == _UNDISTORTED
        if photos.serves(photo) and (sensor, straight) not in lenses:
            if sensor not in sensors or sensor not in sizes:
                raise camera.error("sensor_id", "there is no such sensor", _AGAIN)
            lens = _lens(sensors[sensor], sizes[sensor])
            lenses[sensor, straight] = replace(lens, lens="pinhole", distortion=()) if straight else lens
        moving += "rolling_shutter" in camera and any(camera.numbers("rolling_shutter", 3))
        lens = lenses.get((sensor, straight))
        rotation = rotation_from_omega_phi_kappa(camera.numbers("orientation_deg", 3))
        pose = rigid(rotation, camera.numbers("position", 3))
        found.append(Found(camera.where, uris[identity], photo, pose, lens))
    lost = [uris.get(identity, str(identity)) for identity in taken if identity not in cameras]
    lost, warnings = (lost, "calibration", "calibrate its cameras, and export it again"), ()
    if moving:
        what = counted(f"{moving} camera|cameras moved while its|their photo|photos was|were")
        warnings = (f"{calibration.path.name}: {what} read out (rolling shutter); that is not used",)
    up = None if _is_local(path, items) else (0.0, 0.0, 1.0)
    points, problems = _points(path, items)
    return assemble(
        path, NAME, found, photos, points=points, up=up, warnings=warnings + problems, lost=lost
    )


def _points(path: Path, items: list[Entry]) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """The calibration's sparse points [N, 3], and what is wrong with them; a fit does without."""
    for item in items:
        uris = {str(one.get("format")): one.get("uri") for one in item.objects("resources")}
        uri = uris.get(_POINTS)
        if _CALIBRATION not in uris or not isinstance(uri, str):
            continue
        if (file := _in_project(path, uri)) is not None:
            try:
                return read_gltf_points(file, path.absolute().parent), ()
            except CaptureError as error:
                return None, (str(error),)
    return None, ()


def _resources(path: Path, items: list[Entry], form: str) -> Iterator[Entry]:
    """What the files of one format in a project hold."""
    for item in items:
        for resource in item.objects("resources"):
            if resource.get("format") != form:
                continue
            uri = resource.get("uri")
            if not isinstance(uri, str) or "\0" in uri:
                raise item.error("resources", f"'{shown(uri)}' names no file", _AGAIN)
            file = _in_project(path, uri)
            if file is None:
                raise item.error(
                    "resources", f"'{shown(uri)}' is not in its folder",
                    "copy the whole project, or export it again",
                )  # fmt: skip
            content = Entry.of_file(file)
            if not _KNOWN.fullmatch(version := str(content.get("version"))):
                raise content.error(
                    "version", f"'{shown(version)}' is not known, only 1.0",
                    "export the project with a newer program, or convert it by opf_convert of pyopf",
                )  # fmt: skip
            yield content


def _in_project(path: Path, uri: str) -> Path | None:
    """The file that a URI of a project names; None if there is none in its folder."""
    folder = path.absolute().parent
    return file_below(folder, folder, unquote(uri))


def _uris(path: Path, items: list[Entry]) -> dict[int, str]:
    uris = {}
    for content in _resources(path, items, "application/opf-camera-list+json"):
        for identity, camera in _by_id(content, "cameras").items():
            uris[identity] = camera.name("uri", "the camera names no photo", _AGAIN)
    return uris


def _input_cameras(path: Path, items: list[Entry]) -> tuple[dict[int, np.ndarray], list[int]]:
    """Width and height in pixels of each sensor's photos, and the identities of all cameras."""
    sizes, taken = {}, []
    for content in _resources(path, items, "application/opf-input-cameras+json"):
        for identity, sensor in _by_id(content, "sensors").items():
            sizes[identity] = sensor.numbers("image_size_px", 2)
        for capture in content.objects("captures"):
            taken += _by_id(capture, "cameras")
    return sizes, taken


def _by_id(content: Entry, key: str) -> dict[int, Entry]:
    return {_identity(entry, "id"): entry for entry in content.objects(key)}


def _identity(entry: Entry, key: str) -> int:
    value = entry.get(key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise entry.error(key, f"'{shown(value)}' is not an identity", _AGAIN)
    return value


def _photo(path: Path, uri: str, photos: PhotoFinder) -> Path | None:
    """The photo that a URI names, with or without %20 for a blank."""
    page = _PAGE.search(uri)
    if page is not None and page[1].strip("0"):
        raise CaptureError(
            path, shown(uri), "photos on later pages of a file are not read",
            "save each page as a TIFF of its own",
        )  # fmt: skip
    stated = _PAGE.sub("", uri).removeprefix("file://")
    return photos.find(unquote(stated), beside=path) or photos.find(stated, beside=path)


def _lens(sensor: Entry, size: np.ndarray) -> Intrinsics:
    internals = sensor.inner("internals")
    kind = internals.get("type")
    if kind == "fisheye":
        return _fisheye(internals, size)
    if kind != "perspective":
        raise internals.error(
            "type", f"lenses called '{shown(kind)}' are not supported",
            "calibrate the cameras with a perspective lens, or solve them from the photos",
        )  # fmt: skip
    focal = internals.number("focal_length_px")
    cx, cy = internals.numbers("principal_point_px", 2).tolist()
    radial = internals.numbers("radial_distortion", 3).tolist()
    lens = polynomial_lens(radial, internals.numbers("tangential_distortion", 2).tolist())
    return Intrinsics(*map(int, size), focal, focal, cx, cy, *lens)


def _fisheye(internals: Entry, size: np.ndarray) -> Intrinsics:
    cx, cy = internals.numbers("principal_point_px", 2).tolist()
    affine = internals.numbers("affine", 4).reshape(2, 2).tolist()
    powers = internals.numbers("polynomial").tolist()
    lens = None
    if powers[:2] == [0, 1] and not any(powers[5:]):
        lens = of_quarter_turns([*powers[1:5], 0, 0, 0][:4], affine)
    if lens is None:
        raise internals.error(
            "polynomial", "only polynomials that begin with 0, 1 and end with the 4th "
            "power are supported", "export the undistorted photos, or solve the cameras from the photos",
        )  # fmt: skip
    fx, fy, (name, distortion) = lens
    return Intrinsics(*map(int, size), fx, fy, cx, cy, name, distortion)


def _is_local(path: Path, items: list[Entry]) -> bool:
    """True unless the project says that its world is a map's."""
    for content in _resources(path, items, "application/opf-scene-reference-frame+json"):
        return _LOCAL.search(str(content.inner("crs").get("definition"))) is not None
    return True
