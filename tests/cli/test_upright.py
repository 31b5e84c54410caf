"""What the command line writes stands upright, whatever the capture's world is."""

import json
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.capture.photos import read_exr
from solver.capture.placement import suggest_placement
from solver.capture.read import read_capture
from solver.light.turned import turned
from tests.cli.command import TINY, solver

TURNED = "--set", "field.turn_box=yes"
WRITTEN = ("mesh.ply", "asset.glb", "environment.exr", "environment_upright.exr")


@pytest.fixture(scope="module")
def tilted(tmp_path_factory, duck):
    """A finished job of the duck in a world that says nothing of up; its folder and the capture's file."""
    folder = tmp_path_factory.mktemp("tilted")
    world = np.eye(4)
    world[:3, :3] = 3 * Rotation.random(random_state=7).as_matrix()
    world[:3, 3] = 4, -5, 6
    content = json.loads((duck / "transforms_train.json").read_text())
    content["applied_transform"] = np.eye(4)[:3].tolist()
    for frame in content["frames"]:
        pose = world @ frame["transform_matrix"]
        pose[:3, :3] /= 3
        frame["transform_matrix"] = pose.tolist()
    cameras = folder / "transforms_train.json"
    cameras.write_text(json.dumps(content))
    root = folder / "job"
    result = solver("reconstruct", cameras, "--photos", duck, "--out", root, *TINY, *TURNED)
    assert result.returncode == 0, result.stderr
    return root, cameras, world


def test_a_capture_that_stands_already_is_left_where_it_is(job):
    manifest = json.loads((job / "result" / "manifest.json").read_text())
    assert manifest["placement"] == np.eye(4).tolist()
    assert "environment_upright" not in manifest


def test_the_manifest_says_how_the_glb_is_placed_and_the_light_is_turned_with_it(tilted, duck):
    root, cameras, world = tilted
    manifest = json.loads((root / "result" / "manifest.json").read_text())
    placement = np.array(manifest["placement"])
    np.testing.assert_array_equal(placement, suggest_placement(read_capture(cameras, photos=duck)))
    upright = placement @ world
    up = upright[:3, 2] / np.linalg.norm(upright[:3, 2])
    np.testing.assert_allclose(up, (0, 0, 1), atol=0.05)
    captured, _ = read_exr(root / "result" / "environment.exr")
    light, _ = read_exr(root / "result" / manifest["environment_upright"]["file"])
    rotation = placement[:3, :3] / np.cbrt(np.linalg.det(placement[:3, :3]))
    np.testing.assert_array_equal(light, turned(captured, rotation))


def test_a_finer_export_and_a_job_that_is_resumed_stand_where_the_result_does(tilted, tmp_path):
    root = tmp_path / "job"
    shutil.copytree(tilted[0], root)
    before = {name: (root / "result" / name).read_bytes() for name in WRITTEN}
    manifest = json.loads((root / "result" / "manifest.json").read_text())

    def export(out):
        result = solver("export", root, "--out", out, "--set", "asset.triangles=2000")
        assert result.returncode == 0, result.stderr
        for name in WRITTEN:
            assert (out / name).read_bytes() == before[name], name
        return json.loads((out / "manifest.json").read_text())

    assert export(tmp_path / "finer")["placement"] == manifest["placement"]
    old = {k: v for k, v in manifest.items() if k not in ("placement", "environment_upright")}
    (root / "result" / "manifest.json").write_text(json.dumps(old))
    assert export(tmp_path / "of an old result")["placement"] == manifest["placement"]
    shutil.rmtree(root / "result")
    assert solver("run", root).returncode == 0
    for name in WRITTEN:
        assert (root / "result" / name).read_bytes() == before[name], name
