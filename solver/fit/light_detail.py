"""What of a light's detail photos leave open: what is finer than the lobes that mirror it.

Glossy reflections tell the mean of the light over their lobes. What cancels out in all of them, mostly
lines along rows and columns, stays in the light as the first rays have left it, for an artist to see behind
the object (docs/decisions/0038). So do colours: where the light is dark, or a lobe is wide, each channel
has noise of its own (docs/decisions/0040).
"""

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

from ..brdf.microfacet import fresnel_schlick
from ..light.environment import EnvironmentMap, equirect_coordinates, resized_map
from ..light.smoothing import draw_colours_together, draw_together, map_smoothing
from ..render.scene import Scene, SharedTables
from .chunk import Chunk, ChunkLoss
from .schedule import blur_width
from .settings import LightSettings
from .step import Step

ROWS = 32
"""rows of the map on which lobes are counted"""
AROUND = 1.5
"""texels of it by which the counts are blurred"""
SHARPEST = 0.02
"""share that is open at least"""
SOLID = 0.5
"""opacity from which a pixel shows a surface"""
FEW = 1e-3
"""of the mean count: where less is mirrored, all is open"""


class OpenDetail:
    """Takes from a light, over the last steps of a fit, what photos leave open of it.

    Attributes:
        share: [2, H, 2H] of detail and of colours, see `open_detail`, as they were last looked for; None:
            not yet.
    """

    STEPS = 8
    """as many pixels as so many steps have tell how fine the light is mirrored"""
    EVERY = 8
    """steps from one smoothing to the next, since each takes a good part of a step's time"""

    def __init__(self, settings: LightSettings):
        self._settings = settings
        self.share: Tensor | None = None

    def wanted(self, fraction: float) -> bool:
        """Whether it is time to look, at a fraction of the fit: surfaces have their gloss."""
        settings = self._settings
        some = max(settings.smoothness, settings.colour_smoothness) > 0
        return some and fraction >= settings.smoothness_start

    def look(self, scene: Scene, loss: ChunkLoss, steps: list[Step]) -> None:
        """Find the share of detail that pixels of steps leave open."""
        self.share = open_detail(scene, loss, steps, self._sigmas(scene.environment))

    def take_away(self, light: EnvironmentMap, step: int, rate: float) -> None:
        """Smooth what is open of a light, in place, if it is time.

        Args:
            rate: of the light's optimiser, whose steps bring back what photos tell.
        """
        if self.share is None or step % self.EVERY != 0:
            return
        draws = draw_together, draw_colours_together
        pulls = self._settings.smoothness, self._settings.colour_smoothness
        for draw, sigma, share, pull in zip(draws, self._sigmas(light), self.share, pulls, strict=True):
            if pull > 0:
                draw(light, sigma, share * min(self.EVERY * rate * pull, 1.0))

    def _sigmas(self, light: EnvironmentMap) -> tuple[float, float]:
        """Of the blurs of detail and of colours, texels."""
        settings = self._settings
        widths = settings.smoothness_width, settings.colour_smoothness_width
        return tuple(blur_width(width, light.height) for width in widths)


@torch.no_grad()
def open_detail(scene: Scene, loss: ChunkLoss, steps: list[Step], sigmas: Sequence[float]) -> Tensor:
    """Shares [len(sigmas), H, 2H], from 0 to 1, of detail finer than Gaussians of so many texels that
    pixels of steps leave open, per texel of a scene's light.

    A lobe leaves α / σ of it open, σ as an angle. Of the lobes that mirror a place, the harmonic mean
    counts, weighted by what they reflect: a few sharp ones tell all.
    """
    height = scene.environment.height
    angles = [sigma * math.pi / height for sigma in sigmas]
    counts = torch.zeros(1 + len(angles), ROWS * 2 * ROWS, device=scene.device)
    for chunks, turns in steps:
        tables = SharedTables.of(scene, turns)
        for chunk in chunks:
            place, weight, alpha = _mirrored(scene, loss, tables, chunk, turns[chunk.turn])
            open_here = [(alpha / angle).clamp(SHARPEST, 1) for angle in angles]
            weights = torch.stack([weight, *(weight / share for share in open_here)])
            counts.index_add_(1, place, weights)
    seen, *sharp = map_smoothing(AROUND)(counts.view(-1, ROWS, 2 * ROWS))
    few = FEW * seen.mean() + 1e-12
    shares = [((seen + few) / (each + few)).expand(3, -1, -1) for each in sharp]
    return torch.stack([resized_map(share, height)[0] for share in shares]).clamp(0, 1)


def _mirrored(
    scene: Scene, loss: ChunkLoss, tables: SharedTables, chunk: Chunk, turn: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Of each pixel, where in the map of `ROWS` [B] its mirror direction is, how much it reflects from
    there [B], and its α [B]."""
    seen = loss.pixels(scene, tables.under(chunk.turn), chunk)
    opacity = seen.opacity.clamp(min=1e-6)
    normal = F.normalize(seen.normal, dim=-1)
    view = F.normalize(chunk.batch.directions.mean(1), dim=-1)
    cosine = -(view * normal).sum(-1).clamp(-1, 0)
    direction = view + 2 * cosine[:, None] * normal
    if turn is not None:
        direction = direction @ turn
    column, row = equirect_coordinates(direction, ROWS, 2 * ROWS).unbind(-1)
    place = row.long().clamp(0, ROWS - 1) * 2 * ROWS + column.long().clamp(0, 2 * ROWS - 1)
    reflected = fresnel_schlick(seen.f0 / opacity[:, None], cosine).mean(-1)
    return place, reflected * (seen.opacity > SOLID), seen.alpha / opacity
