"""Bundler files: the manual's formulas, COLMAP's projections, and every way a file can be broken."""

import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.read import read_capture
from tests.capture.programs import numbers

CENTRED = {"SIMPLE_RADIAL": (70, 32, 24, -0.12), "RADIAL": (70, 32, 24, -0.12, 0.03)}


def export(reconstruction, file, list_name="list.txt", suffix=""):
    """What COLMAP's model_converter writes for Bundler."""
    images = [image for _, image in sorted(reconstruction.images.items())]
    lines = ["# Bundle file v0.3", f"{len(images)} {len(reconstruction.points3D)}"]
    flip = np.array([1, -1, -1])
    for image in images:
        camera = reconstruction.cameras[image.camera_id]
        extra = [*camera.params[3:], 0, 0][:2]
        pose = image.cam_from_world()
        lines.append(numbers([camera.params[0], *extra]))
        lines += [numbers(row) for row in pose.rotation.matrix() * flip[:, None]]
        lines.append(numbers(pose.translation * flip))
    for point in reconstruction.points3D.values():
        lines += [numbers(point.xyz), "9 9 9", "2 0 0 1.5 2.5 1 0 3.5 4.5"]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join(lines) + "\n")
    if list_name:
        names = [image.name + suffix for image in images]
        (file.parent / list_name).write_text("\n".join(names) + "\n")
    return file


@pytest.mark.parametrize("model", CENTRED)
def test_points_project_where_colmap_projects_them(tmp_path, solved, agrees, model):
    reconstruction = solved(tmp_path / "images", model, CENTRED[model])
    export(reconstruction, tmp_path / "bundle" / "bundle.out")
    capture = read_capture(tmp_path)
    assert capture.format == "Bundler" and len(capture.cameras) == 5 and not capture.warnings
    assert agrees(capture, reconstruction, tmp_path / "images") > 500
    assert len(capture.points) == 150


def test_points_project_as_bundlers_manual_says(tmp_path, solved):
    file = export(solved(tmp_path, "RADIAL", CENTRED["RADIAL"]), tmp_path / "bundle.out")
    words = file.read_text().split("\n")[2:7]
    focal, k1, k2 = map(float, words[0].split())
    rotation = np.array([row.split() for row in words[1:4]], float)
    point = np.array([0.3, -0.2, 0.4])
    p = rotation @ point + np.array(words[4].split(), float)
    p = -p[:2] / p[2]
    p = focal * (1 + k1 * p @ p + k2 * (p @ p) ** 2) * p
    pixel, depth = read_capture(file).cameras[0].project(point[None])
    np.testing.assert_allclose(pixel[0], (32 + p[0], 24 - p[1]), rtol=0, atol=1e-9)
    assert depth[0] > 0


@pytest.mark.parametrize(
    "file, list_name",
    [
        ("bundle.out", "list.txt"),
        ("bundle.rd.out", "list.rd.txt"),
        ("model.bundle.out", "model.list.txt"),
        ("model.out", "model.out.list.txt"),
        ("scene.out", "scene.txt"),
        ("bundle.out", "photos of the bundle.lst"),
        ("bundle.out", "photos.imagelist"),
        ("bundle/bundle.out", "../list.txt"),
    ],
)
def test_the_list_of_photos_goes_by_several_names(tmp_path, solved, agrees, file, list_name):
    reconstruction = solved(tmp_path / "images", "RADIAL", CENTRED["RADIAL"])
    file = export(reconstruction, tmp_path / file, list_name)
    agrees(read_capture(tmp_path), reconstruction, tmp_path / "images")
    agrees(read_capture(file), reconstruction, tmp_path / "images")


def test_lists_with_focal_lengths_and_names_with_blanks_are_read(tmp_path, solved, agrees):
    names = ["a 1.png", "b 0 2.png", "left/c.png", "right/c.png", "d.png"]
    reconstruction = solved(tmp_path / "images", "RADIAL", CENTRED["RADIAL"], names=names)
    export(reconstruction, tmp_path / "bundle.out", suffix=" 0 660.80306")
    agrees(read_capture(tmp_path), reconstruction, tmp_path / "images")


def test_without_a_list_as_many_photos_are_taken_in_the_order_of_their_names(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images", "RADIAL", CENTRED["RADIAL"])
    export(reconstruction, tmp_path / "bundle.out", None)
    agrees(read_capture(tmp_path), reconstruction, tmp_path / "images")
    (tmp_path / "images" / "r_2.png").unlink()
    with pytest.raises(CaptureError, match="no list of photos.*4 pictures, not 5"):
        read_capture(tmp_path)


def test_unsolved_photos_are_left_out_with_a_warning(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images", "RADIAL", CENTRED["RADIAL"])
    file = export(reconstruction, tmp_path / "bundle.out")
    lines = file.read_text().split("\n")
    lines[7:12] = ["0 0 0"] * 5
    file.write_text("\n".join(lines))
    capture = read_capture(tmp_path)
    assert "1 of 5 photos was not solved" in capture.warnings[0]
    assert "r_1" not in [camera.name for camera in capture.cameras]
    agrees(capture, reconstruction, tmp_path / "images")


def edit(line, text):
    def change(lines):
        lines[line] = text

    return change


@pytest.mark.parametrize(
    "change, told",
    [
        (edit(0, "# Bundle file v0.9"), "not version 0.3"),
        (edit(1, "five 6"), "does not count"),
        (edit(1, f"{2**63} 6"), "breaks off"),
        (edit(1, "3 6"), "lists 5 photos, but bundle.out has 3 cameras"),
        (edit(3, "1 0"), "breaks off"),
        (edit(3, "1 0 up"), "'up' is not a number"),
        (edit(3, "0 0 0"), "singular"),
        (lambda lines: lines.__delitem__(slice(12, None)), "camera 2 of 5 breaks off"),
    ],
)
def test_a_malformed_file_is_named_with_what_is_wrong(tmp_path, solved, change, told):
    file = export(solved(tmp_path, "RADIAL", CENTRED["RADIAL"]), tmp_path / "bundle.out")
    lines = file.read_text().split("\n")
    change(lines)
    file.write_text("\n".join(lines))
    with pytest.raises(CaptureError, match=told) as caught:
        read_capture(tmp_path)
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_points_that_break_off_are_a_warning(tmp_path, solved):
    file = export(solved(tmp_path, "RADIAL", CENTRED["RADIAL"]), tmp_path / "bundle.out")
    file.write_text("\n".join(file.read_text().split("\n")[:-20]))
    capture = read_capture(file)
    assert len(capture.points) < 150 and "break off" in capture.warnings[0]


def test_names_outside_the_capture_find_nothing(tmp_path, solved):
    reconstruction = solved(tmp_path / "elsewhere", "RADIAL", CENTRED["RADIAL"])
    file = export(reconstruction, tmp_path / "capture" / "bundle.out")
    for names in ("../elsewhere/r_{}.png\n", f"{tmp_path}/elsewhere/r_{{}}.png\n"):
        (file.parent / "list.txt").write_text("".join(names.format(i) for i in range(5)))
        with pytest.raises(CaptureError, match="5 of 5 photos are missing"):
            read_capture(file)


@pytest.fixture(scope="module")
def model(tmp_path_factory, solved):
    folder = tmp_path_factory.mktemp("broken")
    reconstruction = solved(folder, "RADIAL", CENTRED["RADIAL"], points=6)
    files = [export(reconstruction, folder / "bundle.out"), folder / "list.txt"]
    return {file: file.read_bytes() for file in files}


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_broken_file_is_a_capture_or_an_error(model, data):
    for file, content in model.items():
        file.write_bytes(content)
    file = data.draw(st.sampled_from(sorted(model)))
    content = bytearray(model[file])
    way = data.draw(st.sampled_from(["cut", "bytes", "lines"]))
    if way == "cut":
        content = content[: data.draw(st.integers(0, len(content)))]
    elif way == "bytes":
        for _ in range(data.draw(st.integers(1, 6))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    else:
        content = b"".join(data.draw(st.permutations(bytes(content).splitlines(True)[:40])))
    file.write_bytes(content)
    begin = time.monotonic()
    try:
        assert len(read_capture(sorted(model)[0]).cameras) >= 3
    except CaptureError as error:
        assert "\n" not in str(error) and error.remedy
        str(error).encode()
    assert time.monotonic() - begin < 5
