"""Cameras that a job has adjusted to their photos: installing its result moves those in the scene."""

import importlib
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from conftest import PACKAGE
from test_job_capture import finished_job, paths_of_photos


@pytest.fixture
def adjust(package):
    """Write a finished job's adjusted cameras: all of its capture, moved up by 0.1."""
    jobs = (importlib.import_module(f"{PACKAGE}.solver.job.{name}") for name in
            ("folder", "inputs", "adjusted"))  # fmt: skip
    folder, inputs, adjusted = jobs

    def write(root):
        job = folder.JobFolder(root)
        moved = []
        for camera in inputs.capture_of(job).cameras:
            pose = camera.camera_to_world.copy()
            pose[2, 3] += 0.1
            moved.append(replace(camera, camera_to_world=pose))
        adjusted.write_adjusted(job.cameras_path, moved)

    return write


def poses(capture):
    bpy.context.view_layer.update()
    return {i.name: np.array(i.matrix_world) for i in capture.all_objects if i.type == "CAMERA"}


@pytest.mark.parametrize("made", ["in Blender", "of its file"])
def test_cameras_move_to_where_the_job_has_them_in_the_captures_own_space(
    capture, adjust, extension, tmp_path, made, capfd
):
    root = extension("scene.capture_collection").root_of(capture)
    root.scale, root.location = (2, 2, 2), (0, 5, 0)
    before = poses(capture)
    how = (
        {"photos": paths_of_photos(capture)} if made == "in Blender" else {"capture": capture["nmf_source"]}
    )
    job = finished_job(tmp_path / "job", **how)
    adjust(job)
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    assert f"Cameras moved to fit their photos: {len(before)}" in capfd.readouterr().out
    for name, pose in poses(capture).items():
        expected = before[name].copy()
        expected[2, 3] += 0.2
        np.testing.assert_allclose(pose, expected, atol=1e-5)


def test_a_camera_that_has_become_another_stays_and_the_others_move(capture, adjust, tmp_path, capfd):
    """A fixed bug: it ended in a traceback, with half of the result in the scene."""
    job = finished_job(tmp_path / "job", paths_of_photos(capture))
    adjust(job)
    items = [item for item in capture.all_objects if item.type == "CAMERA"]
    items[0].data.type = "ORTHO"
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    assert f"Cameras moved to fit their photos: {len(items) - 1}" in capfd.readouterr().out


def test_a_camera_that_a_person_has_moved_stays_and_a_second_time_moves_none(capture, adjust, tmp_path):
    job = finished_job(tmp_path / "job", paths_of_photos(capture))
    adjust(job)
    mine = next(item for item in capture.all_objects if item.type == "CAMERA")
    mine.location.x += 0.5
    before = poses(capture)
    for _ in range(2):
        bpy.ops.nmf.install_result(directory=str(job))
        after = poses(capture)
        np.testing.assert_array_equal(after[mine.name], before[mine.name])
        others = [name for name in after if name != mine.name]
        moved = [after[name][2, 3] - before[name][2, 3] for name in others]
        np.testing.assert_allclose(moved, 0.1, atol=1e-6)


def test_where_the_captures_file_is_gone_or_broken_the_result_stands_and_no_camera_moves(
    capture, adjust, tmp_path
):
    before = poses(capture)
    job = finished_job(tmp_path / "job", capture=capture["nmf_source"])
    adjust(job)
    good = (job / "cameras.json").read_text()
    (job / "cameras.json").write_text(good[:50])
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    (job / "cameras.json").write_text(good)
    Path(capture["nmf_source"]).unlink()
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    assert bpy.context.view_layer.objects.active.name == "job"
    for name, pose in poses(capture).items():
        np.testing.assert_array_equal(pose, before[name])


def test_cameras_move_in_a_scene_that_was_not_looked_at_since_the_file_was_opened(
    capture, adjust, extension, tmp_path
):
    extension("scene.capture_collection").root_of(capture).location = (0, 5, 0)
    before = poses(capture)
    job = finished_job(tmp_path / "job", photos=paths_of_photos(capture))
    adjust(job)
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    bpy.context.window.scene = bpy.data.scenes["Scene"]
    for name, pose in poses(bpy.context.scene.nmf.capture).items():
        expected = before[name].copy()
        expected[2, 3] += 0.1
        np.testing.assert_allclose(pose, expected, atol=1e-5)
