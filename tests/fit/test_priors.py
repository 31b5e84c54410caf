"""What things are usually made of pulls where it should, and nowhere else."""

import dataclasses
import math
from types import SimpleNamespace

import pytest
import torch

from solver.fit import priors
from solver.fit.presets import settings_for
from solver.light.environment import EnvironmentMap, LightTables


def pull(term, name, values, **others):
    """Gradients of a term to the materials of opaque pixels."""
    values = torch.tensor(values, requires_grad=True)
    seen = SimpleNamespace(opacity=torch.ones(len(values)), f0=torch.full((len(values), 3), 0.04))
    for key, value in others.items():
        setattr(seen, key, torch.tensor(value))
    setattr(seen, name, values)
    term(seen).backward()
    return values.grad


def palette(albedo, opacity=None):
    albedo = torch.tensor(albedo)[:, None].expand(-1, 3)
    opacity = torch.ones(len(albedo)) if opacity is None else torch.tensor(opacity)
    albedo, f0 = albedo * opacity[:, None], 0.04 * opacity[:, None].expand(-1, 3)
    return float(priors.off_palette(SimpleNamespace(albedo=albedo, f0=f0, opacity=opacity)))


def test_f0_close_to_a_dielectrics_is_pulled_there_and_metals_are_left_alone():
    def of(f0):
        return float(pull(priors.unlike_dielectric, "f0", [[f0] * 3]).mean())

    assert of(0.04) == 0 and of(0.07) > 0 > of(0.02)
    assert of(0.6) < 1e-3 * of(0.07)


def test_metals_are_pulled_to_bright_ones_without_colour_and_dielectrics_are_left_alone():
    def of(*f0):
        return pull(priors.unlike_metal, "f0", [f0])[0].tolist()

    red, green, blue = of(0.7, 0.5, 0.2)
    assert red == green == blue < -0.1
    assert of(0.9, 0.6, 0.3) == pytest.approx([0, 0, 0], abs=1e-6)
    assert abs(of(0.04, 0.04, 0.04)[0]) < 0.05 * abs(red)


def test_metals_that_are_green_or_blue_are_painted_and_may_be_dim():
    def of(*f0):
        return float(pull(priors.unlike_metal, "f0", [f0])[0].abs().max())

    grey, bluish, bronze = of(0.5, 0.5, 0.5), of(0.36, 0.42, 0.5), of(0.5, 0.42, 0.3)
    # Chrome is bluish while its light is too warm.
    assert min(bluish, bronze) > 0.8 * grey
    for painted in ((0.08, 0.16, 0.5), (0.1, 0.5, 0.2), (0.4, 0.1, 0.5)):
        assert of(*painted) < 0.05 * grey


def test_what_is_no_metal_loses_the_colour_of_its_f0_and_keeps_its_brightness():
    def of(*f0):
        return pull(priors.coloured_dielectric, "f0", [f0])[0]

    assert of(0.04, 0.04, 0.04).tolist() == pytest.approx([0, 0, 0], abs=1e-8)
    orange = of(0.09, 0.05, 0.04)
    assert orange[0] > 0 > orange[2] and float(orange.sum()) == pytest.approx(0, abs=1e-8)
    copper, on_its_way = of(0.95, 0.6, 0.5), of(0.31, 0.2, 0.17)
    assert copper.tolist() == on_its_way.tolist() == [0, 0, 0]
    assert 0 < of(0.25, 0.21, 0.2)[0] < orange[0]


def test_only_what_is_surely_metal_loses_its_albedo():
    albedo = [[0.5] * 3, [0.5] * 3, [0.5] * 3]
    f0 = [[0.9, 0.6, 0.3], [0.04] * 3, [0.3] * 3]
    metal, dielectric, unsure = pull(priors.diffuse_metal, "albedo", albedo, f0=f0).mean(-1)
    assert metal > 0.05
    assert max(dielectric, unsure) < 0.01 * metal


def test_albedos_that_may_be_one_colour_are_pulled_together():
    first, second, *rest = pull(
        priors.off_palette, "albedo", [[0.5] * 3, [0.5] * 3, [0.45] * 3, [0.45] * 3]
    ).mean(-1)
    assert first > 0 and second > 0 and all(other < 0 for other in rest)


def test_colours_far_apart_are_left_alone():
    def of(other):
        return float(pull(priors.off_palette, "albedo", [[0.5] * 3, [other] * 3])[0].mean().abs())

    assert of(0.01) < 0.1 * of(0.45)


def test_differences_that_are_small_are_pulled_ever_more_beside_larger_ones():
    fit = dataclasses.replace(
        settings_for("draft").fit, dielectric_weight=0.0, grey_f0_weight=0.0, metal_weight=0.0,
        metal_albedo_weight=0.0, roughness_weight=0.0,
    )  # fmt: skip

    def of(difference, fraction):
        def term(seen):
            return priors.of_materials(seen, fit, fraction)

        albedo = [[0.5] * 3, [0.5 + difference] * 3]
        return float(pull(term, "albedo", albedo)[0].mean().abs())

    assert of(0.1, 0.0) > of(0.02, 0.0), "at the start they may be shadows"
    assert of(0.1, 0.99) < 0.5 * of(0.02, 0.99), "a texture's steps are left alone at the end"


def test_metals_have_no_colour_of_the_palette_and_pull_nobody_to_theirs():
    def of(*f0):
        albedo = [[0.5] * 3, [0.45] * 3]
        return pull(priors.off_palette, "albedo", albedo, f0=f0).mean(-1).abs()

    alike, beside_gold = of([0.04] * 3, [0.04] * 3), of([0.04] * 3, [0.9, 0.6, 0.3])
    assert float(beside_gold.max()) < 0.01 * float(alike.min())


def test_a_darker_object_is_no_better_than_a_brighter_one():
    albedo = [0.8, 0.7, 0.3, 0.35, 0.82, 0.1]
    assert palette([0.2 * a for a in albedo]) == pytest.approx(palette(albedo), rel=1e-5)


def test_few_colours_are_better_than_many():
    generator = torch.Generator().manual_seed(0)

    def anywhere(albedo):
        order = [torch.randperm(len(albedo), generator=generator) for _ in range(20)]
        return sum(palette(albedo[o].tolist()) for o in order) / len(order)

    two = torch.tensor([0.3] * 32 + [0.9] * 32)
    assert anywhere(two) < 0.9 * anywhere(torch.linspace(0.3, 0.9, 64))
    assert anywhere(torch.full((64,), 0.6)) == 0


def test_what_is_not_the_object_has_no_colour():
    assert palette([0.4, 0.4, 0.9, 0.4], [1.0, 1.0, 0.0, 1.0]) == pytest.approx(0, abs=1e-6)
    assert palette([0.4, 0.6], [0.0, 0.0]) == 0


def light(*colours):
    """A light of so many stripes of these colours."""
    environment = EnvironmentMap(8).requires_grad_(False)
    stripes = torch.tensor(colours).log().T.repeat_interleave(16 // len(colours), 1)
    environment.log_radiance.copy_(stripes[:, None])
    return environment


def test_a_whole_lights_colour_counts_whatever_its_brightness_and_those_of_its_parts_do_not():
    def of(*colours):
        return float(priors.coloured_light(light(*colours).tables()))

    assert of((0.3, 0.3, 0.3)) == pytest.approx(0, abs=1e-12)
    assert of((0.1, 0.5, 1.0), (1.0, 0.6, 0.1)) == pytest.approx(0, abs=1e-12)
    blue = of((0.5, 0.5, 1.0))
    assert blue == pytest.approx(2 / 9 * math.log(2) ** 2)
    assert of((5.0, 5.0, 10.0)) == pytest.approx(blue)


def test_the_gradient_of_a_lights_colour_agrees_with_finite_differences():
    irradiance = torch.rand(2, 9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def of(irradiance):
        return priors.coloured_light(LightTables(None, irradiance))

    torch.autograd.gradcheck(of, irradiance.requires_grad_())


def test_the_paper_has_no_such_terms():
    ones = torch.ones(4, 3)
    f0 = torch.tensor([[0.5, 0.5, 0.5], [0.04, 0.04, 0.04], [0.09, 0.05, 0.04], [0.9, 0.6, 0.5]])
    seen = SimpleNamespace(opacity=ones[:, 0], albedo=ones, f0=f0, alpha=ones[:, 0])
    fit = settings_for("paper").fit
    assert fit.grey_light_weight == 0
    assert priors.of_materials(seen, fit, 0.5) == 0
    assert priors.of_materials(seen, fit, 0.9) == 0
    assert priors.of_materials(seen, dataclasses.replace(fit, metal_weight=1.0), 0.5) > 0
    grey = dataclasses.replace(fit, grey_f0_weight=1.0)
    assert priors.of_materials(seen, grey, 0.5) == 0 < priors.of_materials(seen, grey, 0.9)
