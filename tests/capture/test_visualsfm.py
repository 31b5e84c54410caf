"""VisualSFM files: its distortion by its formula, COLMAP's projections, every way a file can be broken."""

import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture
from tests.capture.programs import numbers

CENTRED = (70, 32, 24)


def export(reconstruction, file, distortion=0.0, name="{}", between=" ", head="NVM_V3", matrix=False):
    """What COLMAP's model_converter writes for VisualSFM."""
    images = [image for _, image in sorted(reconstruction.images.items())]
    lines = [head, "", str(len(images))]
    for image in images:
        pose = image.cam_from_world()
        x, y, z, w = pose.rotation.quat
        place = [w, x, y, z, *pose.inverse().translation]
        if matrix:
            place = [*pose.rotation.matrix().ravel(), *pose.translation]
        focal = reconstruction.cameras[image.camera_id].params[0]
        lines.append(name.format(image.name) + between + numbers([focal, *place, distortion]) + " 0")
    lines += ["", str(len(reconstruction.points3D))]
    for point in reconstruction.points3D.values():
        lines.append(numbers(point.xyz) + " 9 9 9 2 0 0 1.5 2.5 1 0 3.5 4.5")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join([*lines, "", "0"]) + "\n")
    return file


@pytest.mark.parametrize("matrix", [False, True])
def test_points_project_where_colmap_projects_them(tmp_path, solved, agrees, matrix):
    reconstruction = solved(tmp_path / "images", "SIMPLE_PINHOLE", CENTRED)
    head = "NVM_V3_R9T" if matrix else "NVM_V3"
    export(reconstruction, tmp_path / "model.nvm", head=head, matrix=matrix)
    capture = read_capture(tmp_path)
    assert capture.format == "VisualSFM" and len(capture.cameras) == 5 and not capture.warnings
    assert agrees(capture, reconstruction, tmp_path / "images") > 500
    assert len(capture.points) == 150


@pytest.mark.parametrize("distortion", [0.15, -0.2])
def test_rays_leave_through_the_measured_place_times_its_distortion(tmp_path, solved, distortion):
    file = export(solved(tmp_path, "SIMPLE_PINHOLE", CENTRED), tmp_path / "a.nvm", distortion)
    camera = read_capture(file).cameras[0]
    measured = np.random.default_rng(0).uniform(-0.4, 0.4, (60, 2))
    columns, rows = measured.T * 70 + [[32], [24]]
    ideal = measured * (1 + distortion * (measured**2).sum(1, keepdims=True))
    _, directions = camera.rays(columns, rows)
    local = directions @ camera.camera_to_world[:3, :3]
    np.testing.assert_allclose(local[:, 0] / -local[:, 2], ideal[:, 0], atol=1e-12)
    np.testing.assert_allclose(local[:, 1] / local[:, 2], ideal[:, 1], atol=1e-12)
    pixels, _ = camera.project(camera.position + 3 * directions)
    np.testing.assert_allclose(pixels, np.stack([columns, rows], 1), rtol=0, atol=1e-9)
    write_transforms(tmp_path / "job" / "transforms.json", list(read_capture(file).cameras))
    again = read_capture(tmp_path / "job", trusted=True).cameras[0]
    assert (again.lens, again.distortion) == ("visualsfm", (distortion,))


def test_beyond_its_fold_the_distortion_has_no_pixel(tmp_path, solved):
    file = export(solved(tmp_path, "SIMPLE_PINHOLE", CENTRED), tmp_path / "a.nvm", -1 / 3)
    camera = read_capture(file).cameras[0]
    column = 32 + 70 * np.array([0.9, 1.1])  # d (1 − ⅓ d²) grows up to d = 1
    assert camera.lens_reaches(column, np.full(2, 24.0)).tolist() == [True, False]
    inside, beyond = (
        camera.camera_to_world[:3, :3] @ np.array([x, 0, -1]) + camera.position for x in (0.6, 0.7)
    )
    pixels, _ = camera.project(np.stack([inside, beyond]))
    assert np.isfinite(pixels).all(axis=1).tolist() == [True, False]


def test_colmaps_sign_of_the_distortion_agrees_to_first_order(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path, "SIMPLE_RADIAL", (*CENTRED, 1e-3))
    file = export(reconstruction, tmp_path / "a.nvm", -1e-3)
    camera = read_capture(file).cameras[0]
    image = next(i for i in reconstruction.images.values() if i.name == camera.image_path.name)
    point = np.array([0.8, 0.7, 0.6])
    np.testing.assert_allclose(camera.project(point[None])[0][0], image.project_point(point), atol=1e-4)


def test_a_fixed_calibration_counts_for_all(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path, "PINHOLE", (70, 60, 30, 25))
    file = export(reconstruction, tmp_path / "a.nvm", head="NVM_V3 FixedK 70 30 60 25")
    agrees(read_capture(file), reconstruction, tmp_path)


@pytest.mark.parametrize("name, between", [("{}", " "), ('"{}"', " "), ("{}", "\t")])
def test_names_with_blanks_are_read(tmp_path, solved, agrees, name, between):
    names = ["a 1.png", "b 0 2.png", "left/c.png", "right/c.png", "d.png"]
    reconstruction = solved(tmp_path, "SIMPLE_PINHOLE", CENTRED, names=names)
    file = export(reconstruction, tmp_path / "a.nvm", name=name, between=between)
    agrees(read_capture(file), reconstruction, tmp_path)


def test_quotation_marks_within_a_name_stand_for_blanks(tmp_path, solved, agrees):
    names = ["a 1.png", "b 2.png", "c 3.png"]
    reconstruction = solved(tmp_path, "SIMPLE_PINHOLE", CENTRED, names=names)
    file = export(reconstruction, tmp_path / "a.nvm")
    text = file.read_text()
    for name in names:
        text = text.replace(name, name.replace(" ", '"'))
    file.write_text(text)
    agrees(read_capture(file), reconstruction, tmp_path)


def test_further_models_in_the_file_are_mentioned(tmp_path, solved):
    file = export(solved(tmp_path, "SIMPLE_PINHOLE", CENTRED), tmp_path / "a.nvm")
    file.write_text(file.read_text().rstrip("0\n") + "\n2\n")
    assert "further models" in read_capture(file).warnings[0]


def edit(line, text):
    def change(lines):
        lines[line] = text

    return change


@pytest.mark.parametrize(
    "change, told",
    [
        (edit(0, "NVM_V1"), "not version 3"),
        (edit(0, "NVM_V3 FixedK 1 2 3"), "not 4 numbers"),
        (edit(0, "NVM_V3 FixedK 0 2 3 4"), "fx is not positive"),
        (edit(2, "five"), "is not a number of cameras"),
        (edit(2, str(2**63)), "is not 10 numbers|ends before"),
        (edit(4, "r_1.png 70 1 0 0"), "is not 10 numbers"),
        (edit(4, "r_1.png 70 1 0 0 up 0 0 0 0 0"), "'up' is not a number"),
        (edit(4, "r_1.png 70 0 0 0 0 0 0 0 0 0"), "not a number"),
        (edit(4, "r_1.png -70 1 0 0 0 0 0 0 0 0"), "no lens can have"),
        (lambda lines: lines.__delitem__(slice(6, None)), "ends before its 5 cameras"),
    ],
)
def test_a_malformed_file_is_named_with_what_is_wrong(tmp_path, solved, change, told):
    file = export(solved(tmp_path, "SIMPLE_PINHOLE", CENTRED), tmp_path / "a.nvm")
    lines = file.read_text().split("\n")
    change(lines)
    file.write_text("\n".join(lines))
    with pytest.raises(CaptureError, match=told) as caught:
        read_capture(tmp_path)
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_points_that_break_off_are_a_warning(tmp_path, solved):
    file = export(solved(tmp_path, "SIMPLE_PINHOLE", CENTRED), tmp_path / "a.nvm")
    file.write_text("\n".join(file.read_text().split("\n")[:-20]))
    capture = read_capture(file)
    assert 0 < len(capture.points) < 150 and "break off" in capture.warnings[0]


def test_names_outside_the_capture_find_nothing(tmp_path, solved):
    reconstruction = solved(tmp_path / "elsewhere", "SIMPLE_PINHOLE", CENTRED)
    for name in ("../elsewhere/{}", f"{tmp_path}/elsewhere/{{}}"):
        file = export(reconstruction, tmp_path / "capture" / "a.nvm", name=name)
        with pytest.raises(CaptureError, match="5 of 5 photos are missing"):
            read_capture(file)


@pytest.fixture(scope="module")
def model(tmp_path_factory, solved):
    folder = tmp_path_factory.mktemp("broken")
    reconstruction = solved(folder, "SIMPLE_PINHOLE", CENTRED, points=6)
    file = export(reconstruction, folder / "a.nvm", 0.1)
    return file, file.read_bytes()


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_broken_file_is_a_capture_or_an_error(model, data):
    file, content = model[0], bytearray(model[1])
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
        assert len(read_capture(file).cameras) >= 3
    except CaptureError as error:
        assert "\n" not in str(error) and error.remedy
        str(error).encode()
    assert time.monotonic() - begin < 5
