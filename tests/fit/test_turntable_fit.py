"""Fits of objects that were turned before a still camera."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.asset.files import write_exr
from solver.capture.camera import Camera
from solver.capture.capture import Capture, region_seen_by
from solver.capture.formats.transforms import write_transforms
from solver.capture.photos import Photo, read_exr
from solver.capture.turntable import Turntable
from solver.fit import checkpoint
from solver.fit.errors import SettingsError
from solver.fit.load import render_cameras
from solver.fit.presets import settings_for
from solver.fit.render_job import render_job
from solver.fit.settings import Settings
from solver.fit.start import new_trainer
from solver.fit.turned_light import circles_of, turntable_of
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from solver.preflight.turning import turning
from solver.render.image import image_settings, render_view
from solver.render.scene import RenderSettings, StepTables
from tests.capture.test_turntable import carried, photos_of, room, turned_before_cameras
from tests.fit.test_fit import SMALL, resumed
from tests.render.scenes import ball
from tests.render.test_invariance import light_of

SIZE, VIEWS = 32, 12
TURNED = dataclasses.replace(SMALL, light=dataclasses.replace(SMALL.light, turntable="yes"))
STILL = dataclasses.replace(SMALL, light=dataclasses.replace(SMALL.light, turntable="no"))


def lamp(directions):
    """Bright where +x is, and hardly any light elsewhere."""
    return (4 * (directions[..., :1] - 0.5).clamp(min=0) + 0.05).expand(*directions.shape[:-1], 3)


@pytest.fixture(scope="module")
def turned_ball():
    """Photos, with alpha, of a ball that was turned before a camera with a lamp beside it."""
    scene = ball(environment=light_of(lamp), sharpness=2000.0, f0=0.3, roughness=0.3)
    scene.turntable = Turntable(np.eye(3)[2], np.zeros(3), np.eye(3)[0])
    cameras, photos = [], []
    for index, camera in enumerate(turned_before_cameras([(2.6, 0, 0.8)], VIEWS)):
        camera = Camera(f"r_{index}", None, camera.camera_to_world, SIZE, SIZE, 60, 60, 16, 16)
        settings = image_settings(RenderSettings(), secondary_rays=64)
        view = render_view(scene, StepTables.seen_by(camera, scene), settings, camera)
        cameras.append(camera)
        pixels = np.concatenate([view.radiance, view.opacity[..., None]], -1)
        photos.append(Photo(pixels.astype(np.float32), True, True))
    return Capture("memory", tuple(cameras), np.array([[-1.0] * 3, [1.0] * 3])), photos


def started(capture, photos, settings):
    return new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)


def drawn(trainer):
    """Chunks of a step, and the turns of the light that they are under."""
    plan = trainer._plan(1)
    found = trainer.pixels.draw(plan.sizes)
    return trainer.pixels.chunks(plan, found, trainer.random, None), found.turns


def test_a_light_that_turns_explains_what_a_still_one_cannot(turned_ball):
    last = []
    for settings in (TURNED, STILL):
        trainer = started(*turned_ball, settings)
        losses = [trainer.advance(step / 200)["image"] for step in range(200)]
        last.append(np.mean(losses[-10:]))
    assert last[0] < 0.4 * last[1]


def test_a_chunk_has_pixels_of_one_photo_and_the_light_of_that(turned_ball):
    trainer = started(*turned_ball, TURNED)
    chunks, turns = drawn(trainer)
    assert len(chunks) == len(turns) == 4
    assert len({int(chunk.batch.photo[0]) for chunk in chunks}) > 2
    for chunk in chunks:
        photo = chunk.batch.photo[0]
        assert (chunk.batch.photo == photo).all()
        camera = turned_ball[0].cameras[photo]
        expected = trainer.scene.turntable.turn_of(camera)
        np.testing.assert_allclose(turns[chunk.turn], expected, atol=1e-6)


def test_a_still_light_has_no_turns(turned_ball):
    trainer = started(*turned_ball, STILL)
    chunks, turns = drawn(trainer)
    assert trainer.scene.turntable is None and turns == [None]
    assert len(chunks[0].batch.photo.unique()) > 2


def test_a_checkpoint_remembers_the_turntable(turned_ball, tmp_path):
    trainer = started(*turned_ball, TURNED)
    trainer.advance(0.0)
    other, _ = resumed(trainer, tmp_path, *turned_ball)
    torch.testing.assert_close(other.turns, trainer.turns)
    assert other.advance(0.1) == trainer.advance(0.1)


def test_pictures_of_a_turntables_cameras_are_lit_as_its_photos_were(turned_ball):
    capture, photos = turned_ball
    scene = ball(environment=light_of(lamp), sharpness=2000.0, f0=0.3, roughness=0.3)
    scene.turntable = Turntable(np.eye(3)[2], np.zeros(3), np.eye(3)[0])
    settings = dataclasses.replace(Settings(), render=RenderSettings(diffuse_visibility=False))
    for (_, view), photo in zip(
        render_cameras(scene, settings, capture.cameras[:3], 64, neural=1.0),
        photos[:3],
        strict=True,
    ):
        assert np.abs(view.radiance - photo.pixels[..., :3]).mean() < 5e-3


@pytest.fixture
def job(turned_ball, tmp_path):
    """A job that has just begun to fit the turned ball, but knows its lamp, and cameras on two sides."""
    trainer = started(*turned_ball, TURNED)
    with torch.no_grad():
        lit = light_of(lamp, trainer.scene.environment.height)
        trainer.scene.environment.log_radiance.copy_(lit.log_radiance)
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/nowhere"))
    checkpoint.save_checkpoint(trainer, job.checkpoint_dir, 1.0, done=True)
    sides = [
        dataclasses.replace(camera, image_path=Path(f"{camera.name}.png"))
        for camera in turned_ball[0].cameras[:: VIEWS // 2]
    ]
    write_transforms(tmp_path / "cameras.json", sides)
    return job


def brightness(folder):
    return [read_exr(folder / f"r_{index}_linear.exr")[0][..., :3].mean() for index in (0, VIEWS // 2)]


def test_a_light_that_is_given_stands_still(job, tmp_path):
    cameras = tmp_path / "cameras.json"
    render_job(job, cameras, tmp_path / "own", rays=16)
    front, back = brightness(tmp_path / "own")
    assert back == pytest.approx(front, rel=0.1)
    write_exr(tmp_path / "lamp.exr", {"RGB": light_of(lamp).image()})
    render_job(job, cameras, tmp_path / "given", tmp_path / "lamp.exr", rays=16)
    front, back = brightness(tmp_path / "given")
    assert back < 0.5 * front


@pytest.fixture
def saved(tmp_path):
    """Captures with photos on disk: their cameras, and what stands behind the object in each photo."""

    def capture_of(cameras, behind):
        photos = photos_of(behind, noise=0.5)
        found = []
        for index, camera in enumerate(cameras):
            path = tmp_path / f"{index}.png"
            Image.fromarray(photos[index]).save(path)
            found.append(dataclasses.replace(camera, image_path=path, width=48, height=32))
        return Capture(Path("x"), tuple(found), region_seen_by(found))

    return capture_of


def test_a_turntable_is_known_by_circles_and_a_still_background(saved):
    cameras = turned_before_cameras(photos=8)
    before_studio = saved(cameras, lambda index: room(index // 8))
    assert turntable_of(before_studio, "auto") is not None
    assert turntable_of(before_studio, "no") is None
    assert turntable_of(saved(cameras, room), "auto") is None
    assert turntable_of(saved(cameras, room), "yes") is not None


def test_a_check_tells_of_turntables_and_of_what_may_be_one(saved):
    cameras = turned_before_cameras(photos=8)
    (sure,) = turning(circles_of(saved(cameras, lambda index: room(index // 8))))
    assert "the light will go round with the cameras" in sure.text
    (open_question,) = turning(circles_of(saved(cameras, lambda index: np.full((32, 48, 3), 255.0))))
    assert "set Turntable to Yes" in open_question.text
    assert turning(circles_of(saved(cameras, room))) == []
    assert turning(circles_of(saved(carried(16), lambda index: room(0)))) == []


def test_a_still_background_of_carried_cameras_is_no_turntable(saved):
    capture = saved(carried(16), lambda index: room(0))
    assert turntable_of(capture, "auto") is None


def test_a_turntable_before_a_camera_in_a_hand_turns_about_what_is_up():
    cameras = carried(40)
    capture = Capture(Path("x"), tuple(cameras), region_seen_by(cameras))
    table = turntable_of(capture, "yes")
    assert table.axis @ (0, 0, 1) > np.cos(np.radians(2))
    for camera in cameras[::8]:
        x, y, _ = camera.position
        turn = table.turn_of(camera) @ table.turn_of(cameras[0]).T
        angle = np.arctan2(y, x) - np.arctan2(*cameras[0].position[1::-1])
        expected = Rotation.from_rotvec((0, 0, angle)).as_matrix()
        assert np.abs(turn - expected).max() < 0.1


def test_no_turn_can_be_told_where_the_first_photo_is_from_right_above():
    camera = turned_before_cameras()[0]
    above = np.eye(4)
    above[2, 3] = 3.0
    cameras = tuple(dataclasses.replace(camera, camera_to_world=above) for _ in range(3))
    capture = Capture(Path("x"), cameras, np.array([[-1.0] * 3, [1.0] * 3]), up=np.eye(3)[2])
    with pytest.raises(SettingsError, match="light.turntable.*taken from straight above.*choose no"):
        turntable_of(capture, "yes")


def test_the_setting_knows_three_words_and_the_paper_has_no_turntables():
    with pytest.raises(SettingsError, match="auto, yes, no"):
        settings_for("draft", {"light.turntable": "maybe"})
    assert settings_for("paper").light.turntable == "no"
    assert settings_for("draft").light.turntable == "auto"
