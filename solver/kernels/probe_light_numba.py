"""CPU kernels of diffuse light between probes: blend their coefficients, evaluate, and the adjoint.

`render.probes` has the plain twin. Names g_x are cotangents of x. Of 27 coefficients and nine harmonics
three and one are left over when they are taken eight at once (`lanes`).
"""

import numba
import numpy as np

from .compiling import inlined, kernel
from .lanes import LANES, add_to, eight_of, load, store, total

ZERO, ONE = np.float32(0), np.float32(1)
BLOCK = 64  # samples of a task
COEFFICIENTS, WHOLE = 27, 24
LAST = 8  # of the harmonics


@inlined
def homogeneous(normals, s, axis):
    """A normal's coordinate, or the 1 that makes monomials of all degrees up to two of pairs."""
    return normals[s, axis] if axis < 3 else ONE


@inlined
def put_basis(normals, s, form, basis):
    """Harmonics [9] at a unit normal: its quadratic monomials times `form` [16, 9]."""
    many, last = eight_of(ZERO), ZERO
    for i in range(4):
        for j in range(4):
            monomial = homogeneous(normals, s, i) * homogeneous(normals, s, j)
            many = many + monomial * load(form, (4 * i + j, 0), many)
            last += monomial * form[4 * i + j, LAST]
    store(basis, (0,), many)
    basis[LAST] = last


@inlined
def put_corners(points, s, per_spacing, row, clear, rows, shares):
    """Rows of the probes at the eight nodes around a point, and how much each counts."""
    last = row.shape[0] - 1 - 1e-3
    x = min(max(points[s, 0] * per_spacing, 0.0), last)
    y = min(max(points[s, 1] * per_spacing, 0.0), last)
    z = min(max(points[s, 2] * per_spacing, 0.0), last)
    i, j, k = int(x), int(y), int(z)
    u, v, w = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    sum_of_shares = ZERO
    for corner in range(8):
        a, b, c = corner >> 2, corner >> 1 & 1, corner & 1
        share = (u if a else ONE - u) * (v if b else ONE - v) * (w if c else ONE - w)
        share *= clear[i + a, j + b, k + c]
        rows[s, corner], shares[s, corner] = row[i + a, j + b, k + c], share
        sum_of_shares += share
    for corner in range(8):
        shares[s, corner] /= sum_of_shares


@kernel
def irradiance_between(points, row, clear, per_spacing, table, normals, form, out, rows, shares, blended):
    """Irradiance [S, 3]; the rows and shares [S, 8] it was blended of, and coefficients [S, 27].

    `row`, `clear` [N, N, N]: of the nodes. `table` [1 + R, 27].
    """
    samples = points.shape[0]
    for block in numba.prange((samples + BLOCK - 1) // BLOCK):
        basis = np.empty(LAST + 1, np.float32)
        for s in range(block * BLOCK, min((block + 1) * BLOCK, samples)):
            put_corners(points, s, per_spacing, row, clear, rows, shares)
            for c in range(0, WHOLE, LANES):
                mixed = eight_of(ZERO)
                for k in range(8):
                    mixed = mixed + shares[s, k] * load(table, (rows[s, k], c), mixed)
                store(blended, (s, c), mixed)
            for c in range(WHOLE, COEFFICIENTS):
                one = ZERO
                for k in range(8):
                    one += shares[s, k] * table[rows[s, k], c]
                blended[s, c] = one
            put_basis(normals, s, form, basis)
            for channel in range(3):
                value = ZERO
                for degree in range(LAST + 1):
                    value += basis[degree] * blended[s, 3 * degree + channel]
                out[s, channel] = max(value, ZERO)


def irradiance_between_backward(normals, form, out, rows, shares, blended, cotangent, g_table, g_normals):
    """Adjoint of `irradiance_between` with respect to the table (added) and normals."""
    g_blended = np.empty_like(blended)
    _to_samples(normals, form, out, blended, cotangent, g_blended, g_normals)
    _to_table(rows, shares, g_blended, numba.get_num_threads(), g_table)


@kernel
def _to_samples(normals, form, out, blended, cotangent, g_blended, g_normals):
    """The adjoint of what is done for each sample by itself."""
    samples = normals.shape[0]
    for block in numba.prange((samples + BLOCK - 1) // BLOCK):
        basis, g_basis = np.empty(LAST + 1, np.float32), np.empty(LAST + 1, np.float32)
        for s in range(block * BLOCK, min((block + 1) * BLOCK, samples)):
            put_basis(normals, s, form, basis)
            g_basis[:] = 0.0
            for channel in range(3):
                g = cotangent[s, channel] if out[s, channel] > 0 else ZERO
                for degree in range(LAST + 1):
                    g_basis[degree] += g * blended[s, 3 * degree + channel]
                    g_blended[s, 3 * degree + channel] = g * basis[degree]
            many, g_x, g_y, g_z = load(g_basis, (0,), eight_of(ZERO)), ZERO, ZERO, ZERO
            for i in range(4):
                for j in range(4):
                    g = total(many * load(form, (4 * i + j, 0), many))
                    g += g_basis[LAST] * form[4 * i + j, LAST]
                    by_i, by_j = g * homogeneous(normals, s, j), g * homogeneous(normals, s, i)
                    g_x += (by_i if i == 0 else ZERO) + (by_j if j == 0 else ZERO)
                    g_y += (by_i if i == 1 else ZERO) + (by_j if j == 1 else ZERO)
                    g_z += (by_i if i == 2 else ZERO) + (by_j if j == 2 else ZERO)
            g_normals[s, 0], g_normals[s, 1], g_normals[s, 2] = g_x, g_y, g_z


@kernel
def _to_table(rows, shares, g_blended, tasks, g_table):
    """Add what samples say of the coefficients they were blended of; a task has some of the table's rows,
    so the sums have one order on any number of cores."""
    count = g_table.shape[0]
    for task in numba.prange(tasks):
        low, high, many = task * count // tasks, (task + 1) * count // tasks, eight_of(ZERO)
        for s in range(rows.shape[0]):
            for k in range(8):
                r, share = rows[s, k], shares[s, k]
                if low <= r and r < high:
                    for c in range(0, WHOLE, LANES):
                        add_to(g_table, (r, c), share * load(g_blended, (s, c), many))
                    for c in range(WHOLE, COEFFICIENTS):
                        g_table[r, c] += share * g_blended[s, c]
