"""Middlebury's *_par.txt: its projection K [R t], names, sizes, and hostile files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import middlebury
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    numbers,
    outcome,
    poses,
    save_photos,
    spoilt,
)

LENS = np.array([[80.0, 0, 49.5], [0, 90.0, 30.25], [0, 0, 1]])
SKEWED = np.array([[80.0, 9.0, 49.5], [0, 90.0, 30.25], [0, 0, 1]])


def lines(lens=LENS, form="{}.png"):
    from_world = np.linalg.inv(poses())
    cameras = [
        f"{form.format(name)} {numbers(lens)} {numbers(matrix[:3, :3])} {numbers(matrix[:3, 3])}"
        for name, matrix in zip(names(), from_world, strict=True)
    ]
    return [str(COUNT), *cameras]


def write(folder, text, name="duckRing_par.txt"):
    save_photos(folder)
    (folder / name).write_text("\n".join(text) + "\n", encoding="utf-8", newline="")
    return folder


def project(index, point):
    x, y, z = LENS @ (np.linalg.inv(poses()[index]) @ [*point, 1])[:3]
    return x / z, y / z


@pytest.mark.parametrize("given_as", ["duckRing", "duckRing/duckRing_par.txt", ""])
def test_points_project_as_k_r_t(tmp_path, given_as):
    write(tmp_path / "duckRing", lines())
    (tmp_path / "duckRing" / "duckRing_ang.txt").write_text("1.0 2.0 IMG_0000.png\n")
    capture = read_capture(tmp_path / given_as)
    assert capture.format == middlebury.NAME and not capture.warnings and capture.up is None
    check_projection(capture, project, poses())


def test_names_may_have_blanks_and_blank_lines_are_none(tmp_path):
    text = "\r\n\r\n".join(lines(form="a vase {}.png"))
    write(tmp_path, [text])
    for name in names():
        (tmp_path / f"{name}.png").rename(tmp_path / f"a vase {name}.png")
    check_projection(read_capture(tmp_path), project, poses())


def test_photos_of_half_the_size_have_lenses_of_half_the_size(tmp_path):
    save_photos(tmp_path, size=(WIDTH // 2, HEIGHT // 2))
    centred = np.array([[80.0, 0, WIDTH / 2], [0, 90.0, HEIGHT / 2], [0, 0, 1]])
    camera = read_capture(write(tmp_path, lines(centred))).cameras[0]
    assert (camera.width, camera.fx, camera.fy) == (WIDTH // 2, *(0.5 * LENS.diagonal()[:2]))


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    write(tmp_path, lines(), "cameras of tuesday.dat")
    assert reader_of(tmp_path / "cameras of tuesday.dat") is middlebury


@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (lambda text: [*text, "IMG_0009.png 1 2 3"], "line 7"),
        (lambda text: [*text[:2], text[2].rsplit(" ", 1)[0], *text[3:]], "line 3"),
        (lambda text: [*text[:2], text[2].rsplit(" ", 1)[0] + " nan", *text[3:]], "line 3"),
        (lambda text: [*text[:2], text[2].replace(" 80.0 ", " 80.0x "), *text[3:]], "line 3"),
        (lambda text: [*text[:2], text[2].replace(" 80.0 ", " 0.0 "), *text[3:]], "line 3"),
        (lambda text: lines(SKEWED), "line 2"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, spoil, field):
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, spoil(lines())) / "duckRing_par.txt")
    assert field in caught.value.field and caught.value.remedy


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_files_end_in_a_capture_or_an_error(tmp_path, data):
    write(tmp_path, lines())
    spoilt(data, tmp_path / "duckRing_par.txt", data.draw(st.sampled_from([" ", "\n"])))
    outcome(tmp_path / "duckRing_par.txt")
    outcome(tmp_path)
