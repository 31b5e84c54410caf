"""Masks of an imported capture: found by their photos, and also when those were packed and unpacked."""

import json
import shutil

import bpy
import fake_capture
import pytest


@pytest.fixture
def project(extension, tmp_path):
    """A saved file with a capture that has masks."""
    folder = tmp_path / "project"
    path = fake_capture.write_capture(folder / "capture")
    (folder / "capture" / "masks").mkdir()
    for photo in (folder / "capture" / "photos").iterdir():
        shutil.copy(photo, folder / "capture" / "masks" / photo.name)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.nmf.import_capture(filepath=str(path))
    return folder


def pack_and_unpack(folder):
    bpy.ops.file.pack_all()
    bpy.ops.wm.save_mainfile()
    shutil.rmtree(folder / "capture" / "photos")
    bpy.ops.file.unpack_all(method="USE_LOCAL")
    assert (folder / "textures").is_dir(), "else this tests nothing"


def masks_of(job):
    cameras = job.root / "capture" / "transforms_train.json"
    frames = json.loads(cameras.read_text("utf-8"))["frames"]
    return {(cameras.parent / frame["mask_path"]).resolve() for frame in frames}


def test_masks_of_photos_that_were_unpacked_elsewhere_are_found(project, monitor, fake_solver, tick):
    pack_and_unpack(project)
    bpy.ops.nmf.reconstruct()
    assert masks_of(monitor.job) == set((project / "capture" / "masks").iterdir())
    tick()


def test_they_are_found_after_the_project_has_moved_as_well(project, monitor, fake_solver, tick, tmp_path):
    pack_and_unpack(project)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_empty=True)
    moved = project.rename(tmp_path / "elsewhere")
    bpy.ops.wm.open_mainfile(filepath=str(moved / "scene.blend"))
    bpy.ops.nmf.reconstruct()
    assert masks_of(monitor.job) == set((moved / "capture" / "masks").iterdir())
    tick()


def test_what_is_to_be_ignored_of_photos_is_kept_for_the_job(
    extension, monitor, fake_solver, tick, tmp_path
):
    path = fake_capture.write_capture(tmp_path / "capture")
    photos = sorted((tmp_path / "capture" / "photos").iterdir())
    (tmp_path / "hands").mkdir()
    shutil.copy(photos[0], tmp_path / "hands" / photos[0].name)
    bpy.ops.nmf.import_capture(filepath=str(path), ignored=str(tmp_path / "hands"))
    bpy.ops.nmf.reconstruct()
    cameras = monitor.job.root / "capture" / "transforms_train.json"
    frames = json.loads(cameras.read_text("utf-8"))["frames"]
    found = [frame["ignored_path"] for frame in frames if "ignored_path" in frame]
    assert found == [str(tmp_path / "hands" / photos[0].name)]
    assert not any("mask_path" in frame for frame in frames)
    tick()


def test_masks_that_are_gone_are_named_before_a_job_begins(project, monitor, fake_solver):
    shutil.rmtree(project / "capture" / "masks")
    with pytest.raises(RuntimeError, match=r"masks.r_0.png, mask of r_0: it does not exist; put"):
        bpy.ops.nmf.reconstruct()
    assert not (project / "nmf_jobs").exists() and not monitor.running
