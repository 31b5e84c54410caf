"""Files that the programs themselves wrote, against what else these files say: measurements, a drone's notes."""

import dataclasses
import json
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
BERLIN_LENS = {
    "projection_type": "perspective", "width": 3264, "height": 2448, "focal": 0.9604884463403544,
    "k1": 0.013053492749756394, "k2": 0.000634069118971224,
}  # fmt: skip
BERLIN = {
    "01.jpg": ([1.2093954126158601, -0.39118466329305634, 0.5160415730954907],
               [-0.26707060536931448, 4.8370360553880705, 7.9002202403686352]),
    "02.jpg": ([1.2940695283700199, -0.39214506990022585, 0.48363132932553921],
               [0.19287960609884439, 2.0784473237458099, 0.73166782563733967]),
    "03.jpg": ([1.0839814121206541, -0.37128827384298013, 0.51364781706265028],
               [0.1637594261033862, -2.5303377747051177, -10.095115684431756]),
}  # fmt: skip
"""shots of OpenSfM's example (BSD licence), `data/berlin/reconstruction_example.json`"""
BERLIN_POINTS = {
    "1200": ((11.556704833598362, 29.559730007259816, 16.775597026449589),
             {"02.jpg": (-0.176826, -0.192425), "03.jpg": (-0.295622, -0.165761)}),
    "291": ((23.801048018301813, 35.752347648386468, 13.549828780490973),
            {"01.jpg": (-0.023256, 0.0963318), "03.jpg": (-0.0260063, 0.097799)}),
    "342": ((22.270307324195045, 20.391112968456145, 2.6251675477945851),
            {"01.jpg": (0.166474, 0.299202), "02.jpg": (0.247501, 0.202332)}),
    "294": ((8.2515508515555585, 30.307362676330328, 3.7101332341751849),
            {"02.jpg": (-0.298173, 0.172396)}),
    "279": ((5.7162466116633421, 28.618016168805713, 9.3872636129040998),
            {"02.jpg": (-0.353478, -0.0220448)}),
}  # fmt: skip
"""its points, and where `tracks_example.csv` has them in its photos, from the middle in longer sides"""


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


def test_opensfms_points_project_to_where_it_measured_them(tmp_path):
    save_photos(tmp_path / "images", BERLIN, (3264, 2448), "")
    shots = {
        name: {"rotation": turn, "translation": place, "camera": "apple iphone 4s"}
        for name, (turn, place) in BERLIN.items()
    }
    points = {name: {"coordinates": place} for name, (place, _) in BERLIN_POINTS.items()}
    content = [{"cameras": {"apple iphone 4s": BERLIN_LENS}, "shots": shots, "points": points}]
    (tmp_path / "reconstruction.json").write_text(json.dumps(content))
    cameras = {item.image_path.name: item for item in read_capture(tmp_path).cameras}
    misses = []
    for place, seen in BERLIN_POINTS.values():
        for name, (x, y) in seen.items():
            pixel, depth = cameras[name].project(np.array([place]))
            assert depth[0] > 0
            # It counts pixels from the centre of the first one.
            measured = x * 3264 + (3264 - 1) / 2 + 0.5, y * 3264 + (2448 - 1) / 2 + 0.5
            misses.append(math.dist(pixel[0], measured))
    assert len(misses) == 8 and max(misses) < 3


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
