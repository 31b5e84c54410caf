"""OpenDroneMap's shots.geojson as `opendm/shots.py` writes it, on a map and without GPS; hostile files."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import opendronemap
from solver.capture.read import read_capture, reader_of
from tests.capture.hostile import VALUES, reads_or_refuses
from tests.capture.programs import (
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    poses,
    put,
    save_photos,
)
from tests.capture.test_opensfm import BROWN, lens, reference

UTM = np.array([391_000.0, 5_820_000.0, 34.0])
KEY = "v2 maker model 96 64 brown 0.85"


def shots(place=None, focal=BROWN["focal_x"]):
    features = []
    for name, pose in zip(names(), poses(), strict=True):
        turn = Rotation.from_matrix(pose[:3, :3].T).as_rotvec()
        position = pose[:3, 3] if place is None else pose[:3, 3] + place
        properties = {
            "filename": f"{name}.png", "focal": focal, "width": WIDTH, "height": HEIGHT,
            "translation": position.tolist(), "rotation": turn.tolist(),
        }  # fmt: skip
        point = {"type": "Point", "coordinates": [13.4, 52.5, 40.0]}
        features.append({"type": "Feature", "properties": properties, "geometry": point})
    return {"type": "FeatureCollection", "features": features}


def write(folder, content, lenses=None):
    """As a download of WebODM lies beside the photos."""
    save_photos(folder / "images")
    (folder / "odm_report").mkdir(exist_ok=True)
    (folder / "odm_report" / "shots.geojson").write_text(json.dumps(content))
    lenses = {KEY: lens()} if lenses is None else lenses
    (folder / "cameras.json").write_text(json.dumps(lenses))
    (folder / "images.json").write_text("[]")
    return folder


def test_points_project_as_opensfm_projects_them(tmp_path):
    capture = read_capture(write(tmp_path, shots()))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference("brown", BROWN, to_camera[i], x), poses())
    assert capture.format == opendronemap.NAME and capture.up.tolist() == [0, 0, 1]
    assert not capture.metric and not capture.warnings


def test_places_on_a_map_are_counted_from_among_the_cameras(tmp_path):
    capture = read_capture(write(tmp_path, shots(UTM)))
    assert capture.metric
    places = np.array([camera.camera_to_world[:3, 3] for camera in capture.cameras])
    moved = places - poses()[:, :3, 3]
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], moved.shape), atol=1e-8)
    assert np.abs(places).max() < 20 and np.allclose(moved[0], np.round(moved[0]), atol=1e-8)


def test_a_shots_lens_is_the_one_of_its_size_and_focal_length(tmp_path):
    other = lens("brown", dict(BROWN, focal_x=0.7))
    capture = read_capture(write(tmp_path / "a", shots(), {"other": other, KEY: lens()}))
    assert {camera.fx for camera in capture.cameras} == {0.85 * WIDTH}
    for lenses in ({"one": other, "two": other}, {KEY: lens(), "again": lens()}):
        with pytest.raises(CaptureError, match=r"focal: .*fits it; give the project's opensfm"):
            read_capture(write(tmp_path / "b", shots(), lenses))


def test_lenses_that_are_missing_are_asked_for(tmp_path):
    file = write(tmp_path, shots()) / "odm_report" / "shots.geojson"
    (tmp_path / "cameras.json").unlink()
    with pytest.raises(CaptureError, match="cameras.json, are not beside its folder; unpack all"):
        read_capture(tmp_path)
    file.rename(tmp_path / "x.json")
    assert reader_of(tmp_path / "x.json") is opendronemap


def test_other_geojson_is_no_capture(tmp_path):
    (tmp_path / "a.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    assert reader_of(tmp_path / "a.geojson") is None


@RANDOM_TESTS
@given(
    at=st.sampled_from(
        [("features",), ("features", 1), ("features", 1, "properties"),
         *(("features", 1, "properties", key) for key in
           ("filename", "focal", "width", "translation", "rotation"))]
    ),
    lens_at=st.sampled_from(["projection_type", "width", "focal_x", "k1"]),
    value=VALUES, lens_value=VALUES, keep=st.floats(0.3, 2),
)  # fmt: skip
def test_hostile_files_end_in_a_capture_or_an_error(tmp_path, at, lens_at, value, lens_value, keep):
    content = shots()
    put(content, at, value)
    folder = write(tmp_path, content, {KEY: lens() | {lens_at: lens_value}})
    file = folder / "odm_report" / "shots.geojson"
    text = file.read_text()
    file.write_text(text[: int(keep * len(text))])
    reads_or_refuses(folder)
