"""Photos of a ball before surroundings: so far away that they have no parallax, or on a wall close by."""

import numpy as np

from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.photos import Photo, srgb_to_linear

SIZE, RADIUS, FINE, DISTANCE = 48, 0.55, 3, 4.0
WALL = 6.0
REGION = np.array([[-1.0] * 3, [1.0] * 3])


def far_colour(directions):
    """sRGB [N, 3] of what is in directions [N, 3]: bands that differ everywhere."""
    x, y, z = directions.T
    bands = np.stack([np.sin(7 * x + 3 * z), np.sin(9 * y - 2 * x), np.sin(8 * z + 4 * y)], -1)
    return 0.5 + 0.35 * bands


def far_scene(views=40, wall=None, turn=0.0, paint=None, size=SIZE):
    """A capture, its photos, and the coverages [H, W] of the ball.

    Args:
        wall: radius of a sphere that bears the bands; None: they are infinitely far away.
        turn: rad by which the ring of cameras is turned. paint: sRGB [N, 3] of points [N, 3] on the ball.
    """
    cameras, photos, coverages = [], [], []
    for i in range(views):
        # Even over all sides: Fibonacci's spiral.
        z = 1 - (2 * i + 1) / views
        angle = i * np.pi * (3 - 5**0.5) + turn
        back = np.array([np.cos(angle) * (1 - z * z) ** 0.5, np.sin(angle) * (1 - z * z) ** 0.5, z])
        right = np.cross((0, 0, 1), back)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3] = np.stack([right, np.cross(back, right), back, back * DISTANCE], 1)
        focal = 1.3 * size
        camera = Camera(f"c{i}", None, matrix, size, size, focal, focal, size / 2, size / 2)
        row, column = (np.mgrid[0 : size * FINE, 0 : size * FINE] + 0.5) / FINE
        origins, directions = camera.rays(column.ravel(), row.ravel())
        along, square = _chord(origins, directions, RADIUS)
        points = origins + (along - np.sqrt(np.maximum(square, 0)))[:, None] * directions
        behind = directions
        if wall is not None:
            along, beyond = _chord(origins, directions, wall)
            behind = (origins + (along + np.sqrt(beyond))[:, None] * directions) / wall
        hit = square > 0
        ball = (0.2 + 0.3 * np.abs(points)) if paint is None else paint(points)
        colour = np.where(hit[:, None], ball, far_colour(behind))

        def means(values, size=size):
            return values.reshape(size, FINE, size, FINE, -1).mean((1, 3))

        codes = np.round(means(colour) * 255) / 255
        pixels = np.concatenate([srgb_to_linear(codes), np.ones((size, size, 1))], -1)
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), False, False))
        coverages.append(means(hit.astype(float))[..., 0])
    return Capture("memory", tuple(cameras), REGION), photos, coverages


def _chord(origins, directions, radius):
    """Distance [N] to where rays come closest to the origin, and the squared half chord in a sphere."""
    along = -(origins * directions).sum(1)
    return along, radius**2 - (origins**2).sum(1) + along**2
