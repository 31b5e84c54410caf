"""A check tells how far photos lie beside their cameras."""

from dataclasses import replace

import numpy as np
import pytest

from solver.apart import ApartError
from solver.capture import triangulate
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.read import read_capture
from solver.fit.presets import settings_for
from solver.job.control import Cancelled
from solver.preflight.check import LOOKING, check
from solver.preflight.poses import poses
from solver.preflight.reduced_photos import ReducedPhotos
from tests.capture.printed_table import camera_at, shaken, write_table
from tests.preflight.captures import ROOT

SETTINGS = settings_for("draft")


@pytest.fixture(scope="module")
def cameras():
    return [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]


def found_of(folder, cameras, told):
    capture = read_capture(write_table(folder, cameras, told))
    return capture, poses(capture, ReducedPhotos(), SETTINGS, lambda done: None)


def test_of_cameras_that_fit_it_says_how_well(cameras, tmp_path):
    _, (found,) = found_of(tmp_path, cameras, cameras)
    assert found.level == "note" and found.text.startswith("photos and cameras disagree by 0.")


def test_of_cameras_that_are_off_it_says_so_and_what_becomes_of_them(cameras, tmp_path):
    capture, (found,) = found_of(tmp_path, cameras, shaken(cameras, 1.0, 0.01))
    assert found.level == "warning" and "will be adjusted" in found.text
    assert found in check(capture).findings
    with_points = replace(capture, points=np.zeros((500, 3)))
    (found,) = poses(with_points, ReducedPhotos(), SETTINGS, lambda done: None)
    assert found.level == "warning" and "solve cameras" in found.text


def test_of_matrices_in_another_convention_it_says_which(cameras, tmp_path):
    turned = [replace(c, camera_to_world=pose_opengl_from_opencv(c.camera_to_world)) for c in cameras]
    _, (found,) = found_of(tmp_path, cameras, turned)
    assert found.level == "warning" and "negate the second and third column" in found.text


def test_a_check_ends_when_it_is_asked_to_while_photos_are_compared(cameras, tmp_path):
    write_table(tmp_path, cameras, cameras)

    def told(done, text):
        if text == "comparing photos" and done > LOOKING:
            raise Cancelled

    with pytest.raises(Cancelled):
        check(read_capture(tmp_path), progress=told)


def test_photos_that_were_cut_out_are_not_compared():
    """What is left may be a mirror, in which nothing lies where it seems to."""
    report = check(read_capture(ROOT / "samples" / "duck"))
    assert not [f for f in report.findings if "beside" in f.text]


def test_few_pairs_are_compared_and_two_cameras_back_to_back_are_none(cameras, tmp_path, monkeypatch):
    compared = []

    def compare(cameras, pictures, pairs, progress):
        compared.append((len(cameras), len(pictures), pairs))
        raise ApartError("no COLMAP")

    monkeypatch.setattr(triangulate, "compare", compare)
    many = [camera_at(angle) for angle in np.linspace(0, 3.0, 40)]
    _, found = found_of(tmp_path, many, many)
    assert found == []
    count, pictures, pairs = compared.pop()
    assert count == pictures <= 2 * triangulate.PAIRS and len(pairs) == triangulate.PAIRS
    assert {index for pair in pairs for index in pair} == set(range(count))
    capture = read_capture(tmp_path)
    back_to_back = (camera_at(0.0, height=0.0), camera_at(np.pi, height=0.0))
    alone = replace(capture, cameras=back_to_back)
    assert poses(alone, ReducedPhotos(), SETTINGS, lambda done: None) == []
    assert not compared
