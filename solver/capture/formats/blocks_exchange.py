"""BlocksExchange XML of ContextCapture and iTwin Capture, which other photogrammetry programs write, too.

Bentley's "BlocksExchange XML format" and "Perspective camera model" (ContextCapture User Guide): `Rotation`
takes the world to the axes that `CameraOrientation` names, OpenCV's (XRightYDown) unless it says otherwise,
as M_00 … M_22 row by row, or as Omega, Phi and Kappa in degrees, M = (Rx(ω) Ry(φ) Rz(κ))ᵀ; `Center` is the
camera's place. Paths are relative to `BaseImagePath`, or to the file. Yaw, pitch, roll and heading are not
read: the guide has their order in a picture only, and in a wrong one all cameras would be turned.

The world is one of `SpatialReferenceSystems`, or a local one of any scale and any up. ENU has metres and +Z
up; a geocentric one has metres, and up is away from the Earth's centre; a map has +Z up, and may have feet.
Degrees are no world for cameras. Photos of other components than the main one (1) were not placed with it.
"""

import re
from collections import Counter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import CaptureError, counted, shown
from ..files import read_xml, text_head
from ..frames import pose_opengl_from_opencv, rigid, rotation_from_omega_phi_kappa
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble, without_pose
from ..picture_names import parts_of
from ..sparse_points import SparsePoints
from .blocks_exchange_lens import axes_of, read_lens, value_of

NAME = "BlocksExchange XML"
PATTERNS = ("*.xml", "AT/*.xml", "*/*.xml")

_GEOCENTRIC = re.compile(r"EPSG:4978\b|\+proj=geocent|^GEOCCS|^GEOD\w*CRS.*\bCartesian\b", re.I | re.S)
_LOCAL = re.compile(r"LOCAL|ENG(INEERING)?CRS|$", re.I)
_ABSOLUTE = re.compile(r"[A-Za-z]:|[\\/]")
_MAIN = "1"
"""component of the photos that belong together"""
_WITH_MATRICES = "export it again with rotations as matrices, or as omega, phi and kappa"


def recognises(file: Path) -> bool:
    return b"<BlocksExchange" in text_head(file, 1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the block with the most photos; those without a pose are left out with a warning."""
    root = read_xml(path)
    blocks = root.findall("Block")
    if not blocks:
        raise CaptureError(path, "Block", "there is no block in it")
    block, warnings = max(blocks, key=lambda block: len(list(block.iter("Photo")))), []
    if len(blocks) > 1:
        name = shown(block.findtext("Name") or "the largest")
        warnings.append(f"{path.name}: of {len(blocks)} blocks only the largest is read, '{name}'")
    base = (root.findtext("BaseImagePath") or "").strip()
    groups = {photo: g for g in block.iter("Photogroup") for photo in g.iterfind("Photo")}
    listed = list(block.iter("Photo"))
    posed = {photo: pose for photo in groups if (pose := _pose_of(photo)) is not None}
    lost = [photo for photo in listed if photo not in posed]
    warnings += without_pose(
        path, len(listed), [_stated(photo, "ImagePath", base) for photo in lost], "Pose",
        "export it after the photos are aligned (aerotriangulation), with their poses",
    )  # fmt: skip
    parts = Counter(map(_component, posed))
    part = _MAIN if _MAIN in parts else max(sorted(parts), key=parts.__getitem__, default="")
    if len(parts) > 1:
        others = len(posed) - parts[part]
        what = counted(f"{others} photo|photos is|are in other components")
        warnings.append(f"{path.name}: {what}, whose places are not known, and left out")
    posed = {photo: pose for photo, pose in posed.items() if _component(photo) == part}
    axes = {group: axes_of(path, group) for group in {groups[photo] for photo in posed}}
    systems = {_system(group, block) for group in axes}
    if len(systems) > 1:
        raise CaptureError(
            path, "SRSId", f"its photos are in {len(systems)} systems of coordinates",
            "export the block in one",
        )  # fmt: skip
    system = next(iter(systems), "")
    lenses: dict[Element, Intrinsics] = {}
    found, places = [], []
    for index, (photo, pose) in enumerate(posed.items()):
        where, group = f"photo {shown(photo.findtext('Id') or index)}", groups[photo]
        matrix = _camera_to_world(path, where, axes[group], *pose)
        places.append(matrix[:3, 3])
        stated = _stated(photo, "ImagePath", base)
        if not stated:
            raise CaptureError(path, f"{where}, ImagePath", "it names no photo")
        picture = photos.find(stated, beside=path)
        if photos.serves(picture) and group not in lenses:
            lenses[group] = read_lens(path, group)
        mask = None if picture is None else _mask(path, photos, picture, photo, base)
        found.append(
            Found(where, stated, picture, pose_opengl_from_opencv(matrix), lenses.get(group), mask)
        )
    up, metric = _world(path, _definition(root, system), np.array(places))
    return assemble(
        path, NAME, found, photos, points=_points(path, block, system), up=up, metric=metric,
        warnings=tuple(warnings),
    )  # fmt: skip


def _stated(photo: Element, name: str, base: str) -> str:
    """The path of a photo or its mask, behind the one that all have in common."""
    stated = (photo.findtext(name) or "").strip()
    return f"{base}/{stated}" if base and stated and not _ABSOLUTE.match(stated) else stated


def _component(photo: Element) -> str:
    return (photo.findtext("Component") or "").strip() or _MAIN


def _pose_of(photo: Element) -> tuple[Element, Element] | None:
    turn, place = photo.find("Pose/Rotation"), photo.find("Pose/Center")
    if turn is None or place is None or all(child.tag == "Accurate" for child in turn):
        return None
    return turn, place


def _mask(path: Path, photos: PhotoFinder, picture: Path, photo: Element, base: str) -> Path | None:
    """The mask that the file names, by as much of its path as is there."""
    stated = _stated(photo, "MaskPath", base)
    parts = parts_of(stated)
    for start in range(len(parts)):
        mask = photos.mask_of(picture, "/".join(parts[start:]), beside=path)
        if mask is not None and mask != picture and mask.is_file():
            return mask
    return photos.mask_of(picture, stated, beside=path)


def _camera_to_world(path: Path, where: str, axes: np.ndarray, turn: Element, place: Element) -> np.ndarray:
    """[4, 4] with OpenCV's axes.

    Args:
        axes: [3, 3] from those of the file.
    """
    names = {child.tag for child in turn}
    if "M_00" in names:
        matrix = np.array(
            [[value_of(path, where, turn, f"M_{row}{column}") for column in range(3)] for row in range(3)]
        )
    elif "Omega" in names:
        angles = [value_of(path, where, turn, name) for name in ("Omega", "Phi", "Kappa")]
        matrix = rotation_from_omega_phi_kappa(angles).T
    else:
        raise CaptureError(
            path, f"{where}, Rotation", f"rotations as {shown(', '.join(sorted(names)))} are not read",
            _WITH_MATRICES,
        )  # fmt: skip
    centre = [value_of(path, f"{where}, Center", place, axis) for axis in "xyz"]
    return rigid((axes @ matrix).T, centre)


def _system(*elements: Element) -> str:
    return next((text for e in elements if (text := (e.findtext("SRSId") or "").strip())), "")


def _definition(root: Element, system: str) -> str:
    """What a system of coordinates is; empty for the local one that a block without one has."""
    for entry in root.iterfind("SpatialReferenceSystems/SRS"):
        if system and (entry.findtext("Id") or "").strip() == system:
            return (entry.findtext("Definition") or "").strip()
    return ""


def _world(
    path: Path, definition: str, places: np.ndarray
) -> tuple[tuple[float, float, float] | None, bool]:
    """Where up is in the world of cameras at places [N, 3], if it is known, and whether it has metres."""
    if _LOCAL.match(definition) or not len(places):
        return None, False
    if definition.upper().startswith("ENU"):
        return (0.0, 0.0, 1.0), True
    if _GEOCENTRIC.search(definition):
        middle = places.mean(0)
        with np.errstate(over="ignore"):
            distance = np.linalg.norm(middle)
        return (tuple(middle / distance) if 0 < distance < np.inf else None), True
    if (np.abs(places[:, :2]) <= (360, 90)).all():
        raise CaptureError(
            path, "SRSId", f"its world is in degrees ({shown(definition)})",
            "export it in a local system (ENU), or that of a map, such as UTM",
        )  # fmt: skip
    return (0.0, 0.0, 1.0), False


def _points(path: Path, block: Element, system: str) -> np.ndarray:
    """Tie points [N, 3] with a place in the cameras' system of coordinates."""
    points = SparsePoints()
    for group in block.iterfind("TiePoints"):
        standard = _system(group, block)
        for index, point in enumerate(group.iterfind("TiePoint")):
            place = point.find("Position")
            if place is not None and (_system(point) or standard) == system:
                where = f"tie point {index}"
                points.add(*(value_of(path, where, place, axis) for axis in "xyz"))
    return points.array()
