"""What a picture must not depend on: batching, the world's orientation, other parts far away."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.kernels.backend import forced_path
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render.composition import Composition, Placement
from solver.render.image import image_settings, render_view
from solver.render.probing import refresh_probes
from solver.render.scan_line import scan_line_weights
from solver.render.scene import RenderSettings, StepTables
from tests.render.scenes import ball, fill_everywhere, refresh

SETTINGS = image_settings(RenderSettings(step=0.5), secondary_rays=32)
TURN = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # a quarter about +Z


def camera(size=20, position=(3.0, 0.4, 0.8), turn=None):
    back = np.array(position) / np.linalg.norm(position)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], 1)
    if turn is not None:
        pose[:3] = turn @ pose[:3]
    return Camera("c", None, pose, size, size, 2.0 * size, 2.0 * size, size / 2, size / 2)


def light_of(function, height=64):
    """A light with radiance `function` [..., 3] of world directions."""
    return EnvironmentMap.from_radiance(function(equirect_directions(height, 2 * height).float()))


def sky(directions):
    x, y, z = directions.unbind(-1)
    return torch.stack([1 + 0.8 * x, 1 + 0.6 * y * x, 1 + 0.7 * z], -1)


def lumpy(environment=None, axes=None):
    """A ball with a bump and materials that vary, so that nothing is symmetric."""
    scene = ball(
        environment=environment or light_of(sky), roughness=0.3, f0=0.3, sharpness=800.0, axes=axes
    )
    generator = torch.Generator().manual_seed(4)
    with torch.no_grad():
        size = scene.field.size
        x = torch.linspace(-1, 1, size)
        bump = torch.exp(-8 * ((x[:, None] - 0.4) ** 2 + (x[None, :] - 0.2) ** 2))
        scene.field.density_planes[0, :, :, 0] += 12 * bump
        for layer in (scene.field.heads.albedo, scene.field.heads.f0):
            layer.weight.copy_(8 * torch.randn(layer.weight.shape, generator=generator))
    refresh(scene)
    return scene


def picture(scene, camera, settings=SETTINGS, **more):
    return render_view(scene, StepTables.of(scene), settings, camera, **more)


@pytest.mark.parametrize("neural", [0.0, 1.0])
@pytest.mark.parametrize("changes", [{}, {"visibility": False, "retrace_choice": "noisy"}])
def test_a_picture_does_not_depend_on_how_its_pixels_are_batched(neural, changes):
    scene = lumpy()
    settings = dataclasses.replace(SETTINGS, neural=neural, **changes)
    whole = picture(scene, camera(), settings)
    pieces = picture(scene, camera(), settings, rays_per_chunk=37)
    for name in ("radiance", "opacity", "normal", "albedo", "alpha", "f0"):
        np.testing.assert_allclose(getattr(whole, name), getattr(pieces, name), atol=2e-4, err_msg=name)


def quarter_turned(scene):
    """The same scene turned by a quarter about +Z: (x, y) → (−y, x)."""
    other = lumpy(light_of(lambda d: sky(d @ TURN)))
    with torch.no_grad():
        for name in ("density", "feature"):
            planes, lines = (
                getattr(other.field, f"{name}_planes"),
                getattr(other.field, f"{name}_lines"),
            )
            old_planes = getattr(scene.field, f"{name}_planes")
            old_lines = getattr(scene.field, f"{name}_lines")
            # New value at (x', y', z) is the old one at (y', −x', z); planes xy, xz, yz, lines z, y, x.
            planes[0] = old_planes[0].transpose(0, 1).flip(0)
            lines[0] = old_lines[0]
            planes[1], lines[1] = old_planes[2].flip(0), old_lines[2]
            planes[2], lines[2] = old_planes[1], old_lines[1].flip(0)
        if scene.field.basis.in_features:
            width = scene.field.feature_planes.shape[-1]
            a, b, c = scene.field.basis.weight.split(width, dim=1)
            other.field.basis.weight.copy_(torch.cat([a, c, b], dim=1))
        other.field.heads.load_state_dict(scene.field.heads.state_dict())
        other.neural.load_state_dict(scene.neural.state_dict())
    refresh(other)
    return other


def test_turning_the_whole_world_turns_the_picture_with_it():
    """Cameras, field and light together; random numbers differ only through tangent frames."""
    scene = lumpy()
    turned = quarter_turned(scene)
    settings = dataclasses.replace(SETTINGS, secondary_rays=256)
    here = picture(scene, camera(), settings)
    there = picture(turned, camera(turn=TURN.numpy()), settings)
    np.testing.assert_allclose(here.opacity, there.opacity, atol=2e-3)
    np.testing.assert_allclose(here.albedo, there.albedo, atol=5e-3)
    np.testing.assert_allclose(here.normal @ TURN.numpy().T, there.normal, atol=2e-2)
    error = here.radiance - there.radiance
    assert np.sqrt((error**2).mean()) < 0.01
    assert abs(error.mean()) < 2e-3


def test_tilting_the_world_tilts_the_picture_with_it():
    """A turn about +X moves the light's poles; an even ball needs no turned field."""
    tilt = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

    def even(light):
        return ball(environment=light_of(light), sharpness=2000.0, f0=0.4, roughness=0.4)

    here = picture(even(sky), camera())
    there = picture(even(lambda d: sky(d @ tilt)), camera(turn=tilt.numpy()))
    error = here.radiance - there.radiance
    assert np.sqrt((error**2).mean()) < 0.02 and abs(error.mean()) < 3e-3


@pytest.mark.parametrize("path", ["numba", "torch"])
@pytest.mark.parametrize("changes", [{}, {"visibility": False}, {"neural": 1.0}])
def test_what_is_in_a_turned_box_is_turned_with_it(path, changes):
    """Box, cameras and light together; random numbers differ only through tangent frames."""
    axes = Rotation.from_rotvec([0.5, -0.7, 1.1]).as_matrix()  # in the world; so the turn's inverse
    light = light_of(lambda d: sky(d @ torch.tensor(axes).T.float()))
    settings = dataclasses.replace(SETTINGS, secondary_rays=256, diffuse_visibility=True, **changes)
    pictures = []
    with forced_path(path):
        for scene, seen in ((lumpy(), camera()), (lumpy(light, torch.tensor(axes)), camera(turn=axes.T))):
            refresh_probes(scene)
            pictures.append(picture(scene, seen, settings))
    here, there = pictures
    np.testing.assert_allclose(here.opacity, there.opacity, atol=1e-4)
    np.testing.assert_allclose(here.albedo, there.albedo, atol=1e-4)
    np.testing.assert_allclose(here.normal @ axes, there.normal, atol=1e-4)
    error = here.radiance - there.radiance
    assert np.sqrt((error**2).mean()) < 0.01 and abs(error.mean()) < 2e-3
    unturned = picture(lumpy(), camera(turn=axes.T), settings)
    assert np.sqrt(((here.radiance - unturned.radiance) ** 2).mean()) > 0.05


def test_a_part_in_a_turned_box_is_that_part():
    axes = Rotation.from_rotvec([0.5, -0.7, 1.1]).as_matrix()
    scene = lumpy(axes=torch.tensor(axes))
    alone = picture(scene, camera())
    composed = picture(Composition([scene], [Placement()], scene.environment), camera())
    np.testing.assert_allclose(composed.radiance, alone.radiance, atol=1e-3)
    np.testing.assert_allclose(composed.normal, alone.normal, atol=1e-3)


def test_a_composition_of_one_scene_is_that_scene():
    scene = lumpy()
    alone = picture(scene, camera())
    composed = picture(Composition([scene], [Placement()], scene.environment), camera())
    np.testing.assert_allclose(composed.radiance, alone.radiance, atol=1e-3)
    np.testing.assert_allclose(composed.opacity, alone.opacity, atol=1e-4)


def test_a_placed_scene_looks_as_from_the_camera_placed_the_other_way():
    scene = ball(environment=light_of(lambda d: torch.ones_like(d)), f0=0.2)
    placement = Placement((0.5, -0.2, 0.3), 1.5, math.pi / 2)
    composed = picture(Composition([scene], [placement], scene.environment), camera())
    pose = camera().camera_to_world.copy()
    turn = placement.rotation("cpu").numpy().astype(np.float64)
    pose[:3, 3] = turn.T @ (pose[:3, 3] - placement.position) / placement.scale
    pose[:3, :3] = turn.T @ pose[:3, :3]
    alone = picture(scene, dataclasses.replace(camera(), camera_to_world=pose))
    np.testing.assert_allclose(composed.opacity, alone.opacity, atol=5e-3)
    assert np.abs(composed.radiance - alone.radiance).mean() < 5e-3


def test_distances_of_a_placed_scene_are_those_of_the_world():
    """A part twice as large, turned and moved: what it says of world rays is what it says of its own."""
    scene = lumpy()
    placement = Placement((0.5, -0.2, 0.3), 2.0, math.pi / 2)
    world = Composition([scene], [placement], scene.environment)
    torch.manual_seed(0)
    origins = 0.4 * torch.nn.functional.normalize(torch.randn(50, 3), dim=-1)
    directions = torch.nn.functional.normalize(torch.randn(50, 3), dim=-1)
    start = 0.3 * torch.rand(50)
    turn = placement.rotation("cpu").T
    placed = 2.0 * origins @ turn + torch.tensor(placement.position)
    turned = directions @ turn

    passing = scene.grid_transmittance(origins, directions, start)
    assert 0.2 < float((passing < 0.5).float().mean()) < 0.95
    agreeing = world.grid_transmittance(placed, turned, 2 * start) - passing
    assert float((agreeing.abs() < 1e-3).float().mean()) > 0.95

    offset = torch.full((50,), 0.5)
    own = scene.sample(origins, directions, start, offset, 0.5, 1e-3)
    found = world.sample(placed, turned, 2 * start, offset, 0.5, 1e-3)
    first, there = own.offsets[:-1], own.offsets.diff().gt(0) & found.offsets.diff().gt(0)
    assert there.sum() > 20
    torch.testing.assert_close(
        found.distance[found.offsets[:-1][there]], 2 * own.distance[first[there]], atol=0.05, rtol=0
    )

    share, distance = scene.look_around(origins, directions)
    seen, where = world.look_around(placed, turned)
    both = distance.isfinite() & where.isfinite()
    assert float((distance.isfinite() == where.isfinite()).float().mean()) > 0.98 and both.any()
    assert float((where[both] - 2 * distance[both]).abs().median()) < 1e-3
    assert float((seen - share).abs().mean()) < 0.01


def test_parts_that_interpenetrate_add_their_densities():
    scene = ball(sharpness=20.0)
    double = ball(sharpness=20.0)
    double.field.density_scale *= 2
    for each in (scene, double):
        fill_everywhere(each)
    composed = Composition([scene, scene], [Placement()] * 2, scene.environment)
    settings = dataclasses.replace(SETTINGS, step=0.1)
    np.testing.assert_allclose(
        picture(composed, camera(), settings).opacity, picture(double, camera(), settings).opacity,
        atol=0.02,
    )  # fmt: skip


def test_parts_are_seen_in_each_others_reflections():
    mirror = ball(albedo=1e-6, f0=1 - 1e-6, roughness=0.1, sharpness=2000.0, radius=0.45)
    black = ball(albedo=1e-6, f0=1e-6, sharpness=2000.0, radius=0.45)
    view = camera(30, (3.0, 0.0, 0.0))
    alone = picture(mirror, view).radiance
    both = picture(
        Composition([mirror, black], [Placement(), Placement((0.0, 1.0, 0.0))], mirror.environment),
        view,
    ).radiance
    # Seen from +X, +Y is on the right: near that rim the mirror shows the black ball.
    left, right = (slice(13, 17), slice(8, 10)), (slice(13, 17), slice(21, 23))
    assert both[right].mean() < 0.75 * alone[right].mean()
    np.testing.assert_allclose(both[left].mean(), alone[left].mean(), atol=0.03)


def test_scan_line_weights_sum_to_the_opacity():
    scene = lumpy()
    view = picture(scene, camera())
    weights = scan_line_weights(scene, SETTINGS, camera(), 10)
    np.testing.assert_allclose(weights.sum(0), view.opacity[10], atol=2e-3)
    assert weights.min() >= 0


def test_a_scan_line_has_what_is_near_at_the_bottom():
    """The box reaches from the near end of its diagonal to the far one; the ball's front is before its middle."""
    view = camera(size=20, position=(3.0, 0.0, 0.001))
    weights = scan_line_weights(ball(sharpness=2000.0), SETTINGS, view, 10, bins=200)[:, 10]
    row = (weights * (np.arange(200) + 0.5)).sum() / weights.sum()
    before_middle = 0.5 / (2 * 3**0.5)
    np.testing.assert_allclose(row / 200, 0.5 + before_middle, atol=0.03)
