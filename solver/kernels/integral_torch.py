"""Plain torch twin of `integral_numba`; every quantity differentiable by autograd."""

import torch
from torch import Tensor


def prefix_sums(values: Tensor, row_weights: Tensor) -> Tensor:
    """See `integral_numba.prefix_sums`."""
    weighted = values.to(row_weights.dtype) * row_weights[:, None]
    return torch.nn.functional.pad(weighted.cumsum(1).cumsum(2), (1, 0, 1, 0)).permute(1, 2, 0)


def _prefix(table: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Bilinear prefix sum at columns x (any, periodic) and rows y in [0, H] → [N, 3]."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    turns = torch.floor(x.detach() / width)
    x = x - turns * width
    i = x.detach().long().clamp(0, width - 1)
    j = y.detach().long().clamp(0, height - 1)
    f, g, turns = (x - i)[:, None], (y - j)[:, None], turns[:, None]

    def row(j):
        return turns * table[j, width] + table[j, i] * (1 - f) + table[j, i + 1] * f

    return row(j) * (1 - g) + row(j + 1) * g


def _slab(table, x0, x1, y):
    return _prefix(table, x1, y) - _prefix(table, x0, y)


def _slab_over_poles(table, x0, x1, y):
    height, half = table.shape[0] - 1, 0.5 * (table.shape[1] - 1)
    inside = _slab(table, x0, x1, y.clamp(0, height))
    above = -_slab(table, x0 + half, x1 + half, (-y).clamp(0, height))
    bottom = torch.full_like(y, height)
    below = (
        _slab(table, x0, x1, bottom)
        + _slab(table, x0 + half, x1 + half, bottom)
        - _slab(table, x0 + half, x1 + half, (2 * height - y).clamp(0, height))
    )
    y = y[:, None]
    return torch.where(y < 0, above, torch.where(y > height, below, inside))


def _row_integral(rows, y):
    height = len(rows) - 1
    folded = torch.where(y < 0, -y, torch.where(y > height, 2 * height - y, y)).clamp(0, height)
    j = folded.detach().long().clamp(0, height - 1)
    value = rows[j] + (folded - j) * (rows[j + 1] - rows[j])
    return torch.where(y < 0, -value, torch.where(y > height, 2 * rows[-1] - value, value))


def rectangle_mean(table, rows, centre, size) -> Tensor:
    """See `integral_numba.rectangle_mean` → [N, 3]."""
    centre, size = centre.to(table.dtype), size.to(table.dtype)
    (x0, y0), (x1, y1) = (centre - size / 2).unbind(-1), (centre + size / 2).unbind(-1)
    area = (x1 - x0) * (_row_integral(rows, y1) - _row_integral(rows, y0))
    total = _slab_over_poles(table, x0, x1, y1) - _slab_over_poles(table, x0, x1, y0)
    return total / area[:, None]
