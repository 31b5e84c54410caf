"""Files that the programs themselves wrote, against what else these files say: measurements, a drone's notes."""

import dataclasses
import math
import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from solver.capture.read import read_capture
from tests.capture.programs import save_photos

DATA = Path(__file__).parent / "data"
EQUATOR, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84
METRES = 22.039365691522473
"""of a unit of the chunk, by its file"""


def test_visualsfms_points_project_to_where_it_measured_them(tmp_path):
    shutil.copy(DATA / "visualsfm" / "model.nvm", tmp_path)
    lines = (tmp_path / "model.nvm").read_text().splitlines()
    names = [line.split("\t")[0] for line in lines[3:8]]
    save_photos(tmp_path, names, (2592, 1944), "")
    capture = read_capture(tmp_path)
    assert capture.format == "VisualSFM" and not capture.warnings
    cameras = {camera.image_path.name: camera for camera in capture.cameras}
    misses, without_lens = [], []
    for line in lines[10:13]:
        values = np.array(line.split(), dtype=float)
        for image, _, x, y in values[7:].reshape(-1, 4):
            if image < len(names):
                camera = cameras[names[int(image)]]
                measured = (x + 2592 / 2, y + 1944 / 2)
                pixel, depth = camera.project(values[None, :3])
                assert depth[0] > 0
                misses.append(math.dist(pixel[0], measured))
                pinhole = dataclasses.replace(camera, lens="pinhole", distortion=())
                without_lens.append(math.dist(pinhole.project(values[None, :3])[0][0], measured))
    assert len(misses) == 13 and max(misses) < 3
    assert np.mean(misses) < 0.6 * np.mean(without_lens)


def test_metashapes_cameras_are_where_the_drone_was_and_look_where_it_looked(tmp_path):
    shutil.copy(DATA / "metashape" / "cameras.xml", tmp_path)
    stated = {}
    for camera in ElementTree.parse(tmp_path / "cameras.xml").iter("camera"):
        file = tmp_path / camera.get("label")
        save_photos(file.parent, [file.name], (4864, 3648), "")
        stated[camera.get("label")] = {
            k: float(v) for k, v in camera.find("reference").items() if k != "enabled"
        }
    capture = read_capture(tmp_path)
    assert capture.format == "Metashape cameras.xml" and len(capture.cameras) == 5
    up = capture.up / np.linalg.norm(capture.up)
    places, read = {}, {}
    for camera in capture.cameras:
        name = camera.image_path.relative_to(tmp_path).as_posix()
        reference = stated[name]
        tilt = math.degrees(math.acos(-camera.view_direction @ up))
        assert abs(tilt - reference["pitch"]) < 3
        places[name] = earth_centred(reference["x"], reference["y"], reference["z"])
        read[name] = camera.position
    # The drone knew its way on one flight well, its height from flight to flight badly.
    for flight in ("oblique-v3/202MEDIA/DJI_000", "nadir/102MEDIA/DJI_000"):
        first, second = f"{flight}2.JPG", f"{flight}4.JPG"
        metres = math.dist(places[first], places[second])
        assert METRES * math.dist(read[first], read[second]) == pytest.approx(metres, rel=0.04)


def earth_centred(longitude, latitude, height):
    """Metres [3] from the Earth's centre, of degrees and metres above WGS 84's ellipsoid."""
    squared = FLATTENING * (2 - FLATTENING)
    lon, lat = math.radians(longitude), math.radians(latitude)
    radius = EQUATOR / math.sqrt(1 - squared * math.sin(lat) ** 2)
    level = (radius + height) * math.cos(lat)
    return np.array(
        [
            level * math.cos(lon),
            level * math.sin(lon),
            (radius * (1 - squared) + height) * math.sin(lat),
        ]
    )
