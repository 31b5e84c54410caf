"""What the occupancy grid lets through, beside the field that it stands for."""

import math

import pytest
import torch
import torch.nn.functional as F

from solver.brdf.microfacet import tangent_frame
from solver.field.occupancy import Occupancy
from solver.kernels.march import composite
from tests.render.scenes import ball, fill_everywhere


def parallel_rays(direction, count=96):
    """Rays side by side through the box of a `ball`, and the area that each stands for."""
    direction = F.normalize(torch.tensor([direction]), dim=-1)
    across, along = tangent_frame(direction)
    ticks = 0.8 * ((torch.arange(count) + 0.5) / count * 2 - 1)
    shift = ticks[:, None, None] * across + ticks[None, :, None] * along
    origins = (shift - 3 * direction).reshape(-1, 3).contiguous()
    return origins, direction.expand(len(origins), 3).contiguous(), (1.6 / count) ** 2


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (1.0, 1.0, 0.2), (0.3, -0.5, -0.8)])
def test_a_shadow_is_a_third_of_a_cell_wider_than_the_body(direction):
    scene = ball(sharpness=4000.0)
    fill_everywhere(scene)
    origins, directions, area = parallel_rays(direction)
    nothing = torch.zeros(len(origins))
    shadow = (1 - scene.grid_transmittance(origins, directions, nothing)).sum() * area
    steps = scene.sample(origins, directions, nothing, nothing + 0.5, 0.1, 1e-4)
    _, passing = composite(steps.depth, steps.offsets)
    body = (1 - passing.detach()).sum() * area
    wider = ((shadow / math.pi).sqrt() - (body / math.pi).sqrt()) / scene.cell
    assert 0 < float(wider) < 0.4


def test_what_is_half_filled_lets_half_of_the_light_through():
    scene = ball(sharpness=4000.0)
    field, grid = scene.field, Occupancy(8)

    def depths_of(*dense):
        sigma = torch.zeros(9, 9, 9)
        sigma[dense] = 1e3
        field.raw_density_grid, field.extinction = lambda count: sigma, lambda raw: raw
        grid.refresh(field, 0.01, field.voxel, 0)
        return torch.exp(-grid.optical_depth())

    assert float(depths_of(slice(4, None))[3, 3, 3]) == pytest.approx(0.5)
    assert float(depths_of(4, 4, 4)[3, 3, 3]) == pytest.approx(7 / 8)
    assert float(depths_of(slice(4, None))[4, 3, 3]) < 1e-6


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, 0.7, -0.4)])
def test_a_sheet_at_corners_of_cells_stops_all_light(direction):
    scene = ball(sharpness=4000.0)
    grid = Occupancy(scene.occupancy.cells)
    depth = torch.zeros_like(grid.corner_depth)
    depth[16] = 16.0
    grid.fill(grid.occupied, depth)
    scene.occupancy = grid
    towards = F.normalize(torch.tensor([direction]), dim=-1).expand(50, 3).contiguous()
    origins = 0.2 * torch.rand(50, 3, generator=torch.Generator().manual_seed(1)) - 0.1
    origins[:, 0] = -0.5
    assert float(scene.grid_transmittance(origins, towards, torch.zeros(50)).max()) < 0.01


def test_fog_is_as_deep_as_its_mean():
    scene = ball(sharpness=4000.0)
    field, grid = scene.field, Occupancy(8)
    sigma = 0.1 * torch.rand(9, 9, 9, generator=torch.Generator().manual_seed(0))
    field.raw_density_grid, field.extinction = lambda count: sigma, lambda raw: raw
    grid.refresh(field, 0.01, field.voxel, 0)
    corners = F.avg_pool3d(sigma[None, None], 2, 1)[0, 0] * 2 * field.half_size / 8
    torch.testing.assert_close(grid.optical_depth(), corners, rtol=0.02, atol=1e-6)
