"""Panoramas as Blender's panoramic cameras: Cycles renders points where `Camera.project` has them."""

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from samples.demo_views import render_cameras  # noqa: E402
from solver.capture.camera import Camera  # noqa: E402
from solver.capture.formats.transforms import write_transforms  # noqa: E402
from solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere  # noqa: E402

POSE = np.array(Matrix.LocRotScale((0.3, -0.2, 0.5), Euler((1.2, 0.3, 0.7)), None))


PART = (
    12.0,
    16.0,
    30.0,
    22.0,
)  # fx fy cx cy of a picture of 60 × 40 that shows a part of all directions


def panorama(width, height, pose=POSE, path=None, lens=None):
    name = "pano" if path is None else path.stem
    lens = of_whole_sphere(width, height) if lens is None else lens
    return Camera(name, path, pose, width, height, *lens, EQUIRECTANGULAR)


def settings_of(data):
    return data if hasattr(data, "panorama_type") else data.cycles


def glowing_ball(place):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.25, location=place, segments=24, ring_count=12)
    material = bpy.data.materials.new("Glow")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    glow = material.node_tree.nodes.new("ShaderNodeEmission")
    out = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(glow.outputs[0], out.inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


@pytest.mark.parametrize(
    "size, lens, shown", [((64, 32), None, 4), ((64, 48), None, 4), ((60, 40), PART, 3)]
)
def test_cycles_renders_a_point_where_the_solver_projects_it(
    extension, package, tmp_path, size, lens, shown
):
    scene = bpy.context.scene
    for item in list(scene.objects):
        bpy.data.objects.remove(item)
    scene.world = bpy.data.worlds.new("Dark")
    scene.world.color = (0, 0, 0)
    scene.render.engine, scene.render.film_transparent = "CYCLES", True
    scene.cycles.use_denoising = False
    camera, seen = panorama(*size, lens=lens), 0
    ball = glowing_ball((0, 0, 0))
    # Right and up in the picture, its middle, and nearly behind.
    for local in ((1.6, 0.4, -2.0), (-1.5, 0.9, 1.2), (0, 0, -2), (0.4, -1.6, 1.9)):
        point = POSE[:3, :3] @ local + POSE[:3, 3]
        if not camera.in_frame(point[None])[0]:
            continue
        seen += 1
        ball.location = point
        folder = tmp_path / str(local)
        folder.mkdir()
        path = render_cameras(package, bpy.context, [camera], folder, samples=4)[0]
        image = bpy.data.images.load(str(path))
        pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)[::-1]
        assert tuple(image.size) == size
        weight = pixels[..., 3]
        row, column = np.mgrid[: size[1], : size[0]] + 0.5
        found = (weight * column).sum() / weight.sum(), (weight * row).sum() / weight.sum()
        wanted = camera.project(point[None])[0][0]
        # A ball's picture is a little off its middle's where the sphere is stretched.
        np.testing.assert_allclose(found, wanted, atol=0.35)
        bpy.data.images.remove(image)
    assert seen == shown


@pytest.fixture
def capture_of_panoramas(extension, tmp_path):
    cameras = []
    for index in range(3):
        path = tmp_path / f"p{index}.png"
        Image.new("RGB", (64, 32), (40 * index, 90, 90)).save(path)
        pose = POSE.copy()
        pose[0, 3] += index
        cameras.append(panorama(64, 32, pose, path))
    write_transforms(tmp_path / "transforms.json", cameras)
    collection = extension("scene.import_captures").import_capture(
        bpy.context, tmp_path / "transforms.json"
    )
    return collection, cameras


def test_a_panorama_comes_in_as_a_panoramic_camera_and_goes_back_as_it_was(extension, capture_of_panoramas):
    collection, cameras = capture_of_panoramas
    bpy.context.view_layer.update()
    items = sorted((i for i in collection.objects if i.type == "CAMERA"), key=lambda i: i.name)
    assert len(items) == len(cameras)
    to_capture = extension("scene.capture_collection").to_capture_space(collection)
    for item, camera in zip(items, cameras, strict=True):
        assert item.data.type == "PANO"
        assert settings_of(item.data).panorama_type == "EQUIRECTANGULAR"
        # Its photo is kept, but a flat picture behind a panorama would mislead.
        assert not item.data.show_background_images
        assert not any(b.show_background_image for b in item.data.background_images)
        again = extension("scene.cameras").to_solver(item, to_capture)
        assert again.lens_key == camera.lens_key and again.image_path == camera.image_path
    assert extension("scene.hidden_photos").hidden_cameras(collection) == []


def test_a_part_of_a_panorama_comes_back_as_it_was(extension):
    camera = panorama(60, 40, lens=PART)
    data = bpy.data.cameras.new("part")
    extension("scene.panoramic_camera").make_panoramic(data, camera)
    again = extension("scene.cameras").camera_of(
        data, Matrix.Identity(4), 60, 40, name="c", image_path=None
    )
    found = (again.fx, again.fy, again.cx, again.cy)
    np.testing.assert_allclose(found, PART, rtol=1e-5)


def test_a_panorama_of_another_kind_or_of_no_range_is_refused(extension):
    data = bpy.data.cameras.new("other")
    data.type = "PANO"
    camera_of = extension("scene.cameras").camera_of
    settings = settings_of(data)
    settings.panorama_type = "FISHEYE_EQUIDISTANT"
    with pytest.raises(Exception, match="panoramas of the type FISHEYE_EQUIDISTANT are not"):
        camera_of(data, Matrix.Identity(4), 64, 32, name="c", image_path=None)
    settings.panorama_type = "EQUIRECTANGULAR"
    camera = camera_of(data, Matrix.Identity(4), 64, 32, name="c", image_path=None, lens="pinhole")
    assert camera.lens == EQUIRECTANGULAR
    settings.longitude_max = settings.longitude_min
    with pytest.raises(Exception, match="minimum is not below its maximum; set its longitudes"):
        camera_of(data, Matrix.Identity(4), 64, 32, name="c", image_path=None)
