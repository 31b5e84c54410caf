"""Diffuse light between probes in Warp, for CUDA; `render.probes` has the plain twin.

Functions take the arguments of `probe_light_numba`, as tensors, and do what is said there. Names g_x are
cotangents of x.
"""

import warp as wp

from .vectors_warp import Grid, Rows, Vectors
from .warp_device import launch

wp.set_module_options({"enable_backward": False})


@wp.func
def homogeneous(normals: Vectors, s: int):
    return wp.vec4(normals[s, 0], normals[s, 1], normals[s, 2], 1.0)


@wp.func
def harmonic(normal: wp.vec4, form: Vectors, degree: int):
    """One of the nine harmonics at a unit normal."""
    total = float(0.0)
    for i in range(4):
        for j in range(4):
            total += normal[i] * normal[j] * form[4 * i + j, degree]
    return total


@wp.func
def side(k: int, bit: int, part: float):
    return wp.where((k & bit) != 0, part, 1.0 - part)


@wp.kernel
def _around(
    points: Vectors, row: wp.array3d(dtype=wp.int64), clear: Grid, per_spacing: float, rows: Rows,
    shares: Vectors,
):  # fmt: skip
    s = wp.tid()
    last = float(row.shape[0] - 1) - 1.0e-3
    at_x = wp.clamp(points[s, 0] * per_spacing, 0.0, last)
    at_y = wp.clamp(points[s, 1] * per_spacing, 0.0, last)
    at_z = wp.clamp(points[s, 2] * per_spacing, 0.0, last)
    base_x = int(at_x)
    base_y = int(at_y)
    base_z = int(at_z)
    total = float(0.0)
    for k in range(8):
        x = base_x + (k >> 2)
        y = base_y + ((k >> 1) & 1)
        z = base_z + (k & 1)
        share = side(k, 4, at_x - float(base_x)) * side(k, 2, at_y - float(base_y))
        share = share * side(k, 1, at_z - float(base_z)) * clear[x, y, z]
        rows[s, k] = row[x, y, z]
        shares[s, k] = share
        total += share
    for k in range(8):
        shares[s, k] = shares[s, k] / total


@wp.kernel
def _blend(rows: Rows, shares: Vectors, table: Vectors, blended: Vectors):
    s, c = wp.tid()
    total = float(0.0)
    for k in range(8):
        total += shares[s, k] * table[int(rows[s, k]), c]
    blended[s, c] = total


@wp.kernel
def _evaluate(normals: Vectors, form: Vectors, blended: Vectors, out: Vectors):
    s, channel = wp.tid()
    normal = homogeneous(normals, s)
    total = float(0.0)
    for degree in range(9):
        total += harmonic(normal, form, degree) * blended[s, 3 * degree + channel]
    out[s, channel] = wp.max(total, 0.0)


@wp.func
def lit(cotangent: Vectors, out: Vectors, s: int, channel: int):
    """Cotangent of an irradiance, nothing where it was cut at nothing."""
    return wp.where(out[s, channel] > 0.0, cotangent[s, channel], 0.0)


@wp.kernel
def _to_table(
    normals: Vectors, form: Vectors, out: Vectors, rows: Rows, shares: Vectors, cotangent: Vectors,
    g_table: Vectors,
):  # fmt: skip
    s, c = wp.tid()
    g = lit(cotangent, out, s, c % 3) * harmonic(homogeneous(normals, s), form, c // 3)
    for k in range(8):
        wp.atomic_add(g_table, int(rows[s, k]), c, shares[s, k] * g)


@wp.kernel
def _to_normals(
    normals: Vectors, form: Vectors, out: Vectors, blended: Vectors, cotangent: Vectors, g_normals: Vectors
):
    s, axis = wp.tid()
    normal = homogeneous(normals, s)
    total = float(0.0)
    for degree in range(9):
        slope = float(0.0)
        for j in range(4):
            slope += (form[4 * axis + j, degree] + form[4 * j + axis, degree]) * normal[j]
        for channel in range(3):
            total += slope * lit(cotangent, out, s, channel) * blended[s, 3 * degree + channel]
    g_normals[s, axis] = total


def irradiance_between(
    points, row, clear, per_spacing, table, normals, form, out, rows, shares, blended
) -> None:
    samples = len(points)
    launch(_around, samples, points, row, clear, per_spacing, rows, shares)
    launch(_blend, (samples, 27), rows, shares, table, blended)
    launch(_evaluate, (samples, 3), normals, form, blended, out)


def irradiance_between_backward(
    normals, form, out, rows, shares, blended, cotangent, g_table, g_normals
) -> None:
    samples = len(normals)
    launch(_to_table, (samples, 27), normals, form, out, rows, shares, cotangent, g_table)
    launch(_to_normals, (samples, 3), normals, form, out, blended, cotangent, g_normals)
