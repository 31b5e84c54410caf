"""How near the fused CPU kernels come to what this machine can do, and to their plain torch twins.

    python benchmarks/kernels.py            all kernels, a page for docs
    python benchmarks/kernels.py --short    few points, for a look in CI

The limit of a kernel is the largest of three times: its bytes at the machine's copy rate (an array as
large as a grid's planes), its operations at the machine's rate of multiply-adds (on data in the nearest
cache, by the same compiler), and, for lookups all over a table, the cache lines they touch at the rate of
independent random reads from an array of that size. Bytes and lines count every node that a lookup
touches, as if none were met twice; operations are counted in the source; both are single precision's, also
for kernels in double. Kernels and limits are those of one thread; how much of that time they take when all
cores share their loops, as in a fit, says the last column. All is measured in one run, by the best of a
few.
Which kernels matter, a second table says: their shares of a real step.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from solver.threads import prepare_runtimes  # noqa: E402

prepare_runtimes()

import numba  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402

from benchmarks.machine import describe_machine  # noqa: E402
from benchmarks.shares import shares_of_a_step  # noqa: E402
from solver.field.smoothing import gaussian_taps  # noqa: E402
from solver.kernels import vm  # noqa: E402
from solver.kernels.adam import Moments, Rates, adam_step  # noqa: E402
from solver.kernels.backend import gradients_in_place, plain_torch  # noqa: E402
from solver.kernels.integral import prefix_sums, rectangle_mean  # noqa: E402
from solver.kernels.march import march  # noqa: E402
from solver.kernels.skipping import blocking_grid, free_distance  # noqa: E402
from solver.kernels.specular import Blockers, specular  # noqa: E402
from solver.kernels.sphere import look_up  # noqa: E402
from solver.kernels.visibility import look_around  # noqa: E402
from solver.light.environment import equirect_coordinates, equirect_directions  # noqa: E402
from solver.render.probes import Nodes, Probes  # noqa: E402

SIZE, DENSITY, FEATURES, LIGHT, PROBES = 160, 16, 24, 256, 4000
FLOAT, LINE = 4, 64  # bytes
REPEATS = 7
MOST_SHOWN = 10  # kernels of a step


class Case(NamedTuple):
    """A kernel at work, with what it moves and computes at least."""

    name: str
    run: Callable[[], object]
    bytes: float
    operations: float
    twin: bool = True
    lines: float = 0.0  # cache lines met at random; 0 where neighbours share them


def best(run: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest time, s."""
    run()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return min(times)


@numba.njit(parallel=True, fastmath=True)
def _multiply_add(values, rounds):
    """Eight independent chains a thread on an array that stays in the nearest cache."""
    for task in numba.prange(values.shape[0]):
        row = values[task]
        for _ in range(rounds):
            for i in range(row.shape[0]):
                row[i] = row[i] * np.float32(0.999) + np.float32(1e-3)


def copy_rate() -> float:
    """Bytes a second, read and written, of copying an array as large as a grid's planes."""
    source = np.ones(3 * SIZE * SIZE * DENSITY, np.float32)
    target = np.empty_like(source)
    return 2 * source.nbytes / best(lambda: np.copyto(target, source), 30)


@numba.njit(parallel=True, fastmath=True)
def _read_lines(values, first, out):
    """A number of every line in a random order that is known early, so that reads overlap."""
    for task in numba.prange(first.shape[0]):
        total = np.float32(0)
        for i in range(first.shape[1]):
            total += values[first[task, i]]
        out[task] = total


def line_rate() -> float:
    """Cache lines a second that are read at random from an array as large as a grid's planes."""
    values = np.ones(3 * SIZE * SIZE * DENSITY, np.float32)
    threads = numba.get_num_threads()
    generator = np.random.default_rng(0)
    first = generator.integers(0, len(values) // 16, (threads, 1 << 18)) * 16
    out = np.empty(threads, np.float32)
    return first.size / best(lambda: _read_lines(values, first, out))


def multiply_rate() -> float:
    """Multiplications and additions a second."""
    values = np.ones((numba.get_num_threads(), 2048), np.float32)
    rounds = 2000
    return 2 * values.size * rounds / best(lambda: _multiply_add(values, rounds))


def cases(points: int) -> list[Case]:
    """The kernels of a step, with about as many points as a step of `draft` has."""
    generator = torch.Generator().manual_seed(0)

    def rand(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator)

    density = (
        rand(3, SIZE, SIZE, DENSITY).requires_grad_(),
        rand(3, SIZE, DENSITY).requires_grad_(),
    )
    features = (
        rand(3, SIZE, SIZE, FEATURES).requires_grad_(),
        rand(3, SIZE, FEATURES).requires_grad_(),
    )
    # Samples along rays lie side by side, surface points do not.
    start, direction = rand(points // 16, 1, 3) * (SIZE - 20) + 5, rand(points // 16, 1, 3) - 0.5
    along = (start + torch.arange(16)[None, :, None] * direction).reshape(-1, 3).contiguous()
    surface = rand(points // 8, 3) * (SIZE - 1)
    shaded = len(surface)

    def backward(lookup, at, factors):
        value = lookup(at, *factors)
        cotangent = torch.ones_like(value)
        return in_place(lambda: value.backward(cotangent, retain_graph=True))

    def in_place(run):
        """As in a fit, where gradients are added where they lie."""

        def inside():
            with gradients_in_place():
                run()

        return inside

    nodes = 3 * (4 + 2)  # that a lookup meets
    smooth_nodes = 3 * (12 + 4)
    planes_bytes = FLOAT * 3 * SIZE * SIZE
    environment = rand(3, LIGHT, 2 * LIGHT)
    rows = torch.linspace(0, 1, LIGHT + 1, dtype=torch.float64)
    table = prefix_sums(environment, rows[1:])
    lit = environment.clone().requires_grad_()
    turn = torch.linalg.qr(rand(3, 3))[0]
    before = equirect_coordinates(equirect_directions(LIGHT, 2 * LIGHT).float() @ turn, LIGHT, 2 * LIGHT)
    turned = look_up(lit, before)
    centre = rand(points // 2, 2) * torch.tensor([2.0 * LIGHT, LIGHT])
    sizes = 1 + 20 * rand(points // 2, 2)
    rays = points // 16
    origins = torch.nn.functional.normalize(rand(rays, 3) - 0.5, dim=-1) * 2 + 0.5
    directions = torch.nn.functional.normalize(rand(rays, 3) - origins, dim=-1)
    ticks = torch.linspace(-1, 1, 128)
    radius = (ticks[:, None, None] ** 2 + ticks[None, :, None] ** 2 + ticks[None, None] ** 2).sqrt()
    free = free_distance((radius - 0.7).abs() < 0.05)
    normals = torch.nn.functional.normalize(rand(shaded, 3) - 0.5, dim=-1)
    view = torch.nn.functional.normalize(normals + rand(shaded, 3) - 0.5, dim=-1)
    lobe = [normals.requires_grad_(), (0.05 + 0.4 * rand(shaded)).requires_grad_(),
            rand(shaded, 3).requires_grad_(), table.detach().requires_grad_()]  # fmt: skip
    glossy_rays = 5 * shaded
    first = 5 * torch.arange(shaded + 1)
    axis = torch.linspace(-1, 1, 129)
    radii = (axis[:, None, None] ** 2 + axis[None, :, None] ** 2 + axis[None, None] ** 2).sqrt()
    blocking = blocking_grid(3.0 * ((radii - 0.7).abs() < 0.05))
    blockers = Blockers(torch.zeros(3), torch.empty(0, 3), 1.0, 1 / 128, blocking, 0.02)
    u = rand(glossy_rays, 2)
    # Cells that a ray walks through here, and corners that it reads; counted once by a plain loop.
    glossy_cells, glossy_corners, probe_cells, probe_corners = 7, 18, 11, 24
    # Probes stand right outside of the shell that `free` has.
    probes = 0.5 + 0.4 * torch.nn.functional.normalize(rand(points // 100, 3) - 0.5, dim=-1)
    around = torch.nn.functional.normalize(rand(328, 3) - 0.5, dim=-1)
    views = len(probes) * len(around)

    def glossy():
        return specular(
            *lobe, view, rand(shaded, 3), first, torch.full((shaded,), 0.2), torch.full((shaded,), 5), u,
            rows, True, True, True, blockers,
        )[0]  # fmt: skip

    reflected = glossy()
    lights = Probes()
    lights.nodes = [
        Nodes(torch.randint(0, PROBES, (43,) * 3, generator=generator), 0.1 + rand(43, 43, 43), 1 / 42)
    ]
    coefficients, facing = rand(PROBES, 9, 3).requires_grad_(), normals.detach().requires_grad_()
    lifted = rand(shaded, 3)

    def diffuse():
        lights.irradiance(coefficients, 0, lifted, facing).sum().backward()

    taps = gaussian_taps(1.5)
    parameter, gradient = rand(3, SIZE, SIZE, DENSITY), rand(3, SIZE, SIZE, DENSITY)
    moments = Moments(torch.zeros_like(parameter), torch.zeros_like(parameter))
    return [
        Case("vm_sum", lambda: vm.vm_sum(along, *density), len(along) * nodes * DENSITY * FLOAT,
             len(along) * 3 * DENSITY * 13),
        Case("vm_sum, adjoint", backward(vm.vm_sum, along, density),
             len(along) * 3 * nodes * DENSITY * FLOAT, len(along) * 3 * DENSITY * 26, False),
        Case("vm_products", lambda: vm.vm_products(surface, *features),
             shaded * nodes * FEATURES * FLOAT, shaded * 3 * FEATURES * 13,
             lines=shaded * 12 * FEATURES * FLOAT / LINE),
        Case("vm_products, adjoint", backward(vm.vm_products, surface, features),
             shaded * 3 * nodes * FEATURES * FLOAT, shaded * 3 * FEATURES * 26, False,
             shaded * 2 * 12 * FEATURES * FLOAT / LINE),
        Case("vm_gradient", lambda: vm.vm_gradient(surface, *density),
             shaded * smooth_nodes * DENSITY * FLOAT, shaded * 3 * DENSITY * 46,
             lines=shaded * 36 * DENSITY * FLOAT / LINE),
        Case("vm_gradient, adjoint", backward(vm.vm_gradient, surface, density),
             shaded * 3 * smooth_nodes * DENSITY * FLOAT, shaded * 3 * DENSITY * 100, False,
             shaded * 2 * 36 * DENSITY * FLOAT / LINE),
        Case("smooth_planes", lambda: vm.smooth_planes(density[0].detach(), taps),
             2 * planes_bytes * DENSITY, 3 * SIZE * SIZE * DENSITY * 4 * len(taps)),
        Case("rectangle_mean", lambda: rectangle_mean(table, rows, centre, sizes),
             len(centre) * 8 * 3 * 8, len(centre) * 3 * 60, lines=len(centre) * 8),
        Case("look_up", lambda: look_up(environment, before),
             LIGHT * 2 * LIGHT * (2 + 3 + 3) * FLOAT, LIGHT * 2 * LIGHT * (20 + 3 * 6)),
        Case("look_up, adjoint", in_place(lambda: turned.sum().backward(retain_graph=True)),
             LIGHT * 2 * LIGHT * (2 + 3 + 2 * 3) * FLOAT, LIGHT * 2 * LIGHT * (20 + 3 * 9), False),
        # Per ray: about 250 operations for direction and weight, 180 for a mean of three channels, a
        # dozen for a cell of the grid; the adjoint has twice the first and scatters the second.
        Case("specular", glossy, glossy_rays * (8 * 3 * 8 + glossy_corners + 4 * 33),
             glossy_rays * (430 + 12 * glossy_cells + 4 * glossy_corners), False,
             glossy_rays * (8 + glossy_cells)),
        Case("specular, adjoint", in_place(lambda: reflected.sum().backward(retain_graph=True)),
             glossy_rays * (3 * 8 * 3 * 8 + 4 * 33), glossy_rays * 700, False,
             glossy_rays * 8),
        # Eight nodes a sample: their coefficients are read, and read and written by the adjoint.
        Case("irradiance_between and its adjoint", in_place(diffuse), shaded * 3 * 8 * 27 * FLOAT,
             shaded * (4 * 8 * 27 + 2 * 2 * 144 + 4 * 27), lines=shaded * 2 * 16),
        Case("march", lambda: march(
            origins, directions, torch.zeros(rays), torch.zeros(rays), 0.01, 1 / 128, free,
            density[0].detach(), density[1].detach(), -4.0, 5.0),
             rays * 12 * nodes * DENSITY * FLOAT, rays * 12 * 3 * DENSITY * 13),
        Case("look_around", lambda: look_around(
            probes, around, 1.5 / 128, 1 / 128, blockers.blocking),
             views * (probe_corners + 2 * FLOAT),
             views * (12 * probe_cells + 4 * probe_corners), lines=views * probe_cells),
        Case("adam, all touched", lambda: (gradient.fill_(1), adam_step(
            parameter, gradient, moments, Rates(1e-3, 0.9, 0.99, 1e-15, 5))),
             9 * planes_bytes * DENSITY, 3 * SIZE * SIZE * DENSITY * 12),
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=20_000, help="density samples of a step")
    parser.add_argument("--short", action="store_true", help="few points, few repeats, no step")
    parser.add_argument("--capture", type=Path, default=ROOT / "samples" / "duck", help="of the step")
    parser.add_argument("--preset", default="draft", help="of the step")
    parser.add_argument("--out", type=Path, help="a Markdown file to write")
    options = parser.parse_args()
    points = 2_000 if options.short else options.points
    cores = numba.get_num_threads()
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    copies, multiplies, reads = copy_rate(), multiply_rate(), line_rate()
    lines = [
        f"{describe_machine()}; one thread, {points} density samples, grid {SIZE}³.",
        f"Copy {copies / 1e9:.1f} GB/s, multiply-add {multiplies / 1e9:.1f} Gop/s, random reads "
        f"{reads / 1e6:.0f} million lines/s.", "",
        "| kernel | ms | limit ms (by) | share of the limit reached | times faster than its twin | of "
        "that time on all cores |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]  # fmt: skip
    for case in cases(points):
        repeats = 3 if options.short else REPEATS
        seconds = best(case.run, repeats)
        numba.set_num_threads(cores)
        shared = best(case.run, repeats)
        numba.set_num_threads(1)
        limits = {
            "bytes": case.bytes / copies, "operations": case.operations / multiplies,
            "reads": case.lines / reads,
        }  # fmt: skip
        by = max(limits, key=limits.get)
        limit = limits[by]
        ratio = "–"
        if case.twin:
            with plain_torch():
                ratio = f"{best(case.run, 3) / seconds:.1f}"
        lines.append(
            f"| {case.name} | {1e3 * seconds:.2f} | {1e3 * limit:.2f} ({by}) | "
            f"{100 * limit / seconds:.0f} % | {ratio} | {shared / seconds:.2f} |"
        )
    if not options.short:
        step, shares = shares_of_a_step(options.capture, options.preset)
        lines += [
            "", f"A step of `{options.preset}` on its finest grid ({options.capture.resolve().name}) takes "
            f"{1e3 * step:.0f} ms, of which these kernels have most:", "",
            "| kernel | ms a step | share of the step |", "| --- | ---: | ---: |",
        ]  # fmt: skip
        lines += [
            f"| {name} | {1e3 * seconds:.2f} | {100 * seconds / step:.1f} % |"
            for name, seconds in shares.most_common(MOST_SHOWN)
        ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.out:
        options.out.write_text("# Benchmarks: kernels\n\n" + text, encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    main()
