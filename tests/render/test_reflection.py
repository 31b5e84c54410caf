"""The fused kernel of glossy reflection against its plain twin, in values and in gradients."""

import dataclasses
from types import SimpleNamespace

import pytest
import torch

from solver.cli import MOST_RAYS
from solver.field.heads import Materials
from solver.kernels.backend import forced_path, plain_torch
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.light.floor import Floor
from solver.render.random_numbers import RandomNumbers
from solver.render.reflection import CLEAR, _choose, choose_noisy_largest, reflected
from solver.render.scene import RenderSettings, Samples, StepTables, Surface
from tests.render.scenes import ball

COUNT = 60
FLOOR = Floor((0.0, 0.6, 0.8), -0.45, (0.1, 0.0, 0.1))
"""slanted, with some of the ball below it"""


def setting(alpha):
    """Samples all round a ball seen from all sides, some at a grazing angle; a light of many colours."""
    torch.manual_seed(4)
    sky = equirect_directions(32, 64).float()
    light = EnvironmentMap.from_radiance(1.3 + torch.stack(sky.unbind(-1), -1))
    scene = ball(environment=light)
    # Thin everywhere, so that rays are dimmed by all sorts of amounts.
    cells = scene.occupancy.occupied
    thin = torch.rand(cells.shape) * (torch.rand(cells.shape) < 0.02)
    scene.occupancy.fill(cells, torch.nn.functional.pad(thin, (0, 1) * 3))
    normals = torch.nn.functional.normalize(torch.randn(COUNT, 3), dim=-1)
    aside = torch.nn.functional.normalize(torch.randn(COUNT, 3), dim=-1)
    view = torch.nn.functional.normalize(normals + 1.5 * torch.rand(COUNT, 1) * aside, dim=-1)
    view = torch.where((view * normals).sum(-1, keepdim=True) < 0.02, normals, view)
    samples = Samples(0.5 * normals, torch.ones(COUNT), torch.arange(COUNT), 4096 * torch.arange(COUNT))
    leaves = [normals, torch.full((COUNT,), alpha), torch.rand(COUNT, 3)]
    return scene, samples, view, [leaf.requires_grad_() for leaf in leaves]


def result(scene, samples, view, leaves, settings, spread=None, trace=None):
    normals, alpha, f0 = leaves
    surface = Surface(normals, torch.zeros(COUNT, 4), Materials(f0, alpha, f0), 0.1)
    tables = StepTables.of(scene)
    radiance = reflected(
        scene, tables, settings, RandomNumbers(3), samples, surface, normals, view,
        torch.ones(COUNT), 8, trace, spread,
    )  # fmt: skip
    weights = torch.linspace(-1, 1, COUNT * 3).view(COUNT, 3)
    log_radiance = scene.environment.log_radiance
    return radiance, torch.autograd.grad((radiance * weights).sum(), [*leaves, log_radiance])


@pytest.mark.parametrize("alpha", [0.02, 0.2, 0.9])
@pytest.mark.parametrize("change", [{}, {"light_masking": False}, {"integral_image": False}])
@pytest.mark.parametrize("pixel", [0.0, 0.3])
@pytest.mark.parametrize("floor", [None, FLOOR], ids=["all far", "floor"])
def test_fused_reflection_agrees_with_its_twin_in_values_and_gradients(alpha, change, pixel, floor):
    settings = dataclasses.replace(RenderSettings(neural=0.0, retraced_rays=0), **change)
    arguments = setting(alpha)
    arguments[0].environment.floor = floor
    spread = pixel * torch.randn(COUNT, 2, 3) if pixel else None
    compare(arguments, settings, spread)


@pytest.mark.parametrize("alpha", [0.05, 0.1])
def test_the_gradient_of_roughness_knows_that_rays_of_wider_lobes_stand_for_more(alpha):
    """Of the light around a lamp, against finite differences."""
    scene, samples, view, (normals, _, f0) = setting(alpha)
    towards = equirect_directions(64, 128).float() @ torch.tensor([0.0, 0.6, 0.8])
    lamp = 0.1 + 20 * torch.exp((towards - 1) / 0.02)
    scene.environment = EnvironmentMap.from_radiance(lamp.expand(3, -1, -1).movedim(0, -1))

    def to_log_alpha(log_change, widening):
        log_change = torch.tensor(log_change, requires_grad=True)
        materials = Materials(f0, (alpha * log_change.exp()).expand(COUNT), f0)
        settings = RenderSettings(neural=0.0, retraced_rays=0, visibility=False, widening_gradient=widening)
        radiance = reflected(
            scene, StepTables.of(scene), settings, RandomNumbers(3), samples,
            Surface(normals, torch.zeros(COUNT, 4), materials, 0.1), normals, view,
            torch.ones(COUNT), 8,
        ).sum()  # fmt: skip
        return radiance.item(), torch.autograd.grad(radiance, log_change)[0].item()

    difference = (to_log_alpha(0.01, True)[0] - to_log_alpha(-0.01, True)[0]) / 0.02
    assert to_log_alpha(0.0, True)[1] == pytest.approx(difference, rel=0.03)
    assert to_log_alpha(0.0, False)[1] < 0.9 * difference


def test_retraced_rays_carry_the_same_gradients_through_directions_and_weights():
    def trace(origins, directions, keys, start):
        return 2 + torch.sin(3 * directions) + directions.flip(-1), torch.zeros(len(directions))

    # A budget for all: which rays are chosen may hang on the last digit.
    settings = RenderSettings(neural=0.0, retraced_rays=8 * COUNT)
    compare(setting(0.3), settings, None, trace)


def radiance_of(arguments, settings, random, trace, rays=8):
    scene, samples, view, (normals, alpha, f0) = arguments
    surface = Surface(normals, torch.zeros(COUNT, 4), Materials(f0, alpha, f0), 0.1)
    with torch.no_grad():
        return reflected(
            scene, StepTables.of(scene), settings, random, samples, surface, normals, view,
            torch.ones(COUNT), rays, trace,
        )  # fmt: skip


def test_what_a_small_budget_retraces_is_all_of_it_on_average():
    def trace(origins, directions, keys, start):
        return 2 + torch.sin(3 * directions), torch.zeros(len(directions))

    arguments = setting(0.3)
    few, all_of_them = (RenderSettings(neural=0.0, retraced_rays=budget) for budget in (40, 8 * COUNT))
    random = RandomNumbers(3)
    difference = [
        radiance_of(arguments, few, random.at(step), trace).mean()
        - radiance_of(arguments, all_of_them, random.at(step), trace).mean()
        for step in range(100)
    ]
    brought = (
        radiance_of(arguments, all_of_them, random, trace).mean()
        - radiance_of(arguments, all_of_them, random, None).mean()
    )
    assert brought > 0.02
    assert abs(torch.stack(difference).mean()) < 0.05 * brought


@pytest.mark.parametrize("passing", [0.0, 0.3, 1.0])
def test_without_visibility_what_a_traced_ray_meets_takes_the_place_of_the_light_behind(passing):
    """As bright as the sky, an obstacle changes nothing, however much passes it; black, it darkens."""
    scene, *others = setting(0.3)
    scene.environment = EnvironmentMap(32, 1.0)
    arguments = (scene, *others)
    settings = RenderSettings(neural=0.0, retraced_rays=8 * COUNT, visibility=False)

    def obstacle(brightness):
        def trace(origins, directions, keys, start):
            return torch.full_like(directions, brightness * (1 - passing)), torch.full(
                (len(directions),), passing
            )

        return radiance_of(arguments, settings, RandomNumbers(3), trace)

    free = radiance_of(arguments, settings, RandomNumbers(3), None)
    torch.testing.assert_close(obstacle(1.0), free, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(obstacle(0.0), passing * free, rtol=1e-4, atol=1e-5)


def test_the_papers_choice_takes_the_largest_whatever_their_unit_and_its_noise_varies_the_rest():
    torch.manual_seed(0)
    scores, noise = torch.rand(200) ** 4, torch.rand(200)
    silent = choose_noisy_largest(scores, 20, torch.zeros(200))
    assert set(silent.tolist()) == set(scores.topk(20).indices.tolist())
    chosen = set(choose_noisy_largest(scores, 20, noise).tolist())
    assert chosen == set(choose_noisy_largest(1e-5 * scores, 20, noise).tolist())
    assert len(chosen) == 20 and chosen != set(silent.tolist())
    # Scaled to sum to the budget, what stands out by more than the noise is never left out.
    scaled, taken = scores * (20 / scores.sum()), torch.zeros(200, dtype=torch.bool)
    taken[list(chosen)] = True
    assert float(scaled[~taken].max()) < float(scaled[taken].min()) + 1
    assert len(choose_noisy_largest(scores, 0, noise)) == 0


def compare(arguments, settings, spread, trace=None):
    fused, fused_gradients = result(*arguments, settings, spread, trace)
    with plain_torch():
        plain, plain_gradients = result(*arguments, settings, spread, trace)
    torch.testing.assert_close(fused, plain, rtol=2e-3, atol=2e-3)
    for name, a, b in zip(
        ("normals", "alpha", "f0", "light"), fused_gradients, plain_gradients, strict=True
    ):
        error = float((a - b).norm() / b.norm())
        assert error < 5e-3, f"{name}: {error}"


@pytest.mark.parametrize("budget", [0, 7, 60, 4000])
def test_blocked_rays_are_chosen_as_by_the_plain_twin(budget):
    torch.manual_seed(5)
    samples, rays = 50, 600
    sample = torch.arange(rays) // (rays // samples)
    plan = SimpleNamespace(sample=sample, keys=torch.arange(rays))
    weight, mass, passing = torch.rand(rays, 3), torch.rand(samples), 1.3 * torch.rand(rays)
    mass[:10] = 0.0
    found = []
    for path in ("numba", "torch"):
        with forced_path(path):
            settings = RenderSettings(retraced_rays=budget)
            found.append(_choose(settings, RandomNumbers(1), plan, weight, passing, mass))
    (chosen, probability), (same, same_probability) = found
    assert torch.equal(chosen, same)
    torch.testing.assert_close(probability, same_probability)
    blocked = int(((passing < CLEAR) & (mass[sample] > 0)).sum())
    assert abs(len(chosen) - min(budget, blocked)) <= 1


def test_as_many_rays_as_can_be_asked_for_have_points_of_their_own():
    """A fixed bug: since all samples along a ray share a set, rays from the 1,025th on were those before."""
    points = RandomNumbers(3).points
    assert len(points.unique(dim=0)) >= 0.99 * MOST_RAYS
    assert torch.equal(points[:1024], RandomNumbers(3, points=1024).points)
