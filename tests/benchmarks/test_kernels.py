"""The kernels' benchmark: all of its cases run, and their limits are numbers."""

from numbers import Real

import numpy as np
import pytest

from benchmarks.kernels import cases


@pytest.fixture(scope="module")
def few():
    return cases(320)


def test_every_kernel_runs(few):
    for case in few:
        case.run()


def test_the_work_of_every_kernel_is_a_number_above_nothing(few):
    for case in few:
        for counted in (case.bytes, case.operations):
            assert isinstance(counted, Real) and np.isfinite(counted) and counted > 0, case.name
        assert isinstance(case.lines, Real) and case.lines >= 0, case.name
