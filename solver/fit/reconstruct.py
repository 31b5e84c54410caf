"""A whole job: photos → start → fit → asset → report, resumable at every point."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from .. import __version__
from ..asset.files import remove_parts
from ..asset.from_scene import asset_of, has_finer_photos
from ..capture.capture import Capture
from ..capture.photos import Photo, at_sizes_of, load_photos
from ..capture.placement import counted_from
from ..job.control import Cancelled, Control
from ..job.folder import JobFolder
from ..job.inputs import capture_of, placement_of, region_of
from ..job.progress import Progress
from ..job.request import JobRequest
from ..kernels.backend import fast, trouble_with_warp
from ..kernels.compile_ahead import compile_ahead
from ..replacing import remove_file
from . import checkpoint
from .box import Box
from .clock import FitClock
from .devices import choose_device, device_at_hand
from .exposure import photo_views
from .isolation import Isolated, isolated
from .presets import settings_for
from .preview import write_previews
from .report import write_job_report
from .same_photos import POSES, check_poses, what_changed
from .settings import Settings
from .snapshots import write_figure, write_snapshot
from .start import new_trainer, trainer_for
from .time_limit import finish_within, limit_of_fit, too_few_steps
from .trainer import Trainer
from .visual_hull import not_all_masked

FINDING_SHARE = 0.9
"""of the time in which a fit is begun: finding masks, or sparse points"""
SMOOTHING, LEAST_ERROR = 0.05, 1e-10
"""share of the latest step in the image error that progress tells; and what that is at least (100 dB)"""
PREVIEW_PAUSE = 20.0
"""time between two previews, at least, in times that the last one took"""


def run_job(job: JobFolder, progress: Progress, control: Control, began: float | None = None) -> Path:
    """Run or resume a job to its manifest.

    Args:
        began: when it was asked for, by `time.monotonic`: a time limit counts from there, imports
            included, and what the job took before it was stopped. None: now.

    Raises:
        CaptureError, JobError, SettingsError: bad input.
        Cancelled: asked to stop.
    """
    state = checkpoint.read_state(job.checkpoint_dir)
    began = (time.monotonic() if began is None else began) - (state["seconds"] if state else 0.0)
    try:
        return _run(job, progress, control, began)
    except Cancelled:
        checkpoint.keep_seconds(job.checkpoint_dir, time.monotonic() - began)
        raise


def _run(job: JobFolder, progress: Progress, control: Control, began: float) -> Path:
    """As `run_job`; it began when it would have been, had it never been stopped."""

    def told(done: float, text: str = "") -> None:
        progress.fraction(done, text)
        _stop_if_asked(control)

    request = job.request
    settings = settings_for(request.preset, request.overrides)
    device = device_at_hand(request.device) if job.has_checkpoint() else choose_device(request.device)
    progress.stage("photos")
    if request.device not in ("auto", device):
        progress.warning(f"this machine has no '{request.device}'; the job continues on '{device}'")
    capture = capture_of(job)
    placement = placement_of(request, capture)
    for warning in capture.warnings:
        progress.warning(warning)
    photos = load_photos(
        capture, lambda done, count: told(done / count), settings.photos, settings.photos.most_pixels
    )
    capture = at_sizes_of(photos, capture)
    if settings.fit.use_masks:
        _tell_of_missing_masks(capture, photos, progress)

    progress.stage("compile", "compiling kernels (once on this machine)")
    if fast(torch.empty(0, device=device)):
        compile_ahead(device, told)
    elif device == "cuda":
        progress.warning(
            f"NVIDIA Warp does not run on this card ({trouble_with_warp(device)}), so the fit is slower; "
            "update the card's driver"
        )
    _stop_if_asked(control)

    progress.stage("geometry", "first shape")
    state = checkpoint.read_state(job.checkpoint_dir)
    region = region_of(request)
    if state is not None:
        settings = checkpoint.settings_of(state)
    start = isolated(
        job, settings, capture, photos, state is not None, progress,
        lambda done: told(FINDING_SHARE * done), device,
    )  # fmt: skip
    capture, photos = start.capture, start.photos
    if state is not None:
        scene, state, tensors = checkpoint.load_scene(job.checkpoint_dir, device)
        check_poses(tensors[POSES], [c.seen_from(scene.origin) for c in capture.cameras])
        trainer = trainer_for(scene, capture, photos, settings, request.seed, start.light.held)
        checkpoint.restore(trainer, state, tensors)
        names = [camera.name for camera in capture.cameras]
        changed = what_changed(tensors, trainer.bank.mean_colours, names)
        if changed is not None:
            progress.warning(changed)
    else:
        trainer = _at_start(request, settings, start, region, device, progress, told)
    settings = trainer.settings
    _stop_if_asked(control)

    progress.stage("fit")
    left = None
    if request.time_limit is not None:
        left = request.time_limit - (time.monotonic() - began)
    scene = trainer.scene
    cameras = [camera.seen_from(scene.origin) for camera in capture.cameras]
    finer = has_finer_photos(scene, cameras, settings.asset, settings.field.sizes[-1])
    finish = finish_within(
        request.time_limit, scene, settings, capture.cameras if trainer.fog else (),
        len(cameras) if finer else 0,
    )  # fmt: skip
    if not (state and state["done"]):
        limit = None
        if left is not None:
            limit = limit_of_fit(request.time_limit, left, finish, trainer, progress)
        fit(trainer, job, progress, control, limit, began)
    short_of = too_few_steps(trainer.step, settings.fit.steps, trainer.fog)
    if short_of is not None:
        progress.warning(short_of)
    doubts = trainer.outlines.told([camera.name for camera in capture.cameras])
    if doubts is not None:
        progress.warning(doubts)

    # What is there is not complete from here on, until its manifest is written again.
    remove_file(job.manifest_path)
    remove_parts(job.result_dir)
    progress.stage("asset", "mesh and textures")
    less = finish.what_is_less(settings)
    if less is not None:
        progress.warning(less)
    parts = asset_of(
        scene, settings.render, cameras, job.result_dir,
        replace(settings.asset, texture_size=finish.texture_size), told, job.root.name,
        counted_from(placement, scene.origin),
        photo_views(cameras, photos, trainer.log_gain) if finish.photo_detail else (),
    )  # fmt: skip

    progress.stage("report", "report")
    numbers = {
        "seconds": round(time.monotonic() - began, 1), "steps": trainer.step,
        "photos": len(photos), "triangles": parts.pop("triangles"),
    }  # fmt: skip
    report = write_job_report(
        job, scene, settings, capture, photos, trainer.background, numbers, told, finish.report_pixels
    )
    low, high = Box.of(scene.field).world
    job.write_manifest(
        {
            **parts, "report": report, "bounces": 2,
            "region": {"min": low.tolist(), "max": high.tolist()},
            "origin": scene.origin.tolist(),
            "preset": request.preset, "seed": request.seed, "code_version": __version__,
        }
    )  # fmt: skip
    return job.manifest_path


def _tell_of_missing_masks(capture: Capture, photos: list[Photo], progress: Progress) -> None:
    without = [c.name for c, photo in zip(capture.cameras, photos, strict=True) if not photo.has_alpha]
    if 0 < len(without) < len(photos):
        progress.warning(not_all_masked(without, len(photos)))


def _at_start(
    request: JobRequest, settings: Settings, start: Isolated, region: np.ndarray | None,
    device: str, progress: Progress, told: Callable[[float], None],
) -> Trainer:  # fmt: skip
    trainer = new_trainer(
        start.capture, start.photos, settings, request.seed, region, device,
        lambda done: told(FINDING_SHARE + (1 - FINDING_SHARE) * done), start.light,
    )  # fmt: skip
    if trainer.scene.turntable is not None and settings.light.turntable == "auto":
        progress.warning(
            "the object was turned in front of a still camera, so the light turns with the cameras; if it "
            "was the camera that moved, set Turntable to No (light.turntable=no)"
        )
    return trainer


def fit(
    trainer: Trainer, job: JobFolder, progress: Progress, control: Control,
    limit: float | None, began: float,
) -> None:  # fmt: skip
    """Optimise to the end of the schedule, with previews and checkpoints on the way.

    Args:
        limit: seconds of wall time for this fit, or None to count steps.
        began: when the job did, by `time.monotonic`, or would have, had it never been stopped.

    Raises:
        Cancelled: asked to stop; a checkpoint is written first.
    """
    settings = trainer.settings
    steps = settings.fit.steps
    timer = FitClock(settings, trainer.fraction, limit, trainer.fog, trainer.replay is not None)
    last_preview = last_checkpoint = time.monotonic()
    smooth_error, preview_took = None, 0.0

    def save(now: float, done: bool = False) -> None:
        checkpoint.save_checkpoint(trainer, job.checkpoint_dir, now - began, done=done)
        progress.checkpoint(trainer.step)

    while True:
        now, done = time.monotonic(), timer.fraction(trainer.step)
        if done >= 1:
            break
        terms = trainer.advance(done)
        if trainer.replay is not None and trainer.replay.failed is not None:
            progress.warning(f"steps take longer than they could: {trainer.replay.failed}")
            trainer.replay = None
        if trainer.step in settings.fit.snapshots:
            write_snapshot(trainer, job.root / "snapshots", done)
        # One step's may be below zero, which has no decibels: that of a few pixels, without their noise.
        before = terms["image"] if smooth_error is None else smooth_error
        smooth_error = (1 - SMOOTHING) * before + SMOOTHING * terms["image"]
        psnr = -10 * math.log10(max(smooth_error, LEAST_ERROR))
        left = timer.seconds_left(trainer.step, trainer.renewed)
        progress.fit(trainer.step, steps, done, left, psnr)
        if control.should_stop:
            save(now)
            raise Cancelled
        if now - last_preview > max(settings.fit.preview_every, PREVIEW_PAUSE * preview_took):
            _show(trainer, job, progress)
            last_preview = time.monotonic()
            preview_took = last_preview - now
        if now - last_checkpoint > settings.fit.checkpoint_every:
            # On Windows somebody may have the last one open, and lets go of it before another.
            with suppress(PermissionError):
                save(now)
            last_checkpoint = time.monotonic()
    trainer.finish()
    save(time.monotonic(), done=True)
    _show(trainer, job, progress)
    write_figure(job.root / "snapshots")


def _show(trainer: Trainer, job: JobFolder, progress: Progress) -> None:
    """Write previews; on Windows, those that somebody looks at stay as they are."""
    with suppress(PermissionError):
        write_previews(trainer, job.preview_dir)
        progress.preview("preview/render.png")


def _stop_if_asked(control: Control) -> None:
    if control.should_stop:
        raise Cancelled
