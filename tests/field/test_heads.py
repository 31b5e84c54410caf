"""Material heads: what they start with, and what a metalness may and may not say."""

import torch

from solver.brdf.microfacet import DIELECTRIC_F0
from solver.field.heads import MaterialHeads, MetallicHeads


def flat(heads):
    """Heads that say the same everywhere."""
    with torch.no_grad():
        for layer in heads.children():
            layer.weight.zero_()
    return heads


def test_heads_start_with_the_values_they_are_given():
    features = torch.randn(3, 6)
    plain = flat(MaterialHeads(6, 0.3, 0.4, 0.2))(features)
    torch.testing.assert_close(plain.albedo, torch.full((3, 3), 0.3))
    torch.testing.assert_close(plain.f0, torch.full((3, 3), 0.2))
    torch.testing.assert_close(plain.alpha, torch.full((3,), 0.16))
    assert plain.metalness is None
    metallic = flat(MetallicHeads(6, 0.5, 0.4, 0.25))(features)
    torch.testing.assert_close(metallic.albedo, torch.full((3, 3), 0.375))
    torch.testing.assert_close(metallic.f0, torch.full((3, 3), 0.75 * DIELECTRIC_F0 + 0.125))
    torch.testing.assert_close(metallic.metalness, torch.full((3,), 0.25))


def test_a_dielectric_reflects_four_per_cent_and_a_metal_has_no_albedo():
    features = torch.randn(5, 6)
    dielectric = MetallicHeads(6, 0.5, 0.4, 1e-6)
    metal = MetallicHeads(6, 0.5, 0.4, 1 - 1e-6)
    with torch.no_grad():
        for heads in (dielectric, metal):
            heads.metalness.weight.zero_()
    torch.testing.assert_close(dielectric(features).f0, torch.full((5, 3), DIELECTRIC_F0))
    assert metal(features).albedo.max() < 1e-5
    torch.testing.assert_close(
        metal(features).f0, torch.sigmoid(metal.base_colour(features)), rtol=1e-4, atol=1e-5
    )


def test_no_surface_reflects_more_than_it_gets():
    torch.manual_seed(0)
    heads = MetallicHeads(6, 0.5, 0.4, 0.5)
    materials = heads(20 * torch.randn(500, 6))
    assert (materials.albedo + materials.f0).max() <= 1 + DIELECTRIC_F0


def test_albedo_alone_is_the_albedo_of_all():
    features = torch.randn(7, 6)
    for heads in (MaterialHeads(6, 0.3, 0.4, 0.2), MetallicHeads(6, 0.5, 0.4, 0.3)):
        torch.testing.assert_close(heads.albedo_of(features), heads(features).albedo)
