"""What is done for each sample or pixel at once: against the plain torch that it stands for."""

import dataclasses
from types import SimpleNamespace

import pytest
import torch

from solver.brdf.neural import NeuralTerm
from solver.field.field import MicrofacetField
from solver.field.heads import MIN_ALPHA, MaterialHeads, Materials
from solver.fit import priors
from solver.fit.losses import total_loss
from solver.fit.settings import FitSettings
from solver.kernels.backend import forced_path, kernels
from solver.kernels.pointwise import rowwise
from solver.render.footprint import reflected_spread
from solver.render.random_numbers import RandomNumbers
from solver.render.reflection import plan_rays, scatter, secondary_origins
from solver.render.scene import RenderSettings, Samples, StepTables, Surface
from solver.render.shade import Shading, diffuse_radiance
from solver.render.smoothness import smoothness
from tests.kernels.paths import PATHS, to_device
from tests.render.test_invariance import lumpy

CARDS = [path for path in PATHS if path.values[0] == "warp"]
COUNT = 500


def rand(*shape):
    return torch.rand(*shape, generator=rand.generator)


def unit(count=COUNT):
    return torch.nn.functional.normalize(rand(count, 3) - 0.5, dim=-1)


def materials():
    alpha = (1e-4 + rand(COUNT)).requires_grad_()
    return [rand(COUNT, 3).requires_grad_(), alpha, rand(COUNT, 3).requires_grad_()]


def compare(path, device, leaves, function, fixed=(), scale=1.0):
    """Outputs of a function, and gradients to its leaves, by kernels and by plain torch."""
    found = []
    for taken in (path, "torch"):
        inputs = to_device(leaves, device)
        with forced_path(taken):
            outputs = function(*inputs, *to_device(fixed, device))
            weights = torch.linspace(0.5, 1.5, sum(o.numel() for o in outputs), device=device)
            sum(
                (o.flatten() * w).sum()
                for o, w in zip(outputs, weights.split([o.numel() for o in outputs]), strict=True)
            ).backward()
        found.append([*outputs, *(leaf.grad for leaf in inputs)])
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(scale * a, scale * b, rtol=1e-4, atol=1e-5)
    assert all((leaf.grad != 0).any() for leaf in inputs)


@pytest.fixture(autouse=True)
def seeded():
    rand.generator = torch.Generator().manual_seed(3)


@pytest.fixture(autouse=True)
def kernels_run(monkeypatch):
    """A test in which no kernel ran has compared the twin with itself."""
    names = []

    def telling(run):
        def told(name, *arguments):
            names.append(name)
            run(name, *arguments)

        return told

    for path in ("numba", "warp"):
        with forced_path(path):
            family = kernels("pointwise", torch.device("cpu"))
        monkeypatch.setattr(family, "run", telling(family.run))
    yield
    assert names


@pytest.mark.parametrize("path, device", PATHS)
def test_diffuse_light_is_the_same(path, device):
    def function(normals, albedo, f0, light, view):
        return diffuse_radiance(normals, Materials(albedo, None, f0), light, view)

    albedo, _, f0 = materials()
    leaves = [unit().requires_grad_(), albedo, f0, rand(COUNT, 3).requires_grad_()]
    compare(path, device, [*leaves, unit().requires_grad_()], function)


@pytest.mark.parametrize("path, device", PATHS)
def test_materials_are_the_same_also_where_roughness_is_at_its_least(path, device):
    torch.manual_seed(0)
    heads = MaterialHeads(6, 0.5, 0.4, 0.1).to(device)
    features = 4 * (rand(COUNT, 6) - 0.5)
    features[::3, 0] = -40
    with torch.no_grad():
        heads.roughness.weight[0, 0] = 0.2

    def function(features):
        return heads(features)

    compare(path, device, [features.requires_grad_()], function)
    with forced_path(path):
        alpha = heads(features.to(device)).alpha
    assert 0.2 < (alpha == MIN_ALPHA).float().mean() < 0.5


@pytest.mark.parametrize("path, device", PATHS)
def test_gradients_that_are_not_wanted_are_written_nowhere(path, device):
    """A fixed bug: a launch went on to write where the one before it had wanted a gradient."""
    normals, light, view = to_device([unit(), rand(COUNT, 3), unit()], device)
    albedo, alpha, f0 = to_device(materials(), device)
    before = []
    with forced_path(path):
        for wanted in (True, False, True):
            light.grad = None
            light.requires_grad_(wanted)
            radiance, _ = diffuse_radiance(normals, Materials(albedo, alpha, f0), light, view)
            kept = [gradient.clone() for gradient in before]
            radiance.sum().backward()
            assert all(torch.equal(*pair) for pair in zip(before, kept, strict=True))
            before += [light.grad] if wanted else []
    assert len(before) == 2 and torch.equal(*before)


def test_a_gradient_that_no_adjoint_writes_is_refused():
    """A fixed bug: what lay in memory was taken for the gradient of the view along retraced rays."""
    value, known = rand(COUNT).requires_grad_(), torch.ones(COUNT, dtype=torch.bool)
    behind = rand(COUNT, 3).requires_grad_()
    inputs = (
        rand(COUNT, 1, 4), value, value, value, rand(COUNT, 3), rand(COUNT), known,
        known[:, None].expand(COUNT, 3), behind,
    )  # fmt: skip
    with forced_path("numba"):
        image, _ = rowwise("pixel_loss", inputs, (0.5,) * 5, ((), ()))
        with pytest.raises(TypeError, match="pixel_loss: gradients are for the first 4 inputs"):
            image.sum().backward()


@pytest.mark.parametrize("path, device", PATHS)
def test_smoothness_is_the_same(path, device):
    normals = unit()
    close = [torch.nn.functional.normalize(normals + 0.05 * unit(), dim=-1) for _ in range(2)]
    here, there = materials(), materials()
    # Half of all are of one material, where steps of roughness count more.
    there[0] = (
        here[0].detach() + 0.01 * (torch.arange(COUNT) % 2)[:, None] * rand(COUNT, 3)
    ).requires_grad_()
    leaves = [normals.requires_grad_(), *(n.requires_grad_() for n in close), *here, *there]

    def function(normals, near, beyond, albedo, alpha, f0, near_albedo, near_alpha, near_f0):
        nearby = Surface(near, None, Materials(near_albedo, near_alpha, near_f0), 0.0)
        scene = SimpleNamespace(
            field=SimpleNamespace(voxel=0.01), surface=lambda *_: nearby, surface_normals=lambda *_: beyond
        )
        shading = Shading(None, normals, None, Materials(albedo, alpha, f0))
        keys = torch.arange(COUNT, device=normals.device)
        samples = Samples(normals.detach(), None, None, keys)
        tables, random = SimpleNamespace(normals=None), RandomNumbers(0, normals.device)
        return smoothness(scene, tables, RenderSettings(), random, samples, shading)

    compare(path, device, leaves, function)


@pytest.mark.parametrize("path, device", PATHS)
def test_normals_are_the_same_also_where_there_is_hardly_any_slope(path, device):
    planes, lines = rand(3, 8, 8, 4), rand(3, 8, 4)
    planes[:, :3] = 1e-4 * planes[:, :3]
    points = rand(COUNT, 3)
    field = MicrofacetField(torch.zeros(3), 1.0, 8, density_components=4).to(device)

    def function(planes, lines):
        return [field.normals(points.to(device), (planes, lines))]

    compare(path, device, [planes.requires_grad_(), lines.requires_grad_()], function, scale=1e-3)


@pytest.mark.parametrize("path, device", PATHS)
def test_a_pixels_spread_in_a_mirror_is_the_same(path, device):
    scene = lumpy().to(device)
    points, view, normals = 0.5 * unit(), unit(), unit()
    samples = to_device([points, 4 + rand(COUNT), torch.arange(COUNT), None], device)
    normals, view, angle = to_device([normals, view, 0.01 * rand(COUNT)], device)
    found = []
    for taken in (path, "torch"):
        with forced_path(taken):
            tables = StepTables.of(scene)
            found.append(reflected_spread(scene, tables, Samples(*samples), normals, view, angle))
    torch.testing.assert_close(*found, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("reach", [0.02, None])
def test_rays_begin_at_the_same_height(reach):
    samples = Samples(unit(), None, None, None)
    sample, direction = torch.arange(3 * COUNT) % COUNT, unit(3 * COUNT)
    reach = rand(COUNT) if reach is None else reach
    found = []
    for path in ("numba", "torch"):
        with forced_path(path):
            found.append(secondary_origins(samples, samples.points, sample, direction, reach))
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("masking, averaged", [(True, True), (False, False)])
@pytest.mark.parametrize("path, device", CARDS)
def test_scattered_rays_are_the_same_with_the_neural_term(path, device, masking, averaged):
    normals, view = unit(), unit()
    view = torch.where((view * normals).sum(-1, keepdim=True) > 0, view, -view)
    _, alpha, f0 = materials()
    leaves = [normals.requires_grad_(), alpha, f0, rand(COUNT, 24).requires_grad_()]
    settings = RenderSettings(neural=0.7, light_masking=masking, integral_image=averaged)
    torch.manual_seed(0)
    term = NeuralTerm(24).to(device)
    scene = SimpleNamespace(neural_term=lambda part, *inputs: term(*inputs))

    def function(normals, alpha, f0, features, view, mass):
        surface = Surface(normals, features, Materials(None, alpha, f0), 0.0)
        keys = 4096 * torch.arange(COUNT, device=device)
        plan = plan_rays(keys, mass, 4, RandomNumbers(0, device))
        rays = scatter(surface, normals, view, None, plan, scene, settings)
        return [rays.direction, rays.weight, 0.01 * rays.solid_angle]

    compare(path, device, leaves, function, [view, rand(COUNT)], scale=0.1)


@pytest.mark.parametrize("halves", [1, 2])
@pytest.mark.parametrize("use_masks", [True, False])
@pytest.mark.parametrize("path, device", PATHS)
def test_losses_of_pixels_are_the_same(path, device, use_masks, halves):
    opacity, alpha = rand(COUNT, halves, 1), (2 * rand(COUNT) - 0.5).clamp(0, 1)
    opacity[:3] = torch.tensor([1.001, 0.0, 1.0])[:, None, None]
    radiance = 1.2 * rand(COUNT, halves, 3) ** 3 * opacity
    seen = torch.cat([radiance, opacity], 2).requires_grad_()
    leaves = [seen, *(rand(COUNT).requires_grad_() for _ in range(3))]
    fixed = [rand(COUNT, 3), alpha, rand(COUNT) < 0.8, rand(COUNT, 3) < 0.5, rand(COUNT, 3)]

    def function(seen, backfacing, bending, unevenness, colour, alpha, known, clipped, behind):
        buffers = SimpleNamespace(
            radiance=seen[:, 0, :3], opacity=seen[:, 0, 3], halves=seen if halves == 2 else None,
            backfacing=backfacing, bending=bending, unevenness=unevenness,
        )  # fmt: skip
        batch = SimpleNamespace(colour=colour, alpha=alpha, alpha_known=known, clipped=clipped)
        loss, terms = total_loss(buffers, batch, FitSettings(), use_masks, 0.3, behind)
        return [COUNT * loss.view(1), terms["image"].view(1)]

    compare(path, device, leaves, function, fixed)


@pytest.mark.parametrize("fraction", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("path, device", PATHS)
def test_priors_of_materials_are_the_same(path, device, fraction):
    opacity = rand(COUNT)
    opacity[0], opacity[1] = 0.0, 1.0
    f0 = rand(COUNT, 3) ** 2
    f0[: COUNT // 2] = 0.05 + 0.2 * f0[: COUNT // 2]
    albedo, f0 = ((value * opacity[:, None]).requires_grad_() for value in (rand(COUNT, 3), f0))
    settings = dataclasses.replace(FitSettings(), palette_weight=0.3, roughness_weight=0.0)

    def function(albedo, f0, opacity):
        buffers = SimpleNamespace(albedo=albedo, f0=f0, opacity=opacity, alpha=None)
        return [priors.of_materials(buffers, settings, fraction).view(1) * COUNT]

    if fraction < settings.f0_start:
        compare(path, device, [albedo], lambda a, f, o: function(a, f, o), [f0.detach(), opacity])
    else:
        compare(path, device, [albedo, f0], function, [opacity])
