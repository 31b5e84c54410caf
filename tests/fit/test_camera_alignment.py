"""Cut-out photos whose cameras are off get better ones, and only those."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from solver.capture.errors import CaptureError
from solver.capture.placement import seen_from
from solver.fit import camera_alignment, isolation
from solver.fit.camera_alignment import FEWEST_PHOTOS, aligned
from solver.fit.image_alignment import Evidence
from solver.fit.isolation import isolated
from solver.fit.mask_outlines import masks_of
from solver.fit.outline_gap import outline_gap
from solver.fit.presets import PAPER, settings_for
from tests.fit.painted_ball import disagreement, painted_ball
from tests.fit.test_standing import Heard, job_in

DEGREES = 0.6
SETTINGS = settings_for("draft")


def aligned_to(capture, photos, seconds=np.inf):
    return aligned(capture, photos, None, 0, "cpu", lambda done: None, seconds)


def after_a_round(capture, photos):
    """As with no time for another one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(camera_alignment, "WORTH_BEGINNING", 0)
        return aligned_to(capture, photos, seconds=0.0)


@pytest.fixture(scope="module")
def shaken_ball():
    return painted_ball(16, DEGREES)


@pytest.fixture(scope="module")
def found(shaken_ball):
    return aligned_to(*shaken_ball)


@pytest.fixture(scope="module")
def short(shaken_ball):
    """What one round finds."""
    return after_a_round(*shaken_ball)


@pytest.fixture
def never(monkeypatch):
    """Nothing is fitted."""

    def fitted(*_):
        raise AssertionError("a field was fitted")

    monkeypatch.setattr(camera_alignment, "new_trainer", fitted)


def test_cameras_that_are_off_come_near_to_where_photos_were_taken(shaken_ball, found):
    capture, _ = shaken_ball
    assert disagreement(capture.cameras) > 2
    assert disagreement(found.cameras) < 0.25 * disagreement(capture.cameras)
    assert found.after < 0.4 * found.before
    for given, moved in zip(capture.cameras, found.cameras, strict=True):
        assert (given.name, given.lens_key) == (moved.name, moved.lens_key)
        turn = moved.camera_to_world[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)


def test_cameras_far_from_their_world_s_origin_are_moved_alike(shaken_ball, short):
    capture, photos = shaken_ball
    place = np.array([4.0e5, 5.2e6, 120.0])
    far = after_a_round(seen_from(capture, -place), photos)
    for one, other in zip(short.cameras, far.cameras, strict=True):
        np.testing.assert_allclose(other.seen_from(place).camera_to_world, one.camera_to_world, atol=2e-3)


@pytest.mark.usefixtures("never")
def test_what_there_is_no_time_for_is_not_begun(shaken_ball):
    assert aligned_to(*shaken_ball, seconds=0.1) is None


@pytest.mark.usefixtures("never")
def test_right_cameras_few_photos_and_panoramas_are_left_without_a_fit():
    capture, photos = painted_ball(16)
    assert aligned_to(capture, photos) is None
    capture, photos = painted_ball(FEWEST_PHOTOS - 1, DEGREES)
    assert aligned_to(capture, photos) is None
    capture, photos = painted_ball(16, DEGREES)
    first = replace(capture.cameras[0], lens="equirectangular")
    assert aligned_to(replace(capture, cameras=(first, *capture.cameras[1:])), photos) is None


def test_right_cameras_stay_where_outlines_lie_outside_of_the_hull_for_another_reason(monkeypatch):
    """Parts that are thinner than its cells."""
    capture, photos = painted_ball(16)
    monkeypatch.setattr(camera_alignment, "outline_gap", lambda *_: 1.0)
    monkeypatch.setattr(camera_alignment, "ROUNDS", 2)
    assert aligned_to(capture, photos) is None


def test_cameras_stay_if_small_photos_have_nothing_in_common(shaken_ball, monkeypatch):
    def nothing(*_):
        raise CaptureError("memory", "alpha", "no point lies inside the masks of all", "check them")

    monkeypatch.setattr(camera_alignment, "new_trainer", nothing)
    assert aligned_to(*shaken_ball) is None


def test_cameras_stay_if_outlines_fit_them_no_better_then(shaken_ball, monkeypatch):
    capture, photos = shaken_ball
    gaps = iter((0.5, 0.5))
    monkeypatch.setattr(camera_alignment, "outline_gap", lambda *_: next(gaps))
    monkeypatch.setattr(camera_alignment, "ROUNDS", 1)
    assert aligned_to(capture, photos) is None
    assert next(gaps, None) is None


def test_without_time_for_another_round_cameras_are_as_the_first_one_left_them(shaken_ball, short, found):
    capture, _ = shaken_ball
    given, first, last = (disagreement(c) for c in (capture.cameras, short.cameras, found.cameras))
    assert 1.3 * last < first < 0.8 * given


def test_what_a_photo_says_nothing_of_moves_no_camera(shaken_ball, short):
    """A hand before the ball, in each photo elsewhere, that is to be ignored."""
    capture, photos = shaken_ball
    behind_hands = []
    for index, photo in enumerate(photos):
        told, pixels = np.ones(photo.pixels.shape[:2], bool), photo.pixels.copy()
        at = slice(20 + 2 * index, 30 + 2 * index)
        told[at, 36:52] = False
        pixels[~told] = (1.0, 0.6, 0.4, 1.0)
        behind_hands.append(replace(photo, pixels=pixels, told=told))
    found = after_a_round(capture, behind_hands)
    assert disagreement(found.cameras) < 1.15 * disagreement(short.cameras)


def test_masks_that_are_too_wide_in_some_photos_and_too_narrow_in_others_move_no_right_camera():
    capture, photos = painted_ball(16)
    spoiled = []
    for index, photo in enumerate(photos):
        spoil = (ndimage.minimum_filter, ndimage.maximum_filter)[index % 2]
        pixels = photo.pixels.copy()
        pixels[..., 3] = spoil(pixels[..., 3], 3)
        spoiled.append(replace(photo, pixels=pixels))
    gap = outline_gap(list(capture.cameras), lambda: masks_of(spoiled), capture.region)
    assert gap > 2 * camera_alignment.OUTLINES_FIT
    assert aligned_to(capture, spoiled) is None


def test_motions_go_beyond_the_most_likely_ones_and_none_is_common_to_all():
    """Against least squares of all that is said, with the guess as what motions are pulled to."""
    rng = np.random.default_rng(3)
    motions, guess, told = rng.normal(0, 0.01, (5, 6)), 0.02, []
    for _ in range(4):
        slopes = 100 * rng.normal(size=(40, 6))
        told.append((slopes, rng.normal(size=40)))
    found = [Evidence(s.T @ s, s.T @ d, np.zeros((1, 2, 6))) for s, d in told]
    after, _ = camera_alignment._better(motions, [*found, None], guess)
    share = camera_alignment.INDEPENDENT**0.5
    expected = motions.copy()
    for index, (slopes, differences) in enumerate(told):
        likely = guess * camera_alignment.LIKELY
        rows = np.concatenate([share * slopes, np.diag(1 / likely)])
        values = np.concatenate([share * differences, -motions[index] / likely])
        step = np.linalg.lstsq(rows, values, rcond=None)[0]
        expected[index] += camera_alignment.FURTHER * step
    np.testing.assert_allclose(after, expected - expected.mean(0), atol=1e-12)
    assert np.abs(after.mean(0)).max() < 1e-12


def test_a_job_keeps_its_adjusted_cameras_and_says_so(tmp_path, shaken_ball, monkeypatch):
    capture, photos = shaken_ball
    monkeypatch.setattr(camera_alignment, "ROUNDS", 1)
    job, heard, told = job_in(tmp_path), Heard(), []
    found = isolated(job, SETTINGS, capture, photos, False, heard, told.append)
    (warning,) = heard.warnings
    assert "cameras were adjusted" in warning and "fit.refine_cameras=no" in warning
    assert told == sorted(told) and len(told) > 10
    poses = json.loads(job.cameras_path.read_text())
    for camera in found.capture.cameras:
        np.testing.assert_array_equal(poses[camera.name], camera.camera_to_world)
    assert not np.array_equal(found.capture.cameras[0].position, capture.cameras[0].position)


@pytest.mark.usefixtures("never")
def test_a_job_leaves_cameras_by_which_it_cut_photos_out(tmp_path, shaken_ball, monkeypatch):
    capture, photos = shaken_ball
    opaque = [
        replace(photo, pixels=np.ones_like(photo.pixels), has_alpha=False) for photo in photos
    ]  # fmt: skip
    monkeypatch.setattr(isolation, "cut_out", lambda *_: photos)
    job, heard = job_in(tmp_path), Heard()
    found = isolated(job, SETTINGS, capture, opaque, False, heard, lambda done: None)
    assert found.photos is photos and found.capture is capture and not heard.warnings


@pytest.mark.usefixtures("never")
def test_a_job_leaves_cameras_that_were_solved_with_points_and_those_that_are_to_be_left(
    tmp_path, shaken_ball
):
    capture, photos = shaken_ball
    points = np.random.default_rng(0).normal(0, 0.2, (500, 3))
    left = replace(SETTINGS, fit=replace(SETTINGS.fit, refine_cameras=False))
    for name, settings, given, resumed in (
        ("solved", SETTINGS, replace(capture, points=points), False), ("left", left, capture, False),
        ("paper", PAPER, capture, False), ("resumed", SETTINGS, capture, True),
    ):  # fmt: skip
        job, heard = job_in(tmp_path / name), Heard()
        found = isolated(job, settings, given, photos, resumed, heard, lambda done: None)
        assert found.capture.cameras == capture.cameras and not heard.warnings
        assert not job.cameras_path.exists()
