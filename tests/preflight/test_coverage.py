"""Where cameras stand around the object: gaps, heights, sides, and cameras that look elsewhere."""

from dataclasses import replace

import numpy as np

from solver.capture.capture import Capture, region_seen_by
from solver.preflight.coverage import coverage, coverage_of, side_of
from tests.cameras.box_scene import box_camera
from tests.preflight.captures import around, capture_at, warnings


def texts(capture):
    return " ".join(finding.text for finding in warnings(coverage(capture)))


def test_cameras_on_one_side_leave_a_gap_behind():
    assert texts(capture_at(around(30))) == ""
    one_side = texts(capture_at(around(30, degrees=150)))
    assert "gap of 215°" in one_side and "from the left" in one_side
    centred = capture_at([*around(15, degrees=60), *around(15, degrees=-60)])
    assert "from behind (with c0 as the front)" in texts(centred)
    few = texts(capture_at(around(12)))
    assert "only 12 photos" in few
    narrow = texts(capture_at(around(30, degrees=12, heights=(0.9,))))
    assert "walk around it" in narrow and "gap" not in narrow
    level = texts(capture_at(around(30, heights=(1.2,))))
    assert "one height" in level and "gap" not in level


def test_cameras_that_look_away_from_one_another_are_told_what_can_be_reconstructed():
    poses = around(24)
    for distance in (0.2, 2.6):
        outward = [pose @ np.diag([-1.0, 1, -1, 1]) for pose in around(24, (0.4, 0.5), distance=distance)]
        capture = capture_at(outward)
        capture = replace(capture, region=region_seen_by(list(capture.cameras)))
        told = texts(capture)
        assert "24 of 24 cameras (the first: c0) do not see the region" in told
        assert "only an object that all photos show" in told
    # A few that look elsewhere are usual.
    assert "do not see the region" not in texts(capture_at(poses[:20] + outward[20:]))


def test_sides_are_named_as_the_first_camera_sees_them():
    names = {0: "front", 90: "right", 180: "behind", 270: "left", -80: "left", 500: "behind"}
    for degrees, name in names.items():
        assert name in side_of(degrees)
    # The first camera stands at +X and looks along -X: its right hand is at +Y.
    camera = box_camera(around(4)[0])
    assert camera.camera_to_world[:3, 0] @ (0, 1, 0) > 0.99


def test_coverage_grows_with_cameras_and_knows_an_up_of_its_own():
    few, many = (coverage_of(capture_at(around(n, (0.45, 2.0, 3.5)))) for n in (8, 40))
    assert 0 < few.share < many.share < 1 and many.share < many.upper_share
    lying = capture_at(around(30, heights=(1.2,)))
    tipped = Capture(lying.source, lying.cameras, lying.region, up=np.array([1.0, 0, 0]))
    assert coverage_of(tipped).heights[1] > 60 > coverage_of(lying).heights[1]
