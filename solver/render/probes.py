"""Diffuse light in the shade: probes around the surface that know which light gets to them.

The paper's irradiance knows no occlusion, so shadows end up in the albedo. Rays that look for blockers
are too noisy for a fit (docs/decisions/0009). So nodes of a grid close to the surface look around once in
a while, in all directions; from then on their irradiance is a matrix product with the light of the moment,
without noise, and a surface blends that of the nodes before it (as in Majercik et al., "Dynamic Diffuse
Global Illumination with Ray-Traced Irradiance Fields", JCGT 2019; docs/decisions/0014).
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..kernels.backend import fast
from ..kernels.probe_light import irradiance_between
from ..light.irradiance import Arriving, irradiance
from ..light.spherical_harmonics import quadratic_form

NODE_CELLS = (3, 4, 6, 8)
"""cells of the occupancy grid between nodes: the first of these that needs no more than `MOST_PROBES`"""
MOST_PROBES = 16_000
"""probes of a field, so that a step's product with the light stays small beside its rays"""
NEAR_NODES = 1.0
"""nodes along any axis within which a node with a probe has something"""
NEAR_DEPTH = 0.05
"""optical depth of a cell that counts as something"""
INSIDE = 6.0
"""how fast nodes count less inside of things: e^(−6 τ), with the optical depth τ of a cell there"""
LEAST_CLEAR = 1e-4
"""of that, below which a node has no probe; in a crevice none is clear, and one that is half in it does"""
STAND_IN, STAND_IN_REACH = 1e-6, 2
"""how much a node without a probe counts, and from how many nodes away one with a probe stands in for it"""
LIFT_NODES = 0.35
"""how far before a surface its light is looked up, so that nodes behind it count little"""


class Nodes(NamedTuple):
    """Probes on a grid over a field's box."""

    row: Tensor  # [N, N, N] long: of the irradiance tables; 0, all light, far from surfaces
    clear: Tensor  # [N, N, N] how much a node counts, more than 0
    spacing: float  # of the nodes, box units


class Probes:
    """The probes of a scene: `nodes` of each of its fields, and what arrives at them.

    Empty before `probing.refresh_probes`, and where nothing is to block light: then all surfaces see
    all of it.
    """

    def __init__(self):
        self.nodes: list[Nodes] = []
        self.arriving: Arriving | None = None

    def fill(self, nodes: list[Nodes], arriving: Arriving) -> None:
        """Take over new probes."""
        self.nodes, self.arriving = nodes, arriving

    def irradiance(self, table: Tensor, part: int, box_points: Tensor, normals: Tensor) -> Tensor:
        """Irradiance [S, 3] of surfaces with unit normals [S, 3] at points [S, 3] of a field's box,
        blended from the nodes around.

        Args:
            table: [1 + R, 9, 3] `LightTables.irradiance`. part: which of `nodes`.
        """
        nodes = self.nodes[part]
        if fast(normals):
            form = quadratic_form(normals.device)
            return irradiance_between(
                table, normals, box_points, nodes.row, nodes.clear, nodes.spacing, form
            )
        rows, shares = _around(nodes, box_points)
        blended = F.embedding_bag(rows, table.flatten(1), per_sample_weights=shares, mode="sum")
        return irradiance(blended.view(-1, *table.shape[1:]), normals)

    def nearest_rows(self, part: int, box_points: Tensor) -> Tensor:
        """Rows [K] of the nodes next to points [K, 3] of a field's box."""
        nodes = self.nodes[part]
        last = len(nodes.row) - 1
        x, y, z = (box_points / nodes.spacing).round().long().clamp(0, last).unbind(-1)
        return nodes.row[x, y, z]


def nodes_of(depths: Tensor, first_row: int) -> tuple[Nodes, Tensor]:
    """Nodes close to the surface in a grid of cells' optical depths [K, K, K], and where they are
    [P, 3], box units.

    Args:
        first_row: of their irradiance.
    """
    corners = torch.exp(-INSIDE * F.avg_pool3d(F.pad(depths[None, None], (1,) * 6), 2, 1)[0, 0])
    for cells in NODE_CELLS:
        margin = round(NEAR_NODES * cells)
        near = F.max_pool3d(F.pad(depths[None, None], (margin,) * 6), 2 * margin, cells)[0, 0]
        near = near > NEAR_DEPTH
        clear = corners[::cells, ::cells, ::cells]
        probes = near & (clear > LEAST_CLEAR)
        if int(probes.sum()) <= MOST_PROBES:
            break
    at = probes.nonzero()
    # Deep in a crevice there may be no probe: then one close by stands in.
    clear = torch.where(probes, clear, STAND_IN)
    row = torch.zeros(clear.shape, dtype=torch.long, device=depths.device)
    row[probes] = first_row + torch.arange(len(at), device=depths.device)
    for _ in range(STAND_IN_REACH):
        beside = F.max_pool3d(row[None, None].float(), 3, 1, 1)[0, 0].long()
        row = torch.where(row > 0, row, beside)
    spacing = cells / len(depths)
    return Nodes(row, clear, spacing), at.to(depths) * spacing


def _around(nodes: Nodes, box_points: Tensor) -> tuple[Tensor, Tensor]:
    """Rows and shares [S, 8] of the nodes around points [S, 3]; no gradient."""
    count = len(nodes.row)
    with torch.no_grad():
        at = (box_points / nodes.spacing).clamp(0, count - 1 - 1e-3)
        base = at.long()
        fraction = at - base
        side = torch.cartesian_prod(*[torch.arange(2, device=at.device)] * 3)
        shares = torch.where(side.bool(), fraction[:, None], 1 - fraction[:, None]).prod(-1)
        x, y, z = (base[:, None] + side).unbind(-1)
        index = (x * count + y) * count + z
        shares = shares * nodes.clear.flatten()[index]
        return nodes.row.flatten()[index], shares / shares.sum(-1, keepdim=True)
