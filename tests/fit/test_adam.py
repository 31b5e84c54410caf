"""The optimiser's steps, smoothed on their way to the density."""

import pytest
import torch

from solver.field.smoothing import step_smoothing
from solver.fit.adam import Adam
from solver.fit.schedule import step_width
from solver.fit.settings import FieldSettings


def stepped(smooth):
    torch.manual_seed(5)
    planes, lines = torch.randn(3, 20, 20, 4), torch.randn(3, 20, 4)
    start = [planes.clone(), lines.clone()]
    parameters = [torch.nn.Parameter(planes), torch.nn.Parameter(lines)]
    optimiser = Adam([{"params": parameters, "base": 0.1, "smooth": smooth}])
    for parameter in parameters:
        parameter.grad = torch.randn_like(parameter)
    optimiser.step()
    return [(p.detach() - s) for p, s in zip(parameters, start, strict=True)]


def test_smooth_steps_are_the_smoothing_of_plain_steps():
    smooth = step_smoothing(1.7)
    for plain, made in zip(stepped(None), stepped(smooth), strict=True):
        torch.testing.assert_close(made, smooth(plain), atol=1e-6, rtol=1e-5)
        assert made.square().mean() < 0.2 * plain.square().mean()


def test_below_the_floor_steps_shrink_with_the_gradient_and_above_they_stay():
    def moved(floor):
        values = torch.nn.Parameter(torch.zeros(2, 8))
        optimiser = Adam([{"params": [values], "base": 0.1, "floor": floor}])
        for _ in range(40):
            values.grad = torch.stack([torch.ones(8), torch.full((8,), 1e-5)])
            optimiser.step()
        return values.detach()

    plain, floored = moved(0.0), moved(0.2)
    torch.testing.assert_close(plain[1], plain[0])
    assert (floored[0] < 0.7 * plain[0]).all()
    assert (floored[1].abs() < 1e-2 * floored[0].abs()).all()


def test_a_parameter_set_anew_moves_as_if_nothing_had_been_learned_of_it():
    values, others = (torch.nn.Parameter(torch.zeros(2, 8)) for _ in range(2))
    optimiser = Adam([{"params": [values, others], "base": 0.1}])
    for _ in range(10):
        values.grad, others.grad = torch.full((2, 8), 100.0), torch.full((2, 8), 100.0)
        optimiser.step()
    before = values.detach().clone(), others.detach().clone()
    optimiser.forget(values)
    values.grad, others.grad = torch.full((2, 8), -1.0), torch.full((2, 8), -1.0)
    optimiser.step()
    assert (values > before[0]).all() and (others < before[1]).all()


def test_the_floor_is_a_share_of_the_mean_gradient_from_the_first_step_on():
    """Adam's mean of squares starts at 0, and so would the floor if that were not made up for."""
    values = torch.nn.Parameter(torch.zeros(1, 4))
    optimiser = Adam([{"params": [values], "base": 0.1, "floor": 0.5}])
    for step in range(1, 4):
        values.grad = torch.full((1, 4), 3.0)
        optimiser.step()
        # Every step is rate · g/(g + g/2).
        torch.testing.assert_close(values.detach(), torch.full((1, 4), -0.1 * step / 1.5))


def test_smoothing_leaves_a_constant_step_as_it_is():
    for constant in (torch.full((3, 16, 16, 2), 0.3), torch.full((3, 16, 2), 0.3)):
        torch.testing.assert_close(step_smoothing(2.0)(constant), constant)


def test_steps_narrower_than_a_third_of_a_voxel_are_not_smoothed():
    assert step_smoothing(0.3) is None


@pytest.mark.parametrize("fraction, width", [(0.0, 0.04), (0.5, 0.02), (1.0, 0.01)])
def test_the_width_of_steps_falls_geometrically(fraction, width):
    field = FieldSettings(step_smoothing=(0.04, 0.01))
    assert step_width(field, fraction) == pytest.approx(width)
