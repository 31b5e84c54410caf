"""GGX sampling by chi-square, furnace tests, frames."""

import math

import numpy as np
import pytest
import scipy.stats
import torch

from solver.brdf.microfacet import (
    fresnel_schlick,
    masking_shadowing_over_masking,
    sample_visible_normal,
    tangent_frame,
    visible_normal_pdf,
)


def view_at(angle, count=1):
    direction = torch.tensor([math.sin(angle), 0.0, math.cos(angle)], dtype=torch.float64)
    return direction.expand(count, 3)


def reflect(view, half):
    return 2 * (view * half).sum(-1, keepdim=True) * half - view


@pytest.mark.parametrize("angle", [0.0, 0.6, 1.2])
@pytest.mark.parametrize("alpha", [0.1, 0.35, 0.9])
def test_sampled_light_directions_follow_their_pdf(angle, alpha):
    """Chi-square over a latitude–longitude grid of light directions, upper and lower half."""
    count, rows, columns = 200_000, 24, 24
    generator = torch.Generator().manual_seed(7)
    u = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    view, a = view_at(angle, count), torch.full((count,), alpha, dtype=torch.float64)
    light = reflect(view, sample_visible_normal(view, a, u)).numpy()
    bins = [np.linspace(-1, 1, rows + 1), np.linspace(-math.pi, math.pi, columns + 1)]
    observed = np.histogram2d(light[:, 2], np.arctan2(light[:, 1], light[:, 0]), bins)[0]

    fine = 24
    z = (np.arange(rows * fine) + 0.5) / (rows * fine) * 2 - 1
    phi = ((np.arange(columns * fine) + 0.5) / (columns * fine) * 2 - 1) * math.pi
    z, phi = np.meshgrid(z, phi, indexing="ij")
    s = np.sqrt(1 - z * z)
    directions = torch.from_numpy(np.stack([s * np.cos(phi), s * np.sin(phi), z], -1).reshape(-1, 3))
    v = view_at(angle, len(directions))
    half = torch.nn.functional.normalize(v + directions, dim=-1)
    pdf = visible_normal_pdf(v[:, 2], half[:, 2].clamp(min=0), torch.full((len(v),), alpha).double())
    pdf = torch.where(half[:, 2] > 0, pdf, 0.0).numpy().reshape(rows, fine, columns, fine)
    expected = pdf.sum((1, 3)) * (2 / (rows * fine)) * (2 * math.pi / (columns * fine)) * count
    assert abs(expected.sum() / count - 1) < 0.01

    kept = expected > 10
    rest_observed, rest_expected = observed[~kept].sum(), expected[~kept].sum()
    o = np.append(observed[kept], rest_observed)
    e = np.append(expected[kept], rest_expected)
    o, e = o[e > 1], e[e > 1]
    # The quadrature is off by up to half a percent where the lobe is sharp.
    statistic = ((o - e) ** 2 / (e + (0.005 * e) ** 2)).sum()
    assert scipy.stats.chi2.sf(statistic, len(e) - 1) > 1e-4


@pytest.mark.parametrize("alpha", [0.01, 0.2, 0.7])
@pytest.mark.parametrize("angle", [0.1, 0.9, 1.4])
def test_white_furnace_never_gains_energy(alpha, angle):
    generator = torch.Generator().manual_seed(3)
    count = 50_000
    u = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    view, a = view_at(angle, count), torch.full((count,), alpha, dtype=torch.float64)
    light = reflect(view, sample_visible_normal(view, a, u))
    weight = masking_shadowing_over_masking(view[:, 2], light[:, 2], a) * (light[:, 2] > 0)
    reflected = float(weight.mean())
    assert reflected <= 1.0
    # Single scattering loses little on a smooth surface and visibly more on a rough one.
    assert reflected > (0.99 if alpha < 0.05 else 0.5)


def test_estimator_agrees_with_quadrature_of_the_brdf():
    """∫ D G2 F / (4 cos v) dl for F = 1, α = 0.4: samples with weight G2/G1 against a fine grid."""
    alpha, angle = 0.4, 0.8
    z = (np.arange(400) + 0.5) / 400
    phi = ((np.arange(400) + 0.5) / 400 * 2 - 1) * math.pi
    z, phi = np.meshgrid(z, phi, indexing="ij")
    s = np.sqrt(1 - z * z)
    light = torch.from_numpy(np.stack([s * np.cos(phi), s * np.sin(phi), z], -1).reshape(-1, 3))
    view = view_at(angle, len(light))
    half = torch.nn.functional.normalize(view + light, dim=-1)
    a = torch.full((len(light),), alpha, dtype=torch.float64)
    value = visible_normal_pdf(view[:, 2], half[:, 2], a) * masking_shadowing_over_masking(
        view[:, 2], light[:, 2], a
    )
    expected = float(value.sum()) * (1 / 400) * (2 * math.pi / 400)
    u = torch.rand(200_000, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    view, a = view_at(angle, len(u)), torch.full((len(u),), alpha, dtype=torch.float64)
    light = reflect(view, sample_visible_normal(view, a, u))
    weight = masking_shadowing_over_masking(view[:, 2], light[:, 2], a) * (light[:, 2] > 0)
    assert math.isclose(float(weight.mean()), expected, rel_tol=5e-3)


def test_frames_are_right_handed_and_orthonormal_everywhere():
    torch.manual_seed(0)
    normals = torch.nn.functional.normalize(torch.randn(1000, 3, dtype=torch.float64), dim=-1)
    poles = torch.tensor([[0, 0, 1.0], [0, 0, -1.0], [1, 0, 0], [1e-9, 0, -1.0]]).double()
    normals = torch.cat([normals, poles])
    tangent, bitangent = tangent_frame(normals)
    frame = torch.stack([tangent, bitangent, normals], 1)
    identity = torch.eye(3, dtype=torch.float64).expand(len(normals), 3, 3)
    torch.testing.assert_close(frame @ frame.transpose(1, 2), identity, rtol=0, atol=1e-6)
    torch.testing.assert_close(
        torch.linalg.det(frame), torch.ones(len(normals)).double(), rtol=0, atol=1e-6
    )


def test_angle_of_reflection_equals_angle_of_incidence():
    view = view_at(0.7, 100)
    u = torch.rand(100, 2, dtype=torch.float64)
    half = sample_visible_normal(view, torch.full((100,), 0.3).double(), u)
    light = reflect(view, half)
    torch.testing.assert_close((view * half).sum(-1), (light * half).sum(-1))


def test_fresnel_is_f0_at_normal_incidence_and_one_at_grazing():
    f0 = torch.tensor([[0.04, 0.5, 1.0]])
    torch.testing.assert_close(fresnel_schlick(f0, torch.ones(1)), f0)
    torch.testing.assert_close(fresnel_schlick(f0, torch.zeros(1)), torch.ones(1, 3))


def test_sampling_gradients_agree_with_finite_differences():
    view = torch.nn.functional.normalize(torch.tensor([[0.3, -0.4, 0.8]]).double(), dim=-1)
    alpha = torch.tensor([0.3], dtype=torch.float64, requires_grad=True)
    u = torch.tensor([[0.37, 0.61]], dtype=torch.float64)
    view.requires_grad_()
    assert torch.autograd.gradcheck(lambda v, a: sample_visible_normal(v, a, u), (view, alpha))
