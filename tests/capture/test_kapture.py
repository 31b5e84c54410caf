"""Kapture's data sets as its specification has them: poses, rigs, lenses of COLMAP's, points, hostile files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import kapture
from solver.capture.read import read_capture, reader_of
from tests.capture.layouts import write
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    outcome,
    poses,
    save_photos,
    spoilt,
)

VERSION = "# kapture format: 1.1\n"
FX, FY, CX, CY, K1, K2, P1, P2 = 80.0, 82.0, 50.5, 30.25, -0.11, 0.04, 0.004, -0.007
LENS = f"OPENCV, {WIDTH}, {HEIGHT}, {FX}, {FY}, {CX}, {CY}, {K1}, {K2}, {P1}, {P2}"
TO_CAMERA = np.linalg.inv(poses())


def pose_words(matrix):
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    return ", ".join(map(repr, map(float, (w, x, y, z, *matrix[:3, 3]))))


def table(title, rows):
    return f"{VERSION}# {title}\n" + "".join(f"{row}\n" for row in rows)


def make(folder, lens=LENS, device="cam", matrices=TO_CAMERA, rigs=None):
    sensors = folder / "sensors"
    write(
        sensors / "sensors.txt",
        table(
            "sensor_device_id, name, sensor_type, [sensor_params]+",
            [f"cam, Hero7, camera, {lens}", "gps1, , gnss, EPSG:4326"],
        ),
    )
    write(
        sensors / "records_camera.txt",
        table(
            "timestamp, device_id, image_path",
            [f"{index}, cam, mapping/{name}.png" for index, name in enumerate(names())],
        ),
    )
    write(
        sensors / "trajectories.txt",
        table(
            "timestamp, device_id, qw, qx, qy, qz, tx, ty, tz",
            [f"{index}, {device}, {pose_words(matrix)}" for index, matrix in enumerate(matrices)],
        ),
    )
    if rigs is not None:
        write(sensors / "rigs.txt", table("rig_id, device_id, qw, qx, qy, qz, tx, ty, tz", rigs))
    save_photos(sensors / "records_data" / "mapping")
    return folder


def reference(index, point):
    """COLMAP's OPENCV camera, number by number."""
    x, y, z, _ = TO_CAMERA[index] @ [*point, 1]
    x, y = x / z, y / z
    r = x * x + y * y
    u = x * (1 + K1 * r + K2 * r * r) + 2 * P1 * x * y + P2 * (r + 2 * x * x)
    v = y * (1 + K1 * r + K2 * r * r) + 2 * P2 * x * y + P1 * (r + 2 * y * y)
    return FX * u + CX, FY * v + CY


@pytest.mark.parametrize(
    "given_as", ["", "sensors", "sensors/trajectories.txt", "sensors/sensors.txt", ".."]
)
def test_points_project_as_colmaps_cameras_see_them(tmp_path, given_as):
    folder = make(tmp_path / "sets" / "duck")
    points = np.random.default_rng(0).normal(size=(9, 3))
    rows = [f"{x}, {y}, {z}, 9, 9, 9" for x, y, z in points.tolist()]
    write(folder / "reconstruction" / "points3d.txt", table("X, Y, Z, R, G, B", rows))
    write(folder / "reconstruction" / "keypoints" / "sift" / "keypoints.txt", VERSION)
    capture = read_capture(folder / given_as)
    assert capture.format == "Kapture" and not capture.warnings and capture.up is None
    np.testing.assert_allclose(capture.points, points)
    check_projection(capture, reference, poses())


def test_cameras_of_rigs_in_rigs_stand_where_these_have_them(tmp_path):
    inner, outer = TO_CAMERA[1], TO_CAMERA[3]  # any two rigid motions
    of_rig = np.linalg.inv(inner @ outer) @ TO_CAMERA
    rigs = [f"car, head, {pose_words(outer)}", f"head, cam, {pose_words(inner)}"]
    check_projection(
        read_capture(make(tmp_path, device="car", matrices=of_rig, rigs=rigs)), reference, poses()
    )


def test_many_rigs_that_are_all_in_each_other_end(tmp_path):
    names_of_rigs = [f"rig{index}" for index in range(12)]
    still = pose_words(np.eye(4))
    rigs = [f"{a}, {b}, {still}" for a in names_of_rigs for b in names_of_rigs]
    rigs.append(f"rig0, cam, {still}")
    check_projection(read_capture(make(tmp_path / "known", device="rig11", rigs=rigs)), reference, poses())
    assert outcome(make(tmp_path / "unknown", device="car", rigs=rigs)) is None


def test_rigs_in_a_circle_and_empty_poses_are_no_pose(tmp_path):
    rigs = [
        f"a, b, {pose_words(np.eye(4))}",
        f"b, a, {pose_words(np.eye(4))}",
        f"a, cam, {pose_words(np.eye(4))}",
    ]
    with pytest.raises(CaptureError, match="none of its 5 photos has a pose; solve their cameras"):
        read_capture(make(tmp_path / "circle", device="car", rigs=rigs))
    folder = make(tmp_path / "empty")
    file = folder / "sensors" / "trajectories.txt"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:-1], f"{COUNT - 1}, cam, , , , , 1, 2, 3"]))
    capture = read_capture(folder)
    assert (
        "1 of 5 photos has no pose and is left out (the first: mapping/IMG_0004.png)" in capture.warnings[0]
    )


@pytest.mark.parametrize(
    "file, old, new, problem",
    [
        ("sensors.txt", "format: 1.1", "format: 2.0", "line 1: only version 1 of Kapture's format is supported"),
        ("sensors.txt", "OPENCV", "UNKNOWN_CAMERA", "the camera model 'UNKNOWN_CAMERA' is not supported"),
        ("sensors.txt", f", {P2}", "", "OPENCV has 8 parameters, not 7"),
        ("sensors.txt", "camera, OPENCV", "lidar, OPENCV", "is not a camera with a lens"),
        ("sensors.txt", "cam, Hero7", "cam2, Hero7", r"records_camera.txt, line 3: there is no sensor 'cam' in"),
        ("sensors.txt", "80.0", "80;0", "line 3: '80;0' is not a number"),
        ("records_camera.txt", "2, cam, ", "2; cam; ", "records_camera.txt, line 5: '2; cam; mapping/I.* breaks off"),
        ("trajectories.txt", "2, cam, ", "2, cam, 9, ", "trajectories.txt, line 5: .* is not 7 numbers"),
        ("trajectories.txt", "2, cam, ", "2, cam, 0, 0, 0, 0, 0, 0, 0\n9, cam, ", "line 5: its quaternion is not a rot"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_named(tmp_path, file, old, new, problem):
    folder = make(tmp_path)
    path = folder / "sensors" / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(CaptureError, match=problem):
        read_capture(folder)


@pytest.mark.parametrize("name", ["records_camera.txt", "trajectories.txt"])
def test_a_missing_table_is_named(tmp_path, name):
    folder = make(tmp_path)
    (folder / "sensors" / name).unlink()
    with pytest.raises(CaptureError, match=f"{name}: it cannot be read"):
        read_capture(folder)


def test_only_tables_beside_sensors_are_recognised(tmp_path):
    folder = make(tmp_path)
    assert reader_of(folder / "sensors" / "records_camera.txt") is kapture
    write(folder / "reconstruction" / "observations.txt", VERSION)
    assert reader_of(folder / "reconstruction" / "observations.txt") is None


@RANDOM_TESTS
@given(
    data=st.data(),
    name=st.sampled_from(["sensors.txt", "records_camera.txt", "trajectories.txt", "rigs.txt"]),
)
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data, name):
    folder = make(tmp_path, rigs=[f"car, cam, {pose_words(np.eye(4))}"])
    spoilt(data, folder / "sensors" / name, data.draw(st.sampled_from([" ", "\n", ", "])))
    outcome(folder)
