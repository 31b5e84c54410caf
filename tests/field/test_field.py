"""Smoothed normals, upsampling, occupancy."""

import numpy as np
import pytest
import scipy.ndimage
import torch

from solver.field.field import MicrofacetField
from solver.field.occupancy import Occupancy
from solver.field.smoothing import PAPER_SIGMA, gaussian_taps, smoothed_factors
from solver.kernels.vm import vm_gradient, vm_sum

SIZE = 12


def dense(planes, lines):
    """The VM sum on all nodes, as [G, G, G]."""
    return (
        torch.einsum("xyc,zc->xyz", planes[0], lines[0])
        + torch.einsum("xzc,yc->xyz", planes[1], lines[1])
        + torch.einsum("yzc,xc->xyz", planes[2], lines[2])
    )


@pytest.mark.parametrize("sigma", [0.0, 1.3, 5.0])
def test_smoothed_gradient_is_that_of_the_gaussian_filtered_3d_grid(sigma):
    """Filtering the factors equals filtering the field; no axis is damped (an erratum of the code)."""
    torch.manual_seed(0)
    planes, lines = torch.randn(3, SIZE, SIZE, 4), torch.randn(3, SIZE, 4)
    grid, taps = dense(planes, lines).numpy(), gaussian_taps(sigma)
    for axis in range(3):
        grid = scipy.ndimage.correlate1d(grid, taps.numpy(), axis=axis, mode="reflect")
    expected = np.stack(
        [scipy.ndimage.correlate1d(grid, [-0.5, 0, 0.5], axis=a, mode="nearest") for a in range(3)],
        -1,
    )
    nodes = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij"), -1).reshape(-1, 3)
    result = vm_gradient(torch.from_numpy(nodes).float(), *smoothed_factors(planes, lines, taps))
    np.testing.assert_allclose(result.numpy(), expected.reshape(-1, 3), atol=2e-4)


@pytest.mark.parametrize("sigma", [0.0, 0.7, 0.75, 2.0, 6.0])
def test_the_smoothing_kernel_is_normalised_and_as_wide_as_asked_for(sigma):
    taps = gaussian_taps(sigma)
    offsets = torch.arange(len(taps)) - len(taps) // 2
    assert abs(float(taps.sum()) - 1) < 1e-6
    width = float((taps * offsets**2).sum() ** 0.5)
    assert width == pytest.approx(max(sigma, PAPER_SIGMA), rel=0.02)


def field_of_slope(direction, half_size=1.0):
    """A field whose raw density falls linearly along `direction`."""
    field = MicrofacetField(torch.zeros(3), half_size, SIZE, density_components=1)
    ramp = torch.linspace(0, 1, SIZE)
    with torch.no_grad():
        field.density_planes.zero_()
        field.density_lines.fill_(1)
        field.density_planes[0, :, :, 0] -= direction[0] * ramp[:, None] + direction[1] * ramp[None, :]
        field.density_planes[1, :, :, 0] -= direction[2] * ramp[None, :]
    return field


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.0, -0.8)])
def test_normals_point_from_dense_to_empty(direction):
    field = field_of_slope(direction)
    points = 0.3 + 0.4 * torch.rand(20, 3)
    normals = field.normals(points, field.normal_factors())
    torch.testing.assert_close(normals, torch.tensor(direction).float().expand(20, 3), atol=1e-4, rtol=0)


def test_upsampling_keeps_the_field_at_its_nodes():
    torch.manual_seed(1)
    field = MicrofacetField(torch.zeros(3), 1.0, 5)
    points = torch.randint(0, 5, (50, 3)) / 4
    before = field.raw_density(points).detach(), field.features(points).detach()
    field.upsample(9)
    assert field.size == 9
    torch.testing.assert_close(field.raw_density(points).detach(), before[0], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(field.features(points).detach(), before[1], atol=1e-5, rtol=1e-4)


def test_box_units_are_affine_in_world_units():
    field = MicrofacetField(torch.tensor([1.0, 2.0, 3.0]), 0.5, 4)
    corners = torch.tensor([[0.5, 1.5, 2.5], [1.5, 2.5, 3.5], [1.0, 2.0, 3.0]])
    expected = torch.tensor([[0.0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]])
    torch.testing.assert_close(field.to_box(corners), expected)


def test_occupancy_covers_all_that_is_dense_and_lets_go_of_the_rest():
    field = field_of_slope((1.0, 0.0, 0.0))
    with torch.no_grad():
        field.density_planes.mul_(200).add_(20)
    occupancy = Occupancy(16)
    occupancy.refresh(field, min_alpha=0.01, step=0.05, dilation=1)
    points = torch.rand(2000, 3)
    sigma = field.extinction(field.raw_density(points))
    dense_enough = 1 - torch.exp(-sigma * 0.05) >= 0.01
    cell = (points * 16).long().clamp(0, 15)
    occupied = occupancy.occupied[cell[:, 0], cell[:, 1], cell[:, 2]]
    assert occupied[dense_enough].all()
    assert 0.05 < occupancy.occupied.float().mean() < 0.6


@pytest.mark.parametrize("cells", [6, 12, 24])
def test_nothing_outside_the_allowed_space_is_occupied(cells):
    field = field_of_slope((1.0, 0.0, 0.0))
    with torch.no_grad():
        field.density_planes.mul_(200).add_(200)
    allowed = torch.zeros(12, 12, 12, dtype=torch.bool)
    allowed[4:6, 4:6, 4:6] = True
    occupancy = Occupancy(cells)
    occupancy.allow_only(allowed, dilation=1)
    occupancy.refresh(field, min_alpha=0.01, step=0.05, dilation=1)
    points = torch.rand(4000, 3)
    cell = (points * cells).long().clamp(0, cells - 1)
    occupied = occupancy.occupied[cell[:, 0], cell[:, 1], cell[:, 2]]
    near = ((points > 3 / 12) & (points < 7 / 12)).all(-1)
    far = ((points < 2 / 12) | (points > 8 / 12)).any(-1)
    assert occupied[near].all() and not occupied[far].any()


def test_density_is_differentiable_down_to_the_factors():
    field = MicrofacetField(torch.zeros(3), 1.0, 6)
    points = torch.rand(10, 3)
    loss = field.extinction(vm_sum(points * 5, field.density_planes, field.density_lines)).sum()
    loss.backward()
    assert field.density_planes.grad.abs().sum() > 0
    assert field.density_lines.grad.abs().sum() > 0


@pytest.mark.parametrize("count", [4, 9, 30])
def test_raw_density_on_a_grid_is_that_of_its_points(count):
    torch.manual_seed(5)
    field = MicrofacetField(torch.zeros(3), 1.0, 9)
    grid = field.raw_density_grid(count)
    ticks = torch.linspace(0, 1, count)
    points = torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3)
    torch.testing.assert_close(grid.reshape(-1), field.raw_density(points).detach(), atol=1e-5, rtol=1e-4)


def test_an_extinction_is_that_of_its_raw_density():
    field = MicrofacetField(torch.zeros(3), 0.5, 8, density_scale=70.0, density_shift=-6.0)
    for extinction in (1e-4, 0.5, 70.0, 4000.0):
        raw = torch.tensor(field.raw_of(extinction), dtype=torch.float64)
        assert float(field.extinction(raw)) == pytest.approx(extinction, rel=1e-6)


@torch.no_grad()
def seen_depths(field: MicrofacetField) -> tuple[float, float]:
    """Mean and standard deviation of the places along x where rays that enter at 1 end, in box units."""
    along = torch.linspace(1, 0, 4001)
    points = torch.stack([along, torch.full_like(along, 0.4), torch.full_like(along, 0.7)], -1)
    depth = field.extinction(field.raw_density(points)) * 2 * field.half_size / 4000
    weights = torch.exp(-depth.cumsum(0)) * depth
    mean = (weights * along).sum() / weights.sum()
    return float(mean), float(((weights * (along - mean) ** 2).sum() / weights.sum()).sqrt())


def test_a_steeper_density_has_the_same_normals_and_rays_end_in_a_thinner_layer_that_is_further_out():
    field = field_of_slope((1.0, 0.0, 0.0))
    with torch.no_grad():
        field.density_planes.mul_(70).add_(15)
    torch.manual_seed(2)
    points, held = 0.2 + 0.6 * torch.rand(50, 3), 2.0
    normals, raw = field.normals(points, field.normal_factors()), field.raw_density(points).detach()
    (before, soft), level = seen_depths(field), field.raw_of(held)
    told = raw - level
    field.steepen(3.0, held)
    torch.testing.assert_close(field.normals(points, field.normal_factors()), normals, atol=1e-5, rtol=0)
    steep = field.raw_density(points).detach() - field.raw_of(held)
    torch.testing.assert_close(steep, 3 * told, atol=2e-4, rtol=1e-4)
    assert field.raw_of(held) == pytest.approx(3 * level, rel=1e-5)
    after, sharp = seen_depths(field)
    assert sharp < 0.6 * soft and before + 0.5 * soft < after
    assert field.steepness == 3.0


@pytest.mark.parametrize("count", [5, 16, 33])
def test_the_allowed_space_on_a_grid_is_that_of_its_points(count):
    occupancy = Occupancy(16)
    grid = torch.rand(16, 16, 16, generator=torch.Generator().manual_seed(1)) < 0.5
    occupancy.allow_only(grid, dilation=0)
    ticks = torch.linspace(0, 1, count)
    points = torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), dim=-1)
    expected = occupancy.is_allowed(points.reshape(-1, 3)).view(count, count, count)
    assert torch.equal(occupancy.allowed_grid(count), expected)
    assert 0.2 < expected.float().mean() < 0.8
