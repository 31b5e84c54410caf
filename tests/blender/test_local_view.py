"""What comes while a 3D View is in Local View is seen there."""

import bpy
import pytest


def area_of_view():
    return next(a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D")


def seen(item, view):
    """As Blender draws it; the object itself is not told."""
    bpy.context.view_layer.update()
    return item.evaluated_get(bpy.context.evaluated_depsgraph_get()).visible_in_viewport_get(view)


@pytest.fixture
def view(capture):
    """A 3D View in Local View of a cube of the person's."""
    cube = bpy.data.objects.new("mine", bpy.data.meshes.new("mine"))
    bpy.context.scene.collection.objects.link(cube)
    bpy.context.view_layer.update()
    for item in bpy.context.view_layer.objects.selected:
        item.select_set(False)
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    area = area_of_view()
    region = next(r for r in area.regions if r.type == "WINDOW")
    with bpy.context.temp_override(area=area, region=region):
        assert bpy.ops.view3d.localview() == {"FINISHED"}
    assert area.spaces.active.local_view is not None
    return area.spaces.active


def test_a_result_is_seen_in_local_view(view, fake_solver, tick, capture):
    bpy.ops.nmf.reconstruct()
    tick()
    (item,) = (item for item in bpy.data.objects if item.get("nmf_job"))
    assert seen(item, view)
    assert not any(seen(c, view) for c in capture.objects if c.type == "CAMERA")


def test_a_result_that_is_renewed_is_seen_in_local_view(view, result_job):
    bpy.ops.nmf.install_result(directory=str(result_job))
    item = bpy.context.view_layer.objects.active
    item.local_view_set(view, False)
    assert not seen(item, view)
    bpy.ops.nmf.install_result(directory=str(result_job))
    assert seen(item, view)


def test_the_region_box_is_seen_in_local_view_when_it_is_selected(view, capture):
    box = next(item for item in capture.objects if item.get("nmf_region"))
    assert not seen(box, view)
    bpy.ops.nmf.select_region_box()
    assert seen(box, view)
