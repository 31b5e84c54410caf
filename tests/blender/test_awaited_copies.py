"""Undistorted copies of photos are made after an import, one at a time, while Blender goes on."""

import json
import types
from pathlib import Path

import bpy
import fake_capture
import pytest


@pytest.fixture
def copies(extension, monkeypatch):
    """As in a window: timers make the copies, which are those of the tests here."""
    module = extension("scene.awaited_copies")
    monkeypatch.setattr(module, "AT_ONCE", False)
    return module


@pytest.fixture
def distorted(tmp_path):
    path = fake_capture.write_capture(tmp_path / "photos")
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**content, "k1": -0.2}), encoding="utf-8")
    return path


def shown_marks():
    """Of each camera: whether what stands behind it is a copy."""
    backgrounds = [list(data.background_images) for data in bpy.data.cameras]
    return [
        [bool(b.image.get("nmf_undistorted")) for b in some if b.show_background_image]
        for some in backgrounds
    ]


def test_photos_stand_behind_cameras_at_once_and_their_copies_follow(copies, distorted):
    bpy.ops.nmf.import_capture(filepath=str(distorted))
    assert bpy.app.timers.is_registered(copies._tick)
    count = len(bpy.data.cameras)
    assert count > 2 and shown_marks() == [[False]] * count
    for number in range(1, count + 1):
        assert copies._tick() == copies.PAUSE
        assert sorted(shown_marks()) == [[False]] * (count - number) + [[True]] * number
    assert copies._tick() is None and not copies.awaiting(bpy.data.objects)
    assert shown_marks() == [[True]] * count


@pytest.mark.parametrize("job", ["RENDER", "OBJECT_BAKE"])
def test_copies_are_made_once_blender_has_rendered_or_baked(copies, distorted, extension, monkeypatch, job):
    """A fixed bug: pictures changed while Blender baked from them."""
    bpy.ops.nmf.import_capture(filepath=str(distorted))
    running = {job}
    app = types.SimpleNamespace(is_job_running=running.__contains__)
    fake = types.SimpleNamespace(app=app, context=bpy.context)
    monkeypatch.setattr(extension("redraw"), "bpy", fake)
    assert copies._tick() == copies.PAUSE_IN_RENDER and [True] not in shown_marks()
    running.clear()
    assert copies._tick() == copies.PAUSE and [True] in shown_marks()


def test_photos_without_distortion_await_nothing(copies, tmp_path):
    bpy.ops.nmf.import_capture(filepath=str(fake_capture.write_capture(tmp_path / "photos")))
    assert not copies.awaiting(bpy.data.objects) and not bpy.app.timers.is_registered(copies._tick)


def test_one_undo_takes_the_import_back_and_a_redo_awaits_the_copies_again(copies, distorted):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.nmf.import_capture("EXEC_DEFAULT", True, filepath=str(distorted))
    while copies._tick():
        pass
    bpy.ops.ed.undo()
    assert not bpy.data.cameras and copies._tick() is None
    bpy.ops.ed.redo()
    assert copies.awaiting(bpy.data.objects) and bpy.app.timers.is_registered(copies._tick)
    while copies._tick():
        pass
    assert shown_marks() == [[True]] * len(bpy.data.cameras)


def test_undo_in_between_leaves_no_camera_without_its_copy(copies, distorted):
    """A fixed bug: cameras showed images that Undo had freed."""
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.nmf.import_capture("EXEC_DEFAULT", True, filepath=str(distorted))
    copies._tick()
    bpy.data.cameras[0].passepartout_alpha = 0.25
    bpy.ops.ed.undo_push(message="mine")
    while copies._tick():
        pass
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.undo):
        step()
        there = set(bpy.data.images)
        shown = [b.image for data in bpy.data.cameras for b in data.background_images]
        assert len(shown) == 2 * len(bpy.data.cameras) and set(shown) == there
        while copies._tick():
            pass
        assert shown_marks() == [[True]] * len(bpy.data.cameras)
        for copy in (image for image in there if image.get("nmf_undistorted")):
            assert copy.packed_file is not None and max(copy.pixels[:]) > 0.5


def test_a_file_that_was_saved_too_early_gets_its_copies_when_it_is_opened(copies, distorted, tmp_path):
    bpy.ops.nmf.import_capture(filepath=str(distorted))
    copies._tick()
    bpy.app.timers.unregister(copies._tick)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "early.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "early.blend"))
    assert bpy.app.timers.is_registered(copies._tick)
    while copies._tick():
        pass
    assert shown_marks() == [[True]] * len(bpy.data.cameras)


@pytest.mark.parametrize("is_there", [True, False], ids=["damaged", "gone"])
def test_a_photo_without_a_copy_is_left_out_and_the_others_get_theirs(copies, distorted, is_there):
    bpy.ops.nmf.import_capture(filepath=str(distorted))
    first = copies.awaiting(bpy.data.objects)[0]
    image = first.data.background_images[0].image
    path = Path(bpy.path.abspath(image.filepath))
    head = path.read_bytes()[:60]
    path.unlink()
    if is_there:
        path.write_bytes(head)
    image.buffers_free()
    while copies._tick():
        pass
    photo, copy = first.data.background_images
    assert photo.show_background_image and not copy.show_background_image
    assert shown_marks().count([True]) == len(bpy.data.cameras) - 1


def test_the_panel_says_how_many_are_left(copies, draw, distorted):
    bpy.ops.nmf.import_capture(filepath=str(distorted))
    assert "3 photos left to undistort" in draw("capture")[1]
    while copies._tick():
        pass
    assert "left to undistort" not in draw("capture")[1]
