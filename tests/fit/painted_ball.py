"""Photos of a painted ball with soft edges, by its formula; and cameras that are off."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.frames import rigid
from solver.capture.photos import Photo
from tests.cameras.box_scene import look_at

RADIUS, SIZE, FOCAL, AWAY = 0.6, 96, 190.0, 3.5
FINER = 4
"""places per pixel, along its edges"""


def camera_at(eye, name="r_0", lens="pinhole", distortion=(), size=SIZE):
    """A camera that looks at the ball's place."""
    focal = FOCAL * size / SIZE
    matrix = look_at(np.asarray(eye, dtype=np.float64), np.zeros(3))
    return Camera(
        name, None, matrix, size, size, focal, focal, size / 2, size / 2, lens=lens, distortion=distortion
    )


def painted(points):
    """Linear colours [N, 3] of the ball's points [N, 3]."""
    waves = np.sin(points @ np.array([[9.0, 2, 4], [-3, 8, 5], [2, -5, 9]]).T)
    return 0.35 + 0.25 * waves


def picture_of(camera):
    """Linear premultiplied RGBA [H, W, 4], and distances [H, W] times alpha."""
    ticks = (np.arange(FINER * camera.width) + 0.5) / FINER
    column, row = np.meshgrid(ticks, ticks)
    origins, directions = camera.rays(column.ravel(), row.ravel())
    along = -(origins * directions).sum(1)
    beside = (origins**2).sum(1) - along**2
    hit = beside < RADIUS**2
    distance = np.where(hit, along - np.sqrt(np.maximum(RADIUS**2 - beside, 0)), 0)
    colour = np.where(hit[:, None], painted(origins + distance[:, None] * directions), 0)
    values = np.concatenate([colour, hit[:, None], distance[:, None]], axis=1)
    pixels = values.reshape(camera.height, FINER, camera.width, FINER, 5).mean((1, 3))
    return pixels[..., :4].astype(np.float32), pixels[..., 4]


def shaken(camera, rng, degrees):
    """The camera, turned by about so many degrees and shifted as far as that shows."""
    turn = Rotation.from_rotvec(np.radians(rng.normal(0, degrees / 3**0.5, 3))).as_matrix()
    shift = AWAY * np.radians(rng.normal(0, degrees / 3**0.5, 3))
    return replace(camera, camera_to_world=camera.camera_to_world @ rigid(turn, shift))


def painted_ball(views=16, degrees=0.0, seed=0):
    """A capture of the ball whose cameras are off by about so many degrees, and its photos."""
    golden = np.pi * (3 - 5**0.5)
    heights = np.linspace(-0.5, 0.8, views)
    eyes = [
        AWAY * np.array([*(1 - z * z) ** 0.5 * np.array([np.cos(golden * i), np.sin(golden * i)]), z])
        for i, z in enumerate(heights)
    ]
    true = [camera_at(eye, f"r_{i}") for i, eye in enumerate(eyes)]
    photos = [Photo(picture_of(camera)[0], True, False) for camera in true]
    rng = np.random.default_rng(seed)
    cameras = [shaken(camera, rng, degrees) for camera in true]
    return Capture("memory", tuple(cameras), np.array([[-1.0] * 3, [1.0] * 3])), photos


def disagreement(cameras):
    """Pixels, root mean square, by which cameras see the ball's middle, which is in the middle of each photo,
    beside the place on which they agree best; but for what all have in common."""
    rays = [camera.rays(*np.full((2, 1), camera.width / 2)) for camera in cameras]
    across = [np.eye(3) - np.outer(d[0], d[0]) for _, d in rays]
    place = np.linalg.solve(sum(across), sum(a @ o[0] for a, (o, _) in zip(across, rays, strict=True)))
    seen = np.concatenate([camera.project(place[None])[0] for camera in cameras])
    return float(np.sqrt(((seen - seen.mean(0)) ** 2).sum(1).mean()))
