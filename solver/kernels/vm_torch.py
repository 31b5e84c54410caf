"""Plain torch twin of the vector–matrix (VM) tensor lookups in `vm_numba`.

A VM tensor holds three pairs of a plane and a line: planes (x, y), (x, z), (y, z) with lines z, y, x
(Chen et al., TensoRF, ECCV 2022). Layout, channels last: planes [3, G, G, C], the first grid index
runs along the pair's first axis; lines [3, G, C]. Positions are in grid units, [0, G-1] per axis,
and are clamped to the grid; they carry no gradient.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

PLANE_AXES = ((0, 1), (0, 2), (1, 2))
LINE_AXES = (2, 1, 0)


def _cell(coordinate: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Lower index and fraction of a linear interpolation on `size` nodes."""
    coordinate = coordinate.clamp(0, size - 1)
    lower = coordinate.floor().clamp(max=size - 2).long()
    return lower, coordinate - lower


def interpolate_plane(plane: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Bilinear lookup of a plane [G, G, ...] at positions a, b [N] → [N, ...]."""
    i, u = _cell(a, plane.shape[0])
    j, v = _cell(b, plane.shape[1])
    shape = (-1,) + (1,) * (plane.dim() - 2)
    u, v = u.view(shape).to(plane.dtype), v.view(shape).to(plane.dtype)
    near = plane[i, j] * (1 - v) + plane[i, j + 1] * v
    far = plane[i + 1, j] * (1 - v) + plane[i + 1, j + 1] * v
    return near * (1 - u) + far * u


def interpolate_line(line: Tensor, c: Tensor) -> Tensor:
    """Linear lookup of a line [G, ...] at positions c [N] → [N, ...]."""
    k, w = _cell(c, line.shape[0])
    w = w.view((-1,) + (1,) * (line.dim() - 1)).to(line.dtype)
    return line[k] * (1 - w) + line[k + 1] * w


def vm_products(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """The 3·C products plane × line at points [N, 3] → [N, 3·C]."""
    parts = []
    for k, ((a, b), c) in enumerate(zip(PLANE_AXES, LINE_AXES, strict=True)):
        plane = interpolate_plane(planes[k], points[:, a], points[:, b])
        parts.append(plane * interpolate_line(lines[k], points[:, c]))
    return torch.cat(parts, dim=-1)


def vm_sum(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """The sum of all products at points [N, 3] → [N] (the raw density s of TensoRF)."""
    return vm_products(points, planes, lines).sum(-1)


def correlate(factor: Tensor, taps: tuple[float, ...], axis: int) -> Tensor:
    """Correlation along one axis; the borders continue with their last value."""
    radius = len(taps) // 2
    size = factor.shape[axis]
    first, last = factor.narrow(axis, 0, 1), factor.narrow(axis, size - 1, 1)
    padded = torch.cat([first] * radius + [factor] + [last] * radius, dim=axis)
    terms = [padded.narrow(axis, offset, size) * tap for offset, tap in enumerate(taps) if tap != 0.0]
    return sum(terms[1:], terms[0])


def smooth(factor: Tensor, taps: Tensor, axis: int) -> Tensor:
    """Correlation with odd, symmetric taps along one axis; the borders are mirrored (b a | a b c)."""
    size, reach = factor.shape[axis], len(taps) // 2
    index = torch.arange(-reach, size + reach, device=factor.device) % (2 * size)
    index = torch.where(index >= size, 2 * size - 1 - index, index)
    padded = factor.index_select(axis, index)
    terms = [padded.narrow(axis, k, size) * float(tap) for k, tap in enumerate(taps)]
    return sum(terms[1:], terms[0])


def smooth_planes(planes: Tensor, taps: Tensor) -> Tensor:
    """Odd, symmetric taps along both axes of planes [3, G, G, C], borders mirrored."""
    return smooth(smooth(planes, taps, 1), taps, 2)


def vm_gradient(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """Gradient, per grid unit, of a VM sum at points [N, 3] → [N, 3].

    Central differences at the nodes, interpolated between them as the values are. planes and lines
    are those of `vm_sum`, smoothed as one likes (`field.smoothing`).
    """
    gradient = [torch.zeros_like(points[:, 0], dtype=planes.dtype) for _ in range(3)]
    taps = (-0.5, 0.0, 0.5)
    for k, ((a, b), c) in enumerate(zip(PLANE_AXES, LINE_AXES, strict=True)):
        plane, line = planes[k], lines[k]
        at = points[:, a], points[:, b]
        value = interpolate_plane(plane, *at)
        along_a = interpolate_plane(correlate(plane, taps, 0), *at)
        along_b = interpolate_plane(correlate(plane, taps, 1), *at)
        across = interpolate_line(line, points[:, c])
        along_c = interpolate_line(correlate(line, taps, 0), points[:, c])
        gradient[a] = gradient[a] + (along_a * across).sum(-1)
        gradient[b] = gradient[b] + (along_b * across).sum(-1)
        gradient[c] = gradient[c] + (value * along_c).sum(-1)
    return torch.stack(gradient, dim=-1)


def vm_interpolation_gradient(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """Gradient, per grid unit, of the interpolation itself at points [N, 3] → [N, 3].

    planes [3, G, G, C], lines [3, G, C] as in `vm_sum`. Piecewise constant along the axis of
    differentiation ("analytical derivative", paper Table 1).
    """
    gradient = [torch.zeros_like(points[:, 0], dtype=planes.dtype) for _ in range(3)]
    size, channels = planes.shape[1], planes.shape[3]
    for k, ((a, b), c) in enumerate(zip(PLANE_AXES, LINE_AXES, strict=True)):
        (i, u), (j, v) = _cell(points[:, a], size), _cell(points[:, b], size)
        m, w = _cell(points[:, c], size)
        u, v, w = (x[:, None].to(planes.dtype) for x in (u, v, w))
        # `embedding` has a fast backward pass where indexing has not.
        flat = planes[k].reshape(size * size, channels)
        p00, p01 = F.embedding(i * size + j, flat), F.embedding(i * size + j + 1, flat)
        p10, p11 = F.embedding((i + 1) * size + j, flat), F.embedding((i + 1) * size + j + 1, flat)
        l0, l1 = F.embedding(m, lines[k]), F.embedding(m + 1, lines[k])
        line = l0 * (1 - w) + l1 * w
        value = (p00 * (1 - v) + p01 * v) * (1 - u) + (p10 * (1 - v) + p11 * v) * u
        along_a = (p10 - p00) * (1 - v) + (p11 - p01) * v
        along_b = (p01 - p00) * (1 - u) + (p11 - p10) * u
        gradient[a] = gradient[a] + (along_a * line).sum(-1)
        gradient[b] = gradient[b] + (along_b * line).sum(-1)
        gradient[c] = gradient[c] + (value * (l1 - l0)).sum(-1)
    return torch.stack(gradient, dim=-1)
