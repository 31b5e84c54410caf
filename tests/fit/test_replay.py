"""Steps replayed as graphs: reserved lengths change nothing, nothing waits, and what cannot be a graph is none."""

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from solver.fit import replay
from solver.fit.presets import settings_for
from solver.fit.replay import SPARE, Replay, StepPlan, replay_for
from solver.fit.start import new_trainer
from solver.kernels.backend import forced_path
from solver.kernels.flat_form import offsets_of
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_method import SMALL_PAPER
from tests.kernels.paths import WITHOUT_CARD

SETTINGS = {"draft": SMALL, "paper": settings_for("paper", SMALL_PAPER)}
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


class CalledAgain:
    """A graph that is none: it does what is asked for once more, which may wait for nothing."""

    def __init__(self, call, pool):
        self.call = call

    def replay(self):
        with NoWaiting():
            return self.call()


@pytest.fixture
def on_the_processor(monkeypatch):
    """Graphs of `CalledAgain` for Warp's processor device."""
    monkeypatch.setattr(replay, "stream_and_pool", lambda device: (None, None))
    monkeypatch.setattr(Replay, "make_graph", CalledAgain)
    with forced_path("warp"):
        yield


def trainer_on(device, settings, replayed, **options):
    capture, photos = ball_capture()
    trainer = new_trainer(
        capture, photos, settings, 0, None, device, lambda fraction: None, **options
    )
    trainer.replay = Replay(trainer.scene.device) if replayed else None
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
def test_gradients_of_steps_that_are_replayed_are_those_of_others(preset, on_the_processor):
    ordinary, trainer = (
        trainer_on("cpu", SETTINGS[preset], replayed) for replayed in (False, True)
    )
    for some in (ordinary, trainer):
        some.fraction = 0.6
    trainer._begin_period(1)
    ordinary._plan = lambda grid: trainer.replay.plan
    for step in range(4):
        expected, result = gradients(ordinary, step), gradients(trainer, step)
        assert trainer.replay.replays == (step > 0) and trainer.replay.failed is None
        assert result[1] == pytest.approx(expected[1], rel=1e-4)
        for one, other in zip(result[0], expected[0], strict=True):
            assert (one - other).norm() <= 1e-2 * other.norm()


@pytest.mark.parametrize("preset", list(SETTINGS))
@WITHOUT_CARD
def test_gradients_of_a_graph_on_a_card_are_those_of_ordinary_steps(preset):
    ordinary, trainer = (
        trainer_on("cuda", SETTINGS[preset], replayed) for replayed in (False, True)
    )
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
            assert (one - other).norm() <= 2e-2 * other.norm()


def found(*counts):
    """What a step does that has flat forms of so many items."""

    def compute(values):
        for count in counts:
            offsets_of(torch.tensor([count]))
        return [values.sum()]

    return compute


PLAN = StepPlan([4], 1, [0], 0.5)
VALUES = torch.arange(3.0)


def test_a_period_has_an_ordinary_step_and_then_graphs(on_the_processor):
    replay = Replay(torch.device("cpu"))
    for _ in range(2):
        replay.begin(PLAN)
        assert replay.run(found(5), VALUES) == ([3], True) and not replay.replays
        for factor in (2, 3):
            assert replay.run(found(5), factor * VALUES) == ([3 * factor], False) and replay.replays


def test_lengths_are_by_the_most_that_was_seen_in_the_period_before(on_the_processor):
    replay = Replay(torch.device("cpu"))
    most = []
    for count, later in ((100, 900), (100, 100), (100, 100)):
        replay.begin(StepPlan([4], 1, [0], 0.5))
        replay.run(found(count), VALUES)
        replay.run(found(later), VALUES)
        most.append(replay._lengths[0])
    assert most == [120 + SPARE, 1080 + SPARE, 120 + SPARE]


def test_a_step_that_does_other_things_than_the_first_one_is_no_graph(
    on_the_processor, monkeypatch
):
    class Captured(CalledAgain):
        def __init__(self, call, pool):
            super().__init__(call, pool)
            call()

    monkeypatch.setattr(Replay, "make_graph", Captured)
    replay = Replay(torch.device("cpu"))
    replay.begin(PLAN)
    for counts in ((5,), (5, 5), (5,)):
        assert replay.run(found(*counts), VALUES) == ([3], True)
    assert not replay.replays and replay.failed is None
    replay.begin(StepPlan([4], 1, [0], 0.6))
    replay.run(found(5), VALUES)
    replay.run(found(5), VALUES)
    assert replay.replays


def test_where_no_graph_can_be_made_steps_go_on_one_by_one(on_the_processor, monkeypatch):
    def out_of_memory(call, pool):
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(Replay, "make_graph", staticmethod(out_of_memory))
    trainer = trainer_on("cpu", SMALL, True)
    losses = [trainer.advance(0.6)["image"] for _ in range(5)]
    assert trainer.replay.failed == "CUDA out of memory" and np.isfinite(losses).all()


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
