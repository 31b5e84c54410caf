"""The room before and behind the box, along rays."""

import numpy as np
import pytest
import torch

from solver.field.room import Room, contract
from solver.fit.losses import SATURATED, room_light
from solver.light.environment import EnvironmentMap
from solver.render.image import image_settings, render_view
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, StepTables
from solver.render.surroundings import light_of_room, surroundings
from tests.fit.test_fit import ball_capture
from tests.render.scenes import ball

HALF = 1.0


def room(size=16, nearest=0.2, density=1.0, allowed=None):
    torch.manual_seed(5)
    allowed = torch.ones(8, 8, 8, dtype=torch.bool) if allowed is None else allowed
    made = Room(torch.zeros(3), HALF, size, allowed, nearest, extinction=density, shift=0.0)
    with torch.no_grad():
        made.planes.mul_(5)
        made.colour_planes.mul_(5)
    return made


def scene_in(room, environment=None):
    scene = ball(0.5, environment=environment)
    scene.room = room
    return scene


def rays(count=200, seed=0):
    generator = torch.Generator().manual_seed(seed)
    origins = 3 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    target = 1.5 * (torch.rand(count, 3, generator=generator) - 0.5) * 2
    return origins, torch.nn.functional.normalize(target - origins, dim=-1)


def look(scene, origins, directions):
    width = torch.full((len(origins),), 0.01)
    return surroundings(scene, StepTables.of(scene), origins, directions, width)


def slowly(room, origin, direction, light, steps=6000):
    """Before, passing, behind of one ray by many short steps in plain Python order."""
    # Steps grow with the distance: what is far counts little in contracted space.
    distances = room.nearest + (np.geomspace(0.05, 2000, steps) - 0.05)
    edges = torch.from_numpy(distances).float()
    points = origin + edges[:, None] * direction
    middle = 0.5 * (points[1:] + points[:-1])
    inside = (middle.abs() <= HALF).all(-1)
    leaves = inside.nonzero()[-1, 0] if inside.any() else None
    if leaves is None:
        # A ray that misses the box is cut where it comes closest to its centre.
        leaves = (edges[:-1] < -(origin * direction).sum()).nonzero()[-1, 0]
    corners = contract(points)
    length = (corners[1:] - corners[:-1]).norm(dim=-1)
    at = contract(middle)
    depth = room.extinction(at) * length * ~inside
    colour = room.radiance(at)
    sums = {False: torch.zeros(3), True: torch.zeros(3)}
    passing = {False: torch.ones(()), True: torch.ones(())}
    for i in range(steps - 1):
        part = bool(i > leaves)
        alpha = 1 - torch.exp(-depth[i])
        sums[part] = sums[part] + passing[part] * alpha * colour[i]
        passing[part] = passing[part] * (1 - alpha)
    return sums[False], passing[False], sums[True] + passing[True] * light


@pytest.mark.parametrize("density", [0.5, 4.0])
def test_rays_through_the_room_agree_with_many_short_steps(density):
    made = room(size=8, density=density)
    scene = scene_in(made, EnvironmentMap(16, 0.25))
    origins, directions = rays(12)
    with torch.no_grad():
        seen = look(scene, origins, directions)
        for i in range(len(origins)):
            slow = slowly(made, origins[i], directions[i], 0.25)
            for name, value in zip(("before", "passing", "behind"), slow, strict=True):
                torch.testing.assert_close(getattr(seen, name)[i], value, atol=0.02, rtol=0.02)


def test_an_empty_room_shows_the_light_itself():
    empty = room(allowed=torch.zeros(8, 8, 8, dtype=torch.bool))
    torch.manual_seed(0)
    light = EnvironmentMap.from_radiance(torch.rand(16, 32, 3) + 0.1)
    origins, directions = rays()
    with torch.no_grad():
        seen = look(scene_in(empty, light), origins, directions)
        alone = look(scene_in(None, light), origins, directions)
    torch.testing.assert_close(seen.behind, alone.behind)
    torch.testing.assert_close(seen.before, torch.zeros_like(seen.before))
    torch.testing.assert_close(seen.passing, torch.ones_like(seen.passing))
    assert (alone.passing == 1).all()


def test_the_room_has_nothing_in_the_box_and_nothing_right_before_a_camera():
    origins = torch.tensor([[0.0, 0.0, 0.9], [0.0, 0.0, 1.15]])
    directions = torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    with torch.no_grad():
        seen = look(scene_in(room(density=1e4)), origins, directions)
    torch.testing.assert_close(seen.passing, torch.ones(2))
    assert (seen.before == 0).all()


def test_every_ray_ends_in_an_opaque_room_or_in_the_light():
    with torch.no_grad():
        dark = look(scene_in(room(density=200.0), EnvironmentMap(16, 1e6)), *rays())
    assert (dark.behind < 1e3).all()


def test_what_the_room_sends_to_the_centre_is_what_a_ray_from_there_sees():
    made = room(nearest=0.0)
    _, directions = rays(100)
    scene = scene_in(made, EnvironmentMap(16, 1e-6))
    with torch.no_grad():
        seen, opacity = light_of_room(made, directions, torch.full((100,), 0.5))
        same = look(scene, torch.zeros(100, 3), directions)
    torch.testing.assert_close(seen, same.behind, atol=1e-4, rtol=1e-4)
    assert (opacity > 0.1).any() and (opacity <= 1).all()


@pytest.mark.parametrize("name", ["planes", "lines", "colour_planes", "colour_lines"])
def test_gradients_of_the_room_agree_with_finite_differences(name):
    made = room(size=6, density=2.0)
    scene = scene_in(made)
    origins, directions = rays(40)
    parameter = getattr(made, name)

    def total():
        seen = look(scene, origins, directions)
        object_radiance = torch.full((40, 3), 0.2)
        return seen.around(object_radiance, torch.full((40,), 0.4)).double().square().sum()

    total().backward()
    direction = parameter.grad / parameter.grad.abs().max()
    slope = float((parameter.grad * direction).sum())
    step = 1e-2
    with torch.no_grad():
        parameter += step * direction
        above = total()
        parameter -= 2 * step * direction
        below = total()
    assert slope == pytest.approx(float(above - below) / (2 * step), rel=0.03)


def test_a_picture_of_an_object_in_its_room_is_one_of_both():
    made = room(density=3.0)
    scene = scene_in(made, EnvironmentMap(16, 0.5))
    camera = ball_capture(1)[0].cameras[0]
    size = camera.width
    settings = image_settings(RenderSettings(neural=0.0, retraced_rays=0), 8)
    view = render_view(scene, StepTables.of(scene), settings, camera)
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    origins, directions = (torch.from_numpy(v).float() for v in camera.rays(column.ravel(), row.ravel()))
    with torch.no_grad():
        seen = surroundings(
            scene, StepTables.of(scene), origins, directions,
            torch.full((len(origins),), camera.pixel_angle),
        )  # fmt: skip
    inside = view.radiance + (1 - view.opacity[..., None]) * seen.behind.view(size, size, 3).numpy()
    whole = seen.before.view(size, size, 3).numpy() + seen.passing.view(size, size, 1).numpy() * inside
    np.testing.assert_allclose(view.surrounded, whole, atol=1e-5)


def test_the_light_is_pulled_to_the_room_but_may_be_brighter_where_photos_are_white():
    made = room(density=200.0)

    def pull(colour, light):
        with torch.no_grad():
            made.colour_planes.zero_()
            made.basis.bias.fill_(float(np.log(colour)))
        scene = scene_in(made, EnvironmentMap(16, light))
        loss = room_light(scene, StepTables.of(scene), RandomNumbers(0), torch.arange(64))
        loss.backward()
        return float(loss.detach()), float(scene.environment.log_radiance.grad.sum())

    loss, gradient = pull(0.4, 0.4)
    assert loss == pytest.approx(0, abs=1e-3)
    loss, gradient = pull(0.4, 0.1)
    assert loss == pytest.approx(np.log(4) ** 2, rel=0.05) and gradient < 0
    assert pull(0.4, 1.6)[1] > 0
    assert pull(SATURATED + 0.03, 20.0) == (0.0, 0.0)
    assert pull(SATURATED + 0.03, 0.3)[1] < 0
