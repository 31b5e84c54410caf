"""Base colour and metalness: what is no metal stays as it was, and nothing gets darker or brighter."""

import numpy as np

from solver.asset.metallic import SURE_METAL_F0, metallic_workflow
from solver.brdf.microfacet import DIELECTRIC_F0, SURE_DIELECTRIC_F0, principled_albedo


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
    base, metalness, rest = metallic_workflow(albedo, f0)
    assert not metalness.any()
    np.testing.assert_array_equal(rest, f0)
    diffuse, mirrored = head_on(base, metalness, rest)
    np.testing.assert_allclose(diffuse, albedo * (1 - f0))
    np.testing.assert_allclose(mirrored, f0)


def test_a_metal_is_one_also_where_f0_is_not_known():
    _, f0 = surfaces(np.random.default_rng(1), 200, SURE_METAL_F0, 1.0, 0.0)
    base, metalness, _ = metallic_workflow(np.zeros_like(f0), f0)
    np.testing.assert_allclose(base, f0)
    assert (metalness == 1).all()


def test_what_is_bright_enough_for_a_metal_comes_out_as_it_is_in_any_program():
    """Its diffuse layer beside F0, and what it mirrors, whether a program knows F0 or not."""
    albedo, f0 = surfaces(np.random.default_rng(2), 500, 0.5, 0.98, 0.4)
    base, metalness, rest = metallic_workflow(albedo, f0)
    for dielectric_f0 in (rest, np.full_like(f0, DIELECTRIC_F0)):
        diffuse, mirrored = head_on(base, metalness, dielectric_f0)
        wrong = np.abs(diffuse + mirrored - albedo * (1 - f0) - f0)
        assert wrong.mean() < 2e-3 and np.quantile(wrong, 0.95) < 0.02
        assert np.abs((diffuse - albedo * (1 - f0)).mean(-1)).max() < 0.02


def test_of_what_principled_mixes_base_colour_and_metalness_are_found_again():
    random = np.random.default_rng(3)
    base, metalness = random.uniform(0.6, 1, (500, 3)), random.uniform(0.7, 1, (500, 1))
    f0 = DIELECTRIC_F0 * (1 - metalness) + metalness * base
    albedo = (1 - metalness) * base * (1 - DIELECTRIC_F0) / (1 - f0)
    np.testing.assert_allclose(principled_albedo(albedo, f0), (1 - metalness) * base)
    found = metallic_workflow(albedo, f0)
    np.testing.assert_allclose(found.metalness, metalness, atol=1e-9)
    np.testing.assert_allclose(found.base_colour, base, atol=1e-9)
    np.testing.assert_allclose(found.rest_f0, DIELECTRIC_F0)


def test_between_both_nothing_leaps():
    f0 = np.linspace(0.0, 0.95, 2001)[:, None] * np.array([1.0, 0.8, 0.5])
    for albedo in (0.0, 0.1, 0.6):
        base, metalness, rest = metallic_workflow(np.full_like(f0, albedo), f0)
        for values in (base, metalness, rest):
            assert np.abs(np.diff(values, axis=0)).max() < 0.01
            assert (values >= 0).all() and (values <= 1).all()
