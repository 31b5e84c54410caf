"""Captures, installation, material and World in Blender."""

import json

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector


def test_an_imported_capture_is_written_back_as_it_was(extension, duck, tmp_path):
    scene = extension("scene.capture_collection")
    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    root = scene.root_of(collection)
    # The person turns, moves and scales the capture: capture space must not notice.
    root.matrix_world = Matrix.LocRotScale(Vector((1, 2, 3)), Euler((0.3, -0.2, 1.0)), Vector((2, 2, 2)))
    bpy.context.view_layer.update()
    path = scene.write_capture(collection, tmp_path / "job ü")
    from neural_microfacet_fields.solver.capture.read import read_capture

    before = {c.name: c for c in read_capture(duck).cameras}
    after = {c.name: c for c in read_capture(path, trusted=True).cameras}
    assert before.keys() == after.keys() and len(after) == 60
    for name, camera in before.items():
        other = after[name]
        np.testing.assert_allclose(other.camera_to_world, camera.camera_to_world, atol=5e-6)
        np.testing.assert_allclose(
            [other.fx, other.fy, other.cx, other.cy],
            [camera.fx, camera.fy, camera.cx, camera.cy],
            rtol=1e-6,
        )
        assert other.image_path.samefile(camera.image_path)


@pytest.mark.parametrize("size", [(64, 48), (48, 64)])
def test_principal_point_pixel_aspect_and_lens_survive(extension, tmp_path, size):
    cameras = extension("scene.cameras")
    from neural_microfacet_fields.solver.capture.camera import Camera

    image = bpy.data.images.new("photo", *size)
    image.filepath_raw, image.file_format = str(tmp_path / "photo.png"), "PNG"
    image.save()
    photo = bpy.data.images.load(str(tmp_path / "photo.png"))
    camera = Camera(
        "c",
        tmp_path / "photo.png",
        np.eye(4),
        *size,
        70.0,
        63.0,
        30.0,
        26.0,
        "opencv",
        (0.1, 0.02, 0.0, 0.0, 0.0),
    )
    item = cameras.add_camera(camera, photo)
    bpy.context.scene.collection.objects.link(item)
    other = cameras.to_solver(item, Matrix.Identity(4))
    np.testing.assert_allclose((other.fx, other.fy, other.cx, other.cy), (70, 63, 30, 26), rtol=1e-5)
    assert other.lens == "opencv"
    np.testing.assert_allclose(other.distortion, camera.distortion, atol=1e-7)


def test_blender_projects_points_as_the_solver_does(extension, duck):
    from bpy_extras.object_utils import world_to_camera_view

    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    from neural_microfacet_fields.solver.capture.read import read_capture

    camera = read_capture(duck).cameras[7]
    extension("scene.match_solver").match_resolution(bpy.context.scene, camera.width, camera.height)
    item = next(i for i in collection.objects if i.name == camera.name)
    bpy.context.view_layer.update()
    for point in ((0.1, 0.2, 0.3), (-0.5, 0.4, -0.2)):
        x, y, _ = world_to_camera_view(bpy.context.scene, item, Vector(point))
        pixel, _ = camera.project(np.array([point]))
        np.testing.assert_allclose((x * 200, (1 - y) * 200), pixel[0], atol=1e-3)


def _shown_at(pixel, camera, frame):
    """Where Blender shows a pixel of a photo that is fitted into a frame as a whole; (0, 0) is below on the left."""
    photo = camera.width / (camera.height * camera.fx / camera.fy)
    x, y = pixel[0] / camera.width, 1 - pixel[1] / camera.height
    if photo < frame:
        return 0.5 + (x - 0.5) * photo / frame, y
    return x, 0.5 + (y - 0.5) * frame / photo


@pytest.mark.parametrize("frame", [(1920, 1080), (1080, 1920), (100, 100)])
@pytest.mark.parametrize("size, fy", [((64, 48), 70), ((48, 64), 70), ((64, 64), 70), ((64, 48), 60)])
def test_the_scene_lies_under_the_photo_whatever_is_rendered(extension, tmp_path, frame, size, fy):
    from bpy_extras.object_utils import world_to_camera_view
    from neural_microfacet_fields.solver.capture.camera import Camera

    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = frame
    camera = Camera("c", tmp_path / "photo.png", np.eye(4), *size, 70.0, float(fy), 30.0, 26.0)
    cameras, shape = extension("scene.cameras"), frame[0] / frame[1]
    item = cameras.add_camera(camera, None, frame=shape)
    scene.collection.objects.link(item)
    bpy.context.view_layer.update()
    for point in ((0.1, 0.2, -1.0), (-0.2, 0.1, -1.5)):
        shown = _shown_at(camera.project(np.array([point]))[0][0], camera, shape)
        np.testing.assert_allclose(world_to_camera_view(scene, item, Vector(point))[:2], shown, atol=1e-5)


def test_a_render_that_matches_has_the_size_of_the_photo_behind_the_camera(extension, duck):
    scene = bpy.context.scene
    scene.render.resolution_x, scene.cycles.film_exposure = 640, 2.0
    scene.view_settings.use_curve_mapping = scene.view_settings.use_white_balance = True
    scene.camera = bpy.data.objects.new("mine", bpy.data.cameras.new("mine"))
    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    bpy.ops.nmf.match_solver()
    assert (scene.render.resolution_x, scene.cycles.film_exposure) == (640, 1.0)
    assert not scene.view_settings.use_curve_mapping
    assert not scene.view_settings.use_white_balance
    scene.camera = extension("scene.capture_collection").photo_cameras(collection)[0]
    bpy.ops.nmf.match_solver()
    assert (scene.render.resolution_x, scene.render.resolution_y) == (200, 200)


def test_what_else_would_change_a_render_is_switched_off_or_told(extension):
    scene = bpy.context.scene
    render = scene.render

    def match_solver(scene):
        bpy.context.view_layer.update()
        return extension("scene.match_solver").match_solver(scene)

    switched_off = ("use_simplify", "use_border", "use_motion_blur", "use_compositing", "use_sequencer")
    for name in switched_off:
        setattr(render, name, True)
    lamp = bpy.data.objects.new("Key", bpy.data.lights.new("Key", "POINT"))
    scene.collection.objects.link(lamp)
    assert "hide Key in renders" in match_solver(scene)
    assert not any(getattr(render, name) for name in switched_off)
    lamp.hide_render = True
    assert match_solver(scene) == ""
    lamp.hide_render, studio = False, bpy.data.collections.new("Studio")
    scene.collection.children.link(studio)
    studio.objects.link(lamp)
    scene.collection.objects.unlink(lamp)
    assert match_solver(scene) != ""
    studio.hide_render = True
    assert match_solver(scene) == ""
    studio.hide_render = False
    bpy.context.view_layer.layer_collection.children["Studio"].exclude = True
    assert match_solver(scene) == ""


def test_a_broken_capture_changes_nothing(extension, tmp_path):
    module = extension("scene.import_captures")
    from neural_microfacet_fields.solver.capture.errors import CaptureError

    (tmp_path / "transforms.json").write_text('{"frames": [')
    before = len(bpy.data.collections), len(bpy.data.objects)
    with pytest.raises(CaptureError):
        module.import_capture(bpy.context, tmp_path)
    assert (len(bpy.data.collections), len(bpy.data.objects)) == before


def test_the_region_box_is_read_in_capture_space(extension, duck):
    scene, module = extension("scene.capture_collection"), extension("scene.region")
    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    bpy.data.objects.remove(module.region_box(collection))
    assert module.region_of(collection) is None
    box = module.add_region_box(bpy.context, collection)
    box.location, box.scale = (0.5, 0, 0), (1, 2, 3)
    scene.root_of(collection).location = (10, 0, 0)
    region = module.region_of(collection)
    np.testing.assert_allclose(region["min"], (-0.5, -2, -3), atol=1e-5)
    np.testing.assert_allclose(region["max"], (1.5, 2, 3), atol=1e-5)


def test_a_turned_region_box_is_told_when_the_reconstruction_begins(extension, capture, fake_solver, capfd):
    extension("scene.region").region_box(capture).rotation_euler.z = 0.3
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    assert "is rotated, so the region is the unrotated box" in capfd.readouterr().out


def test_a_duplicated_camera_is_told_when_the_reconstruction_begins(extension, capture, fake_solver, capfd):
    first = extension("scene.capture_collection").photo_cameras(capture)[0]
    copy = first.copy()
    capture.objects.link(copy)
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    assert f"{first.name} and {copy.name} have the same photo" in capfd.readouterr().out


def test_imported_cameras_are_locked_where_their_photos_were_taken(extension, capture):
    for item in extension("scene.capture_collection").photo_cameras(capture):
        assert all((*item.lock_location, *item.lock_rotation, *item.lock_scale))


def test_captures_are_those_around_cameras_with_photos(extension, capture, add_capture):
    scene, module = bpy.context.scene, extension("scene.capture_collection")
    other = add_capture("another")
    around, empty = bpy.data.collections.new("around"), bpy.data.collections.new("empty")
    for collection in (around, empty):
        scene.collection.children.link(collection)
    around.children.link(other)
    empty.objects.link(bpy.data.objects.new("lone", bpy.data.cameras.new("lone")))
    found = module.capture_collections(scene)
    assert set(found) == {capture, other, around}
    assert all(module.is_capture(c) == (c in found) for c in scene.collection.children_recursive)


def test_only_captures_of_the_scene_can_be_chosen_in_its_tab(extension, capture):
    may_be_chosen = extension("properties")._may_be_chosen
    second = bpy.data.scenes.new("Second")
    assert may_be_chosen(bpy.context.scene.nmf, capture)
    assert not may_be_chosen(second.nmf, capture)
    second.collection.children.link(capture)
    assert may_be_chosen(second.nmf, capture)


def test_photos_lie_over_the_scene_again_once_the_render_has_their_shape(extension, tmp_path):
    cameras, scene = extension("scene.cameras"), bpy.context.scene
    from neural_microfacet_fields.solver.capture.camera import Camera

    scene.render.resolution_x, scene.render.resolution_y = 1920, 1080
    for name, size in (("upright", (48, 64)), ("lying", (64, 48))):
        path = tmp_path / f"{name}.png"
        bpy.data.images.new(name, *size).save(filepath=str(path))
        camera = Camera(name, path, np.eye(4), *size, 70.0, 70.0, 30.0, 26.0)
        photo = bpy.data.images.load(str(path))
        scene.collection.objects.link(cameras.add_camera(camera, photo, frame=16 / 9))
    scene.camera = bpy.data.objects["upright"]
    assert bpy.data.cameras["lying"].sensor_fit == "VERTICAL"
    before = cameras.to_solver(bpy.data.objects["lying"], Matrix.Identity(4))
    extension("scene.match_solver").match_photo(scene)
    assert bpy.data.cameras["lying"].sensor_fit == "HORIZONTAL"
    after = cameras.to_solver(bpy.data.objects["lying"], Matrix.Identity(4))
    np.testing.assert_allclose(
        (after.fx, after.fy, after.cx, after.cy), (before.fx, before.fy, before.cx, before.cy), rtol=1e-5
    )


def test_a_region_box_that_is_turned_or_there_twice_is_told(extension, duck):
    scene, region = extension("scene.capture_collection"), extension("scene.region")
    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    box, root = region.region_box(collection), scene.root_of(collection)
    assert all(box.lock_rotation)

    def problem():
        bpy.context.view_layer.update()
        return region.region_problem(collection, scene.to_capture_space(collection))

    root.rotation_euler, root.scale = (0.3, 0.5, 0.1), (2, 2, 2)
    box.rotation_euler, box.scale = (0, 0, np.pi / 2), (1, 0.2, 0.3)
    assert problem() == ""
    box.rotation_euler.z = 0.1
    assert "is rotated" in problem()
    box.rotation_euler.z = 0
    collection.objects.link(box.copy())
    assert "2 region boxes" in problem()


def test_an_installed_result_is_a_connected_textured_mesh_under_its_light(extension, result_job):
    asset = extension("scene.install").install_result(bpy.context, result_job)
    mesh = asset.object.data
    assert (len(mesh.vertices), len(mesh.polygons)) == (8, 12)
    assert mesh.uv_layers.active is not None
    corners = np.array([corner.vector for corner in mesh.corner_normals])
    expected = np.array([mesh.polygons[i // 3].normal for i in range(36)])
    np.testing.assert_allclose(corners, expected, atol=1e-3)
    assert bpy.context.scene.world == asset.world
    image = next(n.image for n in asset.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT")
    assert image.colorspace_settings.name == "Linear Rec.709" and tuple(image.size) == (8, 4)


def test_a_missing_file_of_a_result_changes_nothing(extension, result_job):
    from neural_microfacet_fields.solver.job.request import JobError

    (result_job / "result" / "f0.png").unlink()
    with pytest.raises(JobError, match="f0.png is missing"):
        extension("scene.install").install_result(bpy.context, result_job)
    assert not bpy.data.meshes and not bpy.data.materials and not bpy.data.worlds


@pytest.mark.parametrize(
    "damaged", [lambda data: data[:-7], lambda data: data.replace(b"element vertex ", b"element vertex x")]
)
def test_a_cut_off_mesh_and_one_with_an_unreadable_count_change_nothing(extension, result_job, damaged):
    from neural_microfacet_fields.solver.job.request import JobError

    mesh = result_job / "result" / "mesh.ply"
    mesh.write_bytes(damaged(mesh.read_bytes()))
    with pytest.raises(JobError, match="damaged"):
        extension("scene.install").install_result(bpy.context, result_job)
    assert not bpy.data.meshes and not bpy.data.materials


def test_the_material_has_an_exact_output_for_cycles_and_a_portable_one(extension, result_job):
    tree = extension("scene.install").install_result(bpy.context, result_job).material.node_tree
    exact, portable = tree.get_output_node("CYCLES"), tree.get_output_node("EEVEE")
    assert exact.inputs["Surface"].links[0].from_node.type == "GROUP"
    principled = portable.inputs["Surface"].links[0].from_node
    assert principled.type == "BSDF_PRINCIPLED" and principled.distribution == "GGX"
    assert portable.is_active_output
    group = exact.inputs["Surface"].links[0].from_node.node_tree
    metallic = next(n for n in group.nodes if n.type == "BSDF_METALLIC")
    assert (metallic.distribution, metallic.fresnel_type) == ("GGX", "F82")
    spaces = {n.label: n.image.colorspace_settings.name for n in tree.nodes if n.type == "TEX_IMAGE"}
    assert spaces == {
        "Albedo": "sRGB",
        "F0": "sRGB",
        "Roughness": "Non-Color",
        "Normal": "Non-Color",
        "Base Colour": "sRGB",
        "Metallic": "Non-Color",
    }


def test_a_result_of_before_metals_had_textures_is_a_plastic_with_its_f0(extension, result_job):
    path = result_job / "result" / "manifest.json"
    manifest = json.loads(path.read_text())
    for name in ("base_colour", "metallic"):
        (result_job / "result" / manifest["textures"].pop(name)["file"]).unlink()
    path.write_text(json.dumps(manifest))
    tree = extension("scene.install").install_result(bpy.context, result_job).material.node_tree
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    assert principled.inputs["Base Color"].links[0].from_node.label == "Albedo"
    assert not principled.inputs["Metallic"].links and principled.inputs["Specular Tint"].links


def test_a_result_lacks_a_file_of_what_its_manifest_names(extension, result_job):
    (result_job / "result" / "metallic.png").unlink()
    with pytest.raises(Exception, match=r"metallic\.png is missing"):
        extension("scene.install").install_result(bpy.context, result_job)


def render_pixels(path, size=32, samples=64):
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.render.resolution_x = scene.render.resolution_y = size
    image = scene.render.image_settings
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    loaded = bpy.data.images.load(str(path))
    return np.array(loaded.pixels[:]).reshape(size, size, 4)[::-1]


def test_cycles_shows_the_solvers_surface_model_in_a_white_furnace(extension, result_job):
    """A face seen head-on: ρ(1 − F0)(1 − s) + the directional albedo of GGX, by quadrature."""
    asset = extension("scene.install").install_result(bpy.context, result_job)
    extension("scene.match_solver").match_solver(bpy.context.scene, 2)
    background = next(n for n in asset.world.node_tree.nodes if n.type == "BACKGROUND")
    asset.world.node_tree.links.remove(background.inputs["Color"].links[0])
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    data = bpy.data.cameras.new("c")
    data.type, data.ortho_scale = "ORTHO", 0.2
    camera = bpy.data.objects.new("c", data)
    camera.location = (0, 0, 3)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    pixels = render_pixels(result_job / "furnace.exr", 16, 1024)[..., :3].mean((0, 1))

    f0, alpha = 0.08, (128 / 255) ** 2
    encoded = np.array([188, 100, 60]) / 255
    albedo = ((encoded + 0.055) / 1.055) ** 2.4
    z = (np.arange(4000) + 0.5) / 4000  # half vectors by cosine, view along the normal
    light_z = 2 * z * z - 1
    distribution = alpha**2 / (np.pi * (z * z * (alpha**2 - 1) + 1) ** 2)
    smith = np.where(
        light_z > 0, 0.5 * (np.sqrt(1 + alpha**2 * (1 / np.maximum(light_z, 1e-6) ** 2 - 1)) - 1), 0
    )
    fresnel = f0 + (1 - f0) * (1 - z) ** 5
    # ∫ F D G2/(4 n·v) dl with dl = 4 (v·h) dh
    integrand = np.where(light_z > 0, fresnel * distribution / (1 + smith) * z, 0)
    specular = 2 * np.pi * integrand.mean()
    expected = albedo * (1 - f0) * (1 - 0.0005) + specular
    np.testing.assert_allclose(pixels, expected, rtol=0.02)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (-0.6, -0.64, 0.48), (0, 0.6, 0.8)])
def test_the_environment_stands_in_cycles_as_the_solver_says(extension, tmp_path, direction):
    """A camera looks along a direction at a World whose texel there alone is red."""
    from neural_microfacet_fields.solver.job.folder import JobFolder  # noqa: F401

    direction = np.array(direction) / np.linalg.norm(direction)
    u = 0.5 - np.arctan2(direction[1], direction[0]) / (2 * np.pi)
    v = np.arccos(direction[2]) / np.pi
    pixels = np.zeros((64, 128, 4), np.float32)
    pixels[..., 2:] = 1
    row, column = int(v * 64), int(u * 128) % 128
    for r in range(row - 2, row + 3):
        for c in range(column - 2, column + 3):
            pixels[r % 64, c % 128] = (1, 0, 0, 1)
    image = bpy.data.images.new("light", 128, 64, float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
    image.filepath_raw, image.file_format = str(tmp_path / "light.exr"), "OPEN_EXR"
    image.save()
    bpy.context.scene.world = extension("scene.world").build_world("w", tmp_path / "light.exr")
    extension("scene.match_solver").match_solver(bpy.context.scene, 2)
    bpy.context.scene.render.film_transparent = False
    data = bpy.data.cameras.new("c")
    data.angle = 0.02
    camera = bpy.data.objects.new("c", data)
    camera.rotation_euler = Vector(direction).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    seen = render_pixels(tmp_path / "seen.exr", 8, 4)[..., :3].mean((0, 1))
    assert seen[0] > 0.9 and seen[2] < 0.1


def test_relighting_keeps_the_recovered_light_in_the_file(extension, result_job, duck):
    asset = extension("scene.install").install_result(bpy.context, result_job)
    world = extension("scene.world").relight(bpy.context.scene, duck / "relight_studio.exr")
    assert bpy.context.scene.world == world != asset.world
    assert asset.world.use_fake_user


def test_relighting_by_the_same_hdri_uses_its_world_again(extension, result_job, duck):
    recovered = extension("scene.install").install_result(bpy.context, result_job).world
    relight, scene = extension("scene.world").relight, bpy.context.scene
    studio = relight(scene, duck / "relight_studio.exr")
    studio.node_tree.nodes["Background"].inputs["Strength"].default_value = 2
    light = relight(scene, result_job / "result" / "environment.exr")
    assert relight(scene, duck / "relight_studio.exr") == studio == scene.world
    assert set(bpy.data.worlds) == {recovered, studio, light}
    assert studio.node_tree.nodes["Background"].inputs["Strength"].default_value == 2


def test_relighting_brings_the_hdri_that_was_picked_though_its_world_shows_another(extension, duck):
    relight, scene = extension("scene.world").relight, bpy.context.scene
    studio, sunset = (duck / f"relight_{name}.exr" for name in ("studio", "sunset"))
    before = relight(scene, studio)
    texture = next(node for node in before.node_tree.nodes if node.type == "TEX_ENVIRONMENT")
    texture.image = bpy.data.images.load(str(sunset))
    after = relight(scene, studio)
    texture = next(node for node in after.node_tree.nodes if node.type == "TEX_ENVIRONMENT")
    assert after != before and texture.image.filepath.endswith(studio.name)


def test_gltf_export_keeps_f0_and_metalness(extension, result_job, tmp_path):
    extension("scene.install").install_result(bpy.context, result_job)
    bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "x.gltf"), export_format="GLTF_SEPARATE")
    material = json.loads((tmp_path / "x.gltf").read_text())["materials"][0]
    specular = material["extensions"]["KHR_materials_specular"]
    assert specular["specularColorFactor"] == pytest.approx([0.08 / 0.04] * 3)
    assert "specularColorTexture" in specular and "normalTexture" in material
    assert "metallicRoughnessTexture" in material["pbrMetallicRoughness"]
    assert material["pbrMetallicRoughness"].get("metallicFactor", 1) == 1


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size, aspect", [((64, 48), 1.25), ((48, 56), 1.25), ((48, 56), 0.8)])
def test_a_camera_is_read_as_blender_projects_it_whatever_its_fit_and_pixels(extension, fit, size, aspect):
    data = bpy.data.cameras.new("c")
    item = bpy.data.objects.new("c", data)
    bpy.context.scene.collection.objects.link(item)
    data.sensor_fit, data.sensor_width, data.sensor_height, data.lens = fit, 30.0, 20.0, 40.0
    data.shift_x, data.shift_y = 0.06, -0.04
    width, height = size
    camera = extension("scene.cameras").camera_of(
        data, Matrix.Identity(4), width, height, aspect=aspect, name="c", image_path=None
    )
    projection = item.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(), x=width, y=height, scale_x=aspect, scale_y=1.0
    )
    for point in ((0.1, 0.05, -1.0), (-0.2, -0.1, -1.0)):
        x, y, _, w = projection @ Vector((*point, 1.0))
        wanted = ((x / w + 1) / 2 * width, (1 - y / w) / 2 * height)
        np.testing.assert_allclose(camera.project(np.array([point]))[0][0], wanted, atol=1e-3)


def test_a_camera_that_is_not_perspective_is_refused(extension, duck):
    collection = extension("scene.import_captures").import_capture(bpy.context, duck)
    item = next(item for item in collection.objects if item.type == "CAMERA")
    item.data.type = "ORTHO"
    with pytest.raises(Exception, match="type: cameras of the type Ortho are not supported"):
        extension("scene.cameras").to_solver(item, Matrix.Identity(4))
