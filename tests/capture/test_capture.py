"""Captures: rays, round trips, and a clear error for everything that can be wrong."""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture import frames
from solver.capture.camera import Camera
from solver.capture.errors import CaptureError, counted
from solver.capture.formats.transforms import write_transforms
from solver.capture.photos import linear_to_srgb, load_photo, load_photos, srgb_to_linear
from solver.capture.read import read_capture


def pose(angle, distance=4.0):
    back = np.array([math.cos(angle), math.sin(angle), 0.3])
    back /= np.linalg.norm(back)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, back * distance], 1)
    return matrix


def make_capture(folder, count=4, size=8, alpha=True, edit=None):
    folder.mkdir(parents=True, exist_ok=True)
    frames = []
    for i in range(count):
        pixels = np.full((size, size, 4 if alpha else 3), 128, np.uint8)
        if alpha:
            pixels[:2] = 0
        Image.fromarray(pixels).save(folder / f"r_{i}.png")
        frames.append({"file_path": f"./r_{i}", "transform_matrix": pose(i).tolist()})
    content = {"camera_angle_x": 0.7, "frames": frames}
    if edit is not None:
        edit(content)
    (folder / "transforms_train.json").write_text(json.dumps(content))
    return folder


def camera(**changes):
    values = dict(
        name="c", image_path=None, camera_to_world=pose(0.4), width=64, height=48, fx=70.0, fy=60.0,
        cx=30.0, cy=25.0,
    )  # fmt: skip
    return Camera(**{**values, **changes})


LENSES = [
    {},
    {"lens": "opencv", "distortion": (0.1, -0.05, 0.002, -0.001, 0.01)},
    {"lens": "opencv", "distortion": (0.3, -0.05, 0.002, -0.001, 0.01, 0.2, 0.03, 0.001)},
    {"lens": "opencv_fisheye", "distortion": (0.05, -0.01, 0.002, 0.001)},
]


@pytest.mark.parametrize("lens", LENSES)
def test_points_along_a_ray_project_to_its_pixel(lens):
    item = camera(**lens)
    pixels = np.random.default_rng(0).uniform((0, 0), (64, 48), (50, 2))
    origins, directions = item.rays(pixels[:, 0], pixels[:, 1])
    projected, depth = item.project(origins + 2.5 * directions)
    np.testing.assert_allclose(projected, pixels, atol=1e-6)
    assert (depth > 0).all()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


@pytest.mark.parametrize("lens", LENSES)
def test_points_fall_on_the_pixels_of_a_reduced_photo_that_their_projections_are_in(lens):
    item, (rows, columns) = camera(**lens), (12, 32)
    points = np.random.default_rng(1).uniform(-6, 6, (300, 3))
    at, inside, depths = item.pixels_of(points, (rows, columns))
    expected, seen = [], []
    for (x, y), depth in zip(*item.project(points), strict=True):
        if is_seen := depth > 0 and 0 <= x < item.width and 0 <= y < item.height:
            expected.append((int(y * rows / item.height), int(x * columns / item.width), depth))
        seen.append(is_seen)
    assert 0 < len(expected) < len(points)
    assert list(zip(*at, depths, strict=True)) == expected
    np.testing.assert_array_equal(inside, seen)
    np.testing.assert_array_equal(item.in_frame(points), seen)


def test_rays_of_a_pinhole_follow_the_stated_formula():
    item = camera()
    _, directions = item.rays(np.array([10.5]), np.array([40.5]))
    local = np.array([(10.5 - 30) / 70, -(40.5 - 25) / 60, -1.0])
    expected = item.camera_to_world[:3, :3] @ (local / np.linalg.norm(local))
    np.testing.assert_allclose(directions[0], expected)


def test_opencv_distortion_is_applied_as_opencv_defines_it():
    k1, k2, p1, p2, k3 = LENSES[1]["distortion"]
    item = camera(camera_to_world=np.eye(4), **LENSES[1])
    x, y = 0.2, -0.1  # OpenCV: y down, z forward
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    projected, _ = item.project(np.array([[x, -y, -1.0]]))
    np.testing.assert_allclose(projected[0], (xd * 70 + 30, yd * 60 + 25))


def test_beyond_the_fold_of_its_polynomial_a_lens_sees_nothing():
    # x(1 − ⅓x²) grows up to x = 1 and takes its values a second time beyond.
    item = camera(camera_to_world=np.eye(4), lens="opencv", distortion=(-1 / 3, 0, 0, 0, 0))
    inside, _ = item.project(np.array([[0.9, 0, -1]]))
    beyond, _ = item.project(np.array([[1.2, 0, -1]]))
    assert np.isfinite(inside).all() and np.isnan(beyond).all()
    column = item.cx + item.fx * np.array([0.5, 0.9])  # the largest image is at ⅔
    row = np.full(2, item.cy)
    assert item.lens_reaches(column, row).tolist() == [True, False]
    _, directions = item.rays(column, row)
    np.testing.assert_allclose(directions[1], np.array([1, 0, -1]) / math.sqrt(2), atol=1e-3)


def test_a_fisheye_sees_behind_itself():
    item = camera(camera_to_world=np.eye(4), lens="opencv_fisheye", distortion=(0.0,) * 4)
    angle = 1.9  # radians from the axis; the image radius of an undistorted fisheye is the angle
    pixel, depth = item.project(np.array([[math.sin(angle), 0, -math.cos(angle)]]))
    np.testing.assert_allclose(pixel[0], (item.cx + item.fx * angle, item.cy), atol=1e-9)
    assert depth[0] < 0


def test_conventions_of_opengl_and_opencv_are_half_a_turn_apart():
    matrix = pose(0.7)
    as_opencv = frames.pose_opencv_from_opengl(matrix)
    np.testing.assert_allclose(as_opencv[:3, 2], -matrix[:3, 2])
    np.testing.assert_allclose(frames.pose_opengl_from_opencv(as_opencv), matrix)
    np.testing.assert_allclose(frames.invert_pose(matrix) @ matrix, np.eye(4), atol=1e-12)
    point = np.array([[0.1, 0.2, -3.0]])
    np.testing.assert_allclose(frames.opencv_from_opengl(point), [[0.1, -0.2, 3.0]])


def test_equirect_directions_follow_blender():
    named = {(0.5, 0.5): (1, 0, 0), (0.25, 0.5): (0, 1, 0), (0.75, 0.5): (0, -1, 0)}
    for uv, direction in named.items():
        np.testing.assert_allclose(frames.direction_from_equirect(uv), direction, atol=1e-12)
        np.testing.assert_allclose(frames.equirect_from_direction(direction), uv)
    np.testing.assert_allclose(frames.direction_from_equirect((0.3, 0.0)), (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize("lens", LENSES)
def test_transforms_round_trip(tmp_path, lens):
    folder = make_capture(tmp_path / "photos ö 1")
    written = [
        camera(name=f"r_{i}", image_path=folder / f"r_{i}.png", camera_to_world=pose(i), width=8,
               height=8, **lens)
        for i in range(4)
    ]  # fmt: skip
    write_transforms(tmp_path / "job" / "transforms_train.json", written)
    read = read_capture(tmp_path / "job", trusted=True).cameras
    for a, b in zip(written, read, strict=True):
        np.testing.assert_allclose(a.camera_to_world, b.camera_to_world, atol=1e-12)
        assert (a.fx, a.fy, a.cx, a.cy, a.lens, a.name) == (b.fx, b.fy, b.cx, b.cy, b.lens, b.name)
        np.testing.assert_allclose(a.distortion or 0, b.distortion or 0)


def test_a_file_of_our_own_means_the_photos_it_names_whatever_lies_beside_it(tmp_path):
    folder = make_capture(tmp_path / "photos")
    cameras = read_capture(folder).cameras
    for name in ("sunset", "studio"):
        make_capture(tmp_path / "renders" / name)
    file = tmp_path / "renders" / "held_out.json"
    write_transforms(file, list(cameras))
    read = read_capture(file, trusted=True).cameras
    assert [c.image_path for c in read] == [c.image_path for c in cameras]
    with pytest.raises(CaptureError, match="could both be meant"):
        read_capture(file)


def test_the_region_lies_where_the_cameras_look(tmp_path):
    region = read_capture(make_capture(tmp_path)).region
    np.testing.assert_allclose(region.mean(0), 0, atol=1e-4)
    half = (region[1] - region[0]) / 2
    np.testing.assert_allclose(half, 4.0 * math.tan(0.35), rtol=1e-3)


def test_photos_are_linear_and_premultiplied(tmp_path):
    photo = load_photos(read_capture(make_capture(tmp_path)))[0]
    assert photo.has_alpha and not photo.is_hdr
    cover = 128 / 255
    np.testing.assert_allclose(photo.pixels[4, 4], [0.2158605 * cover] * 3 + [cover], atol=1e-5)
    assert (photo.pixels[0] == 0).all()


def test_srgb_round_trips():
    values = np.linspace(0, 3, 50)
    np.testing.assert_allclose(srgb_to_linear(linear_to_srgb(values)), values, atol=1e-9)


def test_jpeg_size_is_read_from_its_header(tmp_path):
    folder = make_capture(tmp_path, alpha=False)
    for i in range(4):
        Image.open(folder / f"r_{i}.png").resize((13, 7)).save(folder / f"r_{i}.jpg")
        (folder / f"r_{i}.png").unlink()
    item = read_capture(folder).cameras[0]
    assert (item.width, item.height) == (13, 7)
    assert load_photo(item).pixels.shape == (7, 13, 4)


def edited(change):
    return lambda content: change(content)


def set_pose(value):
    def change(content):
        content["frames"][1]["transform_matrix"] = value

    return change


SINGULAR = np.diag([1.0, 1.0, 0.0, 1.0]).tolist()
NAN = np.full((4, 4), np.nan).tolist()


@pytest.mark.parametrize(
    "change, field",
    [
        (lambda c: c.pop("camera_angle_x"), "camera_angle_x"),
        (lambda c: c.update(camera_angle_x="wide"), "camera_angle_x"),
        (lambda c: c.update(camera_angle_x=7.0), "camera_angle_x"),
        (lambda c: c.update(frames=[]), "frames"),
        (lambda c: c.update(frames=3), "frames"),
        (lambda c: c.update(w=0, h=0), "w"),
        (lambda c: c.update(camera_model="BANANA"), "camera_model"),
        (lambda c: c["frames"][1].pop("file_path"), "file_path"),
        (set_pose(SINGULAR), "transform_matrix"),
        (lambda c: [f.update(transform_matrix=NAN) for f in c["frames"]], "transform_matrix"),
        (set_pose([[1, 2], [3, 4]]), "transform_matrix"),
        (set_pose("up"), "transform_matrix"),
        (set_pose(np.diag([1.0, 1.0, -1.0, 1.0]).tolist()), "transform_matrix"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, change, field):
    folder = make_capture(tmp_path, edit=change)
    with pytest.raises(CaptureError) as caught:
        read_capture(folder)
    assert caught.value.file.name == "transforms_train.json"
    assert field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_json_cut_in_half_is_named_as_such(tmp_path):
    file = make_capture(tmp_path) / "transforms_train.json"
    file.write_text(file.read_text()[: len(file.read_text()) // 2])
    with pytest.raises(CaptureError, match="not valid JSON"):
        read_capture(tmp_path)


def test_the_folder_around_a_capture_stands_for_it_and_its_training_photos(tmp_path):
    (tmp_path / "lego" / "lego").mkdir(parents=True)
    make_capture(tmp_path / "lego" / "lego")
    cameras = tmp_path / "lego" / "lego" / "transforms_train.json"
    for split in ("relight", "test", "val"):
        shutil.copy(cameras, cameras.with_stem(f"transforms_{split}"))
    assert read_capture(tmp_path).source == cameras
    shutil.copytree(tmp_path / "lego" / "lego", tmp_path / "lego" / "ship")
    with pytest.raises(CaptureError, match=r"several captures \(lego, ship\); give the folder of"):
        read_capture(tmp_path / "lego")


def test_what_blender_wrote_beside_its_file_is_no_capture_of_the_project(tmp_path):
    for name in ("one", "two"):
        make_capture(tmp_path / "nmf_jobs" / name)
    with pytest.raises(CaptureError, match="no camera file"):
        read_capture(tmp_path)
    make_capture(tmp_path / "scan")
    assert read_capture(tmp_path).source.parent == tmp_path / "scan"
    assert read_capture(tmp_path / "nmf_jobs" / "one").source.parent.name == "one"


def test_of_a_folder_without_cameras_it_is_said_what_is_there_instead(tmp_path):
    make_capture(tmp_path / "scan")
    make_capture(tmp_path / "scan" / "train")
    (tmp_path / "scan" / "train" / "transforms_train.json").unlink()
    with pytest.raises(CaptureError, match="give .*scan, which has transforms_train.json"):
        read_capture(tmp_path / "scan" / "train")
    (tmp_path / "matched").mkdir()
    (tmp_path / "matched" / "database.db").write_bytes(b"SQLite format 3")
    with pytest.raises(CaptureError, match="database.db is COLMAP's list.*give its model"):
        read_capture(tmp_path / "matched")
    (tmp_path / "packed").mkdir()
    shutil.make_archive(str(tmp_path / "packed" / "scan"), "zip", tmp_path / "scan")
    with pytest.raises(CaptureError, match="give scan.zip itself"):
        read_capture(tmp_path / "packed")


def test_missing_and_empty_folders_are_named(tmp_path):
    with pytest.raises(CaptureError, match="no such file or folder"):
        read_capture(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(CaptureError, match="folder is empty"):
        read_capture(tmp_path / "empty")


def test_a_few_missing_photos_are_a_warning_and_many_an_error(tmp_path):
    folder = make_capture(tmp_path, count=8)
    (folder / "r_3.png").unlink()
    capture = read_capture(folder)
    assert len(capture.cameras) == 7 and "r_3" in capture.warnings[0]
    for i in (0, 1, 2, 4, 5):
        (folder / f"r_{i}.png").unlink()
    with pytest.raises(CaptureError, match="6 of 8 photos are missing"):
        read_capture(folder)


def test_a_photo_of_another_size_is_named(tmp_path):
    folder = make_capture(tmp_path, edit=lambda c: c.update(w=8, h=8))
    Image.new("RGBA", (13, 8), "red").save(folder / "r_2.png")
    with pytest.raises(CaptureError, match="13 × 8"):
        read_capture(folder)


def test_transparent_photos_are_named(tmp_path):
    folder = make_capture(tmp_path)
    Image.new("RGBA", (8, 8)).save(folder / "r_2.png")
    with pytest.raises(CaptureError, match="r_2.png.*fully transparent"):
        load_photos(read_capture(folder))


def test_a_broken_image_is_named(tmp_path):
    folder = make_capture(tmp_path, edit=lambda c: c.update(w=8, h=8))
    (folder / "r_1.png").write_bytes((folder / "r_1.png").read_bytes()[:40])
    with pytest.raises(CaptureError, match="r_1.png.*cannot be decoded"):
        load_photos(read_capture(folder))


def test_two_cameras_at_one_place_are_a_warning(tmp_path):
    folder = make_capture(tmp_path, edit=set_pose(pose(0).tolist()))
    assert any("same pose" in text for text in read_capture(folder).warnings)


def test_names_stay_unique(tmp_path):
    def change(content):
        (tmp_path / "b").mkdir()
        Image.open(tmp_path / "r_0.png").save(tmp_path / "b" / "r_0.png")
        content["frames"][1]["file_path"] = "b/r_0"

    names = [c.name for c in read_capture(make_capture(tmp_path, edit=change)).cameras]
    assert len(set(names)) == 4


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["frames", "camera_angle_x", "w", "k1", "camera_model", "frame"]),
    value=JSON,
)
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, key, value):
    def change(content):
        if key == "frame":
            content["frames"][0] = value
        else:
            content[key] = value

    folder = make_capture(tmp_path, edit=change)
    try:
        assert len(read_capture(folder).cameras) >= 3
    except CaptureError as error:
        assert str(error)


def test_cameras_are_read_without_the_packages_that_decode_photos():
    # Blender reads captures, and its Python has numpy alone.
    blocked = "OpenImageIO OpenEXR PIL imageio torch scipy skimage".split()
    code = f"import sys; sys.modules.update(dict.fromkeys({blocked})); import solver.capture.read"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


@pytest.mark.parametrize(
    "count, said",
    [
        (1, "1 of 12 photos has no pose and is left out"),
        (2, "2 of 12 photos have no pose and are left out"),
        (11, "11 of 12 photos have no pose and are left out"),
    ],
)
def test_the_words_of_a_warning_go_with_its_number(count, said):
    assert counted(f"{count} of 12 photos has|have no pose and is|are left out") == said
