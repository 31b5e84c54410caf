"""COLMAP models that are incomplete, impossible, cut, shuffled or hostile."""

import struct
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import colmap
from solver.capture.read import read_capture
from tests.capture.colmap_models import PARAMETERS, WRITERS, without_poses, write


@pytest.mark.parametrize("missing", [1, 8, 50, 51, 60])
def test_damaged_points_are_left_out_with_a_warning(tmp_path, solved, missing):
    file = write(solved(tmp_path / "images"), tmp_path / "sparse") / "points3D.bin"
    file.write_bytes(file.read_bytes()[:-missing])
    capture = read_capture(tmp_path)
    assert capture.points is None and "points3D.bin" in capture.warnings[0]


def test_a_missing_cameras_file_is_named(tmp_path, solved):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    (folder / "cameras.bin").unlink()
    with pytest.raises(CaptureError, match="no cameras.bin beside it"):
        read_capture(tmp_path)


def test_a_photo_whose_camera_is_missing_is_named(tmp_path, solved):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse", "txt")
    text = (folder / "cameras.txt").read_text()
    (folder / "cameras.txt").write_text(text.replace("1 PINHOLE", "7 PINHOLE"))
    with pytest.raises(CaptureError, match="there is no camera 1"):
        read_capture(tmp_path)


@pytest.mark.parametrize(
    "change, told",
    [
        (("1 PINHOLE", "1 BANANA"), "'BANANA' is not supported"),
        (("70 60", "70"), "4 parameters, not 3"),
        (("70 60", "70 inf"), "not a number"),
        (("70 60", "0 60"), "no lens can have"),
        (("64 48", "-64 48"), "is not a number of its kind"),
        (("64 48", "0 48"), "no size"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(tmp_path, solved, change, told):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse", "txt")
    text = (folder / "cameras.txt").read_text()
    assert change[0] in text
    (folder / "cameras.txt").write_text(text.replace(*change))
    with pytest.raises(CaptureError, match=told):
        read_capture(tmp_path)


def test_names_outside_the_capture_find_nothing(tmp_path, solved):
    folder = tmp_path / "capture"
    reconstruction = solved(tmp_path / "elsewhere")
    for image in reconstruction.images.values():
        image.name = f"../elsewhere/{image.name}"
    for extension in WRITERS:
        write(reconstruction, folder / "sparse" / "0", extension)
        with pytest.raises(CaptureError, match="5 of 5 photos are missing"):
            read_capture(folder / "sparse" / "0" / f"images.{extension}")


def outcome(file):
    """A capture or None, checked to come soon and with an error of one line."""
    begin = time.monotonic()
    try:
        capture = read_capture(file)
        assert len(capture.cameras) >= 3
        for camera in capture.cameras:
            assert np.isfinite(camera.camera_to_world).all()
    except CaptureError as error:
        assert "\n" not in str(error) and "Traceback" not in str(error) and error.remedy
        str(error).encode()
        capture = None
    assert time.monotonic() - begin < 5
    return capture


@pytest.fixture(scope="module", params=WRITERS)
def model(request, tmp_path_factory, solved):
    """A folder with a model and the bytes of its files."""
    folder = tmp_path_factory.mktemp("broken")
    reconstruction = solved(folder / "images", "OPENCV", PARAMETERS["OPENCV"], points=6)
    write(reconstruction, folder / "sparse", request.param)
    return {file: file.read_bytes() for file in sorted((folder / "sparse").iterdir())}


QUICK = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def restore(files):
    for file, content in files.items():
        file.write_bytes(content)


@QUICK
@given(data=st.data())
def test_a_model_cut_anywhere_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    file.write_bytes(model[file][: data.draw(st.integers(0, len(model[file])))])
    outcome(data.draw(st.sampled_from(sorted(model))))


@QUICK
@given(data=st.data())
def test_a_model_with_other_bytes_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    content = bytearray(model[file])
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    outcome(data.draw(st.sampled_from(sorted(model))))


@QUICK
@given(data=st.data())
def test_a_model_with_shuffled_or_foreign_lines_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    lines = model[file].splitlines(True)
    lines = data.draw(st.permutations(lines[:40]))
    foreign = st.sampled_from([b"1 2 3\n", b"\n", b"\xff\xfe\n", b"1 " * 5000 + b"\n", b"nan\n"])
    lines.insert(data.draw(st.integers(0, len(lines))), data.draw(foreign))
    file.write_bytes(b"".join(lines))
    outcome(data.draw(st.sampled_from(sorted(model))))


@pytest.mark.parametrize("count", [2**63, 2**64 - 1, 2**32, 10**9])
@pytest.mark.parametrize("kind", ["cameras", "images", "points3D", "rigs", "frames"])
def test_hostile_counts_allocate_nothing(tmp_path, solved, kind, count):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    file = folder / f"{kind}.bin"
    file.write_bytes(struct.pack("<Q", count) + file.read_bytes()[8:])
    if kind in ("rigs", "frames"):
        without_poses(folder / "images.bin")
    tracemalloc.start()
    capture = outcome(folder / "images.bin")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20
    assert (capture is not None) == (kind == "points3D")


@pytest.mark.parametrize("count", [2**63, 2**64 - 1, 2**40])
def test_hostile_lengths_within_a_record_allocate_nothing(tmp_path, solved, count):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    data = (folder / "images.bin").read_bytes()
    at = data.index(b".png\0") + 5
    (folder / "images.bin").write_bytes(data[:at] + struct.pack("<Q", count) + data[at + 8 :])
    points = (folder / "points3D.bin").read_bytes()
    (folder / "points3D.bin").write_bytes(points[:51] + struct.pack("<Q", count) + points[59:])
    tracemalloc.start()
    assert outcome(folder / "images.bin") is None
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()


def test_a_million_points_are_read_in_seconds(tmp_path):
    record = struct.Struct("<Q3d3BdQ4I")
    block = b"".join(record.pack(i, i, 2.0 * i, 3.0, 1, 2, 3, 0.5, 2, 1, 2, 3, 4) for i in range(10_000))
    file = tmp_path / "points3D.bin"
    file.write_bytes(struct.pack("<Q", 1_200_000) + block * 120)
    begin = time.monotonic()
    points = colmap.colmap_binary.read_points(file)
    assert time.monotonic() - begin < 10
    file.unlink()
    assert 500_000 <= len(points) <= 1_000_000 and points[:, 2].tolist() == [3.0] * len(points)
