"""Threads with scenes that share memory: the same gradients as one alone, and one optimiser for all."""

import torch

from solver.fit.workers import Workers, sharing
from tests.render.scenes import ball


def work(workers, items):
    """Each item's gradient: that of the density at a point, times the item."""

    def one(worker, item):
        scene = workers.scenes[worker]
        value = item * scene.field.raw_density(torch.full((1, 3), 0.1 * item)).sum()
        value.backward()
        return float(value)

    return workers.run(one, items)


def test_gradients_and_results_do_not_depend_on_the_number_of_workers():
    results, gradients = [], []
    for count in (1, 2, 3):
        workers = Workers(ball(), count)
        results.append(work(workers, [1, 2, 3, 4, 5]))
        workers.gather_gradients()
        gradients.append(workers.scenes[0].field.density_planes.grad)
        others = [p.grad for scene in workers.scenes[1:] for p in scene.parameters()]
        assert all(grad is None or not grad.any() for grad in others)
        workers.close()
    assert results[0] == results[1] == results[2]
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


def test_gathered_twice_each_gradient_counts_once():
    workers = Workers(ball(), 2)
    for _ in range(2):
        work(workers, [1, 2])
        workers.gather_gradients()
        workers.gather_gradients()
    twice = workers.scenes[0].field.density_planes.grad
    once = Workers(ball(), 1)
    work(once, [1, 2])
    torch.testing.assert_close(twice, 2 * once.scenes[0].field.density_planes.grad)
    workers.close()


def test_calls_made_together_give_their_results_in_order():
    for count in (1, 2):
        workers = Workers(ball(), count)
        assert workers.together([lambda i=i: i * i for i in range(5)]) == [0, 1, 4, 9, 16]
        workers.close()


def test_a_workers_error_reaches_the_caller():
    workers = Workers(ball(), 2)

    def fail(worker, item):
        raise ValueError(f"item {item}")

    try:
        workers.run(fail, [1, 2])
    except ValueError as error:
        assert "item" in str(error)
    else:
        raise AssertionError("no error")
    workers.close()
