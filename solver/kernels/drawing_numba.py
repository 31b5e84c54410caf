"""Fused CPU kernels for a step's random choices; `drawing_torch` is their plain twin."""

import math

import numba
import numpy as np

from .hashing_numba import unit_number


@numba.njit(cache=True, nogil=True)
def draw_depths(weights, offsets, opacity, u, least, index, times, counts):
    """Draw D samples of each ray by weight; different ones, ascending, and how often each was drawn.

    Args:
        weights: [S]; those of ray r are `offsets[r]:offsets[r + 1]`. opacity: [R]; rays with no more
            than `least` get none. u: [R, D] in [0, 1).
        index, times: [R, D], out; the first `counts[r]` of a row hold.
    """
    for r in range(u.shape[0]):
        first, last = offsets[r], offsets[r + 1] - 1
        counts[r] = 0
        if opacity[r] <= least or last < first:
            continue
        total = 0.0
        for i in range(first, last + 1):
            total += weights[i]
        found = 0
        for d in range(u.shape[1]):
            target = u[r, d] * total
            running, i = float(weights[first]), first
            while running <= target and i < last:
                i += 1
                running += weights[i]
            at = 0
            while at < found and index[r, at] < i:
                at += 1
            if at < found and index[r, at] == i:
                times[r, at] += 1
                continue
            for later in range(found, at, -1):
                index[r, later], times[r, later] = index[r, later - 1], times[r, later - 1]
            index[r, at], times[r, at] = i, 1
            found += 1
        counts[r] = found


@numba.njit(cache=True, nogil=True)
def flatten(rows, more_rows, offsets, flat, more_flat, row):
    """The first entries of each row r of two arrays, to `offsets[r]` up to `offsets[r + 1]`."""
    for r in range(rows.shape[0]):
        for at in range(offsets[r], offsets[r + 1]):
            i = at - offsets[r]
            flat[at], more_flat[at], row[at] = rows[r, i], more_rows[r, i], r


@numba.njit(cache=True, nogil=True)
def share_out(keys, mass, rays, seed, sample_bits, counts, share):
    """How many of a primary ray's `rays` each sample along it gets, and by how much each of them counts;
    all [S]. See `drawing_torch.share_out`."""
    least, one = np.float32(1e-6), np.float32(1)
    running, u = 0.0, 0.0
    for s in range(keys.shape[0]):
        if s == 0 or keys[s] >> sample_bits != keys[s - 1] >> sample_bits:
            running, u = 0.0, float(unit_number(keys[s] >> sample_bits, seed))
        expected = mass[s] * np.float32(rays)
        before = running
        running += float(expected)
        count = int(math.floor(running + u)) - int(math.floor(before + u))
        counts[s] = count
        share[s] = one / (min(max(expected, least), one) * np.float32(max(count, 1)))
        if mass[s] <= 0:
            share[s] = 0


@numba.njit(cache=True, nogil=True)
def leave(keys, offsets, seed, points, sample_bits, keys_per_sample, sample, ray_keys, u, together):
    """The rays [K] of all samples: whose they are, their keys, and their points, turned by primary ray;
    those of sample s from `offsets[s]` up to `offsets[s + 1]`. And how many the samples along the same
    primary ray have `together` [S]."""
    end = 0
    for begin in range(keys.shape[0]):
        if begin < end:
            continue
        primary = keys[begin] >> sample_bits
        end = begin + 1
        while end < keys.shape[0] and keys[end] >> sample_bits == primary:
            end += 1
        shift0, shift1 = unit_number(primary, seed), unit_number(primary, seed + 1)
        for s in range(begin, end):
            together[s] = offsets[end] - offsets[begin]
            for k in range(offsets[s], offsets[s + 1]):
                i = k - offsets[begin]
                sample[k] = s
                ray_keys[k] = keys[s] * keys_per_sample + (k - offsets[s]) % keys_per_sample
                x, y = points[i % len(points), 0] + shift0, points[i % len(points), 1] + shift1
                u[k, 0], u[k, 1] = x - np.floor(x), y - np.floor(y)


@numba.njit(cache=True, nogil=True)
def choose(weights, passing, mass, sample, clear, least_total, budget, u, scores, indices, probability):
    """Systematic sampling of about `budget` of K rays by what blockers may send along them.

    Args:
        scores, indices, probability: [K], out; of the last two the first entries, as many as is returned.
    """
    total, candidates = 0.0, 0
    for k in range(weights.shape[0]):
        scores[k] = 0
        if passing[k] < clear:
            largest = max(weights[k, 0], weights[k, 1], weights[k, 2])
            scores[k] = (np.float32(1) - passing[k]) * largest * mass[sample[k]]
        total += scores[k]
        candidates += scores[k] > 0
    each = np.float32(budget / max(total, least_total))
    count, running, before = 0, 0.0, 0.0
    for k in range(weights.shape[0]):
        if scores[k] <= 0:
            continue
        share = min(scores[k] * each, np.float32(1)) if candidates > budget else np.float32(1)
        running += share
        if candidates <= budget or np.floor(running + u) > np.floor(before + u):
            indices[count], probability[count] = k, share
            count += 1
        before = running
    return count
