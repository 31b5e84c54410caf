"""A step's random choices in Warp, for CUDA; `drawing_torch` is the plain twin.

Functions take the arguments of `drawing_numba`, as tensors, and do what is said there; a thread takes a
ray, or a sample.
"""

import warp as wp

from .hashing_warp import unit_number
from .vectors_warp import Integers, Numbers, Rows, Vectors
from .warp_device import launch, launched

wp.set_module_options({"enable_backward": False})

ONE = wp.constant(wp.int64(1))


@wp.kernel
def _draw_depths(
    weights: Numbers, offsets: Integers, opacity: Numbers, u: Vectors, least: float, index: Rows,
    times: Rows, counts: Integers,
):  # fmt: skip
    r = wp.tid()
    first = int(offsets[r])
    last = int(offsets[r + 1]) - 1
    found = int(0)
    if opacity[r] > least and last >= first:
        total = wp.float64(0.0)
        for i in range(first, last + 1):
            total += wp.float64(weights[i])
        for d in range(u.shape[1]):
            target = wp.float64(u[r, d]) * total
            running = wp.float64(weights[first])
            chosen = int(first)
            while running <= target and chosen < last:
                chosen += 1
                running += wp.float64(weights[chosen])
            at = int(0)
            while at < found and int(index[r, at]) < chosen:
                at += 1
            again = bool(False)
            if at < found:
                again = int(index[r, at]) == chosen
            if again:
                times[r, at] = times[r, at] + ONE
            else:
                later = int(found)
                while later > at:
                    index[r, later] = index[r, later - 1]
                    times[r, later] = times[r, later - 1]
                    later -= 1
                index[r, at] = wp.int64(chosen)
                times[r, at] = ONE
                found += 1
    counts[r] = wp.int64(found)


@wp.kernel
def _flatten(
    rows: Rows, more_rows: Rows, offsets: Integers, flat: Integers, more_flat: Integers, row: Integers
):
    r = wp.tid()
    first = int(offsets[r])
    for i in range(int(offsets[r + 1]) - first):
        flat[first + i] = rows[r, i]
        more_flat[first + i] = more_rows[r, i]
        row[first + i] = wp.int64(r)


@wp.func
def begin_of(keys: Integers, s: int, sample_bits: wp.int64):
    """The first of the samples along the same primary ray as sample s."""
    begin = int(s)
    while begin > 0 and keys[begin - 1] >> sample_bits == keys[s] >> sample_bits:
        begin -= 1
    return begin


@wp.kernel
def _share_out(
    keys: Integers, mass: Numbers, rays: float, seed: Integers, sample_bits: wp.int64, counts: Integers,
    share: Numbers,
):  # fmt: skip
    s = wp.tid()
    before = wp.float64(0.0)
    for i in range(begin_of(keys, s, sample_bits), s):
        before += wp.float64(mass[i] * rays)
    expected = mass[s] * rays
    u = wp.float64(unit_number(keys[s] >> sample_bits, wp.uint32(seed[0])))
    up_to = before + wp.float64(expected)
    count = wp.int64(wp.floor(up_to + u)) - wp.int64(wp.floor(before + u))
    counts[s] = count
    share[s] = 1.0 / (wp.min(wp.max(expected, 1.0e-6), 1.0) * float(wp.max(count, ONE)))
    if mass[s] <= 0.0:
        share[s] = 0.0


@wp.kernel
def _leave(
    keys: Integers, offsets: Integers, seed: Integers, points: Vectors, sample_bits: wp.int64,
    keys_per_sample: int, sample: Integers, ray_keys: Integers, u: Vectors, together: Integers,
):  # fmt: skip
    s = wp.tid()
    primary = keys[s] >> sample_bits
    begin = int(offsets[begin_of(keys, s, sample_bits)])
    end = int(s) + 1
    while end < keys.shape[0] and keys[end] >> sample_bits == primary:
        end += 1
    together[s] = offsets[end] - wp.int64(begin)
    first = int(offsets[s])
    shift0 = unit_number(primary, wp.uint32(seed[0]))
    shift1 = unit_number(primary, wp.uint32(seed[0]) + wp.uint32(1))
    for k in range(first, int(offsets[s + 1])):
        i = (k - begin) % points.shape[0]
        sample[k] = wp.int64(s)
        ray_keys[k] = keys[s] * wp.int64(keys_per_sample) + wp.int64((k - first) % keys_per_sample)
        x = points[i, 0] + shift0
        y = points[i, 1] + shift1
        u[k, 0] = x - wp.floor(x)
        u[k, 1] = y - wp.floor(y)


draw_depths = launched(_draw_depths, "counts")
flatten = launched(_flatten, "rows")


def share_out(keys, mass, rays, seed, sample_bits, counts, share) -> None:
    launch(_share_out, len(keys), keys, mass, float(rays), seed, sample_bits, counts, share)


leave = launched(_leave, "keys")
