"""Spherical harmonics against scipy; irradiance and lookups against brute force."""

import math

import numpy as np
import pytest
import scipy.special
import torch
from scipy.spatial.transform import Rotation

from solver.capture import frames
from solver.light.environment import (
    EnvironmentMap,
    equirect_coordinates,
    equirect_directions,
)
from solver.light.irradiance import irradiance
from solver.light.spherical_harmonics import quadratic, quadratic_form, sh_basis
from solver.light.turned import turned


def unit(count, seed=0):
    torch.manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1)


def test_spherical_harmonics_agree_with_scipy():
    directions = unit(200)
    x, y, z = directions.numpy().T
    theta, phi = np.arccos(z), np.arctan2(y, x)
    values = sh_basis(directions, 4).numpy()
    index = 0
    for degree in range(5):
        for m in range(-degree, degree + 1):
            complex_value = scipy.special.sph_harm_y(degree, abs(m), theta, phi)
            sign = (-1) ** m  # undoes the Condon–Shortley phase
            expected = (
                complex_value.real
                if m == 0
                else math.sqrt(2) * sign * (complex_value.real if m > 0 else complex_value.imag)
            )
            np.testing.assert_allclose(values[:, index], expected, atol=1e-10)
            index += 1


def test_degree_two_as_a_quadratic_form_is_the_same():
    directions = torch.nn.functional.normalize(torch.randn(50, 3), dim=-1)
    torch.testing.assert_close(
        quadratic(directions) @ quadratic_form(directions.device, directions.dtype),
        sh_basis(directions, 2),
    )


def test_directions_and_texels_are_inverse():
    directions = equirect_directions(20, 40).reshape(-1, 3)
    texel = equirect_coordinates(directions.float(), 20, 40)
    column, row = np.meshgrid(np.arange(40) + 0.5, np.arange(20) + 0.5)
    np.testing.assert_allclose(texel.numpy(), np.stack([column, row], -1).reshape(-1, 2), atol=1e-3)


@pytest.mark.parametrize(
    "direction, u, v",
    [
        ((1, 0, 0), 0.5, 0.5),
        ((0, 1, 0), 0.25, 0.5),
        ((0, -1, 0), 0.75, 0.5),
        ((0, 0, 1), None, 0.0),
    ],
)
def test_the_map_follows_blenders_convention(direction, u, v):
    column, row = equirect_coordinates(torch.tensor([direction], dtype=torch.float32), 100, 200)[0]
    assert math.isclose(float(row) / 100, v, abs_tol=1e-3)
    if u is not None:
        assert math.isclose(float(column) / 200, u, abs_tol=1e-3)


def test_irradiance_of_constant_light_is_pi_times_radiance():
    environment = EnvironmentMap(32, initial=0.7)
    normals = unit(50).float()
    expected = torch.full((50, 3), math.pi * 0.7)
    torch.testing.assert_close(
        irradiance(environment.tables().irradiance[0], normals), expected, rtol=1e-3, atol=0
    )


def test_irradiance_of_smooth_light_agrees_with_quadrature():
    directions = equirect_directions(64, 128)
    radiance = 1 + 0.5 * directions[..., :1] + 0.3 * directions[..., 1:2] * directions[..., 2:]
    environment = EnvironmentMap.from_radiance(radiance.expand(-1, -1, 3))
    normals = unit(20)
    cosine = torch.einsum("hwc,nc->nhw", directions, normals).clamp(min=0)
    weight = environment.texel_solid_angle[:, None]
    expected = torch.einsum("nhw,hwc->nc", cosine * weight, radiance.expand(-1, -1, 3))
    result = irradiance(environment.tables().irradiance[0], normals.float())
    torch.testing.assert_close(result.double(), expected, rtol=2e-3, atol=1e-3)


def test_solid_angles_of_the_texels_add_up_to_the_sphere():
    environment = EnvironmentMap(16)
    assert math.isclose(float(environment.texel_solid_angle.sum()) * 32, 4 * math.pi, rel_tol=1e-9)


@pytest.mark.parametrize("row", [8.0, 32.0, 50.0])
@pytest.mark.parametrize("solid_angle", [0.01, 0.05])
def test_footprints_cover_the_solid_angle_they_stand_for(row, solid_angle):
    """d/(N·p), not N·p/d: the erratum of Appendix A."""
    environment = EnvironmentMap(64)
    columns, rows = environment.footprint(torch.tensor([row]), torch.full((1, 2), solid_angle))[0]
    top, bottom = row - float(rows) / 2, row + float(rows) / 2
    band = math.cos(top * math.pi / 64) - math.cos(bottom * math.pi / 64)
    area = band * float(columns) * 2 * math.pi / 128
    assert math.isclose(area, solid_angle, rel_tol=0.02)


def test_the_light_has_the_directions_of_the_frames_module():
    directions = equirect_directions(8, 16)
    texel = equirect_coordinates(directions.reshape(-1, 3), 8, 16)
    expected = frames.equirect_from_direction(directions.reshape(-1, 3).numpy()) * (16, 8)
    np.testing.assert_allclose(texel.numpy(), expected, atol=1e-4)


@pytest.mark.parametrize("height", [16, 48])
def test_resizing_a_map_knows_that_it_goes_on_around_and_over_the_poles(height):
    torch.manual_seed(0)
    small = EnvironmentMap(8)
    with torch.no_grad():
        small.log_radiance.normal_()
    turned = EnvironmentMap(8)
    with torch.no_grad():
        turned.log_radiance.copy_(small.log_radiance.roll(5, -1))
    step = 5 * height // 8
    torch.testing.assert_close(
        turned.resized(height).log_radiance, small.resized(height).log_radiance.roll(step, -1)
    )
    # Away from edges it is torch's own bilinear interpolation.
    plain = torch.nn.functional.interpolate(
        small.log_radiance.detach()[None], size=(height, 2 * height), mode="bilinear"
    )[0]
    inner = np.s_[:, height // 8 : -height // 8, height // 8 : -height // 8]
    torch.testing.assert_close(small.resized(height).log_radiance.detach()[inner], plain[inner])
    # Across a pole lies what is half a turn away.
    pole = small.resized(8 * height).log_radiance.detach()[:, 0]
    torch.testing.assert_close(pole, pole.roll(8 * height, -1), atol=0.15, rtol=0)


TILTED = torch.tensor(Rotation.from_euler("xz", [0.7, 2.1]).as_matrix(), dtype=torch.float32)


def test_a_turned_light_sends_from_the_turned_direction_what_it_sent_before():
    """Beside the resampling of `light.turned`, which shares out the power of cells."""
    height = 64

    def sky(directions):
        x, y, z = directions.unbind(-1)
        return torch.stack([2 + x, 2 + y, 2 + x * z], -1)

    directions = equirect_directions(height, 2 * height).float()
    light = EnvironmentMap.from_radiance(sky(directions))
    expected = sky(directions @ TILTED)
    found = light.radiance(TILTED).detach().permute(1, 2, 0)
    torch.testing.assert_close(found, expected, atol=5e-3, rtol=0)
    shared_out = turned(light.image(), TILTED.numpy())
    np.testing.assert_allclose(found.numpy(), shared_out, atol=0.06)
    torch.testing.assert_close(light.radiance(torch.eye(3)), light.radiance(), atol=1e-4, rtol=1e-4)


def test_a_turned_lights_tables_are_those_of_the_turned_map():
    light = EnvironmentMap(16)
    with torch.no_grad():
        light.log_radiance.normal_(generator=torch.Generator().manual_seed(3))
    other = EnvironmentMap.from_radiance(light.radiance(TILTED).detach().permute(1, 2, 0))
    for found, expected in zip(light.tables(turn=TILTED), other.tables(), strict=True):
        torch.testing.assert_close(found, expected)


class Turned(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.light = EnvironmentMap(4).double()

    def forward(self):
        return self.light.radiance(TILTED.double())


def test_gradients_of_a_turned_light_are_its_finite_differences():
    start = torch.randn(3, 4, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(2))

    def turned_radiance(log_radiance):
        return torch.func.functional_call(Turned(), {"light.log_radiance": log_radiance}, ())

    assert torch.autograd.gradcheck(turned_radiance, (start.requires_grad_(),))


def test_light_is_the_exponential_of_its_map_and_one_that_is_too_bright_may_come_down():
    environment = EnvironmentMap(4)
    with torch.no_grad():
        environment.log_radiance.copy_(torch.linspace(-3, 25, 3 * 4 * 8).view(3, 4, 8))
    radiance = environment.radiance()
    expected = environment.log_radiance.detach().clamp(max=EnvironmentMap.MAX_LOG_RADIANCE).exp()
    torch.testing.assert_close(radiance, expected)
    (gradient,) = torch.autograd.grad(radiance.sum(), environment.log_radiance)
    torch.testing.assert_close(gradient, expected)
