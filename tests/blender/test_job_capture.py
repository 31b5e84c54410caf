"""Install Result: a result stands in the capture it was made from, and by itself where that is not."""

import json
import shutil
from pathlib import Path

import bpy
import fake_capture
import fake_result
import numpy as np
import pytest
from mathutils import Euler


@pytest.fixture
def find(extension):
    """The capture that `capture_of_job` finds for a folder."""
    part, folder = extension("scene.job_capture"), extension("scene.result").job_of_result
    return lambda root: part.capture_of_job(bpy.context, folder(root))


def finished_job(root: Path, photos: list[str] = (), capture: str = "none") -> Path:
    """A job with a result: of photos as Blender writes them into it, or of a capture's file."""
    root.mkdir(parents=True)
    if photos:
        (root / "capture").mkdir()
        fake_capture.write_cameras(root / "capture" / "transforms_train.json", photos)
        capture = str(root / "capture" / "transforms_train.json")
    (root / "job.json").write_text(json.dumps({"schema_version": 1, "capture": capture}))
    fake_result.write_result(root)
    return root


def paths_of_photos(capture):
    return [
        bpy.path.abspath(item.data.background_images[0].image.filepath)
        for item in capture.objects
        if item.type == "CAMERA"
    ]


def test_a_result_of_another_capture_stands_by_itself(capture, extension, tmp_path):
    """Also where its folder has the name of the one that this capture was last reconstructed in."""
    root = extension("scene.capture_collection").root_of(capture)
    root.rotation_euler, root.scale = (1.2, 0, 0), (5, 5, 5)
    job = finished_job(tmp_path / "elsewhere" / "job", ["/photos of a duck/a.png"])
    capture["nmf_last_job"] = "job"
    assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
    item = bpy.context.view_layer.objects.active
    bpy.context.view_layer.update()
    assert item.parent is None and item.users_collection == (bpy.context.scene.collection,)
    np.testing.assert_array_equal(item.matrix_world, np.eye(4))
    assert not any(n.type == "MAPPING" for n in bpy.context.scene.world.node_tree.nodes)


def test_a_result_by_itself_stands_upright_with_its_light(extension, tmp_path):
    """Here +X is up in the capture, whose unit is half a metre."""
    job = finished_job(tmp_path / "elsewhere" / "job", ["/photos of a duck/a.png"])
    placement = [[0, 0, -0.5, 1], [0, 0.5, 0, 2], [0.5, 0, 0, 3], [0, 0, 0, 1]]
    manifest = job / "result" / "manifest.json"
    content = json.loads(manifest.read_text(encoding="utf-8"))
    manifest.write_text(json.dumps({**content, "placement": placement}), encoding="utf-8")
    for _ in range(2):  # installed again, it stays where it is
        assert bpy.ops.nmf.install_result(directory=str(job)) == {"FINISHED"}
        item = bpy.context.view_layer.objects.active
        bpy.context.view_layer.update()
        np.testing.assert_allclose(item.matrix_world, placement, atol=1e-6)
        world = bpy.context.scene.world
        mapping = next(n for n in world.node_tree.nodes if n.type == "MAPPING")
        evaluated = world.evaluated_get(bpy.context.evaluated_depsgraph_get())
        turn = Euler(evaluated.node_tree.nodes[mapping.name].inputs["Rotation"].default_value)
        np.testing.assert_allclose(turn.to_matrix(), 2 * np.array(placement)[:3, :3], atol=1e-5)


def test_a_result_finds_its_capture_by_its_photos(capture, find, tmp_path):
    photos = paths_of_photos(capture)
    other = fake_capture.write_capture(tmp_path / "other")
    bpy.ops.nmf.import_capture(filepath=str(other))
    capture["nmf_last_job"] = "a later job"
    assert find(finished_job(tmp_path / "job", photos)) == capture


def test_a_result_finds_its_capture_and_not_what_that_lies_in(capture, find, tmp_path):
    parent = bpy.data.collections.new("A")
    bpy.context.scene.collection.children.link(parent)
    bpy.context.scene.collection.children.unlink(capture)
    parent.children.link(capture)
    bpy.context.scene.nmf.capture = None
    assert find(finished_job(tmp_path / "job", paths_of_photos(capture))) == capture


def test_a_result_finds_its_capture_after_both_have_moved(capture, find, tmp_path):
    photos = [f"/where/they/were/{Path(path).name}" for path in paths_of_photos(capture)]
    job = finished_job(tmp_path / "job", photos)
    assert find(job) is None
    capture["nmf_last_job"] = "job"
    assert find(job) == capture


def test_a_result_of_the_command_line_finds_the_capture_of_its_file(capture, find, tmp_path):
    other = fake_capture.write_capture(tmp_path / "other")
    job = finished_job(tmp_path / "job", capture=str(other))
    assert find(job) is None
    bpy.ops.nmf.import_capture(filepath=str(other))
    imported, bpy.context.scene.nmf.capture = bpy.context.scene.nmf.capture, capture
    assert find(job) == imported


def test_a_result_folder_and_an_exported_one_can_be_chosen(capture, extension, tmp_path):
    job = finished_job(tmp_path / "job", paths_of_photos(capture))
    assert bpy.ops.nmf.install_result(directory=str(job / "result")) == {"FINISHED"}
    root = extension("scene.capture_collection").root_of(capture)
    item = bpy.context.view_layer.objects.active
    assert (item.name, item.parent) == ("job", root)
    exported = shutil.copytree(job / "result", tmp_path / "duck for you")
    assert bpy.ops.nmf.install_result(directory=str(exported)) == {"FINISHED"}
    item = bpy.context.view_layer.objects.active
    assert (item.name, item.parent) == ("duck for you", None)


def test_a_script_that_names_no_job_gets_an_error_and_not_what_lies_in_its_folder(result_job, monkeypatch):
    monkeypatch.chdir(result_job)
    with pytest.raises(RuntimeError, match="There is no path; give the folder of a finished job"):
        bpy.ops.nmf.install_result()
    assert not bpy.data.objects


def test_a_result_waits_for_object_mode(result_job):
    """Else two objects would be active in two modes, and the person could not leave the first one's."""
    data = bpy.data.meshes.new("mine")
    mine = bpy.data.objects.new("mine", data)
    bpy.context.scene.collection.objects.link(mine)
    bpy.context.view_layer.objects.active = mine
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode first"):
        bpy.ops.nmf.install_result(directory=str(result_job))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.nmf.install_result(directory=str(result_job)) == {"FINISHED"}


def switched_off(how, capture, parent):
    """Hide a capture by one of the switches of the outliner, its own or those of what it lies in."""
    layer = bpy.context.view_layer.layer_collection.children[parent.name]
    match how:
        case "exclude":
            layer.exclude = True
        case "eye":
            layer.children[capture.name].hide_viewport = True
        case "eye of its parent":
            layer.hide_viewport = True
        case "viewport":
            capture.hide_viewport = True
        case "render":
            capture.hide_render = True


@pytest.mark.parametrize("how", ["exclude", "eye", "eye of its parent", "viewport", "render"])
def test_a_result_is_seen_and_rendered_although_its_capture_is_switched_off(
    capture, fake_solver, tick, how
):
    parent = bpy.data.collections.new("Captures")
    bpy.context.scene.collection.children.link(parent)
    bpy.context.scene.collection.children.unlink(capture)
    parent.children.link(capture)
    next(item for item in capture.objects if item.get("nmf_root")).location.z = 2
    bpy.ops.nmf.reconstruct()
    switched_off(how, capture, parent)
    tick()
    layer = bpy.context.view_layer
    item = layer.objects.active
    assert item.get("nmf_job") and item.visible_get(view_layer=layer)
    assert not any(home.hide_render for home in item.users_collection)
    assert item.matrix_world.translation.z == pytest.approx(2), "it stands where its capture does"
