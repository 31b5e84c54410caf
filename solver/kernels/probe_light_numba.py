"""CPU kernels of diffuse light between probes: blend their coefficients, evaluate, and the adjoint.

`render.probes` has the plain twin. Names g_x are cotangents of x.
"""

from __future__ import annotations

import numba
import numpy as np

from .compiling import inlined, kernel, serial_kernel


@inlined
def basis_of(normal, form, homogeneous, basis):
    """Harmonics [9] at a unit normal: its quadratic monomials times `form` [16, 9]."""
    homogeneous[0], homogeneous[1], homogeneous[2] = normal[0], normal[1], normal[2]
    homogeneous[3] = 1.0
    basis[:] = 0.0
    for i in range(4):
        for j in range(4):
            monomial = homogeneous[i] * homogeneous[j]
            for degree in range(9):
                basis[degree] += monomial * form[4 * i + j, degree]


@kernel
def irradiance_between(
    points, row, clear, per_spacing, table, normals, form, out, rows, shares, blended
):
    """Irradiance [S, 3]; the rows and shares [S, 8] it was blended of, and coefficients [S, 27].

    `row`, `clear` [N, N, N]: of the nodes. `table` [1 + R, 27].
    """
    samples, last = points.shape[0], row.shape[0] - 1
    for s in numba.prange(samples):
        base, part = np.empty(3, np.int64), np.empty(3, np.float32)
        for axis in range(3):
            at = min(max(points[s, axis] * per_spacing, 0.0), last - 1e-3)
            base[axis] = int(at)
            part[axis] = at - base[axis]
        total = np.float32(0.0)
        for k in range(8):
            share = np.float32(1.0)
            x, y, z = base[0] + (k >> 2), base[1] + (k >> 1 & 1), base[2] + (k & 1)
            share *= part[0] if k & 4 else 1 - part[0]
            share *= part[1] if k & 2 else 1 - part[1]
            share *= part[2] if k & 1 else 1 - part[2]
            share *= clear[x, y, z]
            rows[s, k], shares[s, k] = row[x, y, z], share
            total += share
        blended[s] = 0.0
        for k in range(8):
            shares[s, k] /= total
            for c in range(27):
                blended[s, c] += shares[s, k] * table[rows[s, k], c]
        homogeneous, basis = np.empty(4, np.float32), np.empty(9, np.float32)
        basis_of(normals[s], form, homogeneous, basis)
        for channel in range(3):
            value = np.float32(0.0)
            for degree in range(9):
                value += basis[degree] * blended[s, 3 * degree + channel]
            out[s, channel] = max(value, np.float32(0.0))


@serial_kernel
def irradiance_between_backward(
    normals, form, out, rows, shares, blended, cotangent, g_table, g_normals
):
    """Adjoint of `irradiance_between` with respect to the table (added) and normals.

    Not shared out: samples of several threads could add to one row, and 830 samples take 0.25 ms.
    """
    homogeneous, basis = np.empty(4, np.float32), np.empty(9, np.float32)
    to_basis, to_rows = np.empty(9, np.float32), np.empty(27, np.float32)
    for s in range(normals.shape[0]):
        basis_of(normals[s], form, homogeneous, basis)
        to_basis[:] = 0.0
        for channel in range(3):
            g = cotangent[s, channel] if out[s, channel] > 0 else np.float32(0.0)
            for degree in range(9):
                to_basis[degree] += g * blended[s, 3 * degree + channel]
                to_rows[3 * degree + channel] = g * basis[degree]
        for k in range(8):
            for c in range(27):
                g_table[rows[s, k], c] += shares[s, k] * to_rows[c]
        g_normals[s] = 0.0
        for i in range(4):
            for j in range(4):
                g = np.float32(0.0)
                for degree in range(9):
                    g += to_basis[degree] * form[4 * i + j, degree]
                if i < 3:
                    g_normals[s, i] += g * homogeneous[j]
                if j < 3:
                    g_normals[s, j] += g * homogeneous[i]
