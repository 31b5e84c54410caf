"""Steps replayed as graphs: reserved lengths change nothing, nothing waits, and what cannot be a graph is none."""

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from solver.fit import replay
from solver.fit.batching import RETRACED_MEMORY, Batching
from solver.fit.card import Card
from solver.fit.presets import settings_for
from solver.fit.replay import SPARE, Replay, replay_for
from solver.fit.start import new_trainer
from solver.fit.step import StepPlan
from solver.fit.trainer import HELD
from solver.kernels.backend import forced_path
from solver.kernels.flat_form import is_reserved, offsets_of
from tests.devices import pretend
from tests.devices.test_pretended_devices import before_grey
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_method import SMALL_PAPER
from tests.kernels.paths import WITHOUT_CARD
from tests.kernels.test_flat_form import COUNTS

SETTINGS = {"draft": SMALL, "paper": settings_for("paper", SMALL_PAPER)}
FEW = {
    "field.sizes": "24,32", "field.size_starts": "0,0.5", "light.heights": "16,32", "fit.rays": "64",
    "field.hull_cells": "32", "field.occupancy_cells": "32", "render.secondary_rays": "4",
    "field.turn_box": "no",
}  # fmt: skip
WAITING = {
    "_local_scalar_dense",
    "nonzero",
    "masked_select",
    "unique2",
    "_unique2",
    "bincount",
    "equal",
}
"""operations for whose results the processor waits, which no graph may have"""


class NoWaiting(TorchDispatchMode):
    """Refuses what a stream of a card that is captured would."""

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        name = operation.overloadpacket.__name__
        masks = [a for a in torch.utils._pytree.tree_leaves(args) if isinstance(a, torch.Tensor)]
        if name in ("index", "index_put_") and any(m.dtype == torch.bool for m in masks[1:]):
            raise RuntimeError(f"{name} by a mask waits")
        if name in WAITING:
            raise RuntimeError(f"{name} waits")
        return operation(*args, **(kwargs or {}))


class CalledAgain(pretend.CalledAgain):
    """A graph that is none: it does once more what is asked for, which may wait for nothing."""

    def replay(self):
        with NoWaiting():
            return self._call()


class Processor(pretend.PretendedCard):
    """A card that is none."""

    graph = CalledAgain


@pytest.fixture
def on_the_processor(monkeypatch):
    """Graphs of `CalledAgain` for Warp's processor device."""
    monkeypatch.setattr(replay, "Card", Processor)
    with forced_path("warp"):
        yield


def trainer_on(device, settings, replayed, **options):
    capture, photos = ball_capture()
    trainer = new_trainer(capture, photos, settings, 0, None, device, lambda fraction: None, **options)
    trainer.replay = Replay(trainer.scene.device) if replayed else None
    trainer.batching.recent, trainer.batching.rays_per_sample = [1.0] * RETRACED_MEMORY, 0.01
    return trainer


def gradients(trainer, step):
    """Gradients and image loss of a step, and nothing moved."""
    trainer.step = step
    found, _ = trainer._gradients(trainer._begin_period(1))
    gradients = []
    for parameter in trainer.scene.parameters():
        if parameter.grad is not None:
            gradients.append(parameter.grad.cpu().clone())
            parameter.grad.zero_()
    return gradients, float(found[0].image)


@pytest.mark.parametrize("preset", list(SETTINGS))
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=WITHOUT_CARD)])
def test_gradients_of_steps_that_are_replayed_are_those_of_others(device, preset, request):
    if device == "cpu":
        request.getfixturevalue("on_the_processor")
    ordinary, trainer = (trainer_on(device, SETTINGS[preset], replayed) for replayed in (False, True))
    for some in (ordinary, trainer):
        some.fraction = 0.6
    trainer._begin_period(1)
    ordinary._plan = lambda grid: trainer.replay.plan
    for step in range(4):
        with trainer.replay.stream():
            expected, result = gradients(ordinary, step), gradients(trainer, step)
        assert trainer.replay.replays == (step > 0) and trainer.replay.failed is None
        assert result[1] == pytest.approx(expected[1], rel=1e-3)
        for one, other in zip(result[0], expected[0], strict=True):
            assert (one - other).norm() <= 1e-2 * other.norm()


def found(*counts):
    """What a step does that has flat forms of so many items."""

    def compute(values):
        for count in counts:
            offsets_of(torch.tensor([count]))
        return [values.sum()]

    return compute


def nothing():
    """Undoes nothing."""


PLAN = StepPlan([4], 1, [0], 0.5)
VALUES = torch.arange(3.0)


def test_a_period_has_an_ordinary_step_and_then_graphs(on_the_processor):
    replay = Replay(torch.device("cpu"))
    for _ in range(2):
        replay.begin(PLAN)
        assert replay.run(found(5), nothing, VALUES) == ([3], True) and not replay.replays
        for factor in (2, 3):
            assert (
                replay.run(found(5), nothing, factor * VALUES) == ([3 * factor], False) and replay.replays
            )


def test_lengths_are_by_the_most_that_was_seen_in_the_period_before(on_the_processor):
    replay = Replay(torch.device("cpu"))
    most = []
    for count, later in ((100, 900), (100, 100), (100, 100)):
        replay.begin(StepPlan([4], 1, [0], 0.5))
        replay.run(found(count), nothing, VALUES)
        replay.run(found(later), nothing, VALUES)
        most.append(replay._lengths[0])
    assert most == [120 + SPARE, 1080 + SPARE, 120 + SPARE]


def test_a_step_that_does_other_things_than_the_first_one_is_no_graph(on_the_processor, monkeypatch):
    class Recorded(CalledAgain):
        def __init__(self, call):
            super().__init__(call)
            call()

    monkeypatch.setattr(Processor, "graph", Recorded)
    replay = Replay(torch.device("cpu"))
    replay.begin(PLAN)
    for counts in ((5,), (5, 5), (5,)):
        assert replay.run(found(*counts), nothing, VALUES) == ([3], True)
    assert not replay.replays and replay.failed is None
    replay.begin(StepPlan([4], 1, [0], 0.6))
    replay.run(found(5), nothing, VALUES)
    replay.run(found(5), nothing, VALUES)
    assert replay.replays


def test_where_no_graph_can_be_made_steps_go_on_one_by_one(on_the_processor, monkeypatch):
    def out_of_memory(call):
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(Processor, "graph", staticmethod(out_of_memory))
    trainer = trainer_on("cpu", SMALL, True)
    losses = [trainer.advance(0.6)["image"] for _ in range(5)]
    assert trainer.replay.failed == "CUDA out of memory" and np.isfinite(losses).all()


def test_where_memory_ends_in_an_ordinary_step_it_is_taken_from_graphs_and_the_step_made_again(
    on_the_processor,
):
    replay, undone = Replay(torch.device("cpu")), []

    def short(values):
        if replay.failed is None:
            raise torch.OutOfMemoryError("CUDA out of memory")
        return [values.sum()]

    replay.begin(PLAN)
    assert replay.run(short, lambda: undone.append(1), VALUES) == ([3], True)
    assert undone == [1] and replay.failed == "CUDA out of memory"


def test_gradients_of_a_step_that_came_to_nothing_are_cleared():
    trainer = trainer_on("cpu", SMALL, False)
    trainer._gradients(trainer._plan(1))
    assert any(p.grad is not None and p.grad.any() for p in trainer.scene.parameters())
    trainer.optimiser.clear()
    assert not any(p.grad is not None and p.grad.any() for p in trainer.scene.parameters())


WHOLE = {
    "masked": {"fit.pixel_grid_start": "0.8", "render.pixel_grid": "2", "fit.exposure": "gain"},
    "fog": {"fit.background": "white", "fit.emission_fade": "0.2,0.4"},
    "room": {"fit.background": "room", "fit.emission_fade": "0.2,0.4"},
}


@pytest.mark.parametrize("fit", list(WHOLE))
def test_a_whole_fit_that_is_replayed_learns_what_an_ordinary_one_does(fit, on_the_processor):
    """Through all that a fit changes: grids, light, probes, rays a pixel, occupancy, fog to surface."""
    capture, photos = ball_capture()
    if fit != "masked":
        photos = [before_grey(photo) for photo in photos]
    settings = settings_for("draft", FEW | WHOLE[fit])
    losses = []
    for replayed in (False, True):
        trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
        trainer.replay = Replay(trainer.scene.device) if replayed else None
        trainer.OCCUPANCY_EVERY, replays = 8, 0
        told = []
        for step in range(48):
            told.append(trainer.advance(step // 6 / 8)["image"])
            replays += replayed and trainer.replay.replays
        assert np.isfinite(told).all() and replays >= 20 * replayed
        losses.append(np.mean(told[-8:]))
    assert losses[1] == pytest.approx(losses[0], rel=0.1)


def test_a_period_ends_where_the_fit_has_gone_on(on_the_processor):
    trainer = trainer_on("cpu", SMALL, True)
    plans = []
    for fraction in (0.6, 0.6, 0.601, 0.601 + 2 * HELD, 0.601 + 2 * HELD):
        trainer.advance(fraction)
        plans.append(trainer.replay.plan.fraction)
    assert plans == [0.6, 0.6, 0.6, 0.601 + 2 * HELD, 0.601 + 2 * HELD]


def test_batches_that_are_not_yet_settled_are_not_replayed(on_the_processor):
    trainer = trainer_on("cpu", SETTINGS["paper"], True)
    trainer.batching.recent = []
    for _ in range(RETRACED_MEMORY + 2):
        settled = trainer.batching.settled
        trainer.advance(0.01)
        assert trainer.replay.replays == settled
    assert settled and Batching(SETTINGS["draft"].fit, 512).settled


def test_a_fit_that_is_replayed_tells_of_the_step_before_and_ends_without_graphs(on_the_processor):
    trainer = trainer_on("cpu", SMALL, True)
    told = [trainer.advance(0.6)["image"] for _ in range(4)]
    assert told[0] == told[1] and len(set(told[1:])) == 3
    trainer.finish()
    assert trainer.replay is None


def test_on_the_processor_nothing_is_replayed():
    with forced_path("warp"):
        assert replay_for(torch.device("cpu")) is None


@pytest.mark.parametrize(
    "wait",
    [lambda v: float(v.sum()), lambda v: v.nonzero(), lambda v: v[v > 0], lambda v: v.unique()],
)
def test_what_waits_is_refused_within_a_graph(wait):
    with NoWaiting(), pytest.raises(RuntimeError, match="waits"):
        wait(VALUES)


@WITHOUT_CARD
@pytest.mark.parametrize("wait", [False, True])
def test_a_recording_that_fails_on_a_card_leaves_it_as_it_was(wait):
    device = torch.device("cuda", 0)
    replay, values = Replay(device), torch.arange(3.0, device=device)

    def compute(values, counts):
        offsets_of(counts)
        if replay.plan is PLAN and is_reserved():
            if wait:
                float(values.sum())
            else:
                offsets_of(counts)
        return [2 * values.sum()]

    with replay.stream():
        for plan in (StepPlan([4], 1, [0], 0.4), PLAN, StepPlan([4], 1, [0], 0.6)):
            replay.begin(plan)
            for factor in (1, 2, 3):
                found, _ = replay.run(compute, nothing, factor * values, COUNTS.to(device))
                assert float(found[0]) == 6 * factor
            assert replay.replays == (plan is not PLAN and not (wait and plan.fraction == 0.6))
        assert (replay.failed is not None) == wait
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        again = values + 1
    graph.replay()
    assert again.tolist() == [1, 2, 3]


@WITHOUT_CARD
def test_on_a_card_numbers_are_told_a_step_late():
    card = Card(torch.device("cuda", 0))
    values = torch.tensor([3.0, 5.0, 7.0, 9.0], device="cuda")
    assert [card.told_before(value) for value in values] == [3, 3, 5, 7]
