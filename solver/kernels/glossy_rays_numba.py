"""The rays that leave a glossy sample: where to, what each weighs, and which part of the light is its own.

They are done eight at a time (`ray_lanes`), whichever samples they are of: in a fit most have one or two.
"""

import math

import numpy as np

from .angles_numba import angle_of
from .compiling import function, inlined
from .lanes import LANES, store
from .lobe_numba import half_vector, mirrored, power5, seen, smith, stretched_frame, to_world
from .ray_lanes import rays_of, where
from .skipping import SELF_SHADOW_COSINE
from .vectors_numba import dot, plus, row, three_of, times

ABOVE = 1e-4  # cosine from which a reflected direction counts as above the surface
NEVER = 1e30  # distance from which a ray that is not looked at can be blocked
LEAST_VARIANCE = 1e-20  # rad², of which there is a root
# Columns of what is known of a ray, and of what is found of it.
NORMAL, VIEW, F0, EDGES, SHIFT, ALPHA, SHARE, COUNT, U, ROOM = 0, 3, 6, 9, 15, 18, 19, 20, 21, 24
DIRECTION, WEIGHT, START, CENTRE, SIZE, GROWTH = 0, 3, 6, 7, 9, 11


@function
def shift_of(shifts, s):
    """A sample's shift to a floor's centre; 0 without a floor (see `light.floor`)."""
    return (0.0, 0.0, 0.0) if shifts.shape[0] == 0 else row(shifts, s)


@function
def from_centre(d, shift, up):
    """Direction in which a floor's centre sees what ray d meets, its length before it was made unit, and
    the shift of this ray, which is 0 if it does not go down."""
    down = max(-dot(d, up), 0.0)
    shift = times(where(down > 0.0, 1.0, 0.0), shift)
    moved = plus(d, down, shift)
    length = math.sqrt(dot(moved, moved))
    return (moved[0] / length, moved[1] / length, moved[2] / length), length, shift


@function
def along_ray(axis, d, length, shift, up):
    """See `SeenFromCentre.along_rays`."""
    moved = plus(axis, -dot(axis, shift), up)
    moved = plus(moved, -dot(moved, d), d)
    return moved[0] / length, moved[1] / length, moved[2] / length


@function
def side(variance, own, texels, most):
    """A rectangle's side in texels, from its variance, rad², and how that grows with ln α, of which the
    variance has `own` in narrow lobes."""
    deviation = math.sqrt(max(variance, LEAST_VARIANCE))
    found = deviation * texels
    grown = where(found >= 1.0, where(found <= most, own * texels / deviation, 0.0), 0.0)
    return min(max(found, 1.0), most), grown


@inlined
def keep(found, first, values):
    """Write what rays have for each of their columns from `first` on."""
    for c, value in enumerate(values):
        store(found, (first + c, 0), value)


@function
def leave(
    begin, end, low, owners, base, normals, views, alphas, f0s, together, shares, u, masking, averaged,
    widening, spread, shifts, up, width, height, reach, found, directions, weights, start, centre, size,
    growth,
):  # fmt: skip
    """Rays begin ≤ k < end, eight at most: directions, weights, from where they can be blocked, what they
    see of the map, and how that grows with ln α.

    Args:
        low, owners, base: ray k is sample low + owners[k − base]'s. found: room [ROOM, LANES].
    """
    here = min(np.uint64(LANES), end - begin)
    with_floor = shifts.shape[0] > 0
    for lane in range(np.uint64(LANES)):  # those too many do what the last one does
        k = begin + min(lane, here - np.uint64(1))
        s = np.uint64(low + owners[k - np.uint64(base)])
        for c in range(3):
            found[NORMAL + c, lane], found[VIEW + c, lane] = normals[s, c], views[s, c]
            found[F0 + c, lane] = f0s[s, c]
            found[EDGES + c, lane], found[EDGES + 3 + c, lane] = spread[s, 0, c], spread[s, 1, c]
        if with_floor:
            for c in range(3):
                found[SHIFT + c, lane] = shifts[s, c]
        found[ALPHA, lane], found[SHARE, lane] = alphas[s], shares[s]
        found[COUNT, lane] = together[s]
        found[U, lane], found[U + 1, lane] = u[k, 0], u[k, 1]
    nothing = rays_of(0.0)
    n, v, f0 = (
        three_of(found, NORMAL, nothing),
        three_of(found, VIEW, nothing),
        three_of(found, F0, nothing),
    )
    alpha, share, count = three_of(found, ALPHA, nothing)
    u0, u1, _ = three_of(found, U, nothing)
    t, b, view, _ = seen(n, v)
    st, t1, t2, _, _, _ = stretched_frame(view, alpha)
    view_lambda = smith(view[2], alpha)
    square, whole = alpha * alpha, 4.0 * math.pi
    # 1/density is this times the square of what GGX has in its denominator.
    per_density = math.pi * (1.0 + view_lambda) * 4.0 * view[2] / square
    half, _, _, _, _, _, _ = half_vector(st, t1, t2, alpha, u0, u1)
    view_half, out = mirrored(view, half)
    d, _ = to_world(t, b, n, out)
    above = out[2] > ABOVE
    bend = where(above, share, 0.0)
    if masking:
        bend = bend * (1.0 + view_lambda) / (1.0 + view_lambda + smith(out[2], alpha))
    m5 = power5(min(max(1.0 - view_half, 0.0), 1.0))
    solid_angle = nothing
    if averaged:
        # cos²(α² − 1) + 1 without what single precision would lose of it
        across = half[0] * half[0] + half[1] * half[1] + square * half[2] * half[2]
        solid_angle = min(across * across * per_density / count, whole)
    e, length, shift = d, rays_of(1.0), (nothing, nothing, nothing)
    if with_floor:
        e, length, shift = from_centre(d, three_of(found, SHIFT, nothing), up)
    sine = max(math.sqrt(e[0] * e[0] + e[1] * e[1]), 1e-4)
    own = where(solid_angle < whole, solid_angle, 0.0) if widening else nothing
    wide, high, own_wide, own_high = solid_angle, solid_angle, own, own
    if averaged:
        east = (-e[1] / sine, e[0] / sine, nothing)
        south = (e[0] * e[2] / sine, e[1] * e[2] / sine, -sine)
        if with_floor:
            east = along_ray(east, d, length, shift, up)
            south = along_ray(south, d, length, shift, up)
            wide, high = wide * dot(east, east), high * dot(south, south)
            own_wide, own_high = own * dot(east, east), own * dot(south, south)
        for edge in (three_of(found, EDGES, nothing), three_of(found, EDGES + 3, nothing)):
            by_east, by_south = dot(east, edge), dot(south, edge)
            wide = wide + by_east * by_east
            high = high + by_south * by_south
    columns, wider = side(wide, own_wide, width / (2.0 * math.pi * sine), float(width))
    lines, higher = side(high, own_high, height / math.pi, 0.5 * height)
    rise = reach * (1.0 / max(out[2], SELF_SHADOW_COSINE) - 1.0)
    keep(found, DIRECTION, d)
    keep(found, WEIGHT, (
        bend * (f0[0] + (1.0 - f0[0]) * m5), bend * (f0[1] + (1.0 - f0[1]) * m5),
        bend * (f0[2] + (1.0 - f0[2]) * m5),
    ))  # fmt: skip
    keep(found, START, (where(above, min(rise, 4.0 * reach), NEVER),))
    keep(found, CENTRE, (
        (0.5 - angle_of(e[0], e[1]) / (2.0 * math.pi)) * width,
        angle_of(e[2], sine) / math.pi * height,
    ))  # fmt: skip
    keep(found, SIZE, (columns, lines))
    keep(found, GROWTH, (wider, higher))
    for lane in range(here):
        k = begin + lane
        start[k] = found[START, lane]
        for c in range(3):
            directions[k, c] = found[DIRECTION + c, lane]
            weights[k, c] = found[WEIGHT + c, lane]
        for c in range(2):
            centre[k, c], size[k, c] = found[CENTRE + c, lane], found[SIZE + c, lane]
            growth[k, c] = found[GROWTH + c, lane]
