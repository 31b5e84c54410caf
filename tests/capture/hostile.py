"""Values and files as no program writes them, for property-based tests of readers."""

import math

from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.read import read_capture

NASTY = st.sampled_from(
    [
        math.nan, math.inf, -1e308, 1e400, 10**400, 0, -1, True, None, "", "1e400", "nan", "../" * 9 + "etc/passwd",
        "a\nb", "\0", "x" * 5000, [], {}, [[]], [1, 2], [[1, 2, 3]] * 3, {"a": [None]}, [math.nan] * 7, [0] * 7,
    ]
)  # fmt: skip
VALUES = st.recursive(
    NASTY | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=8,
)


def reads_or_refuses(path):
    """The capture, or None after an error of one line."""
    try:
        capture = read_capture(path)
    except CaptureError as error:
        assert "\n" not in str(error) and error.problem and error.remedy
        return None
    assert len(capture.cameras) >= 3
    return capture
