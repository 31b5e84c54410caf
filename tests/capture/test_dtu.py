"""DTU's own calibration: its projections, a matrix it publishes, lights, scans of fewer places, hostile files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import dtu
from solver.capture.pinhole import of_projection
from solver.capture.read import CAMERA_FILES, read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    RANDOM_TESTS,
    names,
    numbers,
    outcome,
    poses,
    save_photos,
    seen_points,
    spoilt,
)

SMALLER = 10
SIZE = 1600 // SMALLER, 1200 // SMALLER
K = np.array([[2892.33, 0, 823.205], [0, 2883.175, 619.071], [0, 0, 1]])
CAL, SCAN = "Calibration/cal18", "Rectified/scan1"
POS_001 = """2607.429996 -3.844898 1498.178098 -533936.661373
-192.076910 2862.552532 681.798177 23434.686572
-0.241605 -0.030951 0.969881 22.540121
"""
"""as DTU publishes it"""
MVSNETS = (
    [[0.970263, 0.00747983, 0.241939, -191.02], [-0.0147429, 0.999493, 0.0282234, 3.28832],
     [-0.241605, -0.030951, 0.969881, 22.5401]],
    (2892.33, 2883.175, 823.205, 619.071),
)  # fmt: skip
"""extrinsic and intrinsic (eight times those for networks) of the same place, as MVSNet publishes them"""


def projection(pose):
    return K @ np.linalg.inv(pose)[:3]


def matrices(count=COUNT):
    return [projection(pose) for pose in poses(count)]


def write_matrices(folder, all_of_them):
    folder.mkdir(parents=True, exist_ok=True)
    for index, matrix in enumerate(all_of_them):
        lines = "\n".join(numbers(row) for row in matrix)
        (folder / f"pos_{index + 1:03d}.txt").write_text(lines + "\n")


def called(light="3_r5000", kind="rect", count=COUNT):
    return [f"{kind}_{index + 1:03d}_{light}" for index in range(count)]


def make(folder, stems=None, scan=SCAN, cal=CAL, size=SIZE, count=COUNT):
    write_matrices(folder / cal, matrices(count))
    save_photos(folder / scan, called() if stems is None else stems, size)
    return folder


def taken(capture):
    return [camera.image_path.stem for camera in capture.cameras]


def test_points_project_where_the_matrices_have_them(tmp_path):
    capture = read_capture(make(tmp_path))
    assert capture.format == "DTU" and not capture.metric and len(capture.cameras) == COUNT
    for index, camera in enumerate(capture.cameras):
        assert camera.image_path.stem == called()[index]
        points = seen_points(poses()[index], spread=0.2)
        pixels, depth = camera.project(points)
        assert (depth > 0).all()
        for point, pixel in zip(points, pixels, strict=True):
            a, b, c = matrices()[index] @ [*point, 1]
            # Their whole numbers are pixels' centres, and the photos here are smaller than DTU's.
            wanted = (a / c + 0.5) / SMALLER, (b / c + 0.5) / SMALLER
            np.testing.assert_allclose(pixel, wanted, atol=1e-6)


def test_a_matrix_that_dtu_publishes_is_the_camera_that_mvsnet_makes_of_it(tmp_path):
    make(tmp_path)
    (tmp_path / CAL / "pos_001.txt").write_text(POS_001)
    camera = read_capture(tmp_path).cameras[0]
    extrinsic, (fx, fy, cx, cy) = MVSNETS
    lens = np.array([fx, fy, cx + 0.5, cy + 0.5]) / SMALLER
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], lens, atol=1e-3)
    to_world = camera.camera_to_world * [1, -1, -1, 1]
    np.testing.assert_allclose(np.linalg.inv(to_world)[:3, :3], np.array(extrinsic)[:, :3], atol=1e-4)
    np.testing.assert_allclose(np.linalg.inv(to_world)[:3, 3], np.array(extrinsic)[:, 3], atol=1e-2)


@given(
    scale=st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3),
    fx=st.floats(20, 5000), fy=st.floats(20, 5000), cx=st.floats(1, 3000), cy=st.floats(1, 3000),
    seed=st.integers(0, 1000),
)  # fmt: skip
def test_a_projection_of_any_scale_and_sign_is_taken_apart(tmp_path_factory, scale, fx, fy, cx, cy, seed):
    pose = poses(1, seed)[0]
    whole = scale * np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) @ np.linalg.inv(pose)[:3]
    lens, to_world = of_projection(None, "", whole)
    np.testing.assert_allclose(lens, (fx, fy, cx, cy), rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(to_world, pose, atol=1e-6)


@pytest.mark.parametrize("given_as", ["", CAL, f"{CAL}/pos_003.txt", ".."])
def test_the_data_set_its_calibration_or_any_matrix_stands_for_all(tmp_path, given_as):
    folder = make(tmp_path / "SampleSet" / "MVS Data")
    assert taken(read_capture(folder / given_as)) == called()


def test_of_several_scans_one_is_to_be_named(tmp_path):
    make(tmp_path)
    save_photos(tmp_path / "Rectified" / "scan6", called(), SIZE)
    with pytest.raises(CaptureError, match="could both be meant.*give the folder of the photos"):
        read_capture(tmp_path)
    capture = read_capture(tmp_path, photos=tmp_path / "Rectified" / "scan6")
    assert {camera.image_path.parent.name for camera in capture.cameras} == {"scan6"}


def test_who_gives_a_scan_is_told_where_its_cameras_are(tmp_path):
    make(tmp_path)
    with pytest.raises(CaptureError, match="give .*Calibration.cal18, and this folder as the photos'"):
        read_capture(tmp_path / SCAN)
    assert len(read_capture(tmp_path / CAL, photos=tmp_path / SCAN).cameras) == COUNT


@pytest.mark.parametrize(
    "there, expected",
    [
        ([called(light) for light in ("0_r5000", "3_r5000", "max")], called()),
        ([called("max"), called("0_r5000")], called("max")),
        ([called("6_r5000"), called("2_r5000")], called("2_r5000")),
        ([called(kind="clean"), called()], called()),
        ([called(kind="clean"), called("max")], called(kind="clean")),
        ([called()[:1], called("max")], called("max")),
        ([called("max")[:3], called()[3:]], called("max")[:3]),
    ],
)
def test_all_photos_are_of_one_light(tmp_path, there, expected):
    folder = make(tmp_path, [stem for stems in there for stem in stems])
    assert taken(read_capture(folder)) == expected


def test_places_without_photos_are_no_fault(tmp_path):
    capture = read_capture(make(tmp_path, called(count=4), count=12))
    assert taken(capture) == called(count=4)
    assert not any("photos" in warning and "exist" in warning for warning in capture.warnings)
    (tmp_path / SCAN / f"{called()[3]}.png").unlink()
    (tmp_path / SCAN / f"{called()[2]}.png").unlink()
    with pytest.raises(CaptureError, match="10 of 12 photos are missing, the first is 'rect_003_3"):
        read_capture(tmp_path)


def test_photos_that_were_cut_for_networks_are_refused(tmp_path):
    folder = make(tmp_path, scan="Rectified/scan1_train", size=(640, 512))
    with pytest.raises(CaptureError, match=r"640 × 512 pixels, but pos_001.txt says 1600 × 1200"):
        read_capture(folder)


def test_photos_of_the_size_of_the_data_set_are_taken_as_they_are(tmp_path):
    capture = read_capture(make(tmp_path, size=(1600, 1200)))
    assert not capture.warnings
    assert (capture.cameras[0].cx, capture.cameras[0].cy) == pytest.approx((823.705, 619.571))


def test_cameras_of_pictures_that_are_to_be_made_need_no_photos(tmp_path):
    make(tmp_path, [])
    cameras = read_capture(tmp_path, wanted=False).cameras
    assert len(cameras) == COUNT and (cameras[0].width, cameras[0].height) == (1600, 1200)


def test_only_projections_to_pixels_are_recognised(tmp_path):
    make(tmp_path)
    file = tmp_path / CAL / "pos_002.txt"
    assert reader_of(file) is dtu and ".txt" in CAMERA_FILES
    text = file.read_text()
    for other in (
        "",
        "CONTOUR\n" + text,
        text + "1 2 3 4\n",
        text.replace("\n", " "),
        text[:60],
        "\0" * 99,
    ):
        (tmp_path / "other_001.txt").write_text(other)
        assert reader_of(tmp_path / "other_001.txt") is not dtu
    pose = "\n".join(numbers(row) for row in poses()[0][:3])
    (tmp_path / "pose_001.txt").write_text(pose)
    assert reader_of(tmp_path / "pose_001.txt") is not dtu
    (tmp_path / "matrix.txt").write_text(text)
    assert reader_of(tmp_path / "matrix.txt") is not dtu


@pytest.mark.parametrize(
    "text, problem",
    [
        ("1 2 3\n", "this is not a 3 × 4 matrix"),
        ("a " * 12, "this is not a 3 × 4 matrix"),
        ("0 " * 12, "this is not a projection"),
        ("nan " * 12, "this is not a projection"),
        ("1 2 3 4 " * 3, "this is not a projection"),
        ("100 60 50 0 0 100 50 0 0 0 1 0", "its pixels are not rectangles"),
        ("100 0 50 inf 0 100 50 0 0 0 1 0", "the pose holds a value that is not a number"),
    ],
)
def test_what_is_wrong_with_a_matrix_is_named(tmp_path, text, problem):
    make(tmp_path)
    (tmp_path / CAL / "pos_002.txt").write_text(text)
    with pytest.raises(CaptureError, match=rf"pos_00.\.txt.*{problem}"):
        read_capture(tmp_path)


def test_other_files_beside_the_matrices_do_not_count(tmp_path):
    make(tmp_path)
    (tmp_path / CAL / "Calib_Results.txt").write_text("fc = [ 2892 ; 2883 ];")
    (tmp_path / CAL / "._pos_001.txt").write_bytes(b"\0\5\x16\7")
    write_matrices(tmp_path / CAL / "pos_old", matrices())
    assert len(read_capture(tmp_path).cameras) == COUNT


def test_photos_of_other_names_are_not_guessed(tmp_path):
    with pytest.raises(CaptureError, match="the first is 'rect_001_3_r5000'"):
        read_capture(make(tmp_path, names()))


@RANDOM_TESTS
@given(data=st.data())
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data):
    folder = make(tmp_path)
    spoilt(data, folder / CAL / f"pos_{data.draw(st.integers(1, COUNT)):03d}.txt", " ")
    outcome(folder)


@RANDOM_TESTS
@given(content=st.binary(max_size=300))
def test_any_bytes_end_in_an_error(tmp_path, content):
    folder = make(tmp_path)
    (folder / CAL / "pos_002.txt").write_bytes(content)
    assert outcome(folder) is None
