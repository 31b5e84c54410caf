"""NeRO's pickled cameras: their projection, pickles of any age, and such as would do harm."""

import os
import pickle
import shutil
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.camera_folder import LARGEST_FILE
from solver.capture.errors import CaptureError
from solver.capture.formats import nero
from solver.capture.frames import pose_opencv_from_opengl
from solver.capture.pickled import matrices_in
from solver.capture.read import CAMERA_FILES, read_capture, reader_of
from tests.capture.layouts import DUCK, check_same_cameras, matrix_of
from tests.capture.programs import COUNT, HEIGHT, RANDOM_TESTS, WIDTH, outcome, poses, save_photos

LENS = 80.0, 82.0, 50.5, 30.25


def write(folder, given=None, lens=LENS, protocol=4, kind=np.float64):
    for index, pose in enumerate(poses() if given is None else given):
        to_camera = np.linalg.inv(pose)[:3].astype(kind)
        content = pickle.dumps([to_camera, matrix_of(*lens).astype(kind)], protocol)
        (folder / f"{index}-camera.pkl").write_bytes(content)
    return folder


def make(folder, count=COUNT, **options):
    for stem in range(count):
        save_photos(folder, [f"{stem}", f"{stem}-depth"], (WIDTH, HEIGHT))
    return write(folder, poses(count), **options)


@pytest.mark.parametrize("protocol", [2, 3, 4])
@pytest.mark.parametrize("kind", [np.float32, np.float64, ">f8"])
def test_points_project_where_the_file_has_them(tmp_path, protocol, kind):
    capture = read_capture(make(tmp_path, protocol=protocol, kind=kind))
    assert capture.format == "NeRO" and not capture.warnings
    assert [camera.image_path.name for camera in capture.cameras] == [f"{i}.png" for i in range(COUNT)]
    for camera, pose in zip(capture.cameras, poses(), strict=True):
        local = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 5), (20, 3))
        pixels, _ = camera.project(local @ pose[:3, :3].T + pose[:3, 3])
        wanted = local[:, :2] / local[:, 2:] * LENS[:2] + LENS[2:]
        np.testing.assert_allclose(pixels, wanted, atol=1e-3)


def test_a_capture_in_this_layout_has_the_cameras_of_its_transforms(tmp_path):
    original = read_capture(DUCK)
    first = original.cameras[0]
    for index, camera in enumerate(original.cameras):
        shutil.copy(camera.image_path, tmp_path / f"{index}.png")
    matrices = np.stack([camera.camera_to_world for camera in original.cameras])
    write(tmp_path, pose_opencv_from_opengl(matrices), (first.fx, first.fy, first.cx, first.cy))
    check_same_cameras(read_capture(tmp_path), original)


def test_any_of_the_files_stands_for_all_in_the_order_of_their_numbers(tmp_path):
    make(tmp_path / "bell", 12)
    for given_as in ("", "7-camera.pkl"):
        cameras = read_capture(tmp_path / "bell" / given_as).cameras
        assert [camera.name for camera in cameras] == [f"{number}" for number in range(12)]
    assert reader_of(tmp_path / "bell" / "7-camera.pkl") is nero and ".pkl" in CAMERA_FILES


def test_fortran_order_is_honoured(tmp_path):
    matrix = np.asfortranarray(np.arange(12.0).reshape(3, 4))
    (tmp_path / "a.pkl").write_bytes(pickle.dumps((matrix,)))
    np.testing.assert_array_equal(matrices_in(tmp_path / "a.pkl", LARGEST_FILE)[0], matrix)


def test_a_lost_camera_is_left_out(tmp_path):
    make(tmp_path)
    lost = [np.full((3, 4), np.nan), matrix_of(*LENS)]
    (tmp_path / "2-camera.pkl").write_bytes(pickle.dumps(lost))
    capture = read_capture(tmp_path)
    assert [camera.name for camera in capture.cameras] == ["0", "1", "3", "4"]
    assert "1 of 5 photos has no pose" in capture.warnings[0]


class Harmful:
    """Its pickle makes a folder when it is read as pickles are."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_what_a_pickle_would_do_is_not_done(tmp_path):
    content = pickle.dumps([Harmful(tmp_path / "made"), np.eye(3)])
    pickle.loads(content)
    (tmp_path / "made").rmdir()
    make(tmp_path)
    (tmp_path / "1-camera.pkl").write_bytes(content)
    with pytest.raises(CaptureError, match="1-camera.pkl: this is not a pickled list of matrices"):
        read_capture(tmp_path)
    assert not (tmp_path / "made").exists()


def laughing(depth=60):
    """A list of two lists that are one, of two lists that are one, …"""
    value = []
    for _ in range(depth):
        value = [value, value]
    return value


@pytest.mark.parametrize(
    "content, problem",
    [
        (pickle.dumps([np.eye(4)[:3]]), "this is not a pickled pair of a pose"),
        (pickle.dumps([np.eye(3), np.eye(4)[:3]]), "this is not a pickled pair of a pose"),
        (pickle.dumps([np.eye(4)[:3], np.zeros((3, 3))]), "lens: this is not a lens's matrix"),
        (pickle.dumps([np.zeros((3, 4)) + 1, np.eye(3)]), "pose: the pose's rotation is singular"),
        (pickle.dumps([np.array([[object()] * 4] * 3), np.eye(3)]), "this is not a pickled list"),
        (pickle.dumps({"pose": np.eye(4)}), "this is not a pickled list of matrices"),
        (pickle.dumps(laughing()), "this is not a pickled list of matrices"),
        (pickle.dumps([np.eye(4)[:3], np.eye(3)])[:-40], "this is not a pickled list of matrices"),
        (b"\x80\x04]r\xff\xff\xff\x7f.", "this is not a pickled pair"),  # kept under a huge number
        (b"\x80\x05\x96\xff\xff\xff\xff\xff\xff\x00\x00.", "this is not a pickled list"),  # huge bytes
        (b"\x80\x04)" + b"\x85" * 900_000 + b".", "this is not a pickled list"),  # tuples in tuples
        (b"\x80\x04" + b"(" * LARGEST_FILE, "it has more than 1 MB"),
    ],
)
def test_what_is_wrong_with_a_file_is_named_in_no_time(tmp_path, content, problem):
    make(tmp_path)
    (tmp_path / "1-camera.pkl").write_bytes(content)
    start = time.process_time()  # other work on the machine does not count
    with pytest.raises(CaptureError, match=rf"1-camera.pkl.*{problem}"):
        read_capture(tmp_path)
    assert time.process_time() - start < 5


@RANDOM_TESTS
@given(data=st.data())
def test_cut_and_changed_files_end_in_a_capture_or_an_error(tmp_path, data):
    make(tmp_path)
    file = tmp_path / f"{data.draw(st.integers(0, COUNT - 1))}-camera.pkl"
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content[: data.draw(st.integers(0, len(content)) | st.just(len(content)))])
    outcome(tmp_path)


@RANDOM_TESTS
@given(content=st.binary(max_size=200))
def test_any_pickled_bytes_end_in_an_error(tmp_path, content):
    make(tmp_path)
    (tmp_path / "0-camera.pkl").write_bytes(b"\x80\x04" + content)
    outcome(tmp_path)
