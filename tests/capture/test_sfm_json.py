"""What must hold of Meshroom's, OpenMVG's and OpenSfM's JSON alike: hostile, cut and shuffled files."""

import copy
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.read import read_capture
from tests.capture import test_meshroom, test_openmvg, test_opensfm
from tests.capture.programs import COUNT, HOSTILE, RANDOM_TESTS, outcome, places, poses, put


@pytest.fixture(params=[test_meshroom, test_openmvg, test_opensfm], ids=["Meshroom", "OpenMVG", "OpenSfM"])
def program(request):
    """How one of them writes a scene."""
    return request.param


@RANDOM_TESTS
@given(data=st.data(), value=HOSTILE)
def test_hostile_values_end_in_a_capture_or_an_error(program, tmp_path, data, value):
    content = copy.deepcopy(program.scene())
    put(content, data.draw(st.sampled_from(places(content))), value)
    outcome(program.write(tmp_path, content))


@RANDOM_TESTS
@given(share=st.floats(0, 1))
def test_a_file_cut_anywhere_ends_in_an_error(program, tmp_path, share):
    content = json.dumps(program.scene())
    assert outcome(program.write(tmp_path, content[: int(share * (len(content) - 1))])) is None


@RANDOM_TESTS
@given(order=st.permutations(range(COUNT)))
def test_the_order_of_views_and_poses_does_not_matter(program, tmp_path, order):
    for item in read_capture(program.write(tmp_path, program.scene(order=order))).cameras:
        expected = poses()[int(item.name[-4:])]
        np.testing.assert_allclose(item.position, expected[:3, 3])
        np.testing.assert_allclose(item.view_direction, expected[:3, 2])
