"""Agisoft Metashape's camera export (File > Export > Export Cameras, Agisoft XML).

Cameras have OpenCV's axes; `transform` takes them to the chunk, the chunk's (or its component's)
`transform` takes the chunk to the world, +Z up. Far from the world's origin, as in geocentric
coordinates (with any projected system on top, Metashape writes these), cameras stay in the chunk's
coordinates instead, and up is away from the Earth's centre.

A lens, in pixels from the corner of the picture (manual, appendix "Camera models"):

    x = X / Z, y = Y / Z; of a fisheye both times atan(r) / r
    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + p1 (r² + 2 x²) + 2 p2 x y
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + p2 (r² + 2 y²) + 2 p1 x y
    u = w / 2 + cx + x' f + x' b1 + y' b2
    v = h / 2 + cy + y' f

so p1 and p2 are OpenCV's p2 and p1. PhotoScan before 1.2 wrote fx, fy, skew and cx, cy from the corner
instead, and p1, p2 in OpenCV's order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..brown_lens import polynomial_lens
from ..capture import Capture
from ..errors import CaptureError, shown
from ..files import head_of, number, numbers, read_xml
from ..frames import pose_opengl_from_opencv
from ..intake import Found, Intrinsics, assemble
from ..photo_finder import PhotoFinder
from ..picture_names import parts_of, stem_of

NAME = "Metashape cameras.xml"
EXTENSIONS = (".xml",)
PATTERNS = ("cameras.xml", "*cameras*.xml", "*.xml")

FAR = 1e5
"""world units from the origin beyond which chunk coordinates are kept: solvers count in single
precision, which is a hundredth there and half a unit on the Earth's surface"""
_EARTH = (6.3e6, 6.45e6)
"""metres from its centre between which all of its surface lies"""
_PANORAMAS = ("spherical", "cylindrical")
_FISHEYES = ("fisheye", "equidistant_fisheye", "equidistant fisheye")
_DISABLED, _NOT_ALIGNED, _PANORAMA = "disabled", "not aligned", "panoramas"
_IN_A_RIG = "members of a rig, whose places this file leaves to its first camera,"
"""what cameras are that are left out"""


def recognises(file: Path) -> bool:
    """True for XML with a document, a chunk and its sensors or cameras, also if it is cut off."""
    head = head_of(file)
    return b"<document" in head and b"<chunk" in head and (b"<sensor" in head or b"<camera" in head)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read exported cameras; those that are disabled, not aligned, in a rig behind another or panoramas are
    left out with a warning.

    Raises:
        CaptureError: anything that cannot be used, with file, field and remedy.
    """
    chunks = [
        chunk for chunk in read_xml(path).iter("chunk") if chunk.find(".//camera") is not None
    ]
    if not chunks:
        raise CaptureError(path, "chunk", "there are no cameras in it", "export the cameras again")
    chunk, warnings = max(chunks, key=lambda chunk: len(chunk.findall(".//camera/transform"))), []
    if len(chunks) > 1:
        name = shown(chunk.get("label", "the largest"))
        warnings.append(f"{path.name}: of {len(chunks)} chunks only the largest is read, '{name}'")
    worlds, pictures = _Worlds(path, chunk), _Pictures(chunk, photos)
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    lenses: dict[str | None, Intrinsics] = {}
    panoramas = {key for key, sensor in sensors.items() if _kind(sensor) in _PANORAMAS}
    found, parts = [], []
    left_out: dict[str, list[str]] = {
        reason: [] for reason in (_DISABLED, _NOT_ALIGNED, _IN_A_RIG, _PANORAMA)
    }
    for index, camera in enumerate(chunk.iter("camera")):
        label = camera.get("label") or ""
        where = f"camera {shown(label)}" if label else f"camera {index + 1}"
        reason = _why_not(camera, panoramas)
        if reason is not None:
            left_out[reason].append(label)
            continue
        text = camera.findtext("transform")
        matrix = numbers(path, f"{where}, transform", text, 16).reshape(4, 4)
        stated, photo = pictures.find(camera, path)
        key = camera.get("sensor_id")
        if photos.serves(photo) and key not in lenses:
            if key not in sensors:
                raise CaptureError(path, where, "its sensor is missing", "export the cameras again")
            lenses[key] = _intrinsics(path, sensors[key], warnings.append)
        world = worlds.of(camera.get("component_id"))
        parts.append("world" if world is not None else str(camera.get("component_id")))
        pose = pose_opengl_from_opencv(matrix if world is None else world @ matrix)
        found.append(Found(where, stated, photo, pose, lenses.get(key)))
    for what, names in left_out.items():
        if names:
            warnings.append(f"{path.name}: {len(names)} cameras are {what} and left out "
                            f"(the first: {shown(names[0])})")  # fmt: skip
    if len(set(parts)) > 1:
        largest = max(sorted(set(parts)), key=parts.count)
        found = [item for item, part in zip(found, parts, strict=True) if part == largest]
        warnings.append(f"{path.name}: {len(parts) - len(found)} cameras are in other components, "
                        "whose places are not known, and left out")  # fmt: skip
    if not found and left_out[_PANORAMA]:
        raise CaptureError(
            path, "sensor, type", "all its cameras are panoramas",
            "cut the panoramas into perspective photos, and align those",
        )  # fmt: skip
    if not found and (unaligned := left_out[_NOT_ALIGNED]):
        raise CaptureError(
            path, "transform", f"none of its {len(unaligned)} cameras is aligned",
            "align the photos in Metashape and export the cameras again",
        )  # fmt: skip
    return assemble(path, NAME, found, photos, up=worlds.up, warnings=tuple(warnings))


def _why_not(camera: Element, panoramas: set[str | None]) -> str | None:
    """Why a camera is left out; None: it is not.

    Args:
        panoramas: ids of their sensors.
    """
    if (camera.get("enabled") or "true").strip().lower() in ("false", "0", "no"):
        return _DISABLED
    if camera.get("sensor_id") in panoramas:
        return _PANORAMA
    transform = camera.find("transform")
    if transform is None and camera.get("master_id") is not None:
        return _IN_A_RIG
    if transform is None or not (transform.text or "").strip():
        return _NOT_ALIGNED
    return None


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
    """

    def __init__(self, path: Path, chunk: Element):
        self._of_component: dict[str | None, np.ndarray] = {}
        places = [(None, chunk.find("transform"))]
        for component in chunk.iter("component"):
            places.append((component.get("id"), component.find("transform")))
        for key, element in places:
            if element is not None:
                self._of_component[key] = _similarity(path, element)
        first = next(iter(self._of_component.values()), None)
        self.up = None if first is None else (0.0, 0.0, 1.0)
        if first is not None and (distance := np.linalg.norm(first[:3, 3])) > FAR:
            geocentric = _EARTH[0] < distance < _EARTH[1]
            up = first[:3, :3].T @ (first[:3, 3] if geocentric else (0.0, 0.0, 1.0))
            self.up = tuple(up / np.linalg.norm(up))
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
        raise CaptureError(
            path, "chunk transform", "it is no rotation and scale", "export the cameras again"
        )
    return matrix


def _kind(sensor: Element) -> str:
    return (sensor.get("type") or "frame").strip().lower()


def _intrinsics(path: Path, sensor: Element, warn: Callable[[str], None]) -> Intrinsics:
    """The lens of a sensor, the adjusted calibration before the initial one."""
    label = sensor.get("label") or sensor.get("id") or ""
    where = f"sensor {shown(label)}"
    calibrations = sorted(
        sensor.findall("calibration"),
        key=lambda item: ("adjusted", None, "initial").index(item.get("class"))
        if item.get("class") in ("adjusted", "initial") else 1,
    )  # fmt: skip
    if not calibrations:
        raise CaptureError(
            path, where, "it has no calibration", "align the photos and export the cameras again"
        )
    calibration = calibrations[0]
    kind = (calibration.get("type") or _kind(sensor)).strip().lower()
    if kind != "frame" and kind not in _FISHEYES:
        raise CaptureError(
            path, f"{where}, type", f"cameras of the type '{shown(kind)}' are not supported",
            "set the type Frame or Equidistant Fisheye in Metashape's Camera Calibration, and align again",
        )  # fmt: skip

    def value(name: str, default: float = 0.0) -> float:
        text = calibration.findtext(name)
        return default if text is None else number(path, f"{where}, {name}", text)

    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size
    if size is None:
        raise CaptureError(path, where, "it has no resolution", "export the cameras again")
    width = int(number(path, f"{where}, width", size.get("width")))
    height = int(number(path, f"{where}, height", size.get("height")))
    old = calibration.find("fx") is not None
    if not old and calibration.find("f") is None:
        raise CaptureError(path, f"{where}, f", "the focal length is missing", "export it again")
    if old:
        fx, fy, skew = value("fx"), value("fy", value("fx")), value("skew")
        cx, cy = value("cx", 0.5 * width), value("cy", 0.5 * height)
        tangential = value("p1"), value("p2")
    else:
        fx, fy, skew = value("f") + value("b1"), value("f"), value("b2")
        cx, cy = 0.5 * width + value("cx"), 0.5 * height + value("cy")
        tangential = value("p2"), value("p1")
    if value("p3") or value("p4"):
        warn(f"{path.name}: {where} has tangential terms p3 and p4, which are left out")
    lens, distortion = polynomial_lens(
        [value(name) for name in ("k1", "k2", "k3", "k4")], tangential, skew / fx if fx else 0.0,
        equidistant=kind in _FISHEYES,
    )  # fmt: skip
    return Intrinsics(width, height, fx, fy, cx, cy, lens, distortion)
