"""Walking rays and compositing in Warp, for CUDA; `march_torch` is the plain twin.

Functions take the arguments of `march_numba`, as tensors; a thread takes a ray.
"""

import math

import warp as wp

from .skipping import EMPTY as EMPTY_CODE
from .skipping import ROOTS_PER_UNIT
from .vectors_warp import Codes, Grid, Integers, Numbers, Planes, Vectors, vector
from .vm_point_warp import raw_density
from .warp_device import launched

# A thread walks a ray, sample after sample, and a step has few of them: they are spread over the card.
wp.set_module_options({"enable_backward": False, "fast_math": True, "block_dim": 32})

EMPTY = wp.constant(EMPTY_CODE)
DEPTH_UNIT = wp.constant(1.0 / ROOTS_PER_UNIT**2)
HALF = wp.constant(math.log(2))
NEVER = wp.constant(wp.inf)


@wp.func
def box_span(origin: wp.vec3, direction: wp.vec3):
    near = float(-1.0e30)
    far = float(1.0e30)
    missed = bool(False)
    for axis in range(3):
        o = origin[axis]
        d = direction[axis]
        if wp.abs(d) < 1.0e-12:
            if o < 0.0 or o > 1.0:
                missed = True
        else:
            t0 = -o / d
            t1 = (1.0 - o) / d
            near = wp.max(near, wp.min(t0, t1))
            far = wp.min(far, wp.max(t0, t1))
    # What has no direction would walk for ever.
    if missed or near <= -1.0e30:
        near = 1.0
        far = 0.0
    return wp.vec2(near, far)


@wp.func
def code_at(grid: Codes, point: wp.vec3):
    cells = grid.shape[0]
    i = wp.clamp(int(point[0] * float(cells)), 0, cells - 1)
    j = wp.clamp(int(point[1] * float(cells)), 0, cells - 1)
    k = wp.clamp(int(point[2] * float(cells)), 0, cells - 1)
    return int(grid[i, j, k])


@wp.func
def extinction(raw: float, shift: float, scale: float):
    """σ = scale · softplus(raw + shift), per world unit."""
    x = raw + shift
    softplus = x
    if x <= 20.0:
        # For large negative x, log(1 + e^x) loses e^x to rounding.
        e = wp.exp(x)
        softplus = wp.where(e < 1.0e-4, e, wp.log(1.0 + e))
    return scale * softplus


@wp.kernel
def _march(
    origins: Vectors, directions: Vectors, start: Numbers, jitter: Numbers, step: float, cell: float,
    free: Codes, planes: Planes, lines: Grid, shift: float, scale: float, min_transmittance: float,
    distance: Vectors, raw: Vectors, counts: Integers,
):  # fmt: skip
    r = wp.tid()
    origin = vector(origins, r)
    direction = vector(directions, r)
    span = box_span(origin, direction)
    far = span[1]
    step_cells = step / cell
    nodes = float(planes.shape[1] - 1)
    count = int(0)
    transmittance = float(1.0)
    t = float(wp.max(span[0], start[r]) + jitter[r] * step)
    walking = bool(True)
    while walking and t < far and count < distance.shape[1]:
        point = origin + t * direction
        ahead = code_at(free, point)
        if ahead > 0:
            t += step * float(int(float(ahead - 1) / step_cells) + 1)
        else:
            density = raw_density(point * nodes, planes, lines)
            keep = wp.exp(-extinction(density, shift, scale) * step)
            distance[r, count] = t
            raw[r, count] = density
            count += 1
            transmittance *= keep
            walking = transmittance >= min_transmittance
            t += step
    counts[r] = wp.int64(count)


@wp.kernel
def _compact(
    origins: Vectors, directions: Vectors, distance: Vectors, raw: Vectors, offsets: Integers,
    flat_distance: Numbers, flat_raw: Numbers, points: Vectors, ray: Integers,
):  # fmt: skip
    r = wp.tid()
    first = int(offsets[r])
    for i in range(int(offsets[r + 1]) - first):
        t = distance[r, i]
        flat_distance[first + i] = t
        flat_raw[first + i] = raw[r, i]
        for axis in range(3):
            points[first + i, axis] = origins[r, axis] + t * directions[r, axis]
        ray[first + i] = wp.int64(r)


@wp.func
def root_at(blocking: Codes, i: int, j: int, k: int):
    code = int(blocking[i, j, k])
    return wp.where(code < EMPTY, float(code), 0.0)


@wp.func
def column(blocking: Codes, i: int, j: int, k: int, along: float):
    return wp.lerp(root_at(blocking, i, j, k), root_at(blocking, i, j, k + 1), along)


@wp.func
def through_grid(origin: wp.vec3, direction: wp.vec3, start: float, step: float, blocking: Codes):
    """Transmittance of a ray, and the distance at which half of its light is stopped, or infinity."""
    span = box_span(origin, direction)
    t = float(wp.max(span[0], start))
    depth = float(0.0)
    half = float(NEVER)
    cells = blocking.shape[0] - 1
    while t < span[1] and depth < 7.0:
        at = float(cells) * (origin + t * direction)
        x = wp.clamp(at[0], 0.0, float(cells))
        y = wp.clamp(at[1], 0.0, float(cells))
        z = wp.clamp(at[2], 0.0, float(cells))
        i = wp.min(int(x), cells - 1)
        j = wp.min(int(y), cells - 1)
        k = wp.min(int(z), cells - 1)
        code = int(blocking[i, j, k])
        if code < EMPTY:
            u = y - float(j)
            v = z - float(k)
            low = wp.lerp(column(blocking, i, j, k, v), column(blocking, i, j + 1, k, v), u)
            high = wp.lerp(column(blocking, i + 1, j, k, v), column(blocking, i + 1, j + 1, k, v), u)
            root = wp.lerp(low, high, x - float(i))
            before = depth
            depth += DEPTH_UNIT * root * root
            if before <= HALF and depth > HALF:
                half = t
            t += step
        else:
            t += step * float(code - EMPTY)
    return wp.vec2(wp.exp(-depth), half)


@wp.kernel
def _grid_transmittance(
    origins: Vectors, directions: Vectors, start: Numbers, step: float, blocking: Codes, out: Numbers
):
    r = wp.tid()
    found = through_grid(vector(origins, r), vector(directions, r), start[r], step, blocking)
    out[r] = found[0]


@wp.kernel
def _composite(optical_depth: Numbers, offsets: Integers, weights: Numbers, transmittance: Numbers):
    r = wp.tid()
    passing = float(1.0)
    for i in range(int(offsets[r]), int(offsets[r + 1])):
        keep = wp.exp(-optical_depth[i])
        weights[i] = passing * (1.0 - keep)
        passing *= keep
    transmittance[r] = passing


@wp.kernel
def _composite_backward(
    offsets: Integers, weights: Numbers, transmittance: Numbers, g_weights: Numbers,
    g_transmittance: Numbers, out: Numbers,
):  # fmt: skip
    r = wp.tid()
    first = int(offsets[r])
    count = int(offsets[r + 1]) - first
    behind = g_transmittance[r] * transmittance[r]
    passing = float(transmittance[r])
    for back in range(count):
        i = first + count - 1 - back
        out[i] = g_weights[i] * passing - behind
        behind += g_weights[i] * weights[i]
        passing += weights[i]


march = launched(_march, "origins")
compact = launched(_compact, "origins")
grid_transmittance = launched(_grid_transmittance, "origins")
composite = launched(_composite, "transmittance")
composite_backward = launched(_composite_backward, "transmittance")
