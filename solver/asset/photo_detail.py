"""Detail of the albedo that is finer than the field's voxels, from the photos.

A field's materials are as sharp as its grid, and photos mostly sharper. What a photo shows more than the
field's diffuse light, less the mean of that over a few voxels around, which the fit has told better from
reflections, is detail of the albedo. Reflections move over a surface from view to view; what views do not
agree on is noise, and is taken away as by Wiener's filter. See docs/decisions/0041.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.capture import evenly_taken
from ..capture.colour import linear_to_srgb
from .bake import SurfaceSamples

FINER = 0.7
"""of a voxel, below which a photo's pixel has to be for there to be any detail"""
MOST_VIEWS = 100
"""evenly taken from all: they cost time, and places need a few that face them"""
VIEWS = 6
"""that count at a place: those that face it most"""
FEWEST_VIEWS = 3
"""from which on all of what they show counts; of one alone nothing does"""
ROUNDS = 5
"""of robust means"""
HIDDEN = 3.0
"""by how much their noise is more than it seems, since they let go of what is far off (Gaussian noise in
three to six views)"""
POINTS_AT_ONCE = 1 << 17
LEAST_COSINE = 0.35
"""between a surface's normal and the way to a camera whose photo counts"""
COARSE_VOXELS = 2.0
"""standard deviation of the mean that is taken away"""
SATURATED = 0.98
"""linear, from which on a photo that is not HDR may be clipped"""
LEAST_ALPHA = 0.99
"""of all pixels around one that shows the object alone"""
LEAST_CLEAR = 0.8
"""share of what is around a place that a photo has to show unclipped"""
POOL_VOXELS = 3.0
"""edge of the cells in which detail is told from noise"""
DIELECTRIC = 0.2
"""F0 up to which a surface has an albedo to speak of"""
DARKEST = 1e-4
"""linear, of what a photo's curve is taken for"""
LEAST_RESPONSE = 0.1
"""of the median: how much of an albedo a place sends at least; in a deep shade, photos tell little of it"""


class View(NamedTuple):
    """A photo and its camera, in the points' world."""

    camera: Camera
    pixels: np.ndarray  # [H, W, 4] linear Rec.709, premultiplied
    is_hdr: bool
    gain: np.ndarray  # [3] by which the photo is brighter than the others


@dataclass(frozen=True)
class Surface:
    """Points of a surface, evenly spread over it."""

    points: np.ndarray  # [T, 3] world
    normals: np.ndarray  # [T, 3] unit, outward
    spacing: float  # world units, from one to the next
    voxel: float  # world units, edge of what the field is made of
    f0: np.ndarray  # [T, 3] reflectance at normal incidence


def are_finer(cameras: Sequence[Camera], middle: np.ndarray, voxel: float) -> bool:
    """Whether most cameras' pixels are much smaller than a voxel is in the `middle` [3] of a scene."""
    edges = [c.pixel_angle * np.linalg.norm(c.position - middle) for c in cameras]
    return bool(edges) and float(np.median(edges)) < FINER * voxel


def with_photo_detail(
    samples: SurfaceSamples, surface: Surface, response: np.ndarray, views: Sequence[View],
    progress: Callable[[float], None],
) -> SurfaceSamples:  # fmt: skip
    """Samples of a surface whose albedo has the detail of photos.

    Args:
        response: [T, 3] radiance that a point sends for an albedo of 1.
        progress: told the share done.
    """
    views = [views[i] for i in evenly_taken(len(views), MOST_VIEWS)]
    detail = photo_detail(
        surface, samples.albedo * response, views, lambda done: progress(done / len(views))
    )
    least = LEAST_RESPONSE * np.median(response, axis=0)
    albedo = samples.albedo + detail / np.maximum(response, np.maximum(least, 1e-6))
    return replace(samples, albedo=np.clip(albedo, 0, 1).astype(np.float32))


def photo_detail(
    surface: Surface, shown: np.ndarray, views: Iterable[View], progress: Callable[[int], None]
) -> np.ndarray:
    """What photos show more than `shown` [T, 3], radiance, at a surface's points [T, 3], finer than a few
    voxels and as far as they agree on it; nothing on metal.

    Args:
        progress: told the number of views done.
    """
    best = _Best(len(surface.points))
    for done, view in enumerate(views, 1):
        best.take(*_residual(surface, shown, view))
        progress(done)
    mean, noise = best.mean_and_noise()
    agreeing = ((best.weight > 0).sum(0) - 1).clip(0, FEWEST_VIEWS - 1) / (FEWEST_VIEWS - 1)
    return mean * agreeing[:, None] * _share_of_signal(surface, mean, noise)


class _Best:
    """The residuals of the views that count most, for each of T points."""

    def __init__(self, count: int):
        self.weight = np.zeros((VIEWS, count), np.float32)
        self.residual = np.zeros((VIEWS, count, 3), np.float32)

    def take(self, index: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> None:
        """Put a view's residuals [K, 3] at points `index` [K] in the place of those that count least."""
        least = self.weight[:, index].argmin(0)
        more = weight > self.weight[least, index]
        least, index = least[more], index[more]
        self.weight[least, index] = weight[more]
        self.residual[least, index] = residual[more]

    def mean_and_noise(self) -> tuple[np.ndarray, np.ndarray]:
        """Robust means [T, 3] and the variances [T, 3] of their noise."""
        count = self.weight.shape[1]
        mean, noise = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        for first in range(0, count, POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            mean[part], noise[part] = _robust(self.weight[:, part, None], self.residual[:, part])
        return mean, noise


def _robust(weight: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means [T, 3] of values [V, T, 3] by weights [V, T, 1], and the variances [T, 3] of their noise.

    By Cauchy's weights, what one view shows alone, such as a highlight, counts little.
    """
    trusted = weight
    for _ in range(ROUNDS):
        sums = np.maximum(trusted.sum(0), 1e-12)
        mean = (trusted * values).sum(0) / sums
        square = (values - mean) ** 2
        spread = (weight * square).sum(0) / np.maximum(weight.sum(0), 1e-12)
        variance = (trusted**2 * square).sum(0) / sums**2
        independent = 1 - (trusted**2).sum(0) / sums**2
        trusted = weight / (1 + square / np.maximum(spread, 1e-12))
    alone = (weight > 0).sum(0) < 2
    noise = HIDDEN * variance / np.maximum(independent, 1e-3)
    return mean, np.where(alone, mean**2, noise)


def _residual(surface: Surface, shown: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points [K] a photo shows well, how much that counts [K], and what it has more there [K, 3]."""
    camera = view.camera
    towards = camera.position - surface.points
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("tk,tk->t", towards, surface.normals) / np.maximum(distance, 1e-12)
    index = np.flatnonzero(cosine > 0)
    places, depth = camera.project(surface.points[index])
    size = camera.height, camera.width
    # No comparison holds for NaN, which is where no lens sees.
    inside = (depth > 0) & ((places >= 0) & (places < size[::-1])).all(1)
    index, places = index[inside], places[inside]
    if len(index) == 0:
        return index, np.zeros(0), np.zeros((0, 3))
    distance, cosine = distance[index], cosine[index]
    per_unit = 1 / (camera.pixel_angle * np.median(distance))  # pixels
    edge = max(1.0, 2 * surface.spacing * per_unit)
    slope = np.sqrt(np.maximum(1 - cosine**2, 0)) / np.maximum(cosine, LEAST_COSINE)
    nearest = _Bins(places, edge, size).least_around(distance)
    is_near = distance < nearest + 2 * surface.voxel + 2 * edge / per_unit * slope
    seen = np.flatnonzero(is_near & (cosine > LEAST_COSINE))
    colours, clear = _sampled(view, places[seen], surface.spacing * per_unit)
    f0, shown = surface.f0[index[seen]], shown[index[seen]]
    clear &= f0.max(1) < DIELECTRIC  # beside metal, what that mirrors would be in the mean
    sigma = COARSE_VOXELS * surface.voxel * per_unit
    bins = _Bins(places[seen], max(1.0, sigma / 2), size)
    light, share = _reflected_light(bins, sigma, colours, shown, f0, clear)
    # Where much around is clipped, what is left is darker in the mean. None begins to count at once.
    clearness = np.maximum((share - LEAST_CLEAR) / (1 - LEAST_CLEAR), 0)
    kept = clear & (clearness > 0)
    weight = cosine[seen] ** 4 / distance[seen] ** 2 * clearness**2
    residual = colours - shown - f0 * light
    return index[seen[kept]], weight[kept], residual[kept]


def _reflected_light(
    bins: "_Bins", sigma: float, colours: np.ndarray, shown: np.ndarray, f0: np.ndarray, clear: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The light [K, 3] that places would mirror to a camera with an F0 of 1, and how much [K] of what is
    around each is `clear` [K].

    It is much the same over a few voxels, and such that what is seen is the photo in the mean; of values as
    sRGB has them, for so it was fitted: of linear ones the mean would be too bright where a field blurs
    letters. One step of Newton's leads there from the linear mean.
    """
    counts = np.repeat(clear[:, None], 3, axis=1).astype(np.float32)
    share = bins.blurred(counts[:, :1], sigma)
    reflecting = bins.blurred(f0 * counts, sigma)
    light = bins.blurred((colours - shown) * counts, sigma) / np.maximum(reflecting, 1e-6)
    fitted = np.maximum(shown + f0 * light, DARKEST)
    off = (linear_to_srgb(colours) - linear_to_srgb(fitted)) * counts
    slope = 1.055 / 2.4 * fitted ** (1 / 2.4 - 1) * f0 * counts
    light += bins.blurred(off, sigma) / np.maximum(bins.blurred(slope, sigma), 1e-6)
    return light, share[:, 0]


class _Bins:
    """Places [K, 2] in a picture, gathered in squares of some pixels."""

    def __init__(self, places: np.ndarray, edge: float, size: tuple[int, int]):
        self.edge, self.at = edge, places / edge
        self.shape = tuple(int(n / edge) + 1 for n in size)
        column, row = self.at.astype(int).T
        self.flat = row.clip(0, self.shape[0] - 1) * self.shape[1] + column.clip(0, self.shape[1] - 1)

    def least_around(self, values: np.ndarray) -> np.ndarray:
        """The least of values [K] in each place's bin and those around."""
        least = np.full(self.shape[0] * self.shape[1], np.inf)
        np.minimum.at(least, self.flat, values)
        return ndimage.minimum_filter(least.reshape(self.shape), 3).ravel()[self.flat]

    def blurred(self, values: np.ndarray, sigma: float) -> np.ndarray:
        """Means of values [K, C] over a Gaussian of `sigma` pixels around each place."""

        def spread(weights):
            sums = np.bincount(self.flat, weights, self.shape[0] * self.shape[1])
            return ndimage.gaussian_filter(sums.reshape(self.shape), sigma / self.edge)

        count = np.maximum(spread(None), 1e-6)
        at = self.at.T[::-1] - 0.5
        means = [_looked_up(spread(channel) / count, at) for channel in values.T]
        return np.stack(means, axis=1)


def _sampled(view: View, places: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Colours [K, 3] of a photo at places [K, 2], pixels; which [K] show the object alone, unclipped."""
    colours, alpha = view.pixels[..., :3], view.pixels[..., 3]
    if spacing > 1.5:
        sigma = 0.4 * spacing
        cover = np.maximum(ndimage.gaussian_filter(alpha, sigma), 1e-6)
        colours = ndimage.gaussian_filter(colours, (sigma, sigma, 0)) / cover[..., None]
    bad = ndimage.minimum_filter(alpha, 5) < LEAST_ALPHA
    if not view.is_hdr:
        bad |= ndimage.maximum_filter(view.pixels[..., :3].max(-1), 3) > SATURATED
    at = places.T[::-1] - 0.5
    values = np.stack([_looked_up(colours[..., c], at) for c in range(3)], axis=1) / view.gain
    row, column = (n.clip(0, most - 1) for n, most in zip((at + 0.5).astype(int), bad.shape, strict=True))
    return values, ~bad[row, column]


def _looked_up(picture: np.ndarray, at: np.ndarray) -> np.ndarray:
    """A picture [H, W] at rows and columns [2, K], bilinearly."""
    return ndimage.map_coordinates(picture, at, order=1, mode="nearest")


def _share_of_signal(surface: Surface, mean: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """How much [T, 1] of the detail is no noise, in the mean of cells of a few voxels."""
    cell = np.floor(surface.points / (POOL_VOXELS * surface.voxel)).astype(np.int64)
    cell = np.ravel_multi_index((cell - cell.min(0)).T, np.ptp(cell, axis=0) + 1)
    _, cell = np.unique(cell, return_inverse=True)
    power = np.bincount(cell, (mean**2).sum(1))
    lost = np.bincount(cell, noise.sum(1))
    return np.clip(1 - lost / np.maximum(power, 1e-20), 0, 1)[cell][:, None]
