"""Stray Scanner's recordings: axes as the app turns them, lenses, which picture is which frame, hostile files."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import stray_scanner
from solver.capture.read import read_capture, reader_of
from tests.capture.poses import look_at
from tests.capture.programs import (
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    outcome,
    save_photos,
    seen_points,
    spoilt,
)

FX, FY, CX, CY = 80.0, 82.0, 50.5, 30.25
FRAMES = 24
OLD = "timestamp, frame, x, y, z, qx, qy, qz, qw"
NEW = f"{OLD}, fx, fy, cx, cy, distortion_center_x, distortion_center_y"
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def arkit_poses(count=FRAMES):
    """`ARCamera.transform`: camera to world with OpenGL's camera axes, +Y up."""
    angles = 2 * np.pi * np.arange(count) / count
    return [Y_UP @ look_at((2 * np.cos(a), 2 * np.sin(a), 0.7), roll=np.pi / 2) for a in angles]


def odometry(header=OLD, tail=lambda index: ""):
    """As OdometryEncoder writes it: the camera's rotation times half a turn about its X."""
    lines = [header]
    for index, pose in enumerate(arkit_poses()):
        turned = Rotation.from_matrix(pose[:3, :3]) * Rotation.from_quat([1, 0, 0, 0])
        values = [*pose[:3, 3], *turned.as_quat()]
        lines.append(f"{1000 + index / 60}, {index:06d}, {', '.join(map(str, values))}{tail(index)}")
    return "\n".join(lines) + "\n"


def make(folder, numbers=range(FRAMES), text=None, photos="rgb", size=(WIDTH, HEIGHT), form="{:06d}"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "odometry.csv").write_text(odometry() if text is None else text)
    (folder / "camera_matrix.csv").write_text(f"{FX}, 0.0, {CX}\n0.0, {FY}, {CY}\n0.0, 0.0, 1.0")
    (folder / "imu.csv").write_text("timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z\n")
    save_photos(folder / "depth", [f"{index:06d}" for index in range(FRAMES)], (32, 24))
    (folder / "rgb.mp4").write_bytes(b"\0\0\0\x18ftypmp42")
    if numbers:
        save_photos(folder / photos, [form.format(number) for number in numbers], size)
    return folder


def check(capture, first=0, lens=lambda index: (FX, FY, CX, CY)):
    """Pixels by ARKit's axes: +Y of the camera is up, and it looks along −Z."""
    for camera in capture.cameras:
        index = int(re.search(r"\d+$", camera.image_path.stem)[0]) - first
        pose = arkit_poses()[index]
        points = seen_points(pose @ np.diag([1.0, -1, -1, 1]), seed=index)
        x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
        fx, fy, cx, cy = lens(index)
        pixels, _ = camera.project(points)
        np.testing.assert_allclose(pixels, np.stack([cx - fx * x / z, cy + fy * y / z], 1), atol=1e-4)


@pytest.mark.parametrize("given_as", ["", "scans", "scans/71de12f9", "scans/71de12f9/odometry.csv"])
def test_points_project_as_arkits_cameras_see_them(tmp_path, given_as):
    make(tmp_path / "scans" / "71de12f9")
    capture = read_capture(tmp_path / given_as)
    assert capture.format == "Stray Scanner" and not capture.warnings and capture.metric
    assert len(capture.cameras) == FRAMES and capture.up.tolist() == [0, 1, 0]
    check(capture)


def test_newer_recordings_have_a_lens_for_each_frame(tmp_path):
    def lens(index):
        return FX + index, FY - index, CX, CY + index / 8

    text = odometry(NEW, lambda index: f", {', '.join(map(str, lens(index)))}, , ")
    folder = make(tmp_path, text=text)
    (folder / "camera_matrix.csv").unlink()
    check(read_capture(folder), lens=lens)


@pytest.mark.parametrize(
    "numbers, first, form",
    [
        (range(FRAMES), 0, "frame_{:05d}"), (range(1, FRAMES + 1), 1, "{:04d}"),
        (range(FRAMES - 2), 0, "{}"), (range(FRAMES + 1), 0, "{:06d}"), (range(0, FRAMES, 3), 0, "{:06d}"),
        ([0, 1, 2, 3, 7, 23], 0, "{:06d}"),
    ],
)  # fmt: skip
def test_pictures_are_frames_where_their_numbers_say_which(tmp_path, numbers, first, form):
    capture = read_capture(make(tmp_path, numbers, photos="frames", form=form))
    assert len(capture.cameras) == min(len(numbers), FRAMES)
    check(capture, first)


@pytest.mark.parametrize(
    "numbers",
    [range(1, 11), range(10), range(1, FRAMES), range(1, FRAMES, 2), [0, 5, 99], [*range(FRAMES), *range(30, 99)]],
)  # fmt: skip
def test_other_numbers_are_refused(tmp_path, numbers):
    with pytest.raises(
        CaptureError, match=r"rgb, photos: its \d+ numbered pictures may be any of 24 frames; ex"
    ):
        read_capture(make(tmp_path, numbers))


def renumbered(number_of):
    """The table with other numbers of frames, in the same order."""
    return re.sub(r"(?<=, )\d{6}(?=, )", lambda match: f"{number_of(int(match[0])):06d}", odometry())


@pytest.mark.parametrize("number_of", [lambda i: 2 * i, lambda i: i + 5, lambda i: i + (i > 7)])
def test_pictures_in_a_run_are_no_frames_whose_numbers_are_in_none_or_begin_elsewhere(tmp_path, number_of):
    with pytest.raises(
        CaptureError,
        match=f"24 numbered pictures may be any of 24 frames.*-start_number {number_of(0)} ",
    ):
        read_capture(make(tmp_path, text=renumbered(number_of)))
    numbers = [number_of(index) for index in range(FRAMES)]
    capture = read_capture(
        make(tmp_path, numbers, photos="images", text=renumbered(number_of)),
        photos=tmp_path / "images",
    )
    for camera in capture.cameras:
        index = numbers.index(int(camera.image_path.stem))
        np.testing.assert_allclose(camera.position, arkit_poses()[index][:3, 3])


def test_a_recording_without_pictures_says_how_to_get_them(tmp_path):
    with pytest.raises(
        CaptureError, match=r"photos are in its video; extract all .* -start_number 0 rgb/%06d"
    ):
        read_capture(make(tmp_path, []))


def test_pictures_elsewhere_may_be_given(tmp_path):
    make(tmp_path / "scan", photos="rgb")
    (tmp_path / "scan" / "rgb").rename(tmp_path / "pictures")
    check(read_capture(tmp_path / "scan", photos=tmp_path / "pictures"))


@pytest.mark.parametrize("size", [(HEIGHT, WIDTH), (WIDTH // 2, HEIGHT // 2)])
def test_pictures_that_were_turned_or_made_smaller_are_refused(tmp_path, size):
    message = f"of {size[0]} × {size[1]} pixels, was turned or scaled down.*; extract all its frames"
    with pytest.raises(CaptureError, match=message):
        read_capture(make(tmp_path, size=size))


@pytest.mark.parametrize(
    "old, new, problem",
    [
        ("000002", "000001", "line 4: '000001' is not a new frame"),
        ("000002", "two", "line 4: 'two' is not a new frame"),
        (", 000002, ", ", 000002, nan, ", "line 4, x: 'nan' is not a number"),
        (", 000002, ", ", 000002, 1, 1, 1, 0, 0, 0, 0, ", "line 4: its quaternion is not a rotation"),
        (", 000002, ", ", 000002;", "line 4: '000002;"),
    ],
)
def test_what_is_wrong_with_a_line_is_named(tmp_path, old, new, problem):
    with pytest.raises(CaptureError, match=problem):
        read_capture(make(tmp_path, text=odometry().replace(old, new)))


def test_a_table_of_distortion_is_refused(tmp_path):
    text = odometry(NEW, lambda index: f", {FX}, {FY}, {CX}, {CY}, 50.1, 30.2")
    with pytest.raises(
        CaptureError, match="line 2, distortion_center_x: its lens has a table of distortion"
    ):
        read_capture(make(tmp_path, text=text))


def test_a_missing_or_damaged_matrix_is_named(tmp_path):
    folder = make(tmp_path)
    (folder / "camera_matrix.csv").write_text("1, 2\n3, 4\n")
    with pytest.raises(CaptureError, match="camera_matrix.csv: '1 2 3 4' is not 9 numbers"):
        read_capture(folder)
    (folder / "camera_matrix.csv").unlink()
    with pytest.raises(CaptureError, match="camera_matrix.csv: it cannot be read"):
        read_capture(folder)


def test_only_its_odometry_is_recognised(tmp_path):
    folder = make(tmp_path)
    assert reader_of(folder / "odometry.csv") is stray_scanner
    assert reader_of(folder / "imu.csv") is None and reader_of(folder / "camera_matrix.csv") is None


@RANDOM_TESTS
@given(data=st.data(), name=st.sampled_from(["odometry.csv", "camera_matrix.csv"]))
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data, name):
    folder = make(tmp_path)
    spoilt(data, folder / name, data.draw(st.sampled_from([" ", "\n", ","])))
    outcome(folder)
