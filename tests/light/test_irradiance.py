"""Patches of the sky, and the irradiance of points that do not see all of them."""

import math

import torch

from solver.light.environment import EnvironmentMap, equirect_directions
from solver.light.irradiance import (
    Arriving,
    arriving_harmonics,
    irradiance,
    middles,
    patches,
    patches_at,
    power,
)
from solver.light.spherical_harmonics import sh_basis

CPU = torch.device("cpu")


def waves(height=64):
    """A smooth coloured light, all positive."""
    x, y, z = equirect_directions(height, 2 * height).unbind(-1)
    return EnvironmentMap.from_radiance(torch.stack([1.2 + x * y, 1.5 + z, 1.0 + 0.6 * y * z], -1))


def nothing(rows):
    return torch.zeros(rows, 9, 3)


def test_patches_cover_the_sphere_once_and_are_alike():
    cut = patches(CPU)
    assert math.isclose(float(cut.solid_angle.sum()), 4 * math.pi, rel_tol=1e-5)
    assert float(cut.solid_angle.max() / cut.solid_angle.min()) < 1.6
    torch.testing.assert_close(middles(cut.lobes).norm(dim=-1), torch.ones(len(cut.lobes)))


def test_a_patchs_power_is_the_light_around_its_middle_times_its_size():
    light, white = waves(), EnvironmentMap(64, 1.0)
    x, y, z = middles(white.patch_lobes()).unbind(-1)
    expected = torch.stack([1.2 + x * y, 1.5 + z, 1.0 + 0.6 * y * z], -1)
    sizes = power(white.tables().table)
    torch.testing.assert_close(sizes[:, 0].sum(), torch.tensor(4 * math.pi), rtol=1e-5, atol=0)
    found = power(light.tables().table) / sizes
    torch.testing.assert_close(found, expected, rtol=0.02, atol=0.02)


def test_power_of_a_map_whose_rows_the_patches_do_not_divide_adds_up():
    torch.manual_seed(0)
    light = EnvironmentMap.from_radiance(torch.rand(50, 100, 3) + 0.1)
    whole = light.tables().table[-1, -1].float()
    torch.testing.assert_close(power(light.tables().table).sum(0), whole, rtol=1e-5, atol=0)


def test_patches_overlap_without_sharp_edges_also_where_the_map_ends():
    light = EnvironmentMap(64, 1.0)
    each = light.texel_solid_angle[:, None].float()
    shares = []
    for patch in range(len(patches(CPU).solid_angle)):
        light.log_radiance.grad = None
        power(light.tables().table)[patch, 0].backward()
        shares.append(light.log_radiance.grad[0] / each)
    shares = torch.stack(shares)
    torch.testing.assert_close(shares.sum(0), torch.ones(64, 128), rtol=1e-4, atol=0)
    assert float(shares.min()) > -1e-4
    across = torch.cat([shares, shares[..., :1]], -1).diff(dim=-1)
    assert float(across.abs().max()) < 0.51 and float(shares.diff(dim=-2).abs().max()) < 0.51


def test_where_all_light_arrives_the_irradiance_is_that_of_the_whole_light():
    light, count = waves(), len(patches(CPU).solid_angle)
    tables = light.tables(Arriving(torch.ones(2, count), light.patch_lobes(), nothing(2)))
    assert tables.irradiance.shape == (3, 9, 3)
    torch.testing.assert_close(tables.irradiance[1], tables.irradiance[0], rtol=0.01, atol=0.02)


def test_a_patchs_light_comes_from_where_it_is_bright():
    radiance = torch.full((64, 128, 3), 1e-3)
    radiance[20, 77] = 500.0
    light = EnvironmentMap.from_radiance(radiance)
    sun = equirect_directions(64, 128)[20, 77].float()
    lobes = light.patch_lobes()
    assert float((middles(lobes) @ sun).max()) > math.cos(0.002)
    tables = light.tables(Arriving(torch.ones(1, len(lobes)), lobes, nothing(1)))
    torch.testing.assert_close(tables.irradiance[1], tables.irradiance[0], rtol=1e-3, atol=1e-3)


def test_in_even_light_patches_have_their_middles():
    for height in (8, 16, 50, 128):
        angle = middles(EnvironmentMap(height, 0.7).patch_lobes()) * middles(patches(CPU).lobes)
        assert float(angle.sum(-1).min()) > math.cos(math.pi / height)


def test_below_a_horizon_no_light_arrives():
    """White light from above z = 0 alone, on surfaces tilted by θ: E = π (1 + cos θ)/2."""
    cut = patches(CPU)
    seen = (middles(cut.lobes)[:, 2] > 0).float()[None]
    coefficients = arriving_harmonics(
        EnvironmentMap(64, 1.0).tables().table, Arriving(seen, cut.lobes, nothing(1))
    )
    tilt = torch.linspace(0, math.pi, 13)
    normals = torch.stack([tilt.sin(), torch.zeros_like(tilt), tilt.cos()], -1)
    found = irradiance(coefficients.expand(13, -1, -1), normals)
    expected = math.pi * (1 + tilt.cos()) / 2
    torch.testing.assert_close(found[:, 0], expected, rtol=0, atol=0.02)


def test_a_surface_each_or_one_for_all():
    coefficients = torch.randn(9, 3)
    normals = torch.nn.functional.normalize(torch.randn(5, 3), dim=-1)
    one = irradiance(coefficients, normals)
    torch.testing.assert_close(one, irradiance(coefficients.expand(5, -1, -1), normals))
    expected = (sh_basis(normals, 2) @ coefficients).clamp(min=0)
    torch.testing.assert_close(one, expected, rtol=1e-5, atol=1e-5)


def test_gradients_to_the_light_agree_with_finite_differences():
    torch.manual_seed(0)
    light = EnvironmentMap.from_radiance(torch.rand(24, 48, 3) + 0.2)
    cut = patches(CPU)
    arriving = Arriving(torch.rand(3, len(cut.solid_angle)), cut.lobes, torch.rand(3, 9, 3))
    weights = torch.randn(4, 9, 3)

    def value():
        return (light.tables(arriving).irradiance * weights).sum()

    value().backward()
    step = torch.randn_like(light.log_radiance)
    predicted = float((light.log_radiance.grad * step).sum())
    ends = []
    with torch.no_grad():
        for sign in (1, -1):
            light.log_radiance += sign * 1e-3 * step
            ends.append(float(value()))
            light.log_radiance -= sign * 1e-3 * step
    assert math.isclose((ends[0] - ends[1]) / 2e-3, predicted, rel_tol=5e-3)


def test_a_direction_lies_in_the_patch_whose_middle_it_is():
    found = patches_at(middles(patches(torch.device("cpu")).lobes))
    assert found.tolist() == list(range(len(found)))


def test_patches_take_equal_parts_of_all_directions():
    torch.manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(200_000, 3), dim=-1)
    solid_angle = patches(torch.device("cpu")).solid_angle
    share = torch.bincount(patches_at(directions), minlength=len(solid_angle)) / len(directions)
    torch.testing.assert_close(share, solid_angle / (4 * math.pi), rtol=0.15, atol=0)
    poles = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [-1.0, -0.0, 0.0]])
    assert ((patches_at(poles) >= 0) & (patches_at(poles) < len(solid_angle))).all()
