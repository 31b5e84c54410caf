"""A film that Blender's tracker has solved, in a real Blender's window, becomes a capture."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.capture.camera import positions_of
from tests.cameras.box_scene import BoxScene, align, box_camera, orbit

K1 = -0.08
FRAMES = 20


@pytest.fixture(scope="module")
def cameras():
    """The true ones: half a round, through a lens that bends lines."""
    poses = orbit(2 * FRAMES, 120)[::2]
    return [
        replace(box_camera(pose, f"shot_{n:03d}", scale=0.5), lens="opencv", distortion=(K1, 0, 0, 0))
        for n, pose in enumerate(poses, start=1)
    ]


@pytest.fixture(scope="module")
def report(tmp_path_factory, screenshots, in_window, cameras):
    """What `film_steps.py` saw."""
    folder, scene = tmp_path_factory.mktemp("film"), BoxScene()
    for camera in cameras:
        Image.fromarray(scene.photo(camera)[0]).save(folder / f"{camera.name}.png")
    points = np.random.default_rng(3).uniform((-0.7, -0.7, 0), (0.7, 0.7, 0.9), (24, 3))
    places = np.stack([camera.project(points)[0] for camera in cameras], axis=1)
    size = np.array([cameras[0].width, cameras[0].height])
    tracks = np.stack([places[..., 0] / size[0], 1 - places[..., 1] / size[1]], axis=-1)
    stated = {"lens": 36.0 * cameras[0].fx / size[0].item(), "k1": K1, "tracks": tracks.tolist()}
    (folder / "film.json").write_text(json.dumps(stated))
    in_window("film_steps.py", "film_4_end.png", NMF_GUI_FILM=str(folder / f"{cameras[0].name}.png"))
    return json.loads((screenshots / "film_report.json").read_text())


def test_cameras_are_where_the_tracker_has_found_them_with_its_lens(report, cameras):
    assert report["error"] < 0.1, "the tracker itself has failed"
    assert sorted(report["poses"]) == [camera.name for camera in cameras]
    found = np.array([report["poses"][camera.name] for camera in cameras])
    positions = positions_of(cameras)
    scale, rotation, shift = align(found[:, :3, 3], positions)
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    moved = scale * found[:, :3, 3] @ rotation.T + shift
    assert np.linalg.norm(moved - positions, axis=1).max() < 0.01 * size
    turned = rotation @ found[:, :3, :3]
    np.testing.assert_allclose(turned, [c.camera_to_world[:3, :3] for c in cameras], atol=2e-3)
    assert report["distortion"][0] == pytest.approx(K1)


def test_the_scene_stays_at_its_frame_and_one_undo_takes_the_capture_back(report, cameras):
    assert report["frame"] == 1
    assert not {camera.name for camera in cameras} & set(report["after_undo"])
