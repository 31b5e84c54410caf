"""The solver on CUDA and on Metal, on devices that are pretended: what that finds is told in `pretend`."""

import dataclasses
import json
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from solver.asset.far_light import light_from_afar
from solver.asset.files import write_png
from solver.capture.panorama import Panorama
from solver.fit.batching import RETRACED_MEMORY
from solver.fit.far_light import SeenLight
from solver.fit.presets import settings_for
from solver.fit.preview import over_plain
from solver.fit.reconstruct import run_job
from solver.fit.render_job import compose_jobs, render_job
from solver.fit.start import new_trainer
from solver.fit.time_limit import _SECONDS_BESIDE_A_CARD, finish_within
from solver.job.control import Cancelled
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from solver.kernels.warm_up import compile_kernels
from solver.light.floor import Floor
from solver.render.composition import Placement
from tests.devices.pretend import Placed, pretended, problems
from tests.fit.test_fit import SIZE, ball_capture
from tests.fit.test_method import SMALL_PAPER
from tests.render.scenes import ball

WAYS = [
    pytest.param("cuda", True, id="cuda-warp"),
    pytest.param("cuda", False, id="cuda-torch"),
    pytest.param("mps", False, id="mps-torch"),
]
# Patches of light smaller than a texel, of which single precision leaves noise; and more secondary rays
# than may be traced once more, so that some are chosen.
SMALL = {
    "field.sizes": "16,20", "field.size_starts": "0,0.5", "light.heights": "8,16", "fit.rays": "32",
    "field.hull_cells": "32", "field.occupancy_cells": "16", "field.points_density": "0",
    "render.secondary_rays": "4", "render.retraced_rays": "2", "fit.steps": "4",
    "field.turn_box": "no",
}  # fmt: skip
FITS = {
    "masked": ("draft", {"fit.exposure": "white_balance", "fit.background": "random"}),
    "room": ("draft", {"fit.background": "room", "fit.emission_fade": "0.2,0.4"}),
    "white": ("draft", {"fit.background": "white", "fit.emission_fade": "0.2,0.4"}),
    "rays-share-a-pixel": (
        "standard",
        {"fit.rays": "16", "fit.pixel_grid_start": "0.75", "fit.exposure": "gain",
         "fit.background": "environment"},
    ),
    "turned": ("draft", {"light.turntable": "yes"}),
    "neural": (
        "draft",
        {"fit.neural_start": "1", "fit.neural_fade": "1,1", "render.visibility": "false"},
    ),
    "ablated": (
        "draft",
        {"field.smoothed_normals": "false", "render.integral_image": "false",
         "render.retrace_choice": "noisy"},
    ),
    "paper": ("paper", SMALL_PAPER),
}  # fmt: skip
WITHOUT_MASKS = ("room", "white")
STEPS, REPLAYED = 4, 2


@pytest.fixture(autouse=True)
def a_look_at_the_lights_detail_is_of_one_step(monkeypatch):
    """Each step takes the same way, in plain torch for seconds."""
    monkeypatch.setattr("solver.fit.light_detail.OpenDetail.STEPS", 1)
    monkeypatch.setattr("solver.fit.trainer.STEPS_OF_PIXELS", 1)


def before_grey(photo):
    """The same photo without alpha."""
    pixels = photo.pixels + 0.6 * (1 - photo.pixels[..., 3:])
    pixels[..., 3] = 1
    return dataclasses.replace(photo, pixels=pixels, has_alpha=False)


# Plain torch takes the same way on both devices, so one of them has all fits.
@pytest.mark.parametrize(
    "device, with_warp, fit",
    [
        pytest.param(*way.values, fit, id=f"{way.id}-{fit}")
        for way in WAYS
        for fit in FITS
        if way.id != "cuda-torch" or fit in ("masked", "room", "paper")
    ],
)
def test_a_fit_on_a_card_mixes_nothing_with_the_processor(device, with_warp, fit):
    preset, changes = FITS[fit]
    capture, photos = ball_capture()
    # Some readers give numpy's numbers, which torch takes for doubles.
    cameras = tuple(dataclasses.replace(c, fx=np.float64(c.fx)) for c in capture.cameras)
    capture = dataclasses.replace(capture, cameras=cameras)
    if fit in WITHOUT_MASKS:
        photos = [before_grey(photo) for photo in photos]
    settings = settings_for(preset, SMALL | changes)
    with pretended(device, with_warp):
        trainer = new_trainer(capture, photos, settings, 0, None, device, lambda fraction: None)
        losses = [trainer.advance(step / STEPS)["image"] for step in range(STEPS)]
        if device == "cuda" and with_warp and fit != "turned":
            last = (STEPS - 1) / STEPS
            trainer.batching.recent = [1.0] * RETRACED_MEMORY
            losses += [trainer.advance(last)["image"] for _ in range(REPLAYED)]
            assert trainer.replay.failed is None and trainer.replay.replays
    assert isinstance(trainer.scene.field.density_planes, Placed) and np.isfinite(losses).all()


def test_what_the_processor_does_beside_a_card_takes_its_time_within_a_limit():
    with pretended("cuda"):
        scene = ball().to("cuda")
        limited = finish_within(60, scene, settings_for("draft"))
        assert limited.seconds > _SECONDS_BESIDE_A_CARD
        assert finish_within(None, scene, settings_for("draft")).seconds == 0


@pytest.mark.parametrize("device, with_warp", WAYS)
def test_a_fit_lit_by_a_floor_and_its_far_light_mix_nothing_with_the_processor(device, with_warp):
    capture, photos = ball_capture()
    shown = Panorama(np.full((256, 512, 3), 0.4, np.float32), np.ones((256, 512), bool))
    floor = Floor((0.0, 0.0, 1.0), -0.5, (0.0, 0.0, 0.1))
    light = SeenLight(shown, shown, floor)
    settings = settings_for("draft", SMALL)
    with pretended(device, with_warp):
        trainer = new_trainer(capture, photos, settings, 0, None, device, lambda fraction: None, light)
        losses = [trainer.advance(step / STEPS)["image"] for step in range(STEPS)]
        light = light_from_afar(trainer.scene, list(capture.cameras)).image()
    assert np.isfinite(losses).all() and np.isfinite(light).all()


@pytest.fixture
def ball_folder(tmp_path):
    """`ball_capture` as files: `transforms.json`, and `one.json` with its first camera alone."""
    folder = tmp_path / "capture"
    capture, photos = ball_capture()
    frames = []
    for camera, photo in zip(capture.cameras, photos, strict=True):
        write_png(folder / f"{camera.name}.png", over_plain(photo.pixels))
        write_png(folder / f"{camera.name}.mask.png", np.repeat(photo.pixels[..., 3:], 3, -1))
        frames.append(
            {"file_path": f"{camera.name}.png", "mask_path": f"{camera.name}.mask.png",
             "transform_matrix": camera.camera_to_world.tolist()}
        )  # fmt: skip
    lens = {"fl_x": 60, "fl_y": 60, "cx": SIZE / 2, "cy": SIZE / 2, "w": SIZE, "h": SIZE}
    for name, some in (("transforms", frames), ("one", frames[:1])):
        (folder / f"{name}.json").write_text(json.dumps({**lens, "frames": some}))
    return folder


def run(job, stop_after=None):
    """Run or resume a job, and ask it to stop after some step."""
    progress, control = Mock(), SimpleNamespace(should_stop=False)

    def told(step, *_):
        control.should_stop = step == stop_after

    progress.fit.side_effect = told
    run_job(job, progress, control)


# What is CUDA's own the first has, what plain torch does the other.
@pytest.mark.parametrize("device, with_warp", [WAYS[0], WAYS[2]])
def test_a_job_on_a_card_is_stopped_resumed_baked_rendered_and_composed_with_the_processors(
    device, with_warp, ball_folder, tmp_path
):
    overrides = SMALL | {
        "fit.snapshots": "2", "asset.cells": "24", "asset.triangles": "500",
        "asset.texture_size": "32", "render.pixel_grid": "1", "fit.refine_cameras": "no",
    }  # fmt: skip
    there, here = (
        JobFolder.create(tmp_path / name, JobRequest(str(ball_folder), device=name, overrides=overrides))
        for name in (device, "cpu")
    )
    with pretended(device, with_warp):
        with pytest.raises(Cancelled):
            run(there, stop_after=2)
        run(there)
        with pytest.raises(Cancelled):
            run(here, stop_after=1)
        cameras = ball_folder / "one.json"
        placements = [Placement(), Placement((0.5, 0, 0), 0.5, 0.3)]
        compose_jobs([there, here], placements, cameras, tmp_path / "composed", rays=4)
        render_job(there, cameras, tmp_path / "relit", here.root, rays=4)
    assert there.manifest_path.is_file() and (there.preview_dir / "render.png").is_file()
    for name in ("composed", "relit"):
        assert (tmp_path / name / "r_0.png").is_file()


def test_the_kernels_are_compiled_for_the_card():
    with pretended("cuda"):
        compile_kernels("cuda")


@pytest.mark.parametrize(
    "found, mixed",
    [
        ("aten.add.Tensor", lambda there, here: there + here),
        ("aten.add_.Tensor", lambda there, here: here[0].add_(there[0])),
        ("aten.cat", lambda there, here: torch.cat([there, here])),
        ("aten.index.Tensor", lambda there, here: here[there > 0]),
        ("aten.index_put_", lambda there, here: there.index_put_((there > 0,), here)),
        ("numpy()", lambda there, here: there.numpy()),
        ("__array__()", lambda there, here: np.asarray(there)),
        ("generator", lambda there, here: there.uniform_(generator=torch.Generator())),
        (
            "generator",
            lambda there, here: torch.rand(3, generator=torch.Generator(), device=there.device),
        ),
    ],
)
def test_what_a_card_refuses_is_found_with_its_line(found, mixed):
    with pytest.raises(AssertionError) as error, pretended("cuda"):
        mixed(torch.ones(3, device="cuda"), torch.ones(3))
    (problem,) = problems
    assert found in problem and problem in str(error.value)
    assert "at tests/devices/test_pretended_devices.py:" in problem


def test_metal_has_no_doubles():
    with pytest.raises(AssertionError, match="a double on Metal"), pretended("mps"):
        torch.ones(3).double().to("mps")
    with pretended("mps"):
        assert torch.ones(3).double().to("mps", torch.float32).device.type == "mps"


def test_what_a_card_allows_is_no_problem():
    with pretended("cuda"):
        there, here = torch.ones(3, device="cuda"), torch.ones(3)
        there[:2] = here[:2]
        there[torch.tensor([0, 2])] = torch.tensor(2.0)
        there.copy_(here * there.cpu() + float(there.sum()))
        assert (there * torch.tensor(2.0)).tolist() == [14, 12, 14]
        leaf = here.clone().requires_grad_()
        first, _ = leaf.to("cuda").split([1, 2])
        (there[:1] * first).sum().backward()
        assert not isinstance(leaf.grad, Placed) and leaf.grad.tolist() == [7, 0, 0]
    assert not problems
