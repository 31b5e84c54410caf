"""Gradients of a step: of all its chunks, each counted once, wherever numba's threads come from."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import torch

from solver.fit.step import add_gradients
from tests.render.scenes import ball

FIT = """
import numba
from tests.fit import test_fit

trainer, losses, *_ = test_fit.trained(12)
print(numba.threading_layer(), *losses)
"""


class Point(NamedTuple):
    """A chunk that is one point."""

    at: float
    turn: int = 0


class DensityThere:
    """A loss: the raw density at each point, times how far along it is; and a little of the light."""

    def accumulate(self, scene, tables, chunk):
        there = torch.full((1, 3), 0.1 * chunk.at)
        value = chunk.at * scene.field.raw_density(there).sum()
        normals = scene.field.normals(there, tables.normals)
        (value + normals.sum() + chunk.at * tables.light.irradiance.sum()).backward()
        return float(value.detach())


def gradients_of(scene):
    return [p.grad for p in scene.parameters() if p.grad is not None and p.grad.any()]


def test_the_gradients_of_a_step_are_those_of_all_its_chunks():
    chunks = [Point(float(n)) for n in range(1, 6)]
    at_once, in_turn = ball(), ball()
    found = add_gradients(at_once, DensityThere(), chunks)
    assert found == [add_gradients(in_turn, DensityThere(), [chunk])[0] for chunk in chunks]
    # Planes and lines of the density, and the light.
    assert len(gradients_of(at_once)) == 3
    torch.testing.assert_close(gradients_of(at_once), gradients_of(in_turn))


def test_over_two_steps_each_gradient_counts_once():
    twice, once = ball(), ball()
    for _ in range(2):
        add_gradients(twice, DensityThere(), [Point(1.0), Point(2.0)])
    add_gradients(once, DensityThere(), [Point(1.0), Point(2.0)])
    expected = [2 * gradient for gradient in gradients_of(once)]
    torch.testing.assert_close(gradients_of(twice), expected)


@pytest.mark.parametrize("turned", [0, 1])
def test_each_chunk_is_under_its_own_turn_of_the_light(turned):
    class Under:
        def accumulate(self, scene, tables, chunk):
            harmonics = tables.light.irradiance[0]
            harmonics.sum().backward()
            return harmonics.detach().clone()

    scene = ball()
    with torch.no_grad():
        scene.environment.log_radiance[:, :, :8] += 2.0
    quarter = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turns = (None, quarter)
    both = add_gradients(scene, Under(), [Point(1.0, 0), Point(1.0, 1)], turns)
    (alone,) = add_gradients(scene, Under(), [Point(1.0)], (turns[turned],))
    torch.testing.assert_close(both[turned], alone)
    assert not torch.allclose(both[0], both[1])


def test_a_fit_runs_on_any_of_numbas_threads_and_finds_the_same():
    """macOS and Windows may have nothing but numba's workqueue."""
    found = {}
    for layer in ("omp", "workqueue"):
        fit = subprocess.run(
            [sys.executable, "-c", FIT], cwd=Path(__file__).parents[2], capture_output=True,
            text=True, timeout=300,
            env={**os.environ, "NUMBA_THREADING_LAYER": layer, "NUMBA_NUM_THREADS": "2"},
        )  # fmt: skip
        if layer == "omp" and "No threading layer" in fit.stderr:
            pytest.skip("numba finds no OpenMP here")
        assert fit.returncode == 0, fit.stderr
        taken, *losses = fit.stdout.split()
        assert taken == layer
        found[layer] = [float(loss) for loss in losses]
    for losses in found.values():
        assert losses == pytest.approx(found["workqueue"], rel=1e-4)
        assert losses[-1] < losses[0]
