"""Agisoft Metashape's camera export (File > Export > Export Cameras, Agisoft XML).

Cameras have OpenCV's axes; `transform` takes them to the chunk, the chunk's (or its component's)
`transform` takes the chunk to the world, +Z up. Far from the world's origin, as in geocentric
coordinates (with any projected system on top, Metashape writes these), cameras stay in the chunk's
coordinates instead, and up is away from the Earth's centre. Panoramas (`spherical`) have the same axes, the
view along +Z in the picture's middle, as nerfstudio has them (metashape_utils.py).

What a rig places behind its first camera has no `transform`, but the first one's number as `master_id`,
and its sensor has `rotation` and `location`: from its own axes to the first camera's, in the chunk's unit.
https://photogrammetrycommunity.github.io/metashape-expert-manual ("The slave-sensor transform"), and
metashape_to_krt.py of Meta's converters for Eyeful Tower, whose rigs were exported so. Lenses are in
`metashape_lens`. With a rolling shutter, `transform` is the pose at the middle row, and how the camera
moved from the first row to the last (`rolling_shutter`) is left aside with a word.
"""

from collections import Counter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import CaptureError, counted, shown, told_of
from ..fields import number, numbers
from ..files import read_xml, text_head
from ..frames import pose_opengl_from_opencv, unit
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..picture_names import parts_of, stem_of
from .metashape_lens import has_rolling_shutter, is_other_panorama, read_lens

NAME = "Metashape cameras.xml"
PATTERNS = ("cameras.xml", "*cameras*.xml", "*.xml")

FAR = 1e5
"""world units from the origin beyond which chunk coordinates are kept: solvers count in single
precision, which is a hundredth there and half a unit on the Earth's surface"""
_EARTH = (6.3e6, 6.45e6)
"""metres from its centre between which all of its surface lies"""
_DISABLED, _NOT_ALIGNED = "disabled", "not aligned"
_PANORAMA = "panoramic (on a cylinder or with a lens's numbers)"
_IN_A_RIG = "part of a rig, whose places in it the file does not state,"
"""what cameras are that are left out"""


def recognises(file: Path) -> bool:
    """True for XML with a chunk and its sensors or cameras, also if it is cut off or a project's own."""
    head = text_head(file, 1 << 16)
    return b"<chunk" in head and (b"<sensor" in head or b"<camera" in head)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read exported cameras; those that are disabled, not aligned or panoramas of another kind than all
    directions are left out with a warning.
    """
    chunks = [chunk for chunk in read_xml(path).iter("chunk") if chunk.find(".//camera") is not None]
    if not chunks:
        raise CaptureError(path, "chunk", "there are no cameras in it")
    chunk, warnings = max(chunks, key=lambda chunk: len(chunk.findall(".//camera/transform"))), []
    if len(chunks) > 1:
        name = shown(chunk.get("label", "the largest"))
        warnings.append(f"{path.name}: of {len(chunks)} chunks only the largest is read, '{name}'")
    worlds, pictures = _Worlds(path, chunk), _Pictures(chunk, photos)
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    rigs = _Rigs(path, chunk, sensors)
    lenses: dict[str | None, Intrinsics] = {}
    rolling = {key for key, sensor in sensors.items() if has_rolling_shutter(sensor)}
    panoramas = {key for key, sensor in sensors.items() if is_other_panorama(sensor)}
    found, parts, moving = [], [], []
    left_out: dict[str, list[str]] = {
        reason: [] for reason in (_DISABLED, _NOT_ALIGNED, _IN_A_RIG, _PANORAMA)
    }
    for index, camera in enumerate(chunk.iter("camera")):
        label = camera.get("label") or ""
        where = f"camera {shown(label)}" if label else f"camera {index + 1}"
        reason = _why_not(camera, panoramas, rigs)
        if reason is not None:
            left_out[reason].append(label)
            continue
        matrix = rigs.to_chunk(camera, where)
        stated, photo = pictures.find(camera, path)
        key = camera.get("sensor_id")
        if photos.serves(photo) and key not in lenses:
            if key not in sensors:
                raise CaptureError(path, where, "its sensor is missing")
            lenses[key] = read_lens(path, sensors[key])
        if key in rolling or camera.find("rolling_shutter") is not None:
            moving.append(label)
        component = rigs.placed(camera).get("component_id")
        world = worlds.of(component)
        parts.append("world" if world is not None else str(component))
        pose = pose_opengl_from_opencv(matrix if world is None else world @ matrix)
        found.append(Found(where, stated, photo, pose, lenses.get(key)))
    if moving:
        what = "camera|cameras was|were aligned with a rolling shutter, and is|are taken as standing still"
        warnings.append(told_of(path, moving, f"{what} where it|they was|were at a photo's middle row"))
    for what, names in left_out.items():
        if names:
            warnings.append(told_of(path, names, f"camera|cameras is|are {what} and left out"))
    if len(set(parts)) > 1:
        largest = max(sorted(set(parts)), key=parts.count)
        found = [item for item, part in zip(found, parts, strict=True) if part == largest]
        others = len(parts) - len(found)
        told = counted(f"{others} camera|cameras is|are in other components")
        warnings.append(f"{path.name}: {told}, whose places are not known, and left out")
    if not found and left_out[_PANORAMA]:
        raise CaptureError(
            path, "sensor, type", f"all its cameras are {_PANORAMA}",
            "cut the panoramas into perspective photos, and align those",
        )  # fmt: skip
    if not found and (unaligned := left_out[_NOT_ALIGNED]):
        raise CaptureError(
            path, "transform", "its camera is not aligned" if len(unaligned) == 1
            else f"none of its {len(unaligned)} cameras is aligned",
            "align the photos in Metashape and export the cameras again",
        )  # fmt: skip
    return assemble(path, NAME, found, photos, up=worlds.up, metric=worlds.metric, warnings=tuple(warnings))


def _why_not(camera: Element, panoramas: set[str | None], rigs: "_Rigs") -> str | None:
    """Why a camera is left out, such as one of a sensor of `panoramas` (ids); None: it is not."""
    if (camera.get("enabled") or "true").strip().lower() in ("false", "0", "no"):
        return _DISABLED
    if camera.get("sensor_id") in panoramas:
        return _PANORAMA
    if not _has_transform(rigs.placed(camera)):
        return _NOT_ALIGNED
    return None if rigs.knows(camera) else _IN_A_RIG


def _has_transform(camera: Element) -> bool:
    return bool((camera.findtext("transform") or "").strip())


class _Rigs:
    """Where a chunk's cameras lie in it, also those that a rig's first camera takes along."""

    def __init__(self, path: Path, chunk: Element, sensors: dict[str | None, Element]):
        self._path, self._sensors = path, sensors
        self._cameras = {camera.get("id"): camera for camera in chunk.iter("camera")}

    def placed(self, camera: Element) -> Element:
        """The camera whose `transform` counts: the rig's first one if a camera has none, else itself."""
        first = self._cameras.get(camera.get("master_id"))
        return camera if _has_transform(camera) or first is None else first

    def knows(self, camera: Element) -> bool:
        """Whether a camera has a place of its own, or one in its rig."""
        sensor = self._sensors.get(camera.get("sensor_id"))
        return self.placed(camera) is camera or (
            sensor is not None
            and sensor.find("rotation") is not None
            and sensor.find("location") is not None
        )

    def to_chunk(self, camera: Element, where: str) -> np.ndarray:
        """The matrix [4, 4] from a camera's axes, OpenCV's, to the chunk.

        Raises:
            CaptureError: its numbers are none.
        """
        placed = self.placed(camera)
        text = placed.findtext("transform")
        matrix = numbers(self._path, f"{where}, transform", text, 16).reshape(4, 4)
        if placed is camera:
            return matrix
        sensor, to_first = self._sensors[camera.get("sensor_id")], np.eye(4)
        for name, part in (("rotation", to_first[:3, :3]), ("location", to_first[:3, 3])):
            field = f"{where}, sensor, {name}"
            part.flat = numbers(self._path, field, sensor.findtext(name), part.size)
        return matrix @ to_first


class _Pictures:
    """The photos of a chunk's cameras, which are called by their names without folders.

    Photos of several memory cards can share a name. Metashape can group cameras by the photos' folders,
    so there a group's name tells the folder; elsewhere people group cameras as they like.
    """

    def __init__(self, chunk: Element, photos: PhotoFinder):
        self._photos = photos
        self._groups = {
            camera: group.get("label") or ""
            for group in chunk.iter("group")
            for camera in group.iter("camera")
        }
        self._of_name = Counter(_name_of(camera) for camera in chunk.iter("camera"))

    def find(self, camera: Element, path: Path) -> tuple[str, Path | None]:
        """What a camera calls its photo, and the photo.

        Raises:
            CaptureError: several pictures could be meant.
        """
        label = camera.get("label") or ""
        if self._of_name[_name_of(camera)] == 1:
            return label, self._photos.find(label, beside=path)
        group = self._groups.get(camera)
        stated = f"{group}/{label}" if group and len(parts_of(label)) == 1 else label
        try:
            return stated, self._photos.find(stated, beside=path)
        except CaptureError as error:
            raise CaptureError(
                error.file, error.field, error.problem,
                "rename the photos so that no two share a name, and export the cameras again",
            ) from error  # fmt: skip


def _name_of(camera: Element) -> str:
    """A camera's label as photos are compared."""
    return stem_of("/".join(parts_of(camera.get("label") or "")))


class _Worlds:
    """Where a chunk's components lie.

    Attributes:
        up: the world's upward direction, if the chunk is placed in one.
        metric: the world has the scale of something measured, such as scale bars, and is turned anyhow.
    """

    def __init__(self, path: Path, chunk: Element):
        parts = [(None, chunk), *((part.get("id"), part) for part in chunk.iter("component"))]
        stated = ((key, part.find("transform")) for key, part in parts)
        self._of_component = {key: _similarity(path, e) for key, e in stated if e is not None}
        first = next(iter(self._of_component.values()), None)
        # Scale bars alone say nothing of axes, which are then those of the first photos.
        self.metric = first is not None and np.allclose(first[:3, :3], first[0, 0] * np.eye(3))
        self.up = None if first is None or self.metric else (0.0, 0.0, 1.0)
        if first is not None and (distance := np.linalg.norm(first[:3, 3])) > FAR:
            geocentric = _EARTH[0] < distance < _EARTH[1]
            up = first[:3, :3].T @ (first[:3, 3] if geocentric else (0.0, 0.0, 1.0))
            self.up = tuple(unit(up))
            back = np.linalg.inv(first)  # components share the first one's coordinates
            self._of_component = {k: back @ m for k, m in self._of_component.items()}

    def of(self, component: str | None) -> np.ndarray | None:
        """Chunk-to-world [4, 4] of a component's cameras; None if it has no place in the world."""
        if component is None and len(self._of_component) == 1:
            return next(iter(self._of_component.values()))
        return self._of_component.get(component, self._of_component.get(None))


def _similarity(path: Path, element: Element) -> np.ndarray:
    """Chunk to world [4, 4]: rotation, uniform scale and translation."""
    matrix = np.eye(4)
    if (text := element.findtext("rotation")) is not None:
        matrix[:3, :3] = numbers(path, "chunk rotation", text, 9).reshape(3, 3)
    if (text := element.findtext("scale")) is not None:
        matrix[:3, :3] *= number(path, "chunk scale", text)
    if (text := element.findtext("translation")) is not None:
        matrix[:3, 3] = numbers(path, "chunk translation", text, 3)
    # Older files have one 4 × 4 matrix instead.
    if len(element) == 0 and (element.text or "").strip():
        matrix = numbers(path, "chunk transform", element.text, 16).reshape(4, 4)
    if not np.isfinite(matrix).all() or not np.linalg.det(matrix[:3, :3]) > 1e-30:
        raise CaptureError(path, "chunk transform", "it is not a rotation and scale")
    return matrix
