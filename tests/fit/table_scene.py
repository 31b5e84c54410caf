"""Photos of things on a table in a room, traced here, with sparse points and the true masks."""

import numpy as np

from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.photos import Photo, srgb_to_linear
from tests.capture.poses import look_at

WIDTH, HEIGHT, VIEWS, FINE, FOCAL = 100, 76, 26, 2, 105.0
REGION = np.array([[-0.8, -0.8, -0.3], [0.8, 0.8, 1.3]])
CENTRE, RADIUS = np.array([0.05, -0.05, 0.3]), 0.3
LAMP = np.array([0.5, -0.3, 0.81]) / np.linalg.norm([0.5, -0.3, 0.81])


def ball(points):
    """Signed distance [N] of points [N, 3] to a ball on the table."""
    return np.linalg.norm(points - CENTRE, axis=1) - RADIUS


def ring(points):
    """The same to a ring that stands upright, through which the table is seen."""
    x, y, z = (points - [0, 0, 0.4]).T
    return np.hypot(np.hypot(y, z) - 0.29, x) - 0.1


def nothing(points):
    """The same to nothing at all."""
    return np.full(len(points), 10.0)


def red(points, normals, directions):
    """sRGB [N, 3] of red glaze: shaded, with a highlight."""
    half = LAMP - directions
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shade = 0.35 + 0.6 * np.maximum(normals @ LAMP, 0)[:, None]
    highlight = np.maximum((normals * half).sum(1), 0)[:, None] ** 120
    return shade * np.array([0.8, 0.12, 0.1]) + highlight


def gold(points, normals, directions):
    """sRGB [N, 3] of a mirror of gold: the room and the table once more."""
    mirrored = directions - 2 * (directions * normals).sum(1, keepdims=True) * normals
    return 0.1 + 0.8 * _around(points, mirrored) * np.array([1.0, 0.8, 0.45])


def table_scene(thing=ball, paint=red, views=VIEWS, turn=0.0):
    """A capture, its photos, and where these show the thing, [H, W] bool.

    Args:
        turn: rad by which the ring of cameras is turned.
    """
    rng = np.random.default_rng(0)
    table = np.concatenate([rng.uniform(-0.9, 0.9, (500, 2)), rng.normal(0, 0.002, (500, 1))], 1)
    walls = rng.uniform(-3, 3, (300, 3)) * [1, 1, 0.3] + [0, 0, 1]
    walls[:, 0] = np.where(walls[:, 0] < 0, -3, 3)
    cameras, photos, shown = [], [], []
    for i in range(views):
        angle = 2 * np.pi * i / views + turn
        position = 1.9 * np.array([np.cos(angle), np.sin(angle), 0.5 + 0.25 * np.sin(2.3 * i)])
        pose = look_at(position, target=(0, 0, 0.25))
        size = WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2
        camera = Camera(f"v{i:02d}", None, pose, *size)
        row, column = (np.mgrid[: HEIGHT * FINE, : WIDTH * FINE] + 0.5).reshape(2, -1) / FINE
        origins, directions = camera.rays(column, row)
        distance = _distance(thing, origins, directions)
        hit = np.isfinite(distance)
        colour = _around(origins, directions)
        points = origins[hit] + distance[hit, None] * directions[hit]
        colour[hit] = paint(points, _normals(thing, points), directions[hit])

        def means(values):
            return values.reshape(HEIGHT, FINE, WIDTH, FINE, -1).mean((1, 3))

        codes = np.round(means(colour).clip(0, 1) * 255) / 255
        pixels = np.concatenate([srgb_to_linear(codes), np.ones((HEIGHT, WIDTH, 1))], -1)
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), False, False))
        shown.append(means(hit.astype(float))[..., 0] > 0.5)
    points, up = np.concatenate([table, walls]), np.array([0.0, 0.0, 1.0])
    return Capture("memory", tuple(cameras), REGION, points=points, up=up), photos, shown


def _distance(thing, origins, directions):
    """[N] along each ray to the thing, by sphere tracing; infinity beside it."""
    distance = np.full(len(origins), 0.8)
    for _ in range(40):
        distance += thing(origins + distance[:, None] * directions)
    near = np.abs(thing(origins + distance[:, None] * directions)) < 2e-3
    return np.where(near & (distance < 4), distance, np.inf)


def _normals(thing, points):
    steps = 1e-4 * np.eye(3)
    normals = np.stack([thing(points + s) - thing(points - s) for s in steps], 1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _around(origins, directions):
    """sRGB [N, 3] along rays: a table with grain and some gloss, a room of another pattern."""
    with np.errstate(divide="ignore"):
        to_table = -origins[:, 2] / directions[:, 2]
        to_walls = np.where(directions[:, :2] > 0, 3 - origins[:, :2], -3 - origins[:, :2])
        to_walls = (to_walls / directions[:, :2]).min(1)
    at = origins + to_table[:, None] * directions
    on_table = (to_table > 1e-6) & (np.abs(at[:, :2]) < 1.1).all(1)
    at = np.where(on_table[:, None], at, origins + to_walls[:, None] * directions)
    x, y, z = at.T
    grain = np.sin(17 * x + 4 * np.sin(5 * y)) + np.sin(31 * y - 9 * x) + np.sin(53 * (x + y))
    wood = np.stack([0.5 + 0.06 * grain, 0.36 + 0.05 * grain, 0.22 + 0.03 * grain], -1)
    mirrored = directions * [1, 1, -1]
    gloss = 0.12 * np.maximum(mirrored @ LAMP, 0) ** 6
    pattern = np.sin(4 * x + 2 * z) + np.sin(5 * y - 3 * z)
    room = np.stack([0.5 + 0.1 * pattern, 0.55 - 0.05 * pattern, 0.6 + 0.08 * pattern], -1)
    return np.where(on_table[:, None], wood + gloss[:, None], room)
