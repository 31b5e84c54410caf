"""What a person does while a job runs, and what becomes of files that move: results go where they belong."""

import json
import shutil
import types
from pathlib import Path

import bpy
import fake_capture
import numpy as np
import pytest
from mathutils import Matrix
from picking import select_two_vertices

from solver.job.status import read_status


def results():
    return [item for item in bpy.data.objects if item.get("nmf_job")]


def stop_in_the_fit(monitor, tick, fake_solver):
    """Reconstruct, and cancel half way."""
    fake_solver("slow")
    bpy.ops.nmf.reconstruct("EXEC_DEFAULT", True)
    tick(lambda: monitor.model.psnr is not None)
    monitor.cancel()
    tick()


def test_a_result_comes_to_the_capture_it_was_made_from(capture, add_capture, fake_solver, tick):
    bpy.ops.nmf.reconstruct()
    other = add_capture("another")
    assert other != capture
    tick()
    (item,) = results()
    assert item.users_collection == (capture,)
    assert item.parent in set(capture.objects)


@pytest.mark.parametrize("job", ["RENDER", "OBJECT_BAKE"])
def test_a_result_waits_until_blender_has_rendered_or_baked(
    capture, monitor, fake_solver, tick, extension, monkeypatch, job
):
    """A fixed bug: objects that were baked after it came were lit by its World."""
    running = {job}
    app = types.SimpleNamespace(is_job_running=running.__contains__)
    fake = types.SimpleNamespace(app=app, context=bpy.context)
    monkeypatch.setattr(extension("redraw"), "bpy", fake)
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.waits_to_install and "render or bake" in monitor.model.text)
    assert not results()
    running.clear()
    tick()
    assert len(results()) == 1


def test_a_result_and_its_light_come_to_the_scene_of_their_capture(capture, fake_solver, tick):
    first = bpy.context.scene
    bpy.ops.nmf.reconstruct()
    second = bpy.data.scenes.new("Other")
    second.world = mine = bpy.data.worlds.new("mine")
    bpy.context.window.scene = second
    tick()
    (item,) = results()
    assert item.users_scene == (first,)
    assert second.world == mine and first.world is not None


def test_a_result_of_a_capture_in_two_scenes_is_seen_in_the_one_that_is_looked_at(
    capture, fake_solver, tick
):
    mine, other = bpy.context.scene, bpy.data.scenes.new("Another")  # which comes first by its name
    other.collection.children.link(capture)
    other.view_layers[0].update()  # Blender 5.3 has no collections of a view layer before
    other.view_layers[0].layer_collection.children[capture.name].exclude = True
    bpy.ops.nmf.reconstruct()
    tick()
    (item,) = results()
    assert item.visible_get() and mine.world is not None and other.world is None


def test_install_result_does_not_stay_with_the_job_that_was_installed_by_itself():
    """Blender offers an operator's last properties to the next press of its button."""
    properties = bpy.ops.nmf.install_result.get_rna_type().properties
    assert properties["job"].is_skip_save and properties["directory"].is_skip_save


def test_a_folder_of_an_unfinished_job_can_be_resumed(capture, monitor, fake_solver, tick):
    stop_in_the_fit(monitor, tick, fake_solver)
    folder = monitor.job.root
    monitor.look_at("")
    assert not bpy.ops.nmf.resume.poll()
    with pytest.raises(RuntimeError, match="resume"):
        bpy.ops.nmf.install_result(directory=str(folder))
    assert monitor.model.resumable and bpy.ops.nmf.resume.poll()


def test_undo_after_reconstruct_keeps_the_job(capture, monitor, fake_solver, tick):
    bpy.ops.ed.undo_push(message="start")
    stop_in_the_fit(monitor, tick, fake_solver)
    name = bpy.context.scene.nmf.job
    bpy.ops.object.empty_add("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    assert bpy.context.scene.nmf.job == name != ""


def test_a_file_saved_elsewhere_finds_its_job(capture, monitor, fake_solver, tick, tmp_path):
    stop_in_the_fit(monitor, tick, fake_solver)
    root = monitor.job.root
    (tmp_path / "elsewhere" / "deep").mkdir(parents=True)
    copy = tmp_path / "elsewhere" / "deep" / "copy.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(copy))
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    assert monitor.job.root.resolve() == root.resolve()
    assert monitor.model.resumable


def test_the_same_file_opened_again_still_gets_the_result(capture, monitor, fake_solver, tick, tmp_path):
    fake_solver("normal", pause=0.03)
    bpy.ops.nmf.reconstruct()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert monitor.running
    tick()
    assert monitor.model.text == "Done" and len(results()) == 1


def test_a_job_of_another_process_is_looked_at_until_it_ends(
    capture, monitor, fake_solver, tick, extension
):
    fake_solver("slow")
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.model.psnr is not None)
    process, monitor.process = monitor.process, None
    monitor.look_at(bpy.context.scene.nmf.job)
    assert monitor.model.state == "elsewhere"
    assert monitor.tick() == extension("jobs.monitor").LOOK_AGAIN
    process.close()
    process.popen.wait(10)
    assert monitor.tick() is None
    assert monitor.model.state == "cancelled" and monitor.model.resumable


def test_a_job_that_another_process_ends_well_offers_its_object(capture, monitor, fake_solver, tick):
    fake_solver("normal", pause=0.1)
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.model.psnr is not None)
    process, monitor.process = monitor.process, None
    monitor.look_at(bpy.context.scene.nmf.job)
    assert monitor.model.state == "elsewhere"
    process.popen.wait(20)
    assert monitor.tick() is None
    assert monitor.model.text == "Done; press Install Result to add its object" and not results()


def test_a_job_that_another_blender_has_resumed_is_not_resumed_here_as_well(
    capture, monitor, fake_solver, tick
):
    stop_in_the_fit(monitor, tick, fake_solver)
    mine, root = monitor.model, bpy.context.scene.nmf.job
    fake_solver("silent")
    bpy.ops.nmf.resume()
    tick(lambda: read_status(monitor.job.status_path).get("state") == "preparing")
    process, monitor.process, monitor.model = monitor.process, None, mine
    with pytest.raises(RuntimeError, match="another process is working on this job"):
        bpy.ops.nmf.resume()
    assert monitor.model.state == "elsewhere" and not monitor.running
    assert bpy.context.scene.nmf.job == root
    process.close()
    process.popen.wait(10)
    monitor.tick()
    assert monitor.model.state == "cancelled"


def test_a_job_whose_folder_is_gone_is_told_in_a_sentence(capture, monitor, fake_solver, tick):
    stop_in_the_fit(monitor, tick, fake_solver)
    shutil.rmtree(monitor.job.root)
    with pytest.raises(RuntimeError, match=r"there is no job.json; give the folder of a job"):
        bpy.ops.nmf.resume()
    assert not monitor.running


def test_textures_light_and_photos_are_found_after_the_project_has_moved(
    capture, fake_solver, tick, tmp_path
):
    project = Path(bpy.data.filepath).parent
    bpy.ops.nmf.reconstruct()
    tick()
    bpy.ops.wm.save_mainfile()
    moved = project.with_name(project.name + " moved")
    project.rename(moved)
    bpy.ops.wm.open_mainfile(filepath=str(moved / "scene.blend"))
    sizes = {image.name: tuple(image.size) for image in bpy.data.images if image.filepath}
    moved.rename(project)
    assert len(sizes) == 10 and (0, 0) not in sizes.values(), sizes


def test_cameras_in_no_collection_are_reconstructed(extension, monitor, fake_solver, tick, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    folder = fake_capture.write_capture(tmp_path / "photos").parent
    for number in range(3):
        data = bpy.data.cameras.new(f"c{number}")
        item = bpy.data.objects.new(data.name, data)
        item.location = (4 - number, number, 1)
        bpy.context.scene.collection.objects.link(item)
        photo = bpy.data.images.load(str(folder / f"photos/r_{number}.png"))
        data.background_images.new().image = photo
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    assert bpy.context.scene.nmf.capture is None
    tick()
    assert monitor.model.text == "Done" and len(results()) == 1


def test_a_collection_without_photos_is_no_capture(capture, extension):
    props = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(props)
    layers = bpy.context.view_layer.layer_collection
    for layer in (layers, layers.children["Props"]):
        bpy.context.scene.nmf.capture = None
        bpy.context.view_layer.active_layer_collection = layer
        found = extension("scene.capture_collection").active_capture(bpy.context)
        assert found == capture


def test_a_flat_region_box_is_told_and_nothing_is_written(capture, tmp_path):
    box = next(item for item in capture.objects if item.get("nmf_region"))
    box.scale.z = 0
    with pytest.raises(RuntimeError, match="flat"):
        bpy.ops.nmf.reconstruct()
    jobs = tmp_path / "nmf_jobs"
    assert not jobs.exists() or not list(jobs.iterdir())


@pytest.fixture
def linked_capture(capture, tmp_path):
    """Name of the capture, which is linked into another file."""
    name, library = capture.name, bpy.data.filepath
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    (tmp_path / "shot").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot" / "shot.blend"))
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.collections = [name]
    bpy.context.scene.collection.children.link(bpy.data.collections[name])
    return name


def test_pictures_of_a_job_of_an_unsaved_file_are_packed_since_that_goes_with_the_extension(
    extension, result_job, tmp_path
):
    install, names = extension("scene.install"), extension("names")
    kept = install.install_result(bpy.context, result_job).material
    inside = names.user_folder(names.JOBS_OF_UNSAVED) / result_job.name
    shutil.copytree(result_job, inside)
    packed = install.install_result(bpy.context, inside).material
    for material, there in ((kept, False), (packed, True)):
        images = extension("scene.replace").images_of(material)
        assert images and all((image.packed_file is not None) == there for image in images)


def test_a_linked_capture_cannot_be_scaled_here(linked_capture, extension):
    cameras = [i for i in bpy.data.collections[linked_capture].objects if i.type == "CAMERA"]
    for item in cameras[:2]:
        item.select_set(True)
    with pytest.raises(RuntimeError, match="linked from another file; scale it there"):
        bpy.ops.nmf.set_scale(distance=2.0)


def test_what_a_check_of_a_linked_capture_found_is_in_the_panel(linked_capture, task, fake_solver, draw):
    bpy.ops.nmf.check_capture()
    task.finish()
    assert task.model.text == "Check: 1 warning"
    assert "r_0: " in draw("capture")[1]
    with pytest.raises(RuntimeError, match="the capture is in another file; fit the region box there"):
        bpy.ops.nmf.fit_region_box()


@pytest.mark.parametrize("is_override", [False, True], ids=["linked", "overridden"])
def test_a_capture_of_another_file_gets_its_region_box_there(linked_capture, extension, is_override):
    collection = bpy.data.collections[linked_capture]
    if is_override:
        layer = bpy.context.view_layer
        collection = collection.override_hierarchy_create(bpy.context.scene, layer)
    bpy.context.scene.nmf.capture = collection
    bpy.data.objects.remove(extension("scene.region").region_box(collection))
    before = set(bpy.data.objects)
    with pytest.raises(RuntimeError, match="the capture is in another file; add the region box there"):
        bpy.ops.nmf.add_region_box()
    assert set(bpy.data.objects) == before


def test_a_result_comes_to_an_overridden_capture(linked_capture, monitor, fake_solver, tick):
    linked = bpy.data.collections[linked_capture]
    mine = linked.override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    assert mine.override_library
    bpy.context.scene.nmf.capture = mine
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    tick()
    assert monitor.model.text == "Done", monitor.model.error
    (item,) = results()
    assert item.users_collection == (bpy.context.scene.collection,)
    assert item.parent in set(mine.all_objects)


def test_a_linked_capture_is_reconstructed(linked_capture, monitor, fake_solver, tick):
    assert bpy.data.images[0].filepath.startswith("//")
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    tick()
    assert monitor.model.text == "Done", monitor.model.error
    assert results()[0].users_collection == (bpy.context.scene.collection,)


def test_setting_the_scale_between_vertices_can_be_undone(capture, fake_solver, tick):
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.nmf.reconstruct()
    tick()
    (item,) = results()
    root = item.parent.name
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set("EXEC_DEFAULT", True, mode="EDIT")
    select_two_vertices(item)
    bpy.ops.ed.undo_push(message="select")
    before = bpy.data.objects[root].scale.x
    bpy.ops.nmf.set_scale("EXEC_DEFAULT", True, distance=10.0)
    assert bpy.data.objects[root].scale.x != pytest.approx(before)
    bpy.ops.ed.undo()
    assert bpy.data.objects[root].scale.x == pytest.approx(before)


def with_orientation(path: Path, orientation: int) -> None:
    """Give a JPEG an EXIF orientation."""
    tiff = b"MM\0*\0\0\0\x08\0\x01" + bytes([1, 0x12, 0, 3, 0, 0, 0, 1, 0, orientation, 0, 0])
    exif = b"Exif\0\0" + tiff + b"\0\0\0\0"
    data = path.read_bytes()
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    path.write_bytes(data[:2] + segment + data[2:])


def test_a_portrait_photo_keeps_its_cameras_size_and_stands_upright(extension, tmp_path):
    """Its file lies on its side and has an orientation tag; Blender's images know nothing of it."""
    path = fake_capture.write_capture(tmp_path / "portrait")
    file = json.loads(path.read_text(encoding="utf-8"))
    file.pop("camera_angle_x")
    file.update(fl_x=70.0, fl_y=70.0, cx=24.0, cy=32.0, w=48, h=64)
    for frame in file["frames"]:
        photo = path.parent / frame["file_path"]
        image = bpy.data.images.new("lying", 64, 48)
        # Upright, the photo's upper third is red: on its side that is the left one, for tag 6.
        image.pixels = [v for _ in range(48) for x in range(64) for v in (float(x < 21), 0, 0, 1)]
        image.filepath_raw, image.file_format = str(photo.with_suffix(".jpg")), "JPEG"
        image.save()
        bpy.data.images.remove(image)
        photo.unlink()
        with_orientation(photo.with_suffix(".jpg"), 6)
        frame["file_path"] = frame["file_path"].replace(".png", ".jpg")
    path.write_text(json.dumps(file), encoding="utf-8")
    bpy.ops.nmf.import_capture(filepath=str(path))
    collection = bpy.context.scene.nmf.capture
    written = extension("scene.capture_collection").write_capture(collection, tmp_path / "job")
    frame = json.loads(written.read_text(encoding="utf-8"))["frames"][0]
    for name in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        assert frame[name] == pytest.approx(file[name]), name
    camera = next(item for item in collection.objects if item.type == "CAMERA")
    shown = next(b.image for b in camera.data.background_images if b.show_background_image)
    assert tuple(shown.size) == (48, 64)
    red = [shown.pixels[4 * (48 * row + 24)] for row in (60, 10)]  # rows count from below
    assert red[0] > 0.9 and red[1] < 0.1


def test_nothing_is_decoded_to_write_a_job(capture, fake_solver, tick):
    for image in bpy.data.images:
        image.buffers_free()
    bpy.ops.nmf.reconstruct()
    assert not any(image.has_data for image in bpy.data.images if image.filepath.endswith("r_0.png"))
    tick()


def test_a_photo_replaced_by_a_smaller_copy_has_that_copys_size(capture, extension, tmp_path):
    item = next(item for item in capture.objects if item.type == "CAMERA")
    cameras = extension("scene.cameras")
    photo, whole = cameras.photo_of(item), cameras.to_solver(item, Matrix.Identity(4))
    fake_capture.write_pixels(tmp_path / "half.png", np.zeros((8, 8, 3)))
    photo.filepath = str(tmp_path / "half.png")
    half = cameras.to_solver(item, Matrix.Identity(4))
    assert (whole.width, half.width) == (16, 8)
    assert half.fx == pytest.approx(whole.fx / 2)


def test_a_copy_of_the_file_leaves_the_job_of_the_open_one_where_it_is(
    capture, monitor, fake_solver, tick, tmp_path
):
    bpy.ops.nmf.reconstruct()
    tick()
    root = monitor.job.root.resolve()
    (tmp_path / "copies").mkdir()
    for copy in (tmp_path.parent / "copy.blend", tmp_path / "copies" / "copy.blend"):
        bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True)
        assert Path(bpy.path.abspath(bpy.context.scene.nmf.job)).resolve() == root
    with pytest.raises(RuntimeError):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "nowhere" / "scene.blend"))
    assert Path(bpy.path.abspath(bpy.context.scene.nmf.job)).resolve() == root


def test_a_folder_that_holds_a_capture_is_no_place_for_a_job(capture, extension, tmp_path):
    create = extension("jobs.create").create_job
    mine = tmp_path / "mine" / "capture"
    mine.mkdir(parents=True)
    (mine / "transforms_train.json").write_text("mine")
    with pytest.raises(Exception, match="not empty and holds no job"):
        create(capture, tmp_path / "mine")
    assert (mine / "transforms_train.json").read_text() == "mine"


def test_the_solver_is_not_set_up_anew_while_it_runs(capture, monitor, fake_solver, tick):
    assert bpy.ops.nmf.setup_solver.poll()
    fake_solver("slow")
    bpy.ops.nmf.reconstruct()
    assert not bpy.ops.nmf.setup_solver.poll()
    bpy.ops.nmf.cancel()
    tick()
    assert bpy.ops.nmf.setup_solver.poll()


def test_a_result_that_comes_to_another_scene_says_where(capture, monitor, fake_solver, tick):
    scene = bpy.context.scene
    bpy.ops.nmf.reconstruct()
    bpy.context.window.scene = bpy.data.scenes.new("Another")
    tick()
    assert monitor.model.text == f"Done; its object is in the scene {scene.name}"
