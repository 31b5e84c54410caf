"""HEIC and raw photos, which Blender cannot decode: imported, shown by copies, handed to the solver as they are."""

import json
import shutil
import sys
from pathlib import Path

import bpy
import fake_capture
import numpy as np
import pytest

from tests.capture.raw_photos import write_dng

HEIC = Path(__file__).resolve().parents[1] / "capture" / "data" / "heif" / "plain.heic"
SIZE = 80, 48


@pytest.fixture
def capture(extension, tmp_path, request):
    """An imported capture of three HEIC photos."""
    names = [f"photos/IMG_{n}.HEIC" for n in range(3)]
    (tmp_path / "photos").mkdir()
    for name in names:
        shutil.copy(HEIC, tmp_path / name)
    file = fake_capture.write_cameras(tmp_path / "transforms_train.json", names)
    content = json.loads(file.read_text())
    content.update(getattr(request, "param", {}))
    file.write_text(json.dumps(content))
    return extension("scene.import_captures").import_capture(bpy.context, file)


def cameras_of(collection):
    return [item for item in collection.objects if item.type == "CAMERA"]


def shown(item):
    return [b.image for b in item.data.background_images if b.show_background_image]


def test_cameras_of_photos_that_blender_cannot_show_are_imported_and_keep_them(extension, capture):
    cameras, collection = extension("scene.cameras"), extension("scene.capture_collection")
    assert len(cameras_of(capture)) == 3
    for item in cameras_of(capture):
        assert cameras.size_of(item) == SIZE
        assert cameras.photo_path(cameras.photo_of(item)).suffix == ".HEIC"
    assert len(collection.photo_paths(capture)) == 3


@pytest.mark.parametrize("capture", [{}, {"k1": 0.1, "k2": 0.01}], indirect=True, ids=str)
def test_copies_stand_behind_the_cameras_and_the_photos_stay_the_solvers(
    extension, task, capture, fake_solver, tmp_path
):
    hidden = extension("scene.hidden_photos")
    assert len(hidden.hidden_cameras(capture)) == 3
    assert bpy.ops.nmf.show_photos() == {"FINISHED"}
    task.finish()
    assert task.model.state == "done" and task.model.text == "Photos shown: 3"
    assert not hidden.hidden_cameras(capture)
    scene, cameras = extension("scene.capture_collection"), extension("scene.cameras")
    for item in cameras_of(capture):
        (picture,) = shown(item)
        assert tuple(picture.size) == SIZE and picture.packed_file is not None
        assert abs(picture.pixels[4 * (24 * 80 + 40)] - 0.5) < 0.01
        assert cameras.photo_path(cameras.photo_of(item)).suffix == ".HEIC"
    written = json.loads(scene.write_capture(capture, tmp_path / "job").read_text())
    assert {Path(frame["file_path"]).suffix for frame in written["frames"]} == {".HEIC"}
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.nmf.show_photos()


def test_copies_come_to_the_cameras_of_a_capture_that_was_renamed_meanwhile(
    extension, task, capture, fake_solver
):
    bpy.ops.nmf.show_photos()
    capture.name = "Teapot"
    task.finish()
    assert task.model.text == "Photos shown: 3"


def test_copies_find_their_photos_beside_the_folder_of_the_blend(extension, capture, tmp_path):
    """Blender stores such paths as //../photos/…, and the solver tells them without dots."""
    (tmp_path / "scenes").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scenes" / "duck.blend"))
    photo_of = extension("scene.cameras").photo_of
    picture = fake_capture.write_capture(tmp_path / "other").parent / "photos" / "r_0.png"
    pictures = {}
    for item in cameras_of(capture):
        name = Path(photo_of(item).filepath).name
        photo_of(item).filepath = f"//../photos/{name}"
        pictures[str(tmp_path / "photos" / name)] = str(picture)
    assert extension("scene.hidden_photos").show_pictures(capture, pictures) == 3


def test_the_panel_offers_to_show_what_blender_cannot_until_it_is_shown(draw, task, capture, fake_solver):
    bpy.context.scene.nmf.capture = capture
    assert ("operator", "nmf.show_photos") in draw("capture")[0]
    bpy.ops.nmf.show_photos()
    # A button that greys under the pointer stays so until the next redraw.
    assert ("operator", "nmf.show_photos") not in draw("capture")[0]
    task.finish()
    assert ("operator", "nmf.show_photos") not in draw("capture")[0]


def test_that_photos_are_shown_is_said_until_undo_hides_them_or_takes_their_cameras(
    draw, task, capture, fake_solver
):
    bpy.context.scene.nmf.capture = capture
    bpy.ops.ed.undo_push(message="import")
    bpy.ops.nmf.show_photos()
    task.finish()
    assert "Photos shown: 3" in draw("capture")[1]
    bpy.ops.ed.undo()
    assert "Photos shown" not in draw("capture")[1]
    bpy.ops.ed.redo()
    assert "Photos shown: 3" in draw("capture")[1]
    bpy.data.collections.remove(bpy.context.scene.nmf.capture)
    assert "Photos shown" not in draw("capture")[1]


def test_solved_photos_of_a_phone_are_shown_and_what_the_solve_said_stays(
    extension, task, fake_solver, tmp_path
):
    for number in range(4):
        shutil.copy(HEIC, tmp_path / f"IMG_{number}.HEIC")
    bpy.ops.nmf.solve_cameras(directory=str(tmp_path))
    task.finish()
    assert task.title == "Show Photos" and task.model.state == "done"
    assert task.model.text == "4 of 5 photos have a camera"
    assert task.model.warnings == ["the last photo overlaps no other"]
    found = bpy.context.scene.nmf.capture
    assert len(cameras_of(found)) == 4
    assert not extension("scene.hidden_photos").hidden_cameras(found)


def test_photos_that_blender_shows_need_no_copies(extension, tmp_path):
    file = fake_capture.write_capture(tmp_path)
    capture = extension("scene.import_captures").import_capture(bpy.context, file)
    assert not extension("scene.hidden_photos").hidden_cameras(capture)
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.nmf.show_photos()


def test_a_damaged_photo_through_a_distorted_lens_is_imported_with_nothing_to_see(extension, tmp_path):
    file = fake_capture.write_capture(tmp_path)
    photo = tmp_path / "photos" / "r_0.png"
    photo.write_bytes(photo.read_bytes()[:60])
    content = json.loads(file.read_text())
    file.write_text(json.dumps({**content, "k1": 0.1}))
    capture = extension("scene.import_captures").import_capture(bpy.context, file)
    assert len(cameras_of(capture)) == 3


@pytest.fixture
def raw_capture(extension, package, monkeypatch, tmp_path):
    """An imported capture of three raw photos that lie on their side, of cameras that stand upright; in a
    Python without LibRaw, as Blender's is."""
    header = sys.modules[f"{package.__name__}.solver.capture.image_header"]
    monkeypatch.setattr(header, "find_spec", lambda name: None)
    names = [f"IMG_{n}.dng" for n in range(3)]
    for name in names:
        write_dng(tmp_path / name, np.full((80, 48, 3), 0.5), orientation=6)
    file = fake_capture.write_cameras(tmp_path / "transforms_train.json", names)
    size = {"w": SIZE[0], "h": SIZE[1], "cx": SIZE[0] / 2, "cy": SIZE[1] / 2}
    file.write_text(json.dumps({**json.loads(file.read_text()), **size}))
    return extension("scene.import_captures").import_capture(bpy.context, file)


def test_raw_photos_whose_size_the_solver_alone_can_read_are_imported_shown_and_handed_on(
    extension, task, raw_capture, fake_solver, tmp_path
):
    scene, cameras = extension("scene.capture_collection"), extension("scene.cameras")
    assert [cameras.size_of(item) for item in cameras_of(raw_capture)] == [SIZE] * 3
    assert bpy.ops.nmf.show_photos() == {"FINISHED"}
    task.finish()
    assert task.model.text == "Photos shown: 3"
    for item in cameras_of(raw_capture):
        (picture,) = shown(item)
        assert tuple(picture.size) == SIZE
    written = json.loads(scene.write_capture(raw_capture, tmp_path / "job").read_text())
    assert {Path(frame["file_path"]).suffix for frame in written["frames"]} == {".dng"}
    assert {(frame["w"], frame["h"]) for frame in written["frames"]} == {SIZE}


def test_a_raw_photo_behind_a_camera_of_another_origin_is_told_to_have_no_size_here(extension, raw_capture):
    scene = extension("scene.capture_collection")
    del cameras_of(raw_capture)[0].data[extension("scene.cameras").SIZE]
    with pytest.raises(ValueError, match="IMG_.*cannot be read in Blender; let Solve Cameras"):
        scene.write_capture(raw_capture, Path("nowhere"))


def test_no_photo_makes_blender_load_libraw(package, raw_capture):
    assert f"{package.__name__}.solver.capture.image_header" in sys.modules
    assert f"{package.__name__}.solver.capture.raw" not in sys.modules
