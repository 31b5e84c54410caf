"""Imported captures: distortion, placement, points, several files; the light turns with them."""

import json
import math

import bpy
import fake_capture
import numpy as np
import OpenEXR
import pytest
from mathutils import Euler, Matrix
from picking import select_two_vertices


def edit(path, change):
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_a_distorted_photo_is_shown_without_its_distortion_and_solved_with_it(extension, tmp_path):
    cameras = extension("scene.cameras")
    path = fake_capture.write_capture(tmp_path / "photos")
    edit(path, lambda c: c.update(k1=-0.2, k2=0.02, p1=0.0, p2=0.0))
    collection = extension("scene.import_captures").import_capture(bpy.context, path)
    item = next(i for i in collection.objects if i.type == "CAMERA")
    kept, shown = item.data.background_images
    assert shown.show_background_image and shown.image.get("nmf_undistorted")
    assert shown.image.packed_file is not None
    assert not kept.show_background_image and cameras.photo_of(item) == kept.image
    solver = cameras.to_solver(item, Matrix.Identity(4))
    assert solver.lens == "opencv" and solver.distortion[0] == pytest.approx(-0.2)
    assert solver.image_path.is_file() and tmp_path in solver.image_path.parents


@pytest.mark.parametrize("bits", [8, 16])
def test_an_undistorted_photo_has_the_photos_colours_also_when_the_file_is_opened_again(tmp_path, bits):
    path = fake_capture.write_capture(tmp_path / "photos")
    for photo in (tmp_path / "photos" / "photos").iterdir():
        fake_capture.write_pixels(photo, np.full((16, 16, 3), (0.5, 0.2, 0.8)), bits)
    edit(path, lambda c: c.update(k1=0.1, k2=0.02))
    bpy.ops.nmf.import_capture(filepath=str(path))
    for _ in range(2):
        kept, shown = (b.image for b in bpy.data.cameras[0].background_images)
        middle = slice(4 * (8 * 16 + 8), 4 * (8 * 16 + 8) + 3)
        np.testing.assert_allclose(shown.pixels[middle], kept.pixels[middle], atol=1e-3)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
        bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)


def test_undistortion_moves_every_pixel_to_where_its_ray_meets_a_pinhole(extension):
    background = extension("scene.background")
    from neural_microfacet_fields.solver.capture.camera import Camera

    camera = Camera("c", None, np.eye(4), 90, 60, 70.0, 65.0, 43.0, 31.0, "opencv",
                    (-0.25, 0.05, 0.002, -0.001, 0.0))  # fmt: skip
    row, column = np.mgrid[0:60, 0:90] + 0.5
    # A photo whose colour is the direction its lens sees there.
    _, rays = camera.rays(column.ravel(), row.ravel())
    photo = np.ones((60, 90, 4), np.float32)
    photo[..., :2] = (rays[:, :2] / -rays[:, 2:]).reshape(60, 90, 2)
    shown = background.undistorted(camera, photo, (90, 60))
    seen = shown[..., 3] == 1
    assert 0.5 < seen.mean() <= 1
    expected = np.stack([(column - camera.cx) / camera.fx, -(row - camera.cy) / camera.fy], -1)
    inner = np.abs(expected).max(-1) < 0.35
    np.testing.assert_allclose(shown[inner][:, :2], expected[inner], atol=2e-3)


def test_picking_a_good_and_a_broken_file_imports_neither(extension, tmp_path):
    good = fake_capture.write_capture(tmp_path / "photos")
    (good.parent / "broken.json").write_text('{"frames": [')
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "collections", "images")}
    with pytest.raises(RuntimeError, match="broken.json.*not valid JSON"):
        bpy.ops.nmf.import_capture(
            directory=str(good.parent), files=[{"name": good.name}, {"name": "broken.json"}]
        )
    after = {name: len(getattr(bpy.data, name)) for name in before}
    assert after == before


def test_two_files_picked_are_two_captures(extension, tmp_path):
    first = fake_capture.write_capture(tmp_path / "photos")
    (first.parent / "again.json").write_bytes(first.read_bytes())
    result = bpy.ops.nmf.import_capture(
        directory=str(first.parent), files=[{"name": first.name}, {"name": "again.json"}]
    )
    assert result == {"FINISHED"}
    assert len(extension("scene.capture_collection").capture_collections(bpy.context.scene)) == 2


def test_a_folder_is_imported_by_what_it_holds(extension, tmp_path):
    path = fake_capture.write_capture(tmp_path / "photos")
    path.rename(path.with_name("whatever it is.json"))
    assert bpy.ops.nmf.import_capture(filepath=str(path.parent)) == {"FINISHED"}


def test_a_script_that_names_no_path_gets_an_error_and_not_what_lies_in_its_folder(tmp_path, monkeypatch):
    path = fake_capture.write_capture(tmp_path / "photos")
    monkeypatch.chdir(path.parent)
    for words in ({}, {"filepath": ""}, {"directory": "", "files": [{"name": ""}]}):
        with pytest.raises(RuntimeError, match="There is no path; give a camera file or a folder"):
            bpy.ops.nmf.import_capture(**words)
    assert not bpy.data.collections
    assert bpy.ops.nmf.import_capture(directory=str(path.parent)) == {"FINISHED"}


def test_cameras_follow_the_capture_under_an_empty_that_viewports_do_not_show(extension, capture):
    """Where a parent is shown, a dashed line leads to it from each of its children."""
    scene = extension("scene.capture_collection")
    root = scene.root_of(capture)
    (above,) = {item.parent for item in scene.photo_cameras(capture)}
    assert above.parent == root and above.hide_viewport and not root.hide_viewport
    assert set(root.children) == {above, extension("scene.region").region_box(capture)}
    before = [np.array(item.matrix_world) for item in scene.photo_cameras(capture)]
    move = Matrix.LocRotScale((1, 2, 3), Euler((0.1, 0.2, 0.3)), (2, 2, 2))
    root.matrix_world = move @ root.matrix_world
    bpy.context.view_layer.update()
    for item, matrix in zip(scene.photo_cameras(capture), before, strict=True):
        np.testing.assert_allclose(np.array(item.matrix_world), np.array(move) @ matrix, atol=1e-5)


def test_what_viewports_do_not_show_above_the_cameras_is_not_shown_to_find_where_they_stand(
    extension, capture, fake_solver, tick
):
    """Viewports would go on drawing lines to it afterwards."""
    scene = extension("scene.capture_collection")
    (above,) = {item.parent for item in scene.photo_cameras(capture)}
    bpy.ops.nmf.reconstruct()
    tick()
    (axes,) = (item for item in capture.objects if "nmf_light_axes" in item)
    with extension("scene.evaluated").evaluated(capture):
        assert above.hide_viewport and axes.hide_viewport


def test_the_recovered_light_turns_with_the_capture(extension, capture, result_job, tmp_path):
    """The world is seen along +X; turned a quarter about Z, what was seen along −Y is there."""
    scene = extension("scene.capture_collection")
    install, world = extension("scene.install"), extension("scene.world")
    height, width = 16, 32
    azimuth = (0.5 - (np.arange(width) + 0.5) / width) * 2 * math.pi
    sky = np.zeros((height, width, 3), np.float32)
    sky[..., 0], sky[..., 1] = 0.5 + 0.4 * np.cos(azimuth), 0.5 + 0.4 * np.sin(azimuth)
    OpenEXR.File({}, {"RGB": sky}).write(str(tmp_path / "sky.exr"))
    root = scene.root_of(capture)
    bpy.context.scene.world = world.build_world("sky", tmp_path / "sky.exr")
    world.turn_with(bpy.context.scene.world, root)
    data = bpy.data.cameras.new("eye")
    data.lens = 200
    eye = bpy.data.objects.new("eye", data)
    bpy.context.scene.collection.objects.link(eye)
    eye.rotation_euler = (math.pi / 2, 0, -math.pi / 2)  # along +X
    settings = bpy.context.scene
    settings.camera = eye
    settings.render.engine = "CYCLES"
    settings.cycles.device, settings.cycles.samples = "CPU", 16
    settings.cycles.use_denoising = False  # it tints flat pictures
    settings.render.resolution_x = settings.render.resolution_y = 4
    settings.render.resolution_percentage = 100
    settings.render.image_settings.file_format = "OPEN_EXR"

    def colour(name):
        settings.render.filepath = str(tmp_path / name)
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(str(tmp_path / f"{name}.exr"))
        values = np.empty(64, np.float32)
        picture.pixels.foreach_get(values)
        return values.reshape(16, 4).mean(0)[:2]

    np.testing.assert_allclose(colour("straight"), (0.9, 0.5), atol=0.02)
    root.rotation_euler = Euler((0, 0, math.pi / 2))
    bpy.context.view_layer.update()
    np.testing.assert_allclose(colour("turned"), (0.5, 0.1), atol=0.02)
    asset = install.install_result(bpy.context, result_job, capture)
    mapping = next(n for n in asset.world.node_tree.nodes if n.type == "MAPPING")
    bpy.context.view_layer.update()
    assert asset.object.parent == root
    evaluated = bpy.context.evaluated_depsgraph_get()
    turned = asset.world.evaluated_get(evaluated).node_tree.nodes[mapping.name]
    assert turned.inputs["Rotation"].default_value[2] == pytest.approx(math.pi / 2, abs=1e-5)


def test_a_result_made_from_the_captures_file_stands_where_its_cameras_do(extension, result_job, tmp_path):
    """A job of the command line is in the file's coordinates; here they are turned, scaled and moved."""
    scene, install = extension("scene.capture_collection"), extension("scene.install")
    origin = np.array([412345.0, 5212345.0, 120.0])
    path = fake_capture.write_capture(tmp_path / "photos")
    collection = extension("scene.import_captures").import_capture(bpy.context, path)
    root = scene.root_of(collection)
    placed = np.eye(4)
    placed[:3, :3] = 0.4 * np.array(Matrix.Rotation(0.7, 3, "Y"))
    placed[:3, 3] = -placed[:3, :3] @ (origin + (1.0, 2.0, 3.0))
    root[scene.FILE_TO_CAPTURE] = placed.ravel().tolist()
    root.location = (0.0, 0.0, 2.0)
    edit(result_job / "job.json", lambda job: job.update(capture=str(path.parent)))
    edit(result_job / "result" / "manifest.json", lambda m: m.update(origin=origin.tolist()))
    asset = install.install_result(bpy.context, result_job, collection)
    bpy.context.view_layer.update()
    corner = np.array(asset.object.data.vertices[0].co, dtype=np.float64)
    expected = (placed @ [*(origin + corner), 1.0])[:3] + (0.0, 0.0, 2.0)
    shown = asset.object.matrix_world @ asset.object.data.vertices[0].co
    np.testing.assert_allclose(shown, expected, atol=1e-5)
    mapping = next(n for n in asset.world.node_tree.nodes if n.type == "MAPPING")
    evaluated = asset.world.evaluated_get(bpy.context.evaluated_depsgraph_get())
    turn = Euler(evaluated.node_tree.nodes[mapping.name].inputs["Rotation"].default_value)
    np.testing.assert_allclose(turn.to_matrix(), placed[:3, :3] / 0.4, atol=1e-4)


def test_a_result_of_cameras_as_they_stand_in_blender_needs_no_frame(extension, capture, result_job):
    install = extension("scene.install")
    asset = install.install_result(bpy.context, result_job, capture)
    assert asset.object.parent == extension("scene.capture_collection").root_of(capture)


def two_empties(first, second):
    for item in bpy.context.view_layer.objects.selected:
        item.select_set(False)
    for position in (first, second):
        empty = bpy.data.objects.new("point", None)
        empty.location = position
        bpy.context.scene.collection.objects.link(empty)
        empty.select_set(True)
    bpy.context.view_layer.update()


def test_two_points_of_known_distance_scale_the_capture_about_the_first(extension, capture):
    module = extension("scene.region")
    camera = next(item for item in capture.objects if item.type == "CAMERA")
    region = module.region_of(capture)
    before = camera.matrix_world.translation.copy()
    two_empties((1, 0, 0), (1, 0, 0.5))
    assert bpy.ops.nmf.set_scale(distance=2.0) == {"FINISHED"}
    bpy.context.view_layer.update()
    expected = 4 * (np.array(before) - (1, 0, 0)) + (1, 0, 0)
    np.testing.assert_allclose(camera.matrix_world.translation, expected, atol=1e-4)
    assert camera.data.display_size == pytest.approx(0.8)
    # The solver works in capture space, which does not notice.
    np.testing.assert_allclose(module.region_of(capture)["max"], region["max"], atol=1e-4)


def test_a_capture_that_no_viewport_shows_is_scaled_where_it_stands(extension, capture):
    root = extension("scene.capture_collection").root_of(capture)
    root.location, root.scale, capture.hide_viewport = (1, 2, 3), (2, 2, 2), True
    bpy.context.scene.camera = None
    two_empties((0, 0, 0), (1, 0, 0))
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert bpy.ops.nmf.set_scale(distance=2.0) == {"FINISHED"}
    root = extension("scene.capture_collection").root_of(bpy.context.scene.nmf.capture)
    np.testing.assert_allclose(root.location, (2, 4, 6), atol=1e-5)
    np.testing.assert_allclose(root.scale, (4, 4, 4), atol=1e-5)


def test_the_capture_that_was_measured_is_scaled(extension, capture, result_job, add_capture):
    scene, install = extension("scene.capture_collection"), extension("scene.install")
    item = install.install_result(bpy.context, result_job, capture).object
    other = add_capture("another")
    assert bpy.context.scene.nmf.capture == other
    roots = [scene.root_of(collection) for collection in (capture, other)]
    first, second = (root.scale.x for root in roots)
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set(mode="EDIT")
    select_two_vertices(item)
    bpy.ops.nmf.set_scale(distance=50.0)
    assert roots[0].scale.x != first and roots[1].scale.x == second
    for chosen in bpy.context.selected_objects:
        chosen.select_set(False)
    for camera in scene.photo_cameras(other)[:2]:
        camera.select_set(True)
    first = roots[0].scale.x
    bpy.ops.nmf.set_scale(distance=50.0)
    assert roots[0].scale.x == first and roots[1].scale.x != second


def test_cameras_without_an_empty_are_not_taken_for_another_capture(capture, duck):
    bpy.context.scene.nmf.capture = capture
    mine = bpy.data.collections.new("mine")
    bpy.context.scene.collection.children.link(mine)
    for item in [item for item in capture.objects if item.type == "CAMERA"][:2]:
        copy = item.copy()
        copy.parent = None
        mine.objects.link(copy)
        copy.select_set(True)
    with pytest.raises(RuntimeError, match="mine has no transform empty"):
        bpy.ops.nmf.set_scale(distance=2.0)


def test_vertices_picked_in_edit_mode_are_measured(extension, capture):
    mesh = bpy.data.meshes.new("m")
    mesh.from_pydata([(0, 0, 0), (3, 0, 0), (9, 9, 9)], [], [])
    item = bpy.data.objects.new("m", mesh)
    item.location = (0, 0, 1)
    bpy.context.scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    for vertex, chosen in zip(mesh.vertices, (True, True, False), strict=True):
        vertex.select = chosen
    bpy.ops.object.mode_set(mode="EDIT")
    first, second = extension("scene.measure").picked_points(bpy.context)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (second - first).length == pytest.approx(3) and first.z == pytest.approx(1)


def test_one_point_is_not_enough_to_measure(extension, capture):
    for item in bpy.context.view_layer.objects.selected:
        item.select_set(False)
    with pytest.raises(RuntimeError, match="Two objects are needed, not 0; select two"):
        bpy.ops.nmf.set_scale(distance=2.0)
