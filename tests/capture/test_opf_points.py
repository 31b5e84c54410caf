"""Sparse points of OPF projects: where they are, which are drawn, and files that state what is not there."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import opf_points
from solver.capture.formats.opf_points import read_gltf_points
from solver.capture.read import read_capture
from tests.capture.programs import HOSTILE, RANDOM_TESTS, places, put
from tests.capture.test_opf import project, write

TO_Y_UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
"""as the specification has it, column by column"""


def points(count=50):
    return np.random.default_rng(3).normal(size=(count, 3)).astype("<f4")


def gltf(count=50, matrix=TO_Y_UP, start=0, uri="track-positions.glbin"):
    node = {"mesh": 0} if matrix is None else {"mesh": 0, "matrix": list(matrix)}
    return {
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"}],
        "asset": {"extensions": {"OPF_asset_version": {"version": "1.0"}}, "version": "2.0"},
        "bufferViews": [{"buffer": 0, "byteLength": 12 * count, "byteOffset": start}],
        "buffers": [{"byteLength": 12 * count + start, "uri": uri}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "nodes": [node], "scene": 0, "scenes": [{"nodes": [0]}],
    }  # fmt: skip


def with_points(folder, content=None, data=None):
    write(folder)
    (folder / "calibration" / "tracks.gltf").write_text(json.dumps(content or gltf()))
    data = points().tobytes() if data is None else data
    (folder / "calibration" / "track-positions.glbin").write_bytes(data)
    return folder


def test_points_that_were_turned_to_gltfs_up_are_where_they_were(tmp_path):
    capture = read_capture(with_points(tmp_path))
    assert not capture.warnings
    np.testing.assert_allclose(capture.points, points())


def test_a_node_without_a_matrix_has_y_up_and_a_node_may_be_far_away(tmp_path):
    folder = with_points(tmp_path / "plain", gltf(matrix=None))
    turned = points() @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    np.testing.assert_allclose(read_capture(folder).points, turned)
    far = [*TO_Y_UP[:12], 10, 30, -20, 1]
    folder = with_points(tmp_path / "far", gltf(matrix=far, start=8), b"12345678" + points().tobytes())
    np.testing.assert_allclose(read_capture(folder).points, points() + [10, 20, 30], rtol=1e-6)


def test_of_too_many_points_some_are_drawn_evenly(tmp_path, monkeypatch):
    monkeypatch.setattr(opf_points, "MOST_POINTS", 20)
    np.testing.assert_allclose(read_capture(with_points(tmp_path)).points, points()[::3])


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (gltf(count=51), "tracks.gltf states 51 points in it, it has fewer"),
        (gltf(count=1 << 39), "it has fewer"),
        (gltf(start=4), "it has fewer"),
        (gltf(start=-12), "count or place is not a number"),
        (gltf(uri="../../../etc/passwd"), "is not in the project's folder"),
        (gltf(uri="gone.bin"), "is not in the project's folder"),
        (gltf(uri="data:application/octet-stream;base64,AAAA"), "is not in the project's folder"),
        (gltf() | {"accessors": []}, "accessors: there is no '0' in it"),
        (gltf() | {"nodes": [{"mesh": True}]}, "meshes: there is no 'True' in it"),
    ],
)
def test_points_that_cannot_be_read_are_told_and_not_used(tmp_path, content, problem):
    capture = read_capture(with_points(tmp_path, content))
    assert capture.points is None and len(capture.warnings) == 1
    assert problem in capture.warnings[0]


def test_a_file_that_repeats_its_points_ends_soon(tmp_path, monkeypatch):
    monkeypatch.setattr(opf_points, "_MOST_IN_ALL", 1000)
    content = gltf()
    content["nodes"] *= 100_000
    assert "more nodes with points" in read_capture(with_points(tmp_path, content)).warnings[0]


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_values_end_in_points_or_an_error(tmp_path, data):
    content = gltf()
    put(content, data.draw(st.sampled_from(places(content))), data.draw(HOSTILE))
    file = tmp_path / "tracks.gltf"
    file.write_text(json.dumps(content))
    (tmp_path / "track-positions.glbin").write_bytes(points().tobytes())
    try:
        assert read_gltf_points(file, tmp_path).shape[1:] == (3,)
    except CaptureError as error:
        assert "\n" not in str(error) and error.problem and error.remedy


def test_projects_without_points_are_read_as_before(tmp_path):
    assert read_capture(write(tmp_path, project())).points is None
