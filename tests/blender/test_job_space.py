"""Where a result comes to stand whose capture was moved, or had its transform applied, since the job began."""

import bpy
import fake_capture
import numpy as np
from mathutils import Euler, Matrix


def results():
    return [item for item in bpy.data.objects if item.get("nmf_job")]


def apply_transform(root):
    """Ctrl+A, All Transforms."""
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = root
    root.select_set(True)
    assert bpy.ops.object.transform_apply(location=True, rotation=True, scale=True) == {"FINISHED"}
    bpy.context.view_layer.update()


def cameras_of(capture):
    return [item for item in capture.all_objects if item.type == "CAMERA"]


def test_a_result_stands_before_its_cameras_although_the_captures_transform_was_applied_meanwhile(
    extension, capture, fake_solver, tick, tmp_path
):
    path = fake_capture.write_capture(tmp_path / "five", 5)
    bpy.ops.nmf.import_capture(filepath=str(path))
    capture = bpy.context.scene.nmf.capture
    root = extension("scene.capture_collection").root_of(capture)
    root.matrix_world = placed = Matrix.LocRotScale((3, 1, 2), Euler((0.2, 0.4, 0.6)), (2, 2, 2))
    bpy.context.view_layer.update()
    before = {item.name: np.array(item.matrix_world.normalized()) for item in cameras_of(capture)}
    bpy.ops.nmf.reconstruct()
    apply_transform(root)
    assert root.matrix_world == Matrix.Identity(4), "else this tests nothing"
    cameras_of(capture)[0].location.x += 0.3  # one may have been moved by hand
    root.location.z += 5
    tick()
    bpy.context.view_layer.update()
    (item,) = results()
    raised = Matrix.Translation((0, 0, 5))
    np.testing.assert_allclose(item.matrix_world, raised @ placed, atol=1e-4)
    for camera in cameras_of(capture)[1:]:
        expected = np.array(raised) @ before[camera.name]
        np.testing.assert_allclose(camera.matrix_world.normalized(), expected, atol=1e-4)


def test_a_result_goes_with_its_capture_that_was_moved_by_its_empty(extension, capture, fake_solver, tick):
    root = extension("scene.capture_collection").root_of(capture)
    bpy.ops.nmf.reconstruct()
    moved = Matrix.LocRotScale((3, 1, 2), Euler((0.2, 0.4, 0.6)), (2, 2, 2))
    root.matrix_world = moved
    tick()
    bpy.context.view_layer.update()
    (item,) = results()
    assert item.parent == root, "no frame is needed"
    np.testing.assert_allclose(item.matrix_world, moved, atol=1e-5)
