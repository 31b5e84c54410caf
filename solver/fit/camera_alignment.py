"""Cameras that fit cut-out photos better: poses measured by a phone are some tenths of a degree off.

A field of plain colours is fitted to small photos for a moment; then each photo is laid over what is seen
of that with its camera, which moves as `image_alignment` says; and so on, for the field blurs less each
time. Bundle-adjusting radiance fields (Lin et al. 2021, doi:10.1109/ICCV48922.2021.00569) go down the
loss's gradient with cameras, too; taking turns needs some ten steps of each instead of thousands.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.photos import Photo, at_sizes_of
from ..capture.placement import far_origin, seen_from
from ..render.arrays import floats_on
from ..render.radiance import render_rays
from ..render.random_numbers import RandomNumbers
from ..render.scene import RenderSettings, StepTables
from .image_alignment import Evidence, comparable, evidence, moved
from .mask_outlines import masks_of
from .outline_gap import made_small, outline_gap
from .ray_bank import camera_space_directions
from .settings import FieldSettings, FitSettings, LightSettings, Settings
from .start import new_trainer, telling
from .trainer import Trainer

OUTLINES_FIT, CAMERAS_FIT = 0.06, 0.12
"""pixels up to which outlines may lie outside of the hull, and cameras stay: right ones would move by up to
0.1, for plain colours lack lustre"""
BETTER = 0.9
"""of the pixels from outlines to the hull that may be left"""
FEWEST_PHOTOS = 8
WORTH_BEGINNING = 20
"""times as long as a look at outlines took that there has to be: the first round takes about ten"""
QUICK = Settings(
    field=FieldSettings(sizes=(96,), size_starts=(0.0,), carve_hollows=False, turn_box=False),
    light=LightSettings(heights=(8,), turntable="no", smoothness=0.0, colour_smoothness=0.0),
    render=RenderSettings(pixel_grid=1),
    fit=FitSettings(
        background="white", emission_fade=(2.0, 2.0), grey_light_weight=0.0, doubt_outlines=False
    ),
)
"""all emission: no light, no materials"""
STEPS, ROUNDS = 30, 10
ENOUGH = 0.05
"""pixels that cameras still move by when no other round is worth its time"""
INDEPENDENT = 0.02
"""share of what pixels say that counts: neighbours err alike, and colours lack lustre"""
FURTHER = 1.7
"""times as far as what a step says: the field holds cameras back, for it blurs to fit where they were"""
FIRST_GUESS = 0.01
"""by how much cameras may be off at first, rad and shares of the object's distance"""
LIKELY = np.array([1, 1, 1, 1, 1, 0.1])
"""of a motion, as shares of that guess: masks that are too wide or narrow look like one along the view"""


class _View(NamedTuple):
    """A small photo, and what stays the same of it while its camera moves."""

    shown: np.ndarray  # [H, W, 4], as `comparable` has it
    near: np.ndarray  # [H, W] bool: the object may be there
    told: np.ndarray | None  # [H, W] bool; None: everywhere
    directions: np.ndarray  # [H, W, 3] unit, in camera axes
    away: float  # the object's distance, world units


class Aligned(NamedTuple):
    """Cameras that were moved, and pixels of their photos from outlines to the hull before and then."""

    cameras: list[Camera]
    before: float
    after: float


def aligned(
    capture: Capture, photos: list[Photo], region: np.ndarray | None, seed: int, device: str,
    told: Callable[[float], None], seconds: float,
) -> Aligned | None:  # fmt: skip
    """Cameras in the same world that fit photos with alpha better; None: they fit, or it cannot be told.

    Args:
        region: [2, 3] world box given by the person, or None.
        told: is told the share done; what it raises ends the work.
        seconds: that it should take, at most.
    """
    if len(photos) < FEWEST_PHOTOS or any(camera.is_panoramic for camera in capture.cameras):
        return None
    origin = far_origin(capture)
    small, factor = made_small(photos)
    near = at_sizes_of(small, seen_from(capture, origin))
    if region is not None:
        near = replace(near, region=np.asarray(region, dtype=np.float64) - origin)

    def gap(cameras: list[Camera]) -> float | None:
        return outline_gap(cameras, lambda: masks_of(small), near.region)

    began = time.monotonic()
    before = gap(list(near.cameras))
    is_in_time = WORTH_BEGINNING * (time.monotonic() - began) <= seconds
    if before is None or before < OUTLINES_FIT or not is_in_time:
        return None
    try:
        found = _motions(near, small, seed, device, told, seconds)
    except CaptureError:  # outlines of small photos have nothing in common
        return None
    if found is None:
        return None
    motions, away = found
    after = gap(_all_moved(near.cameras, motions, away))
    if after is None or after > BETTER * before:
        return None
    return Aligned(_all_moved(capture.cameras, motions, away), before / factor, after / factor)


def _all_moved(cameras: tuple[Camera, ...], motions: np.ndarray, away: np.ndarray) -> list[Camera]:
    return [moved(*each) for each in zip(cameras, motions, away, strict=True)]


def _motions(
    capture: Capture, photos: list[Photo], seed: int, device: str, told: Callable[[float], None],
    seconds: float,
) -> tuple[np.ndarray, np.ndarray] | None:  # fmt: skip
    """Motions [P, 6] of cameras (see `image_alignment`), and how far away the object is of each [P]; None:
    they stay."""
    began = time.monotonic()
    start = new_trainer(capture, photos, QUICK, seed, None, device, lambda done: told(0.1 * done))
    trainer = Trainer(start.scene, start.bank, start.settings, seed, True, start.background, fog=True)
    trainer.replay = None
    centre = start.scene.field.centre.cpu().numpy().astype(np.float64)
    away = np.array([np.linalg.norm(camera.position - centre) for camera in capture.cameras])
    views = [_view_of(*each) for each in zip(capture.cameras, photos, away, strict=True)]
    motions, guess, cameras = np.zeros((len(photos), 6)), FIRST_GUESS, list(capture.cameras)
    for done in range(ROUNDS):
        round_began = time.monotonic()
        for step in range(STEPS):
            trainer.advance((done + step / STEPS) / ROUNDS)
            told(0.1 + 0.9 * (done + 0.5 * step / STEPS) / ROUNDS)
        trainer.refresh_occupancy()
        tables = StepTables.of(trainer.scene)
        found = [_evidence(trainer, tables, *each) for each in zip(cameras, views, strict=True)]
        before = motions
        motions, guess = _better(motions, found, guess)
        shifts = _shifts(found, motions - before)
        if done == 0 and shifts < CAMERAS_FIT:
            return None
        cameras = _all_moved(capture.cameras, motions, away)
        trainer.bank.stand(cameras)
        now = time.monotonic()
        if shifts < ENOUGH or now - began + (now - round_began) > seconds:
            break
    return (motions, away) if _shifts(found, motions) >= CAMERAS_FIT else None


def _shifts(found: list[Evidence | None], motions: np.ndarray) -> float:
    """By how many pixels motions [P, 6] shift the object, the median of photos that show it."""
    told = [e.pixels(motion) for e, motion in zip(found, motions, strict=True) if e is not None]
    return float(np.median(told)) if told else 0.0


def _better(motions: np.ndarray, found: list[Evidence | None], guess: float) -> tuple[np.ndarray, float]:
    """Motions [P, 6] after what was found with them, and how large they are likely to be.

    The most likely ones, if each number is off by `guess` times `LIKELY` in the root mean square; which is
    what that was for all, with how uncertain they are (expectation maximisation). What all cameras have in
    common is taken away, for the field follows it.
    """
    motions, variances, pull = motions.copy(), [], 1 / (guess * LIKELY) ** 2
    for index, told in enumerate(found):
        if told is None:
            continue
        variance = np.linalg.inv(INDEPENDENT * told.information + np.diag(pull))
        motions[index] += FURTHER * variance @ (INDEPENDENT * told.towards - pull * motions[index])
        variances.append(np.diag(variance))
    motions -= motions.mean(0)
    uncertain = np.mean(variances) if variances else 0.0
    return motions, float(np.sqrt((motions**2).mean() + uncertain) / np.sqrt((LIKELY**2).mean()))


def _view_of(camera: Camera, photo: Photo, away: float) -> _View:
    near = telling(photo)
    directions = camera_space_directions(camera).numpy().reshape(*near.shape, 3).astype(np.float64)
    return _View(comparable(photo.pixels), near, photo.told, directions, away)


@torch.no_grad()
def _evidence(trainer: Trainer, tables: StepTables, camera: Camera, view: _View) -> Evidence | None:
    scene, near = trainer.scene, view.near
    rows, columns = np.nonzero(near)
    if len(rows) == 0:
        return None
    rays = floats_on(scene.device, *camera.rays(columns + 0.5, rows + 0.5))
    seen = render_rays(
        scene, tables, trainer.loss.render_settings(trainer.fraction), RandomNumbers(0, scene.device),
        *rays, torch.arange(len(rows), device=scene.device), jitter=False,
        pixel_angle=rays[0].new_full((len(rows),), camera.pixel_angle),
    )  # fmt: skip

    def picture(*values: torch.Tensor) -> np.ndarray:
        flat = torch.cat([value.view(len(rows), -1) for value in values], 1).cpu().numpy()
        whole = np.zeros((*near.shape, flat.shape[1]), np.float32)
        whole[rows, columns] = flat
        return whole

    rendered = picture(seen.radiance, seen.opacity)
    return evidence(
        view.shown, comparable(rendered), rendered[..., 3], picture(seen.distance)[..., 0],
        view.directions, view.away, view.told,
    )  # fmt: skip
