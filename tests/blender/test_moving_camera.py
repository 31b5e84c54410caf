"""Use Moving Camera: a tracked or animated camera and its film become a capture."""

import math
import sys
from pathlib import Path

import bpy
import fake_capture
import numpy as np
import pytest
from mathutils import Matrix
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from solver.capture.lenses import distort  # noqa: E402
from solver.capture.video import frames as frames_of  # noqa: E402
from tests.capture.videos import write_video  # noqa: E402

WIDTH, HEIGHT = 80, 48
FIRST_NUMBER, COUNT = 7, 9


@pytest.fixture
def film(tmp_path):
    """A sequence of pictures, each of one grey that tells its number; a file saved beside it."""
    for number in range(FIRST_NUMBER, FIRST_NUMBER + COUNT):
        fake_capture.write_pixels(
            tmp_path / "füm" / f"{name(number)}.png",
            np.full((HEIGHT, WIDTH, 3), number / 255),
        )
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path / "füm" / f"{name(FIRST_NUMBER)}.png"


@pytest.fixture
def camera():
    """A camera that goes round the origin from frame 1 to 9 and zooms in, the scene's."""
    data = bpy.data.cameras.new("Walk")
    item = bpy.data.objects.new("Walk", data)
    bpy.context.scene.collection.objects.link(item)
    bpy.context.scene.camera = item
    arm = bpy.data.objects.new("Arm", None)
    bpy.context.scene.collection.objects.link(arm)
    item.parent, item.location, item.rotation_euler = arm, (0, -5, 0), (math.pi / 2, 0, 0)
    for frame in range(1, 10):
        arm.rotation_euler.z = math.radians(20 * frame)
        arm.keyframe_insert("rotation_euler", frame=frame)
        data.lens = 30 + frame
        data.keyframe_insert("lens", frame=frame)
    return item


def put_sequence_behind(camera, film, start=1):
    image = bpy.data.images.load(str(film))
    image.source = "SEQUENCE"
    background = camera.data.background_images.new()
    background.image = image
    user = background.image_user
    user.frame_duration, user.frame_start, user.frame_offset = COUNT, start, FIRST_NUMBER - 1
    return background


def put_clip_behind(camera, film):
    clip = bpy.data.movieclips.load(str(film))
    background = camera.data.background_images.new()
    background.source, background.clip = "MOVIE_CLIP", clip
    return clip


def made():
    collection = bpy.context.scene.nmf.capture
    return [item for item in collection.objects if item.type == "CAMERA"]


def name(number):
    return f"take2_{number:04d}_graded"


@pytest.mark.parametrize("put_behind", [put_sequence_behind, put_clip_behind])
def test_a_moving_camera_becomes_one_for_each_picture_where_it_stood(extension, film, camera, put_behind):
    put_behind(camera, film)
    scene = bpy.context.scene
    scene.frame_set(4, subframe=0.25)
    assert bpy.ops.nmf.use_moving_camera() == {"FINISHED"}
    assert (scene.frame_current, round(scene.frame_subframe, 3)) == (4, 0.25)
    cameras = made()
    assert len(cameras) == COUNT
    photo_of = extension("scene.cameras").photo_of
    for frame, item in enumerate(cameras, start=1):
        scene.frame_set(frame)
        np.testing.assert_allclose(item.matrix_world, camera.matrix_world, atol=1e-5)
        assert item.data.lens * 36 / item.data.sensor_width == pytest.approx(30 + frame)
        path = Path(bpy.path.abspath(photo_of(item).filepath))
        assert path == film.with_stem(name(FIRST_NUMBER + frame - 1))


def test_a_camera_that_no_viewport_shows_and_the_scene_does_not_look_through_moves_as_well(film, camera):
    put_sequence_behind(camera, film)
    bpy.context.scene.camera = None
    camera.hide_viewport = True
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    camera = bpy.data.objects["Walk"]
    bpy.context.view_layer.objects.active = camera
    assert bpy.ops.nmf.use_moving_camera() == {"FINISHED"}
    assert len(made()) == COUNT and camera.hide_viewport


def test_only_some_frames_are_taken_and_evenly(film, camera):
    put_sequence_behind(camera, film, start=3)
    assert bpy.ops.nmf.use_moving_camera(first=1, last=7, count=3) == {"FINISHED"}
    assert [item.name for item in made()] == [name(7), name(9), name(11)]


def test_frames_in_which_the_camera_stands_still_are_left_out(film, camera):
    put_sequence_behind(camera, film, start=5)  # its last four pictures are after the last key
    bpy.ops.nmf.use_moving_camera()
    assert [item.name for item in made()] == [name(n) for n in range(7, 12)]


def test_pictures_that_are_missing_are_left_out(film, camera):
    put_sequence_behind(camera, film)
    film.with_stem(name(9)).unlink()
    bpy.ops.nmf.use_moving_camera()
    assert len(made()) == COUNT - 1


def test_a_camera_that_stands_still_and_a_film_that_is_gone_are_refused(film, camera, tmp_path):
    put_sequence_behind(camera, film)
    camera.parent = None
    with pytest.raises(RuntimeError, match="Walk, motion: the camera hardly moves"):
        bpy.ops.nmf.use_moving_camera()
    for path in film.parent.iterdir():
        path.unlink()
    with pytest.raises(RuntimeError, match="only 0 of the 9 pictures of the sequence"):
        bpy.ops.nmf.use_moving_camera()
    assert not (tmp_path / "nmf_jobs").exists() and len(bpy.data.cameras) == 1


def test_a_camera_without_a_film_has_no_button_and_a_film_is_no_photo(extension, film, camera, draw):
    assert ("operator", "nmf.use_moving_camera") not in draw("capture")[0]
    assert not bpy.ops.nmf.use_moving_camera.poll()
    put_sequence_behind(camera, film)
    assert ("operator", "nmf.use_moving_camera") in draw("capture")[0]
    assert extension("scene.capture_collection").active_capture(bpy.context) is None
    bpy.ops.nmf.use_moving_camera()
    assert f"{COUNT} photos with cameras" in draw("capture")[1]
    assert extension("scene.cameras").photo_of(camera) is None


def test_a_last_frame_before_the_first_is_refused(film, camera):
    put_sequence_behind(camera, film)
    with pytest.raises(RuntimeError, match="0 between the first and the last"):
        bpy.ops.nmf.use_moving_camera(first=5, last=4)


@pytest.mark.parametrize("start, offset, number", [(1, 6, 12), (4, 6, 9), (4, 8, 11)])
def test_the_picture_of_a_frame_is_the_one_that_blender_shows(
    extension, film, camera, start, offset, number
):
    background = put_sequence_behind(camera, film, start)
    background.image_user.frame_offset = offset
    bpy.context.scene.frame_set(6)
    bpy.context.view_layer.update()
    shot = extension("scene.shot").shot_of(camera, bpy.context.scene)
    assert shot.picture(6).name == f"{name(number)}.png"
    shown = background.image.filepath_from_user(image_user=background.image_user)
    assert Path(shown) == shot.picture(6)


def shown_by_blender(clip, frames, folder):
    """The grey of a movie clip's picture at frames of the scene, as Blender's compositor shows it."""
    scene = bpy.context.scene
    scene.camera = scene.camera or bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    if bpy.app.version < (5, 0, 0):
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        end = tree.nodes.new("CompositorNodeComposite")
    else:
        tree = scene.compositing_node_group = bpy.data.node_groups.new("c", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        end = tree.nodes.new("NodeGroupOutput")
    node = tree.nodes.new("CompositorNodeMovieClip")
    node.clip = clip
    tree.links.new(node.outputs[0], end.inputs[0])
    render = scene.render
    render.engine, scene.cycles.samples = "CYCLES", 1
    render.resolution_x, render.resolution_y = WIDTH, HEIGHT
    scene.view_settings.view_transform = "Standard"
    render.image_settings.file_format, render.filepath = "PNG", str(folder / "shown.png")
    for frame in frames:
        scene.frame_set(frame)
        bpy.ops.render.render(write_still=True)
        yield int(np.asarray(Image.open(render.filepath).convert("L"))[HEIGHT // 2, WIDTH // 2])


@pytest.mark.parametrize("start, offset", [(1, 0), (4, 3)])
def test_frames_of_a_video_are_numbered_as_blender_counts_them(extension, camera, tmp_path, start, offset):
    # As phones record: fewer frames at times.
    ticks = [0, 1, 2, 3, 6, 7, 8, 9, 15, 16, 17, 18, 19, 20, 21, 22]
    greys = [np.full((HEIGHT, WIDTH, 3), 20 + 12 * n, np.uint8) for n in range(len(ticks))]
    clip = put_clip_behind(camera, write_video(tmp_path / "walk.mp4", greys, ticks=ticks))
    clip.frame_start, clip.frame_offset = start, offset
    shot = extension("scene.shot").shot_of(camera, bpy.context.scene)
    assert shot.is_video and len(shot.frames) == ticks[-1] + 1
    ours = {frame.number: int(frame.pixels()[0, 0, 0]) for frame in frames_of(shot.file, True)}
    assert sorted(ours) == ticks
    wanted = [number for number in ticks if number >= offset]
    asked = [number - shot.offset for number in wanted]
    for number, shown in zip(wanted, shown_by_blender(clip, asked, tmp_path), strict=True):
        assert abs(shown - ours[number]) <= 3


def followed(clip, camera, markers):
    """The directions (x, y, at unit distance, y up) in which Blender's tracker sees markers."""
    tracks = [clip.tracking.tracks.new(name="mark", frame=1) for _ in markers]
    for track, marker in zip(tracks, markers, strict=True):
        track.markers.insert_frame(1, co=marker)
        target = bpy.data.objects.new(track.name, None)
        bpy.context.scene.collection.objects.link(target)
        target.location.z = -5
        constraint = target.constraints.new("FOLLOW_TRACK")
        constraint.clip, constraint.use_active_clip, constraint.camera = clip, False, camera
        constraint.track, constraint.use_undistorted_position = track.name, True
    bpy.context.scene.frame_set(1)
    graph = bpy.context.evaluated_depsgraph_get()
    for track in tracks:
        x, y, z = bpy.data.objects[track.name].evaluated_get(graph).matrix_world.translation
        yield np.array([x, y]) / -z


LENSES = {
    "POLYNOMIAL": {"k1": -0.2, "k2": 0.06, "k3": 0.02},
    "BROWN": {
        "brown_k1": -0.2, "brown_k2": 0.06, "brown_k3": -0.01, "brown_k4": 0.02, "brown_p1": 0.03,
        "brown_p2": -0.02,
    },
    "DIVISION": {"division_k1": 0.15},
    "DIVISION two": {"division_k1": 0.15, "division_k2": -0.03},
    "NUKE": {"nuke_k1": 0.06, "nuke_k2": 0.01},
}  # fmt: skip


@pytest.mark.parametrize("name", LENSES)
def test_the_lens_of_the_tracker_is_the_solvers(extension, tmp_path, name):
    size = 80  # square: what Blender's Follow Track does with a shifted centre is right there alone
    fake_capture.write_pixels(tmp_path / "a_1.png", np.zeros((size, size, 3)))
    clip = bpy.data.movieclips.load(str(tmp_path / "a_1.png"))
    lens = clip.tracking.camera
    lens.distortion_model = name.partition(" ")[0]
    lens.sensor_width, lens.focal_length = 36, 30
    for key, value in LENSES[name].items():
        setattr(lens, key, value)
    centre = np.array([44.0, 37.0])
    lens.principal_point_pixels = centre
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = size
    item = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(item)
    scene.camera = item
    item.data.sensor_width, item.data.lens = 36, 30
    item.data.shift_x, item.data.shift_y = (size / 2 - centre) / size
    ours = extension("scene.clip_lens").lens_of(clip)
    markers = ((0.95, 0.9), (0.1, 0.55), (0.6, 0.05))
    for marker, (x, y) in zip(markers, followed(clip, item, markers), strict=True):
        u, v = distort(*ours, np.array([[x, -y, 1.0]]))
        pixel = np.array(marker) * size
        focal = 30 / 36 * size
        np.testing.assert_allclose([centre[0] + focal * u[0], centre[1] - focal * v[0]], pixel, atol=0.03)
        assert np.hypot(*(centre + focal * np.array([x, y]) - pixel)) > 0.3, "the lens does nothing"


def test_the_lens_and_centre_of_a_clip_go_into_the_capture(extension, film, camera):
    clip = put_clip_behind(camera, film)
    clip.tracking.camera.k1 = -0.1
    clip.tracking.camera.pixel_aspect = 1.25
    camera.data.shift_x, camera.data.shift_y = 0.05, -0.02
    bpy.ops.nmf.use_moving_camera()
    cameras = extension("scene.cameras")
    found = cameras.to_solver(made()[2], Matrix.Identity(4))
    assert (found.lens, found.distortion) == ("opencv", pytest.approx((-0.1, 0, 0, 0, 0)))
    assert found.fx == pytest.approx(33 / camera.data.sensor_width * WIDTH)
    assert found.fy == pytest.approx(1.25 * found.fx)
    assert found.cx == pytest.approx(WIDTH / 2 - 0.05 * WIDTH, abs=1e-4)
    assert found.cy == pytest.approx(HEIGHT / 2 - 0.02 * WIDTH * 1.25, abs=1e-4)


@pytest.fixture
def video(extension, film, camera, monkeypatch):
    """A video behind the camera, for all that the extension sees; its size."""
    put_sequence_behind(camera, film)
    shot = extension("scene.shot")
    size = [80, 48]
    module = sys.modules["neural_microfacet_fields.operators.use_moving_camera"]
    monkeypatch.setattr(
        module, "shot_of",
        lambda item, scene: shot.Shot(film.with_name("a.mov"), True, range(2, 9), -2, tuple(size)),
    )  # fmt: skip
    return size


def test_photos_of_a_video_are_taken_by_the_solver_from_the_frames_that_were_asked_for(
    task, fake_solver, camera, video
):
    assert bpy.ops.nmf.use_moving_camera(first=4, last=20) == {"FINISHED"}
    task.finish()
    assert task.model.text == "3 photos extracted"
    assert [item.name for item in made()] == ["frame_000002", "frame_000004", "frame_000006"]
    data = made()[0].data
    assert data.lens * 36 / data.sensor_width == pytest.approx(34)


def test_a_video_that_is_stored_on_its_side_is_refused(task, fake_solver, camera, video):
    video.reverse()
    bpy.ops.nmf.use_moving_camera()
    task.finish()
    assert "80 × 48 pixels, but Blender says 48 × 80" in task.model.error


def test_a_camera_that_is_renamed_while_its_photos_are_taken_is_found(task, fake_solver, camera, video):
    bpy.ops.nmf.use_moving_camera(first=4, last=20)
    camera.name = "Hero"
    task.finish()
    assert task.model.text == "3 photos extracted" and len(made()) == 3


def test_a_camera_that_is_gone_when_its_photos_are_there_is_named(task, fake_solver, camera, video):
    bpy.ops.nmf.use_moving_camera()
    bpy.data.objects.remove(camera)
    task.finish()
    assert task.model.error.startswith("Walk: the camera or its footage is gone")


def test_a_capture_comes_to_the_scene_of_its_camera_while_another_is_looked_at(
    draw, task, fake_solver, camera, video
):
    mine, other = bpy.context.scene, bpy.data.scenes.new("Another")  # first by its name
    bpy.ops.nmf.use_moving_camera(first=4, last=20)
    bpy.context.window.scene = other
    task.finish()
    assert task.model.text == "3 photos extracted", task.model.error
    assert "3 photos extracted" in draw("capture")[1], "told wherever the person looks"
    assert other.nmf.capture is None and not other.collection.children
    capture = mine.nmf.capture
    assert capture in list(mine.collection.children) and bpy.context.scene == other
    places = {round(i.matrix_world.translation.x, 3) for i in capture.objects if i.type == "CAMERA"}
    assert len(places) == 3, "each stands where the moving one stood"
    assert mine.frame_current == 1
