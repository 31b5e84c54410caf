"""transforms.json beyond its basics: lenses and masks of single frames, what is up, sparse points."""

import json
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.ply_points import MOST_POINTS, read_ply_points
from solver.capture.read import read_capture
from tests.capture.hostile import VALUES, reads_or_refuses
from tests.capture.test_capture import make_capture, pose

NERFSTUDIO = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]]


def capture_with(folder, **content):
    return read_capture(make_capture(folder, edit=lambda c: c.update(content)))


def test_each_frame_may_have_a_lens_and_a_mask_of_its_own(tmp_path):
    def change(content):
        content.update(fl_x=20.0, w=8, h=8, camera_model="OPENCV", k1=0.1)
        content["frames"][1].update(
            camera_model="OPENCV_FISHEYE", fl_x=9.0, fl_y=10.0, cx=3.0, cy=5.0, k1=0.02, k2=0.03
        )
        content["frames"][2].update(camera_model="PINHOLE", k1=0, mask_path="cut/two.png")

    folder = make_capture(tmp_path, edit=change)
    (folder / "cut").mkdir()
    Image.new("L", (8, 8), 255).save(folder / "cut" / "two.png")
    first, second, third, _ = read_capture(folder).cameras
    assert (first.lens, first.fx, first.fy, first.distortion) == (
        "opencv",
        20,
        20,
        (0.1, 0, 0, 0, 0),
    )
    assert (second.lens, second.fx, second.fy, second.cx) == ("opencv_fisheye", 9, 10, 3)
    assert second.distortion == (0.02, 0.03, 0, 0)
    assert third.lens == "pinhole" and third.mask_path == folder / "cut" / "two.png"
    assert first.mask_path is None


def test_a_frames_own_field_of_view_goes_before_the_files_focal_length_and_null_before_nothing(
    tmp_path,
):
    """As instant-ngp reads a frame after the file (`nerf_loader.cu`)."""

    def change(content):
        content.update(fl_x=20.0, fl_y=21.0, w=8, h=8, k1=0.1, camera_angle_y=0.3)
        content["frames"][0].update(camera_angle_x=math.radians(90))
        content["frames"][1].update(x_fov=90.0, k1=None)
        content["frames"][2].update(fl_x=None, k1=None, w=None)

    first, second, third, fourth = read_capture(make_capture(tmp_path, edit=change)).cameras
    assert first.fx == pytest.approx(4) and first.fy == pytest.approx(4)
    assert second.fx == pytest.approx(4) and second.distortion == first.distortion
    assert (third.fx, third.fy, third.width, third.distortion) == (20, 21, 8, fourth.distortion)


def test_neus2s_own_files_have_matrices_of_lenses_and_opencvs_axes(tmp_path):
    """Its README, "Data Convention": `from_na`."""
    plain = read_capture(make_capture(tmp_path / "plain"))

    def change(content):
        content.pop("camera_angle_x")
        content.update(from_na=True, w=8, h=8, scale=0.5, offset=[0.5, 0.5, 0.5])
        for frame in content["frames"]:
            pose = np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
            frame["transform_matrix"] = pose.tolist()
            frame["intrinsic_matrix"] = [
                [9, 0, 3.5, 0],
                [0, 10, 4.5, 0],
                [0, 0, 1, 0],
                [0, 0, 0, 1],
            ]

    capture = read_capture(make_capture(tmp_path / "neus2", edit=change))
    for camera, other in zip(capture.cameras, plain.cameras, strict=True):
        assert np.allclose(camera.camera_to_world, other.camera_to_world)
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (9, 10, 3.5, 4.5)
    assert not capture.warnings


@pytest.mark.parametrize("matrix", [[[1, 2], [3]], "1 0 0", [[9, 0, 4], [0, 9, 4], [0, 0, None]]])
def test_a_lens_matrix_that_is_none_is_named(tmp_path, matrix):
    with pytest.raises(CaptureError, match=r"frames\[0\].intrinsic_matrix: "):
        capture_with(
            tmp_path,
            frames=[
                {
                    "file_path": "./r_0",
                    "transform_matrix": pose(0).tolist(),
                    "intrinsic_matrix": matrix,
                }
            ],
        )


def test_the_foreground_masks_of_head_avatars_show_the_object(tmp_path):
    """As VHAP writes them and GaussianAvatars reads them, beside `file_path`."""

    def change(content):
        for index, frame in enumerate(content["frames"]):
            frame.update(timestep_index=0, camera_index=index)
            frame["fg_mask_path"] = f"fg_masks/00000_{index:02}.png"
        content["frames"][2]["mask_path"] = "cut/two.png"

    folder = make_capture(tmp_path, alpha=False, edit=change)
    masks = [f"fg_masks/00000_{index:02}.png" for index in range(4)]
    for name in (*masks, "cut/two.png"):
        (folder / name).parent.mkdir(exist_ok=True)
        Image.new("L", (8, 8), 255).save(folder / name)
    masks[2] = "cut/two.png"
    assert [c.mask_path for c in read_capture(folder).cameras] == [folder / name for name in masks]


def test_cameras_that_look_away_from_one_another_may_have_the_axes_of_opencv(tmp_path):
    """As scripts write that forget to turn them."""

    def turned(content):
        for frame in content["frames"]:
            matrix = np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
            frame["transform_matrix"] = matrix.tolist()

    said = "look away from one another; if transform_matrix has OpenCV's axes, negate its second"
    file = make_capture(tmp_path / "right") / "transforms_train.json"
    assert not read_capture(file).warnings
    file = make_capture(tmp_path / "turned", edit=turned) / "transforms_train.json"
    (warning,) = read_capture(file).warnings
    assert said in warning
    # Of cameras that this program wrote for itself there is no such file.
    assert not read_capture(file, trusted=True).warnings
    panoramas = make_capture(
        tmp_path / "all_around",
        edit=lambda c: (turned(c), c.update(camera_model="EQUIRECTANGULAR")),
    )
    assert not read_capture(panoramas).warnings


def test_one_mask_for_all_frames_hides_a_lenss_corners_and_is_no_object(tmp_path):
    """As nerfstudio writes them for `--percent-radius-crop`, fisheyes and Project Aria."""

    def mask(content):
        for frame in content["frames"]:
            frame["mask_path"] = "masks/mask.png"

    folder = make_capture(tmp_path / "all", edit=mask)
    (folder / "masks").mkdir()
    Image.new("L", (8, 8), 255).save(folder / "masks" / "mask.png")
    capture = read_capture(folder)
    assert not any(camera.mask_path for camera in capture.cameras)
    assert "all frames share one mask, mask.png" in capture.warnings[0]

    def one_less(content):
        mask(content)
        content["frames"][2].pop("mask_path")

    folder = make_capture(folder, edit=one_less)
    assert sum(camera.mask_path is not None for camera in read_capture(folder).cameras) == 3


def with_masks(folder, masks, edit=lambda content: None):
    """A capture whose frames name these masks, which are there."""

    def change(content):
        for frame, mask in zip(content["frames"], masks, strict=True):
            frame["mask_path"] = f"lens/{mask}.png"
        edit(content)

    make_capture(folder, len(masks), edit=change)
    (folder / "lens").mkdir()
    for mask in set(masks):
        Image.new("L", (8, 8), 255).save(folder / "lens" / f"{mask}.png")
    return folder


def masks_in(folder):
    return sum(camera.mask_path is not None for camera in read_capture(folder).cameras)


def test_one_mask_for_each_of_several_lenses_is_no_object_either(tmp_path):
    folder = with_masks(tmp_path / "rig", "ababab")
    capture = read_capture(folder)
    assert not any(camera.mask_path for camera in capture.cameras)
    assert "frames share 2 masks, such as a.png" in capture.warnings[0]
    (folder / "r_3.png").unlink()
    assert masks_in(folder) == 0
    assert masks_in(with_masks(tmp_path / "one is its own", "aabbc")) == 5

    def in_pairs(content):
        for i in (0, 2, 4):
            content["frames"][i + 1]["transform_matrix"] = content["frames"][i]["transform_matrix"]

    assert masks_in(with_masks(tmp_path / "views under two lights", "aabbcc", in_pairs)) == 6


def test_photos_that_are_missing_make_no_object_of_a_lenss_mask(tmp_path):
    folder = with_masks(tmp_path, "aaaaa")
    (folder / "r_1.png").unlink()
    assert masks_in(folder) == 0


NO_POSES = {
    "null": None, "NaN": np.full((4, 4), np.nan).tolist(), "zeros": np.zeros((4, 4)).tolist(),
    "nulls": [[None] * 4] * 3, "one infinity": [[1, 0, 0, math.inf], [0, 1, 0, 0], [0, 0, 1, 0]],
    "zeros above the last row": np.diag([0.0, 0, 0, 1]).tolist(),
}  # fmt: skip


@pytest.mark.parametrize("value", [*NO_POSES, "missing"])
def test_frames_without_a_pose_are_left_out_with_one_warning(tmp_path, value):
    def lose(frames):
        for frame in frames:
            frame.pop("transform_matrix")
            if value in NO_POSES:
                frame["transform_matrix"] = NO_POSES[value]

    some = make_capture(tmp_path / "some", 6, edit=lambda c: lose(c["frames"][1:3]))
    capture = read_capture(some)
    assert [camera.name for camera in capture.cameras] == ["r_0", "r_3", "r_4", "r_5"]
    assert len(capture.warnings) == 1
    assert "2 of 6 photos have no pose" in capture.warnings[0] and "r_1" in capture.warnings[0]
    every = make_capture(tmp_path / "all", edit=lambda c: lose(c["frames"]))
    with pytest.raises(CaptureError, match="transform_matrix: none of its 4 photos has a pose"):
        read_capture(every)


@pytest.mark.parametrize("value", [[], "", False, 0, [[math.nan]], [[0, 0], [0, 0]], {"a": 1}])
def test_what_is_no_matrix_is_an_error(tmp_path, value):
    with pytest.raises(CaptureError, match=r"frames\[1\].transform_matrix.*4 × 4"):
        read_capture(make_capture(tmp_path, edit=lambda c: c["frames"][1].update(transform_matrix=value)))


def test_where_only_some_frames_have_a_focal_length_the_first_without_one_is_named(tmp_path):
    own = [{"fl_x": 20.0}, {"camera_angle_x": 0.7}, {}, {"fl_x": None}]

    def change(content):
        content.pop("camera_angle_x")
        for frame, values in zip(content["frames"], own, strict=True):
            frame.update(values)

    with pytest.raises(CaptureError, match=r"frames\[2\].camera_angle_x: neither the frame nor"):
        read_capture(make_capture(tmp_path, edit=change))


@pytest.mark.parametrize("model", ["", None])
def test_a_model_that_is_empty_is_none(model, tmp_path):
    def change(content):
        content.update(camera_model="OPENCV_FISHEYE", k1=0.1)
        content["frames"][1].update(camera_model=model)

    assert read_capture(make_capture(tmp_path / "a", edit=change)).cameras[1].lens == "opencv_fisheye"
    assert capture_with(tmp_path / "b", camera_model=model, k1=0.1).cameras[1].lens == "opencv"


def test_what_only_trainers_need_is_ignored(tmp_path):
    plain = read_capture(make_capture(tmp_path / "a"))
    extra = capture_with(
        tmp_path / "b", aabb_scale=16, offset=[0.5, 0.5, 0.5], scale=0.33, enable_depth_loading=True,
        integer_depth_scale=0.001, applied_scale=0.2, applied_transform=NERFSTUDIO,
        orientation_override="none", train_filenames=[],
    )  # fmt: skip
    for a, b in zip(plain.cameras, extra.cameras, strict=True):
        np.testing.assert_array_equal(a.camera_to_world, b.camera_to_world)


def test_up_is_what_nerfstudio_turned_to_z_if_people_held_cameras_so(tmp_path):
    assert capture_with(tmp_path / "a").up.tolist() == [0, 0, 1]
    assert capture_with(tmp_path / "b", applied_transform=NERFSTUDIO).up.tolist() == [0, 0, 1]
    metashape = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]]
    assert capture_with(tmp_path / "d", applied_transform=metashape).up.tolist() == [0, 0, 1]
    assert capture_with(tmp_path / "e", applied_transform=np.eye(4).tolist()).up is None
    assert capture_with(tmp_path / "f", applied_transform="up").up.tolist() == [0, 0, 1]


@pytest.mark.parametrize("angle", [10, 40, 90, 170])
def test_up_is_how_cameras_are_held_where_nerfstudios_z_is_something_else(angle, tmp_path):
    """As from COLMAP's world where the first photo looks down, or where a program's up was not Z."""
    turn = np.radians(angle)
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]

    def tilted(content):
        content["applied_transform"] = NERFSTUDIO
        for i, frame in enumerate(content["frames"]):
            camera = level_camera(2 * np.pi * i / len(content["frames"]))
            frame["transform_matrix"] = (tilt @ camera).tolist()

    up = read_capture(make_capture(tmp_path, count=9, edit=tilted)).up
    held = tilt[:3, 2]
    wanted = held if angle > 20 else np.array([0.0, 0, 1])
    assert np.degrees(np.arccos(np.clip(up @ wanted, -1, 1))) < 1


X, Y, Z = np.eye(3)


@pytest.mark.parametrize("axis, turn", [(Y, 0), (Y, 8), (X, 0), (-Y, 40), (-Z, 5), (Z, 0), (Z, 30)])
def test_up_is_how_cameras_are_held_where_a_file_without_a_word_of_it_lies_on_its_side(
    axis, turn, tmp_path
):
    """ARKit's +Y, as NeRFCapture and nerfstudio's Record3D write it; a turned COLMAP's anything. Axes are
    meant as they are, and +Z is not given up for cameras that are only tilted."""
    to_axis = Rotation.align_vectors([axis], [Z])[0].as_matrix()
    tilt = np.eye(4)
    tilt[:3, :3] = to_axis @ Rotation.from_euler("x", turn, degrees=True).as_matrix()

    def lie(content):
        for i, frame in enumerate(content["frames"]):
            camera = level_camera(2 * np.pi * i / len(content["frames"]))
            frame["transform_matrix"] = (tilt @ camera).tolist()

    up = read_capture(make_capture(tmp_path, count=9, edit=lie)).up
    believed = turn <= 20 or (axis == Z).all()
    np.testing.assert_allclose(up, axis if believed else tilt[:3, 2], atol=0 if believed else 0.02)


def level_camera(angle):
    """Camera to world on a circle, looking a little down at its centre."""
    position = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.0])
    back = position / np.linalg.norm(position)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    pose[:3, 3] = position
    return pose


def test_numbers_may_be_texts_as_nerfstudio_writes_realitycaptures(tmp_path):
    first = capture_with(tmp_path, k1="-0.05", k2="0.01", fl_x="20").cameras[0]
    assert first.fx == 20 and first.distortion == (-0.05, 0.01, 0, 0, 0)


@pytest.mark.parametrize(
    ("values", "lens", "distortion"),
    [
        ({"camera_model": "PINHOLE", "k1": -0.2}, "opencv", (-0.2, 0, 0, 0, 0)),
        ({"camera_model": "OPENCV", "k4": 0.8}, "brown", (0, 0, 0, 0, 0, 0.8, 0, 0)),
        ({"k1": 0.1, "p2": 0.02, "k4": 0.3}, "brown", (0.1, 0, 0, 0.02, 0, 0.3, 0, 0)),
        ({"camera_model": "FULL_OPENCV", "k4": 0.3}, "opencv", (0, 0, 0, 0, 0, 0.3, 0, 0)),
        ({"camera_model": "SIMPLE_RADIAL_FISHEYE", "k1": 0.1}, "opencv_fisheye", (0.1, 0, 0, 0)),
    ],
)
def test_no_term_of_a_lens_is_dropped(values, lens, distortion, tmp_path):
    first = capture_with(tmp_path, **values).cameras[0]
    assert (first.lens, first.distortion) == (lens, distortion)


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        (
            "ftheta_p0",
            0.0,
            "ftheta_p0: f-theta lenses are not read; export the cameras with one of OpenCV's",
        ),
        (
            "equirectangular",
            True,
            r"equirectangular: panoramas of equal areas \(instant-ngp's equirectangular\) are not read; cut",
        ),
        ("orthographic", True, "orthographic: orthographic lenses are not read"),
        ("k6", 0.1, "k6: only the lens FULL_OPENCV has this coefficient; call its camera_model so"),
    ],
)
def test_lenses_of_instant_ngps_own_and_numbers_that_no_model_has_are_refused(
    tmp_path, key, value, problem
):
    with pytest.raises(CaptureError, match=rf"frames\[0\].{problem}"):
        capture_with(tmp_path, fl_x=20.0, k1=0.1, **{key: value})
    without = capture_with(tmp_path, fl_x=20.0, k1=0.1, **{key: False if value is True else None})
    assert without.cameras[0].lens == "opencv"


WIDE = {"camera_angle_x": None, "w": 8, "h": 8}
FIELD = 4 / math.tan(math.radians(25))


@pytest.mark.parametrize(
    ("values", "fx", "fy"),
    [
        ({"x_fov": 50.0}, FIELD, FIELD), ({"x_fov": 50.0, "y_fov": 90.0}, FIELD, 4.0),
        ({"y_fov": 50.0}, FIELD, FIELD), ({"fl_y": 9.0}, 9.0, 9.0), ({"x_fov": 50.0, "fl_x": 7.0}, 7.0, 7.0),
        ({"camera_angle_y": math.radians(50)}, FIELD, FIELD), ({"x_fov": 50.0, "fl_y": 9.0}, FIELD, 9.0),
    ],
)  # fmt: skip
def test_fields_of_view_may_be_in_degrees_and_of_either_side(tmp_path, values, fx, fy):
    """As `read_focal_length` of instant-ngp's nerf_loader.cu."""
    camera = capture_with(tmp_path, **{**WIDE, **values}).cameras[0]
    assert (camera.fx, camera.fy) == pytest.approx((fx, fy))


@pytest.mark.parametrize("degrees", [0, 180, -50, 400])
def test_what_is_no_field_of_view_is_refused(tmp_path, degrees):
    with pytest.raises(CaptureError, match="x_fov: .* is not a field of view; give 0 to 180 degrees"):
        capture_with(tmp_path, **WIDE, x_fov=degrees)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("given_as", ["folder", "file"])
def test_files_may_be_in_the_encodings_of_windows_shells(tmp_path, encoding, given_as):
    folder = make_capture(tmp_path)
    file = folder / "transforms_train.json"
    mark = "\ufeff" if encoding == "utf-16-le" else ""
    file.write_text(mark + file.read_text().replace("\n", "\r\n"), encoding, newline="")
    assert len(read_capture(folder if given_as == "folder" else file).cameras) == 4


LISTED = [0.1, 0.02, 0.003, 0, -0.004, 0.005]  # nerfstudio's order: k1 k2 k3 k4 p1 p2
POLYNOMIAL = ("opencv", (0.1, 0.02, -0.004, 0.005, 0.003))
FISHEYE = ("brown", (0.1, 0.02, -0.004, 0.005, 0.003, 0, 0, 1))


@pytest.mark.parametrize(
    ("values", "lens", "distortion"),
    [
        ({}, *POLYNOMIAL),
        ({"camera_model": "OPENCV", "k1": None}, *POLYNOMIAL),
        ({"camera_model": ""}, *POLYNOMIAL),
        ({"distortion_params": [0.1, 0, 0, 0.4, 0, 0]}, "brown", (0.1, 0, 0, 0, 0, 0.4, 0, 0)),
        ({"camera_model": "OPENCV_FISHEYE"}, *FISHEYE),
        ({"is_fisheye": True}, *FISHEYE),
        ({"k1": 0.5}, "opencv", (0.5, 0, 0, 0, 0)),
        ({"distortion_params": []}, "pinhole", ()),
        ({"distortion_params": [0] * 6}, "pinhole", ()),
    ],
)
@pytest.mark.parametrize("place", ["file", "frame"])
def test_nerfstudios_list_of_a_lens_counts_where_its_terms_have_no_names(
    values, lens, distortion, place, tmp_path
):
    def change(content):
        for target in [content] if place == "file" else content["frames"]:
            target.update({"distortion_params": LISTED, **values})

    for camera in read_capture(make_capture(tmp_path, edit=change)).cameras:
        assert (camera.lens, camera.distortion) == (lens, distortion)


def test_tangential_terms_of_a_fisheye_act_on_the_equidistant_picture(tmp_path):
    """As nerfstudio's rays: the pixel's polynomial is inverted first, then its length is the angle."""
    terms = dict(fl_x=5.0, cx=4.0, cy=4.0, k1=0.1, k2=0.02, k3=0.003, k4=-0.01, p1=-0.004, p2=0.005)
    camera = capture_with(tmp_path, camera_model="OPENCV_FISHEYE", **terms).cameras[0]
    for x, y in np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2)):
        r2, angle = x * x + y * y, math.hypot(x, y)
        radial = 1 + terms["k1"] * r2 + terms["k2"] * r2**2 + terms["k3"] * r2**3 + terms["k4"] * r2**4
        u = x * radial + 2 * terms["p1"] * x * y + terms["p2"] * (r2 + 2 * x * x)
        v = y * radial + 2 * terms["p2"] * x * y + terms["p1"] * (r2 + 2 * y * y)
        sine = math.sin(angle) / angle
        direction = camera.camera_to_world[:3, :3] @ (x * sine, -y * sine, -math.cos(angle))
        _, found = camera.rays(np.array([5 * u + 4]), np.array([5 * v + 4]))
        np.testing.assert_allclose(found[0], direction, atol=1e-9)


def test_a_fisheye_has_no_more_radial_terms(tmp_path):
    with pytest.raises(CaptureError, match=r"frames\[0\].k5: no fisheye has this coefficient"):
        capture_with(tmp_path, camera_model="OPENCV_FISHEYE", k5=0.1)


def test_project_arias_lens_has_twelve_numbers_in_its_list(tmp_path):
    listed = [0.4, -0.5, 0.3, 0.2, -0.1, 0.02, 1e-3, 2e-3, -1e-3, 3e-4, 4e-4, -5e-4]
    content = dict(camera_model="FISHEYE624", distortion_params=listed)
    for camera in capture_with(tmp_path / "a", **content).cameras:
        assert (camera.lens, camera.distortion) == ("rad_tan_thin_prism_fisheye", tuple(listed))
    with pytest.raises(CaptureError, match=r"frames\[0\].distortion_params"):
        capture_with(tmp_path / "b", **{**content, "distortion_params": listed[:6]})


@pytest.mark.parametrize("value", [[0.1] * 4, [0.1] * 5, [0.1] * 7, ["a"] * 6, [math.nan] * 6, {}, 0.1])
def test_a_list_of_a_lens_that_is_not_nerfstudios_six_numbers_is_named(value, tmp_path):
    with pytest.raises(CaptureError, match=r"frames\[0\].distortion_params"):
        capture_with(tmp_path, distortion_params=value)


def test_a_lens_without_a_size_is_for_the_photo_that_its_centre_tells_of(tmp_path):
    """Photos of 8 pixels, of which 16 were solved."""
    first = capture_with(tmp_path / "a", fl_x=24, cx=8.1, cy=7.9).cameras[0]
    assert (first.width, first.fx) == (8, pytest.approx(12))
    off_centre = capture_with(tmp_path / "b", fl_x=24, cx=4.5, cy=3.2).cameras[0]
    assert (off_centre.width, off_centre.fx, off_centre.cx) == (8, 24, 4.5)


POINTS = np.random.default_rng(0).normal(size=(150, 3)).astype(np.float32)


def ply(points, kind="binary_little_endian", count=None, before="", extra="property uchar red\n"):
    head = f"ply\nformat {kind} 1.0\ncomment made by hand\n{before}"
    head += f"element vertex {len(points) if count is None else count}\n"
    head += "property float x\nproperty float y\nproperty float z\n" + extra
    head += "element face 0\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        return head.encode() + "".join(f"{x} {y} {z} 7\n" for x, y, z in points.tolist()).encode()
    order = "<" if "little" in kind else ">"
    table = np.zeros(len(points), [("p", order + "f4", 3), ("red", "u1")])
    table["p"] = points
    return head.encode() + table.tobytes()


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_sparse_points_are_read_in_the_world_as_written(tmp_path, kind):
    (tmp_path / "sparse_pc.ply").write_bytes(ply(POINTS, kind))
    capture = capture_with(tmp_path, ply_file_path="sparse_pc.ply", applied_transform=NERFSTUDIO)
    np.testing.assert_allclose(capture.points, POINTS, rtol=1e-6)
    assert not capture.warnings


def test_lines_may_end_as_on_windows_and_names_may_repeat(tmp_path):
    text = ply(POINTS, "ascii").replace(b"\n", b"\r\n").replace(b"uchar red", b"uchar w")
    (tmp_path / "a.ply").write_bytes(text)
    np.testing.assert_allclose(read_ply_points(tmp_path / "a.ply"), POINTS, rtol=1e-6)


def test_many_points_are_thinned(tmp_path):
    points = np.zeros((MOST_POINTS + 1, 3), np.float32)
    points[:, 0] = np.arange(len(points))
    (tmp_path / "a.ply").write_bytes(ply(points))
    read = read_ply_points(tmp_path / "a.ply")
    assert len(read) == (MOST_POINTS + 2) // 2
    assert (read[0, 0], read[-1, 0]) == (0, MOST_POINTS)


@pytest.mark.parametrize(
    "content, problem",
    [
        (b"", "not a PLY"), (b"ply\nformat ascii 1.0\n", "not a PLY"), (b"\x89PNG" * 9, "not a PLY"),
        (ply(POINTS, count=10**11), "states 100000000000 points and has fewer"),
        (ply(POINTS, "ascii", count=10**11), "states 100000000000 points and has fewer"),
        (ply(POINTS, "ascii", count=151), "states 151 points and has fewer"),
        (ply(POINTS, count=10**30), "is not a count"), (ply(POINTS, count=-1), "is not a count"),
        (ply(POINTS)[:-1], "states 150 points and has fewer"),
        (ply(POINTS, "ascii").replace(b" 7", b" x"), "states 150 points and has fewer"),
        (ply(POINTS).replace(b"float y", b"float w"), "no x, y and z"),
        (ply(POINTS).replace(b"float y", b"float x"), "no x, y and z"),
        (ply(POINTS).replace(b"float y", b"matrix y"), "type is unknown"),
        (ply(POINTS).replace(b"uchar red", b"list uchar int red"), "hold lists"),
        (ply(POINTS, before="element camera 1\nproperty float q\n"), "not the first"),
        (ply(POINTS, "morse"), "no known format"),
        (ply(POINTS, extra="property double a\n" * 2000), "type is unknown"),
    ],
)  # fmt: skip
def test_points_that_cannot_be_read_are_named_and_cost_nothing(tmp_path, content, problem):
    (tmp_path / "a.ply").write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(CaptureError, match=f"a.ply.*{problem}"):
            read_ply_points(tmp_path / "a.ply")
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_unusable_points_are_a_warning(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "outside.ply").write_bytes(ply(POINTS))
    (tmp_path / "a" / "cut.ply").write_bytes(ply(POINTS)[:300])
    for stated, said in {
        "cut.ply": "has fewer", "none.ply": "do not exist", "../outside.ply": "do not exist",
        str(tmp_path / "outside.ply"): "do not exist", "x" * 5000: "",
    }.items():  # fmt: skip
        capture = capture_with(tmp_path / "a", ply_file_path=stated)
        assert capture.points is None and len(capture.warnings) == 1 and said in capture.warnings[0]
    assert capture_with(tmp_path / "a", ply_file_path=["a"]).points is None


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from(["ascii", "binary_little_endian"]), keep=st.floats(0, 1), at=st.floats(0, 1),
    patch=st.binary(max_size=8),
)  # fmt: skip
def test_damaged_points_end_in_points_or_an_error(tmp_path, kind, keep, at, patch):
    data = bytearray(ply(POINTS[:9], kind))
    data = data[: round(keep * len(data))]
    start = int(at * len(data))
    data[start : start + len(patch)] = patch
    (tmp_path / "a.ply").write_bytes(data)
    try:
        assert read_ply_points(tmp_path / "a.ply").shape[1] == 3
    except CaptureError as error:
        assert "\n" not in str(error)


KEYS = [
    "frames", "fl_x", "fl_y", "w", "h", "cx", "k1", "camera_model", "camera_angle_x", "is_fisheye",
    "applied_transform", "ply_file_path", "distortion_params",
]  # fmt: skip
KEYS_OF_FRAME = ["file_path", "transform_matrix", "mask_path", "fl_x", "w", "camera_model", "k2"]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(key=st.sampled_from(KEYS), frame_key=st.sampled_from(KEYS_OF_FRAME), value=VALUES, other=VALUES,
       keep=st.floats(0.5, 2))  # fmt: skip
def test_hostile_files_end_in_a_capture_or_an_error(tmp_path, key, frame_key, value, other, keep):
    def change(content):
        content["frames"][1][frame_key] = other
        content[key] = value

    file = make_capture(tmp_path, edit=change) / "transforms_train.json"
    file.write_text(file.read_text()[: int(keep * len(file.read_text()))])
    reads_or_refuses(tmp_path)


def test_poses_of_a_file_that_names_photos_elsewhere_find_nothing(tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "secret.png")
    folder = make_capture(tmp_path / "a")
    frames = [
        {"file_path": name, "transform_matrix": pose(i).tolist()}
        for i, name in enumerate(["../secret.png", str(tmp_path / "secret"), "../../etc/passwd", "r_0"])
    ]
    content = {"camera_angle_x": math.pi / 4, "frames": frames}
    (folder / "transforms_train.json").write_text(json.dumps(content))
    with pytest.raises(CaptureError, match="3 of 4 photos are missing"):
        read_capture(folder)


def test_of_nerfstudios_lists_only_what_is_for_training_is_read(tmp_path):
    capture = capture_with(tmp_path, train_filenames=["./r_0", "./r_1", "./r_3"], test_filenames=["./r_2"])
    assert [camera.name for camera in capture.cameras] == ["r_0", "r_1", "r_3"]
    (told,) = (text for text in capture.warnings if "train_filenames" in text)
    assert "1 photo for validation or tests left out" in told


@pytest.mark.parametrize("stated", [["r_0", r".\r_1", "./r_3"], ["./r_0"], ["x"] * 4, [], 5, {}, [1, None]])
def test_a_list_for_training_counts_however_its_paths_are_spelt_unless_it_is_none(tmp_path, stated):
    cameras = capture_with(tmp_path, train_filenames=stated).cameras
    assert len(cameras) == (3 if len(stated if isinstance(stated, list) else []) == 3 else 4)


@pytest.mark.parametrize("folder_told", ["./", "", "/data/hotdog/train/"])
def test_photos_of_synthetic4relight_are_read_from_their_layers(tmp_path, folder_told):
    def change(content):
        for i, frame in enumerate(content["frames"]):
            frame["file_path"] = f"{folder_told}r_{i}"

    folder = make_capture(tmp_path, edit=change)
    for i in range(4):
        photo = folder / f"r_{i}.png"
        Image.open(photo).getchannel("A").save(folder / f"r_{i}_mask.png")
        Image.open(photo).convert("RGB").save(folder / f"r_{i}_rgb.png")
        photo.unlink()
    for i, camera in enumerate(read_capture(folder).cameras):
        assert camera.image_path == folder / f"r_{i}_rgb.png"
        assert camera.mask_path == folder / f"r_{i}_mask.png"
