"""Base colour and metalness: what is no metal stays as it was, and nothing gets darker or brighter."""

import numpy as np

from solver.asset.metallic import SURE_METAL_F0, metallic_workflow
from solver.brdf.microfacet import SURE_DIELECTRIC_F0


def head_on(base, metalness, dielectric_f0):
    """Diffuse and mirrored share [..., 3] of light along the normal, by glTF 2.0, appendix B."""
    attenuated = 1 - dielectric_f0.max(-1, keepdims=True)
    return (1 - metalness) * base * attenuated, (1 - metalness) * dielectric_f0 + metalness * base


def surfaces(random, count, low, high, most_albedo):
    """Random albedo and F0 [N, 3], whose brightest channel lies between low and high."""
    f0 = random.uniform(0.3, 1, (count, 3))
    f0 *= random.uniform(low, high, (count, 1)) / f0.max(-1, keepdims=True)
    return random.uniform(0, most_albedo, (count, 3)), f0


def test_what_is_no_metal_has_none_of_it_and_reflects_by_its_f0():
    albedo, f0 = surfaces(np.random.default_rng(0), 200, 0.0, SURE_DIELECTRIC_F0, 0.7)
    base, metalness = metallic_workflow(albedo, f0)
    assert not metalness.any()
    diffuse, mirrored = head_on(base, metalness, f0)
    np.testing.assert_allclose(diffuse, albedo * (1 - f0))
    np.testing.assert_allclose(mirrored, f0)


def test_a_metal_is_one_also_where_f0_is_not_known():
    _, f0 = surfaces(np.random.default_rng(1), 200, SURE_METAL_F0, 1.0, 0.0)
    base, metalness = metallic_workflow(np.zeros_like(f0), f0)
    np.testing.assert_allclose(base, f0)
    assert (metalness == 1).all()


def test_a_little_of_an_albedo_leaves_a_metal_as_bright_as_it_is():
    albedo, f0 = surfaces(np.random.default_rng(2), 500, 0.5, 0.98, 0.05)
    base, metalness = metallic_workflow(albedo, f0)
    assert (metalness > 0.7).all()
    for dielectric_f0, most in ((f0, 0.03), (np.full_like(f0, 0.04), 0.08)):
        diffuse, mirrored = head_on(base, metalness, dielectric_f0)
        wrong = np.abs(diffuse + mirrored - albedo * (1 - f0) - f0)
        assert wrong.mean() < most / 2 and np.quantile(wrong, 0.95) < most


def test_between_both_nothing_leaps():
    f0 = np.linspace(0.0, 0.95, 2001)[:, None] * np.array([1.0, 0.8, 0.5])
    for albedo in (0.0, 0.1, 0.6):
        base, metalness = metallic_workflow(np.full_like(f0, albedo), f0)
        assert np.abs(np.diff(base, axis=0)).max() < 0.01
        assert np.abs(np.diff(metalness, axis=0)).max() < 0.01
        assert (base >= 0).all() and (base <= 1).all()
