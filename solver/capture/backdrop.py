"""An object before plain white or black: where photos show it, without alpha or masks.

Only what is connected with the edge of a photo counts as backdrop: a highlight on the object is white, too.
"""

import numpy as np
from scipy import ndimage

LEVELS = {"white": 1.0, "black": 0.0}
"""sRGB level of each backdrop"""
TOLERANCE = 5 / 255
"""sRGB levels by which a backdrop differs from plain: JPEG's traces"""
PLAIN_BORDER = 0.8
"""share of a photo's border that a backdrop takes; the rest may be a stand, or the object itself"""
LEAST_PART = 1e-4
"""share of the photo from which on a connected part is the object's, and no dust"""
SURE = 0.05
"""difference from the backdrop, sRGB, from which on the share of it in a pixel can be told"""


def border_of(pixels: np.ndarray) -> np.ndarray:
    """The pixels [N, …] along the edges of a picture [H, W, …]."""
    return np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])


def border_share(shown: np.ndarray) -> float:
    """Share of a picture's edge that a mask [H, W] takes."""
    return float(border_of(shown).mean())


def backdrop_of(borders: list[np.ndarray]) -> str | None:
    """'white' or 'black', if most of the border of the median photo is that; else None.

    Args:
        borders: [N, 3] sRGB from 0 to 1 of the pixels along the edges of each photo.
    """
    for name, level in LEVELS.items():
        shares = [float(_is_plain(border, level).mean()) for border in borders]
        if shares and np.median(shares) > PLAIN_BORDER:
            return name
    return None


def object_before(colour: np.ndarray, backdrop: str) -> np.ndarray:
    """[H, W] bool: where a photo, [H, W, 3] sRGB, shows something before a backdrop."""
    return without_dust(~from_the_edge(_is_plain(colour, LEVELS[backdrop])))


def from_the_edge(mask: np.ndarray) -> np.ndarray:
    """What of a mask [H, W] is connected with the picture's edge."""
    parts, _ = ndimage.label(mask)
    edge = np.unique(border_of(parts))
    return np.isin(parts, edge[edge > 0])


def without_dust(shown: np.ndarray) -> np.ndarray:
    """What is `shown` [H, W] but for its smallest parts."""
    parts, count = ndimage.label(shown, np.ones((3, 3)))
    if count > 1:
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        shown = (sizes >= min(max(LEAST_PART * shown.size, 2), sizes.max()))[parts]
    return shown


def coverage_before(colour: np.ndarray, shown: np.ndarray, behind: float | np.ndarray) -> np.ndarray:
    """Coverage [H, W] float32 of the object: whole but for the pixels next to the backdrop.

    Such a pixel mixes the backdrop with the object, of whose colour the nearest pixel further in tells.

    Args:
        colour: [H, W, 3] sRGB. shown: [H, W] bool, as `object_before` has it.
        behind: the backdrop's sRGB level, or its colours [H, W, 3].
    """
    edge = shown & ndimage.binary_dilation(~shown, np.ones((3, 3)))
    inner = shown & ~edge
    coverage = shown.astype(np.float32)
    if not inner.any() or not edge.any():
        return coverage
    at = ndimage.distance_transform_edt(~inner, return_distances=False, return_indices=True)
    plain = np.broadcast_to(np.asarray(behind, dtype=colour.dtype), colour.shape)[edge]
    mixed = colour[edge] - plain
    whole = colour[at[0][edge], at[1][edge]] - plain
    square = (whole * whole).sum(-1)
    share = (mixed * whole).sum(-1) / np.maximum(square, 1e-6)
    # An object of the backdrop's colour tells nothing.
    coverage[edge] = np.where(square > SURE**2, np.clip(share, 0.02, 1), 1)
    return coverage


def _is_plain(colour: np.ndarray, level: float) -> np.ndarray:
    return (np.abs(colour - level) <= TOLERANCE).all(-1)
