"""Glossy reflection in Warp, for CUDA: sample, weigh, look up the light, add up; and the adjoint.

Functions take the arguments of `specular_numba`, as tensors, and do what is said there; a thread takes a
ray. The adjoint of a ray's geometry is derived by Warp, that of its place in the light by hand, for
arcus functions have no end at the poles.
"""

import torch
import warp as wp

from .integral_warp import rectangle_mean
from .lobe_warp import ABOVE, PI, TURN, fresnel_power, masked_share, reflected, solid_angle_of, to_world
from .march_warp import through_grid
from .skipping import SELF_SHADOW_COSINE
from .vectors_warp import Codes, Grid, Integers, Numbers, Vectors, vector
from .warp_device import launch, launch_adjoint

wp.set_module_options({"enable_backward": False})

LEAST_LIFT = wp.constant(SELF_SHADOW_COSINE)

Owners = wp.array(dtype=wp.int32)


@wp.struct
class Seen:
    """What a ray meets of a floor's light, as the floor's centre sees it (see `light.floor`)."""

    direction: wp.vec3
    length: float  # before it was made unit
    shift: wp.vec3  # of the ray's origin, 0 for rays that do not go down


@wp.func
def from_centre(d: wp.vec3, shifts: Vectors, up: wp.vec3, s: int):
    found = Seen()
    found.direction = d
    found.length = 1.0
    found.shift = wp.vec3(0.0, 0.0, 0.0)
    if shifts.shape[0] > 0:
        down = -wp.dot(d, up)
        if down > 0.0:
            found.shift = vector(shifts, s)
            moved = d + down * found.shift
            found.length = wp.length(moved)
            found.direction = moved / found.length
    return found


@wp.func
def along_ray(axis: wp.vec3, d: wp.vec3, seen: Seen, up: wp.vec3):
    moved = axis - wp.dot(axis, seen.shift) * up
    return (moved - wp.dot(moved, d) * d) / seen.length


@wp.kernel
def _own(first: Integers, owners: Owners):
    """Whose a ray is: of the last sample that begins no later."""
    k = wp.tid()
    low = int(0)
    high = int(first.shape[0] - 1)
    while high - low > 1:
        middle = (low + high) // 2
        if int(first[middle]) <= k:
            low = middle
        else:
            high = middle
    owners[k] = low


@wp.kernel(enable_backward=True)
def _leave(
    normals: Vectors, views: Vectors, alphas: Numbers, f0s: Vectors, shares: Numbers, u: Vectors,
    owners: Owners, masking: bool, directions: Vectors, weights: Vectors,
):  # fmt: skip
    """Directions of rays, and what they weigh."""
    k = wp.tid()
    s = owners[k]
    n = vector(normals, s)
    view, half, out = reflected(n, vector(views, s), alphas[s], u[k, 0], u[k, 1])
    d = to_world(n, out)
    bent = masked_share(view, out, alphas[s], shares[s], masking)
    m5 = fresnel_power(wp.dot(view, half))
    for axis in range(3):
        directions[k, axis] = d[axis]
        weights[k, axis] = (f0s[s, axis] + (1.0 - f0s[s, axis]) * m5) * bent


@wp.func
def side(variance: float, own: float, texels: float, most: float):
    """A rectangle's side in texels, and how it grows with ln α."""
    found = wp.sqrt(variance) * texels
    grown = float(0.0)
    if found >= 1.0 and found <= most:
        grown = found * own / variance
    return wp.vec2(wp.clamp(found, 1.0, most), grown)


@wp.func
def along_axes(axes: Vectors, v: wp.vec3):
    """A vector along axes [3, 3]; where there are none [0, 3], as it is."""
    if axes.shape[0] == 0:
        return v
    x, y, z = vector(axes, 0), vector(axes, 1), vector(axes, 2)
    return wp.vec3(wp.dot(x, v), wp.dot(y, v), wp.dot(z, v))


@wp.kernel
def _look(
    normals: Vectors, views: Vectors, alphas: Numbers, together: Integers, u: Vectors, owners: Owners,
    averaged: bool, widening: bool, spread: Grid, shifts: Vectors, up: wp.vec3, points: Vectors,
    reach: float, box_low: Numbers, box_axes: Vectors, box_scale: float, cell: float, blocking: Codes,
    width: float, height: float, directions: Vectors, passing: Numbers, centre: Vectors, size: Vectors,
    growth: Vectors,
):  # fmt: skip
    """What rays see of the map, how that grows with ln α, and what the grid lets through."""
    k = wp.tid()
    s = owners[k]
    n = vector(normals, s)
    view, half, out = reflected(n, vector(views, s), alphas[s], u[k, 0], u[k, 1])
    if out[2] <= ABOVE:
        passing[k] = 0.0
        centre[k, 0] = 0.0
        centre[k, 1] = 0.0
        size[k, 0] = 1.0
        size[k, 1] = 1.0
        growth[k, 0] = 0.0
        growth[k, 1] = 0.0
        return
    d = vector(directions, k)
    solid_angle = float(0.0)
    if averaged:
        count = float(together[s])
        solid_angle = wp.min(solid_angle_of(view[2], half[2], alphas[s], count), 4.0 * PI)
    seen = from_centre(d, shifts, up, s)
    e = seen.direction
    sine = wp.max(wp.sqrt(e[0] * e[0] + e[1] * e[1]), 1.0e-4)
    wide = float(solid_angle)
    high = float(solid_angle)
    own_wide = wp.where(widening and solid_angle < 4.0 * PI, solid_angle, 0.0)
    own_high = float(own_wide)
    if averaged:
        east = wp.vec3(-e[1] / sine, e[0] / sine, 0.0)
        south = wp.vec3(e[0] * e[2] / sine, e[1] * e[2] / sine, -sine)
        if shifts.shape[0] > 0:
            east = along_ray(east, d, seen, up)
            south = along_ray(south, d, seen, up)
            wide = wide * wp.dot(east, east)
            high = high * wp.dot(south, south)
            own_wide = own_wide * wp.dot(east, east)
            own_high = own_high * wp.dot(south, south)
        for edge in range(2):
            pixel = wp.vec3(spread[s, edge, 0], spread[s, edge, 1], spread[s, edge, 2])
            by_east = wp.dot(east, pixel)
            by_south = wp.dot(south, pixel)
            wide += by_east * by_east
            high += by_south * by_south
    centre[k, 0] = (0.5 - wp.atan2(e[1], e[0]) / TURN) * width
    centre[k, 1] = wp.atan2(sine, e[2]) / PI * height
    columns = side(wide, own_wide, width / (TURN * sine), width)
    lines = side(high, own_high, height / PI, 0.5 * height)
    size[k, 0] = columns[0]
    size[k, 1] = lines[0]
    growth[k, 0] = columns[1]
    growth[k, 1] = lines[1]
    start = wp.min(reach * (1.0 / wp.max(out[2], LEAST_LIFT) - 1.0), 4.0 * reach)
    low = wp.vec3(box_low[0], box_low[1], box_low[2])
    origin = along_axes(box_axes, vector(points, s) + reach * n - low) * box_scale
    along = along_axes(box_axes, d) * box_scale
    found = through_grid(origin, along, start, cell, blocking)
    passing[k] = found[0]


@wp.kernel
def _gather(
    first: Integers, weights: Vectors, passing: Numbers, radiance: Vectors, light: Vectors, slope: Grid
):
    """What the rays of a sample bring back; their light and its slopes are dimmed by the grid."""
    s, channel = wp.tid()
    total = float(0.0)
    for k in range(int(first[s]), int(first[s + 1])):
        through = passing[k]
        light[k, channel] = light[k, channel] * through
        for by in range(4):
            slope[k, channel, by] = slope[k, channel, by] * through
        total += weights[k, channel] * light[k, channel]
    radiance[s, channel] = total


@wp.kernel
def _arrive(
    owners: Owners, alphas: Numbers, shifts: Vectors, up: wp.vec3, directions: Vectors,
    weights: Vectors, passing: Numbers, light: Vectors, slope: Grid, growth: Vectors, width: float,
    height: float, cotangent: Vectors, g_directions: Vectors, g_weights: Vectors,
    to_directions: Vectors, to_weights: Vectors, to_light: Vectors, to_alphas: Numbers,
):  # fmt: skip
    """Cotangents of rays' directions, weights and light, from those of their samples' radiance; and, added,
    those of α by what rays stand for."""
    k = wp.tid()
    s = owners[k]
    column = float(0.0)
    row = float(0.0)
    wider = float(0.0)
    for c in range(3):
        g = cotangent[s, c]
        grown = slope[k, c, 2] * growth[k, 0] + slope[k, c, 3] * growth[k, 1]
        wider += g * weights[k, c] * grown
        column += g * weights[k, c] * slope[k, c, 0]
        row += g * weights[k, c] * slope[k, c, 1]
        to_weights[k, c] = g * light[k, c] + g_weights[k, c]
        to_light[k, c] = g * weights[k, c] * passing[k]
    if wider != 0.0:
        wp.atomic_add(to_alphas, s, wider / alphas[s])
    seen = from_centre(vector(directions, k), shifts, up, s)
    e = seen.direction
    turn = column * width / (TURN * wp.max(e[0] * e[0] + e[1] * e[1], 1.0e-14))
    fall = float(0.0)
    if wp.abs(e[2]) < 1.0 - 1.0e-7:
        fall = -row * height / (PI * wp.sqrt(1.0 - e[2] * e[2]))
    to_e = wp.vec3(turn * e[1], -turn * e[0], fall)
    to_d = (to_e - wp.dot(to_e, e) * e) / seen.length
    to_d = to_d - wp.dot(to_d, seen.shift) * up
    for axis in range(3):
        to_directions[k, axis] = to_d[axis] + g_directions[k, axis]


def _owners(first: torch.Tensor, rays: int) -> torch.Tensor:
    owners = torch.empty(rays, dtype=torch.int32, device=first.device)
    launch(_own, rays, first, owners)
    return owners


def specular(
    normals, views, alphas, f0s, first, shares, u, masking, averaged, widening, spread, shifts, up,
    points, together, reach, box_low, box_axes, box_scale, cell, blocking, table, rows, radiance,
    directions, weights, passing, light, slope, centre, size, growth,
) -> None:  # fmt: skip
    rays = len(u)
    owners = _owners(first, rays)
    launch(_leave, rays, normals, views, alphas, f0s, shares, u, owners, masking, directions, weights)
    launch(
        _look, rays, normals, views, alphas, together, u, owners, averaged, widening, spread, shifts,
        wp.vec3(*up), points, reach, box_low, box_axes, box_scale, cell, blocking,
        float(table.shape[1] - 1), float(table.shape[0] - 1), directions, passing, centre, size, growth,
    )  # fmt: skip
    rectangle_mean(table, rows, centre, size, light, slope)
    launch(_gather, (len(normals), 3), first, weights, passing, radiance, light, slope)


def specular_backward(
    normals, views, alphas, f0s, first, shares, u, masking, shifts, up, directions, weights, passing,
    light, slope, growth, width, height, cotangent, g_directions, g_weights, g_normals, g_alphas, g_f0s,
    to_light,
) -> None:  # fmt: skip
    rays = len(u)
    owners = _owners(first, rays)
    to_directions, to_weights = torch.empty_like(directions), torch.empty_like(weights)
    for gradient in (g_normals, g_alphas, g_f0s):
        gradient.zero_()
    launch(
        _arrive, rays, owners, alphas, shifts, wp.vec3(*up), directions, weights, passing, light, slope,
        growth, float(width), float(height), cotangent, g_directions, g_weights, to_directions,
        to_weights, to_light, g_alphas,
    )  # fmt: skip
    launch_adjoint(
        _leave, rays,
        (normals, views, alphas, f0s, shares, u, owners, masking, directions, weights),
        (g_normals, None, g_alphas, g_f0s, None, None, None, None, to_directions, to_weights),
    )  # fmt: skip
