"""Threads with scenes that share memory: the same gradients as one alone, and one optimiser for all."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import pytest
import torch

from solver.fit.workers import Workers, sharing, worker_count
from solver.kernels.backend import forced_path
from tests.render.scenes import ball

FIT = """
import dataclasses
import numba
from solver.kernels.warm_up import compile_kernels
from tests.fit import test_fit

compile_kernels("cpu")
in_two = dataclasses.replace(test_fit.SMALL.fit, chunk_rays=128)
test_fit.SMALL = dataclasses.replace(test_fit.SMALL, fit=in_two)
trainer, losses, *_ = test_fit.trained(2)
print(numba.threading_layer(), len(trainer.workers.scenes), len(losses))
"""


@pytest.fixture
def threads_may_run_kernels():
    ball().field.raw_density(torch.zeros(1, 3))  # until then numba has not chosen
    if numba.threading_layer() == "workqueue":
        pytest.skip("numba's workqueue ends a process in which two threads run kernels at once")


def test_kernels_of_warp_are_run_by_one_thread_on_the_processor_too(threads_may_run_kernels):
    """Nothing says that two may launch one for the first time at once."""
    cpu = torch.device("cpu")
    assert worker_count(cpu) == numba.get_num_threads()
    with forced_path("warp"):
        assert worker_count(cpu) == 1


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


def points(count):
    return [Point(float(n)) for n in range(1, count + 1)]


def gradients_of(scene):
    return [p.grad for p in scene.parameters() if p.grad is not None and p.grad.any()]


@pytest.mark.usefixtures("threads_may_run_kernels")
def test_gradients_and_results_do_not_depend_on_the_number_of_workers():
    results, gradients = [], []
    for count in (1, 2, 3):
        workers = Workers(ball(), DensityThere(), count)
        results.append(workers.gradients(points(5)))
        gradients.append(gradients_of(workers.scenes[0]))
        others = [p.grad for scene in workers.scenes[1:] for p in scene.parameters()]
        assert all(grad is None or not grad.any() for grad in others)
        workers.close()
    assert results[0] == results[1] == results[2]
    # Planes and lines of the density, and the light.
    assert len(gradients[0]) == 3
    for other in gradients[1:]:
        torch.testing.assert_close(other, gradients[0])


def test_a_sharing_scene_sees_every_change_but_has_its_own_gradients():
    scene = ball()
    other = sharing(scene)
    with torch.no_grad():
        scene.field.density_planes.add_(1)
    scene.occupancy.fill(torch.zeros_like(scene.occupancy.occupied), scene.occupancy.optical_depth)
    assert torch.equal(other.field.density_planes, scene.field.density_planes)
    assert other.occupancy.occupied.sum() == 0
    other.field.raw_density(torch.rand(4, 3)).sum().backward()
    assert scene.field.density_planes.grad is None
    assert other.environment is not scene.environment


@pytest.mark.usefixtures("threads_may_run_kernels")
def test_over_two_steps_each_gradient_counts_once():
    workers, alone = Workers(ball(), DensityThere(), 2), Workers(ball(), DensityThere(), 1)
    for _ in range(2):
        workers.gradients(points(2))
    alone.gradients(points(2))
    twice, once = gradients_of(workers.scenes[0]), gradients_of(alone.scenes[0])
    torch.testing.assert_close(twice, [2 * gradient for gradient in once])
    workers.close()


def test_calls_made_together_give_their_results_in_order():
    for count in (1, 2):
        workers = Workers(ball(), DensityThere(), count)
        assert workers.together([lambda i=i: i * i for i in range(5)]) == [0, 1, 4, 9, 16]
        workers.close()


def test_a_workers_error_reaches_the_caller():
    class Failing:
        def accumulate(self, scene, tables, chunk):
            raise ValueError(f"chunk {chunk.at}")

    workers = Workers(ball(), Failing(), 2)
    with pytest.raises(ValueError, match="chunk"):
        workers.gradients(points(2))
    workers.close()


@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_a_fit_has_threads_of_its_own_only_where_numbas_may_be_shared(layer):
    """macOS and Windows may have nothing but numba's workqueue, which would end the process."""
    fit = subprocess.run(
        [sys.executable, "-c", FIT], cwd=Path(__file__).parents[2], capture_output=True, text=True,
        env={**os.environ, "NUMBA_THREADING_LAYER": layer, "NUMBA_NUM_THREADS": "2"}, timeout=300,
    )  # fmt: skip
    if layer == "omp" and "No threading layer" in fit.stderr:
        pytest.skip("numba finds no OpenMP here")
    assert fit.returncode == 0, fit.stderr
    assert fit.stdout.split() == [layer, "1" if layer == "workqueue" else "2", "2"]
