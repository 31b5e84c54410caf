"""A result keeps its light as it stood when its capture's empty goes, is applied, or the object leaves it."""

import json
import types

import bpy
import fake_capture
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

TURNED = Matrix.LocRotScale((3, 1, 2), Euler((0.2, 0.4, 0.6)), (2, 2, 2))


def select(item):
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = item
    item.select_set(True)


def apply(item):
    select(item)
    assert bpy.ops.object.transform_apply(location=True, rotation=True, scale=True) == {"FINISHED"}


def delete(item):
    select(item)
    bpy.ops.object.delete()


def leave(item):
    """Alt+P, Clear and Keep Transformation."""
    select(item)
    bpy.ops.object.parent_clear(type="CLEAR_KEEP_TRANSFORM")
    bpy.context.view_layer.update()


def turn_of_light():
    """As Cycles sees it, 3×3."""
    bpy.context.view_layer.update()
    world = bpy.context.scene.world.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mapping = next(node for node in world.node_tree.nodes if node.type == "MAPPING")
    return np.array(Euler(mapping.inputs["Rotation"].default_value).to_matrix())


def relative(item):
    """The light in the axes of the mesh, whose corner stands for what an applied rotation is in."""
    bpy.context.view_layer.update()
    corners = [item.matrix_world @ vertex.co for vertex in item.data.vertices[:4]]
    edges = np.array([corner - corners[0] for corner in corners[1:]])
    return edges / np.linalg.norm(edges, axis=1, keepdims=True) @ turn_of_light()


@pytest.fixture(params=["blender", "command line"])
def placed(request, capture, extension, result_job):
    """A result in its turned capture, and the capture's empty: of a job in the capture's space, and of one
    in the space of its file, which has a frame."""
    root = extension("scene.capture_collection").root_of(capture)
    if request.param == "command line":
        turn = Matrix.LocRotScale((0, 1, 0), Euler((0.5, 0.1, 0.9)), (0.5, 0.5, 0.5))
        root["nmf_file_to_capture"] = np.array(turn).ravel().tolist()
        for item in capture.objects:
            if item.type == "CAMERA":
                item.matrix_local = (turn @ item.matrix_local).normalized()
        job = json.loads((result_job / "job.json").read_text())
        job["capture"] = capture["nmf_source"]
        (result_job / "job.json").write_text(json.dumps(job))
    root.matrix_world = TURNED
    bpy.context.view_layer.update()
    item = extension("scene.install").install_result(bpy.context, result_job, capture).object
    assert (item.parent != root) == (request.param == "command line")
    return item, root


CHANGES = {
    "the capture's empty is deleted": lambda item, root: delete(root),
    "its transform is applied": lambda item, root: apply(root),
    "the object's is": lambda item, root: apply(item),
    "both are": lambda item, root: (apply(item), apply(root)),
    "what the object hangs on is applied": lambda item, root: apply(item.parent),
    "what it hangs on is deleted": lambda item, root: delete(item.parent),
    "the object leaves and the capture's empty is deleted": lambda item, root: (leave(item), delete(root)),
    "it is applied, then turned": lambda item, root: (
        apply(root),
        setattr(root, "rotation_euler", (1, 0, 0)),
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_the_light_stays_as_it_stood_about_the_object(placed, change):
    item, root = placed
    before = relative(item)
    change(item, root)
    np.testing.assert_allclose(relative(item), before, atol=1e-4)


def test_the_light_stands_still_when_the_object_alone_is_turned(placed):
    item, _ = placed
    before = turn_of_light()
    item.rotation_euler = (0.3, 0.2, 0.1)
    np.testing.assert_allclose(turn_of_light(), before, atol=1e-6)


def test_light_axes_go_with_their_result_once(placed, result_job, extension, capture):
    install = extension("scene.install").install_result
    item, root = placed
    apply(root)
    before = relative(item)

    def axes():
        return [other for other in bpy.data.objects if "nmf_light_axes" in other]

    (first,) = axes()
    assert first.hide_viewport and first.users_collection == item.users_collection
    install(bpy.context, result_job, capture)
    assert axes() == [first]
    np.testing.assert_allclose(relative(item), before, atol=1e-4)
    bpy.data.objects.remove(item)
    again = install(bpy.context, result_job, capture).object
    assert axes() == [first]
    np.testing.assert_allclose(relative(again), before, atol=1e-4)


def test_a_light_that_was_turned_by_hand_stays_so_when_its_job_was_moved(
    placed, result_job, extension, capture
):
    """A fixed bug: it got axes anew."""
    install = extension("scene.install").install_result
    item, _ = placed
    (axes,) = (other for other in bpy.data.objects if "nmf_light_axes" in other)
    axes.rotation_euler.z += 1.0
    before = relative(item)
    moved = result_job.parent / "elsewhere" / result_job.name
    moved.parent.mkdir()
    result_job.rename(moved)
    item = install(bpy.context, moved, capture).object
    np.testing.assert_allclose(relative(item), before, atol=1e-4)
    bpy.data.objects.remove(item)
    install(bpy.context, moved, capture)
    assert [other for other in bpy.data.objects if "nmf_light_axes" in other] == [axes]


def test_a_result_that_has_left_its_capture_keeps_its_light_when_it_is_installed_again(
    placed, result_job, extension, capture
):
    """A fixed bug: the new light was not turned at all."""
    item, _ = placed
    before = relative(item)
    leave(item)
    extension("scene.install").install_result(bpy.context, result_job, capture)
    np.testing.assert_allclose(relative(item), before, atol=1e-4)


def test_a_deleted_result_is_not_kept_in_the_file_by_its_light(placed):
    item, _ = placed
    name = item.name
    delete(item)
    assert name not in bpy.data.objects


@pytest.mark.parametrize("job", ["RENDER", "OBJECT_BAKE"])
def test_a_light_is_let_go_once_blender_has_rendered_or_baked(placed, extension, monkeypatch, job):
    """A fixed bug: its axes were written to in the thread that baked."""
    item, _ = placed
    axes, running = next(o for o in bpy.data.objects if "nmf_light_axes" in o), {job}
    app = types.SimpleNamespace(is_job_running=running.__contains__)
    fake = types.SimpleNamespace(app=app, context=bpy.context)
    monkeypatch.setattr(extension("redraw"), "bpy", fake)
    leave(item)
    assert axes.parent is not None
    running.clear()
    item.update_tag()
    bpy.context.view_layer.update()
    assert axes.parent is None


def test_light_axes_last_over_saving_and_opening(placed):
    item, root = placed
    names, before = (item.name, root.name), relative(item)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    item, root = (bpy.data.objects[name] for name in names)
    leave(item)
    delete(root)
    np.testing.assert_allclose(relative(item), before, atol=1e-4)


def test_a_result_is_counted_from_its_origin_also_in_the_captures_own_space(capture, extension, result_job):
    file = result_job / "result" / "manifest.json"
    manifest = json.loads(file.read_text())
    file.write_text(json.dumps({**manifest, "origin": [1000.0, 2000.0, 0.0]}))
    root = extension("scene.capture_collection").root_of(capture)
    root.matrix_world = TURNED
    item = extension("scene.install").install_result(bpy.context, result_job, capture).object
    bpy.context.view_layer.update()
    np.testing.assert_allclose(item.matrix_world.translation, TURNED @ Vector((1000, 2000, 0)), atol=1e-3)


def test_a_result_of_the_command_line_stands_among_its_cameras_whose_empty_was_applied(
    extension, result_job, tmp_path
):
    """Far from the origin, where single precision would not do."""
    scene, install = extension("scene.capture_collection"), extension("scene.install")
    path = fake_capture.write_capture(tmp_path / "five", 5)
    origin = np.array([412345.0, 5212345.0, 120.0])
    cameras = json.loads(path.read_text())
    for frame in cameras["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] += origin
        frame["transform_matrix"] = pose.tolist()
    path.write_text(json.dumps(cameras))
    collection = extension("scene.import_captures").import_capture(bpy.context, path)
    root = scene.root_of(collection)
    placement = np.array(root["nmf_file_to_capture"]).reshape(4, 4)
    root.matrix_world = TURNED
    bpy.context.view_layer.update()
    apply(root)
    assert root.matrix_world == Matrix.Identity(4), "else this tests nothing"
    job = json.loads((result_job / "job.json").read_text())
    (result_job / "job.json").write_text(json.dumps({**job, "capture": str(path)}))
    manifest = json.loads((result_job / "result" / "manifest.json").read_text())
    (result_job / "result" / "manifest.json").write_text(
        json.dumps({**manifest, "origin": origin.tolist()})
    )
    item = install.install_result(bpy.context, result_job, collection).object
    bpy.context.view_layer.update()
    for vertex in item.data.vertices:
        place = placement @ [*(origin + vertex.co), 1.0]
        expected = TURNED @ Matrix.Translation(place[:3]).translation
        np.testing.assert_allclose(item.matrix_world @ vertex.co, expected, atol=1e-3)
    expected = np.array(TURNED.to_3x3().normalized()) @ placement[:3, :3]
    expected /= np.cbrt(np.linalg.det(expected))
    np.testing.assert_allclose(turn_of_light(), expected, atol=1e-4)
