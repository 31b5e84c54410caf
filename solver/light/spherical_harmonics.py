"""Real spherical harmonics up to degree 4, orthonormal, in Cartesian form.

Order: (l, m) with l = 0…degree and m = −l…l; the sign convention without the Condon–Shortley phase
(Sloan, "Stupid Spherical Harmonics Tricks", 2008).
"""

from functools import cache

import torch
import torch.nn.functional as F
from torch import Tensor


def sh_basis(directions: Tensor, degree: int) -> Tensor:
    """Values [..., (degree + 1)²] at unit directions [..., 3], degree ≤ 4."""
    if not 0 <= degree <= 4:
        raise ValueError(f"spherical harmonics are implemented up to degree 4, not {degree}")
    x, y, z = directions.unbind(-1)
    values = [torch.full_like(x, 0.28209479177387814)]
    if degree >= 1:
        values += [0.4886025119029199 * c for c in (y, z, x)]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        values += [
            1.0925484305920792 * x * y, 1.0925484305920792 * y * z, 0.31539156525252005 * (3 * zz - 1),
            1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy),
        ]  # fmt: skip
    if degree >= 3:
        values += [
            0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z,
            0.4570457994644658 * y * (5 * zz - 1), 0.3731763325901154 * z * (5 * zz - 3),
            0.4570457994644658 * x * (5 * zz - 1), 1.445305721320277 * z * (xx - yy),
            0.5900435899266435 * x * (xx - 3 * yy),
        ]  # fmt: skip
    if degree >= 4:
        values += [
            2.5033429417967046 * x * y * (xx - yy), 1.7701307697799304 * y * z * (3 * xx - yy),
            0.9461746957575601 * x * y * (7 * zz - 1), 0.6690465435572892 * y * z * (7 * zz - 3),
            0.10578554691520431 * (35 * zz * zz - 30 * zz + 3),
            0.6690465435572892 * x * z * (7 * zz - 3),
            0.47308734787878004 * (xx - yy) * (7 * zz - 1),
            1.7701307697799304 * x * z * (xx - 3 * yy),
            0.6258357354491761 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
        ]  # fmt: skip
    return torch.stack(values, dim=-1)


def quadratic(directions: Tensor) -> Tensor:
    """All products of pairs of (x, y, z, 1) [N, 16] of unit directions [N, 3]."""
    homogeneous = F.pad(directions, (0, 1), value=1.0)
    return (homogeneous[:, :, None] * homogeneous[:, None, :]).flatten(1)


@cache
def quadratic_form(device: torch.device, dtype: torch.dtype = torch.float32) -> Tensor:
    """[16, 9] with sh_basis(d, 2) = quadratic(d) @ it: three operations where the sum takes twenty.

    Ramamoorthi & Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001, eq. 11.
    """
    x, y, z, one = range(4)
    terms = [
        {(one, one): 0.28209479177387814},
        {(y, one): 0.4886025119029199},
        {(z, one): 0.4886025119029199},
        {(x, one): 0.4886025119029199},
        {(x, y): 1.0925484305920792},
        {(y, z): 1.0925484305920792},
        {(z, z): 3 * 0.31539156525252005, (one, one): -0.31539156525252005},
        {(x, z): 1.0925484305920792},
        {(x, x): 0.5462742152960396, (y, y): -0.5462742152960396},
    ]
    form = torch.zeros(4, 4, 9, dtype=dtype)
    for column, term in enumerate(terms):
        for pair, factor in term.items():
            form[(*pair, column)] = factor
    return form.view(16, 9).to(device)


def sh_degrees(degree: int) -> Tensor:
    """The degree l of every coefficient of `sh_basis`, [(degree + 1)²]."""
    return torch.cat([torch.full((2 * d + 1,), float(d)) for d in range(degree + 1)])
