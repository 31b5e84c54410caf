"""Compile the fused kernels before the clock of a fit starts; numba and Warp keep them on disk."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from .adam import Moments, Rates, adam_step, mean_root_square
from .backend import has_kernels, kernels, on_numba, on_warp
from .drawing import choose_blocked, draw_depths, plan_rays
from .hashing import uniform
from .integral import corner_sums, prefix_sums, rectangle_mean
from .march import composite, grid_transmittance, march
from .pointwise import rowwise
from .probe_light import irradiance_between
from .seen import seen
from .skipping import blocking_grid
from .specular import Blockers, specular
from .sphere import look_up
from .visibility import look_around
from .vm import smooth_lines, smooth_planes, vm_gradient, vm_products, vm_sum

WARP_FAMILIES = (
    "adam", "drawing", "hashing", "integral", "loss", "march", "probe_light", "shading", "specular",
    "visibility", "vm",
)  # fmt: skip


def compile_kernels(device: torch.device | str = "cpu") -> None:
    """Run every kernel once, forwards and backwards, on a handful of numbers on a device."""
    device = torch.empty(0, device=device).device  # which of the cards, if only 'cuda' is said
    if on_warp(device):
        from . import warp_device

        warp_device.load(WARP_FAMILIES, device)
    with device:
        for group in GROUPS.values():
            if on_numba(device) or (has_kernels(device) and not group.cpu_only):
                group.run()


def run_groups(names: list[str], progress: Callable[[float], None]) -> None:
    """Compile some of the `GROUPS` for the CPU; `progress` is told the share done."""
    for done, name in enumerate(names, 1):
        GROUPS[name].run()
        progress(done / len(names))


def _leaf(*shape: int) -> Tensor:
    return torch.rand(*shape, requires_grad=True)


def _rays() -> tuple[Tensor, Tensor]:
    points = torch.rand(4, 3)
    return points, torch.nn.functional.normalize(points - 0.4, dim=-1)


def _run_lookups() -> None:
    points, _ = _rays()
    planes, lines = _leaf(3, 4, 4, 8), _leaf(3, 4, 8)
    taps = torch.tensor([0.25, 0.5, 0.25])
    vm_sum(points, planes, lines).sum().backward()
    vm_products(points, planes, lines).sum().backward()
    vm_gradient(points, smooth_planes(planes, taps), smooth_lines(lines, taps)).sum().backward()


def _run_walks() -> None:
    points, directions = _rays()
    segments = march(
        points, directions, torch.zeros(4), torch.zeros(4), 0.1, 0.25, torch.zeros(4, 4, 4).byte(),
        torch.rand(3, 4, 4, 8), torch.rand(3, 4, 8), -4.0, 25.0,
    )  # fmt: skip
    weights, transmittance = composite(_leaf(len(segments.ray)), segments.offsets)
    (weights.sum() + transmittance.sum()).backward()
    blocking = blocking_grid(torch.rand(5, 5, 5))
    grid_transmittance(points, directions, torch.zeros(4), 0.25, blocking)
    look_around(points, directions, 0.1, 0.25, blocking)


def _light() -> tuple[Tensor, Tensor]:
    """Prefix sums of a light and of its rows' solid angles."""
    rows = torch.linspace(0, 1, 5, dtype=torch.float64)
    return prefix_sums(_leaf(3, 4, 8), rows[1:]), rows


def _run_light() -> None:
    table, rows = _light()
    look_up(_leaf(3, 4, 8), torch.rand(4, 8, 2)).sum().backward()
    rectangle_mean(table, rows, _leaf(4, 2), torch.ones(4, 2)).sum().backward()


def _run_reflection() -> None:
    points, directions = _rays()
    blocking = blocking_grid(torch.rand(5, 5, 5))
    blockers = Blockers(torch.zeros(3), torch.empty(0, 3), 1.0, 0.25, blocking, 0.1)
    table, rows = _light()
    radiance, _ = specular(
        directions.clone().requires_grad_(), _leaf(4), _leaf(4, 3), table, directions, points,
        torch.arange(5), torch.ones(4), torch.ones(4).long(), torch.rand(4, 2), rows, True, True, True,
        blockers,
    )  # fmt: skip
    radiance.sum().backward()


def _run_rest() -> None:
    points, directions = _rays()
    keys, ones = torch.arange(4), torch.ones(4)
    uniform(keys, 0, 2)
    draw_depths(ones, torch.arange(5), ones, torch.rand(4, 2), 0.0)
    plan_rays(keys, ones, 1, torch.rand(4, 2), (0, 0))
    irradiance_between(
        _leaf(3, 9, 3), directions.clone().requires_grad_(), points, torch.ones(2, 2, 2).long(),
        torch.rand(2, 2, 2), 1.0, torch.rand(16, 9),
    ).sum().backward()  # fmt: skip
    moments = Moments(torch.zeros(4, 3), torch.zeros(4, 3))
    adam_step(torch.zeros(4, 3), torch.ones(4, 3), moments, Rates(0.1, 0.9, 0.99, 1e-15, 1))


def _run_pointwise() -> None:
    """Those of `pointwise`, of which Warp has modules that are compiled whole."""
    vectors, (points, view) = partial(_leaf, 4, 3), _rays()
    numbers, known = partial(_leaf, 4), torch.ones(4, dtype=torch.bool)
    calls = [
        ("materials", (_leaf(4, 7),), 1, ((3,), (), (3,))),
        ("outward", (vectors(),), 1, ((3,),)),
        ("diffuse", (vectors(), vectors(), vectors(), vectors(), view), 0, ((3,), (3,))),
        ("smoothness", (vectors(), vectors(), vectors(), numbers(), numbers(), vectors(), vectors(),
                        vectors(), vectors()), 5, ((), ())),
        ("pixel_loss", (_leaf(4, 2, 4), numbers(), numbers(), numbers(), points, numbers().detach(), known,
                        known[:, None].expand(4, 3).contiguous(), points), 5, ((), ())),
        ("material_priors", (vectors(), vectors(), numbers().detach()), 13, ((),)),
    ]  # fmt: skip
    for name, inputs, count, widths in calls:
        sum(out.sum() for out in rowwise(name, inputs, (0.5,) * count, widths)).backward()
    palette = vectors(), _leaf(1), numbers().detach()
    rowwise("off_palette", palette, (0.2, 2), ((),))[0].sum().backward()
    with torch.no_grad():
        edges = points, view, points, torch.ones(4), torch.ones(4)
        (other,) = rowwise("pixel_edges", edges, (0.1,), ((2, 3),))
        rowwise("mirrored_edges", (points, view, other, torch.ones(4)), (), ((2, 3),))
        rays = points, points, torch.ones(4), torch.arange(4), view
        rowwise("lifted", rays, (0.1, 4.0), ((3,), ()), 4)


def _run_choices() -> None:
    rays, ones = torch.arange(4), torch.ones(4)
    choose_blocked(torch.rand(4, 3), torch.zeros(4), ones, rays, 0.9, 2, torch.rand(1))
    seen(_leaf(4, 3), _leaf(4), _leaf(4), rays, rays, ones, 1e-12, 2.0).sum().backward()
    corner_sums(_leaf(4, 3).double(), rays[:, None], ones[:, None].double()).sum().backward()
    mean_root_square(ones[:, None], Moments(ones[:, None], ones[:, None]), 0.99, 1)
    kernels("map_blur", ones.device).blur(torch.rand(3, 4, 8), torch.ones(3) / 3, torch.empty(3, 4, 8))


class Group(NamedTuple):
    """Kernels that are compiled by being run."""

    run: Callable[[], None]
    seconds: float  # that numba takes, about
    cpu_only: bool = False


GROUPS = {
    "reflection": Group(_run_reflection, 25.0),
    "lookups": Group(_run_lookups, 23.0),
    "light": Group(_run_light, 15.0),
    "walks": Group(_run_walks, 10.0),
    "rest": Group(_run_rest, 7.0),
    "pointwise": Group(_run_pointwise, 10.0, cpu_only=True),
    "choices": Group(_run_choices, 3.0, cpu_only=True),
}
"""which may be compiled side by side; what two of them need, both compile"""
