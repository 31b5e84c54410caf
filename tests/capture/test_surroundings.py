"""Cameras of photos with mask files are compared by what is around the object."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.capture.photo_matches import picture_from
from solver.capture.read import read_capture
from solver.capture.refine import TOLERATED
from solver.capture.surroundings import picture_around
from solver.capture.triangulate import compare_some
from solver.fit.point_start import found_in_surroundings
from solver.fit.presets import settings_for
from solver.preflight.check import check
from tests.capture.printed_table import HEIGHT, WIDTH, camera_at, printed, shaken, write_table
from tests.capture.test_refine import turns_and_ways

OBJECT = np.s_[35:145, 50:190]
"""where photos show a thing that reflects what is far away: that does not move as they do"""


@pytest.fixture(scope="module")
def cameras():
    return [camera_at(angle) for angle in np.linspace(0, 1.6, 9)]


def write(folder, cameras, told=None, around=True):
    """A capture of a mirror on a table, with masks; or on nothing."""
    write_table(folder, cameras, told)
    reflected = (255 * printed(WIDTH)[:HEIGHT]).astype(np.uint8)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[OBJECT] = 255
    (folder / "masks").mkdir()
    for camera in cameras:
        path = folder / f"{camera.name}.png"
        pixels = np.array(Image.open(path))
        pixels[mask > 0] = reflected[mask > 0][:, None]
        pixels[mask == 0] *= around
        Image.fromarray(pixels).save(path)
        Image.fromarray(mask).save(folder / "masks" / f"{camera.name}.jpg", quality=60)
    return read_capture(folder)


def test_what_a_mirror_shows_does_not_count(cameras, tmp_path):
    capture = write(tmp_path, cameras)

    def whole(camera):
        return picture_from(np.array(Image.open(camera.image_path)))

    assert compare_some(capture.cameras, whole).beside > 3
    assert compare_some(capture.cameras, picture_around).beside < 0.5
    assert found_in_surroundings(capture, lambda done: None).refined is None


def test_cameras_that_are_off_are_adjusted_by_what_is_around_the_object(cameras, tmp_path):
    capture = write(tmp_path, cameras, shaken(cameras, 1.0, 0.01))
    told = []
    found = found_in_surroundings(capture, told.append)
    assert found.beside > TOLERATED and found.refined_beside < 0.5
    turn, way = turns_and_ways(found.refined, cameras)
    assert turn < 0.2 and way < 0.01
    assert told == sorted(told) and told[-1] == 1.0


def test_a_check_tells_of_them_where_there_is_something_around(cameras, tmp_path):
    off = shaken(cameras, 1.0, 0.01)
    for around in (True, False):
        (tmp_path / str(around)).mkdir()
        capture = write(tmp_path / str(around), cameras, off, around)
        said = [f.text for f in check(capture).findings if "photos and cameras disagree" in f.text]
        assert bool(said) == around
        assert all("will be adjusted" in text for text in said)


def test_a_fit_begins_with_the_adjusted_cameras_and_goes_on_with_them(cameras, tmp_path):
    from solver.capture.photos import load_photos
    from solver.fit.isolation import isolated
    from solver.job.events import EventStream
    from solver.job.folder import JobFolder
    from solver.job.inputs import capture_of
    from solver.job.progress import Progress
    from solver.job.request import JobRequest
    from solver.job.status import Heartbeat

    (tmp_path / "photos").mkdir()
    write(tmp_path / "photos", cameras, shaken(cameras, 1.0, 0.01))
    job = JobFolder.create(tmp_path / "job", JobRequest(capture=str(tmp_path / "photos")))
    capture, settings = capture_of(job), settings_for("draft")
    events = EventStream(job.events_path)
    progress = Progress(events, Heartbeat(job.status_path), bar=False)

    def begun(settings):
        return isolated(
            job, settings, capture, load_photos(capture), False, progress, lambda done: None
        ).capture

    left = replace(settings, fit=replace(settings.fit, refine_cameras=False))
    assert begun(left).cameras == capture.cameras and not job.cameras_path.exists()
    found = begun(settings)
    assert turns_and_ways(found.cameras, cameras)[0] < 0.2
    assert found.points is None, "masks say where the object is"
    again = capture_of(job)
    for one, other in zip(found.cameras, again.cameras, strict=True):
        np.testing.assert_array_equal(one.camera_to_world, other.camera_to_world)
    assert "were adjusted" in job.events_path.read_text(encoding="utf-8")
