"""Hollow and solid shapes with patterns, glosses and mirrors, and photos of them with alpha."""

from functools import cache

import numpy as np

from solver.capture.camera import Camera
from solver.capture.photos import Photo, srgb_to_linear
from solver.fit.seen_space import cell_centres
from solver.fit.visual_hull import carve
from tests.cameras.box_scene import look_at

CELLS, SIZE, VIEWS = 64, 96, 40
BOX = np.array([[-1.0] * 3, [1.0] * 3])


def cup(points):
    """A pot with a wall as thick as two cells."""
    radius, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    return (radius < 0.7) & (np.abs(z) < 0.5) & ((radius > 0.62) | (z < -0.4))


def block(points):
    return (np.abs(points) < [0.6, 0.5, 0.4]).all(-1)


def ball(points):
    return np.linalg.norm(points, axis=-1) < 0.7


def painted(points, directions):
    """sRGB of a dull surface with a pattern."""
    return 0.5 + 0.4 * np.sin(9 * points + [0, 1, 2])


def mirrored(points, directions):
    """sRGB of what only depends on where one looks from, as in a mirror before a busy room."""
    return 0.5 + 0.4 * np.sin(14 * directions + [0, 1, 2])


def mirroring(points, directions):
    """sRGB of a block of mirrors on a painted floor, under a plain sky."""
    side = np.abs(points / [0.6, 0.5, 0.4]).argmax(-1)
    reflected = np.where(np.arange(3) == side[:, None], -directions, directions)
    down = reflected[:, 2] < -0.05
    far = np.where(down, (-0.4 - points[:, 2]) / np.where(down, reflected[:, 2], 1.0), 0.0)
    floor = painted(points + far[:, None] * reflected, reflected)
    return np.where((down & (far < 1.5))[:, None], floor, [0.5, 0.6, 0.7])


def mirror_door(points, directions):
    """sRGB of a painted block, one side of which is a mirror."""
    door = points[:, :1] > 0.58
    return np.where(door, mirroring(points, directions), painted(points, directions))


def stump(points):
    """A ball cut off flat."""
    return ball(points) & (points[:, 2] < 0.3)


def flat_gloss(points, directions):
    """sRGB of something dull whose flat top is a soft mirror."""
    top = 0.5 + 0.4 * np.sin(4 * directions * [1, 1, -1] + [0, 1, 2])
    return np.where(points[:, 2:] > 0.25, top, [0.6, 0.2, 0.15])


@cache
def photographed(shape, colour):
    """Cameras over and around a shape, photos of it with alpha, and its hull."""
    steps = np.arange(0, 2.4, 1 / CELLS)
    cameras, photos = [], []
    for i in range(VIEWS):
        z, turn = 0.05 + 0.9 * i / VIEWS, 2.4 * i
        place = 3 * np.array([np.cos(turn) * (1 - z * z) ** 0.5, np.sin(turn) * (1 - z * z) ** 0.5, z])
        matrix = look_at(place, np.zeros(3))
        camera = Camera(f"r_{i}", None, matrix, SIZE, SIZE, 115.0, 115.0, SIZE / 2, SIZE / 2)
        row, column = np.mgrid[0:SIZE, 0:SIZE] + 0.5
        origins, directions = camera.rays(column.ravel(), row.ravel())
        points = origins[:, None] + (1.8 + steps)[:, None] * directions[:, None]
        solid = shape(points.reshape(-1, 3)).reshape(points.shape[:2])
        hit = points[np.arange(len(points)), solid.argmax(1)]
        alpha = solid.any(1)[:, None].astype(np.float32)
        linear = srgb_to_linear(colour(hit, directions)) * alpha
        pixels = np.concatenate([linear, alpha], 1).reshape(SIZE, SIZE, 4)
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), True, False))
    hull = carve(cameras, [photo.pixels[..., 3] > 0.5 for photo in photos], BOX, CELLS)
    return cameras, photos, hull


def shares(shape, hull, kept):
    """Of what the hull has too much, how much is left; of the shape within it, how much."""
    true = shape(cell_centres(BOX, CELLS)).reshape(hull.shape)
    return (kept & ~true).sum() / (hull & ~true).sum(), (kept & true).sum() / (hull & true).sum()
