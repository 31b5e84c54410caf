"""A fitted scene as the asset sees it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from solver.asset.errors import EmptySurfaceError
from solver.asset.from_scene import SceneSurface, has_finer_photos, surface_level
from solver.asset.settings import AssetSettings
from solver.asset.surface import marching_cubes
from solver.capture.camera import Camera
from solver.light.environment import EnvironmentMap
from solver.render.image import ray_peaks
from solver.render.scene import RenderSettings
from tests.capture.test_capture import pose
from tests.render.scenes import ball, fill_everywhere, refresh


def cameras():
    return [Camera(f"c{i}", None, pose(i), 64, 64, 110.0, 110.0, 32.0, 32.0) for i in range(6)]


def test_density_that_no_ray_ever_meets_does_not_reach_the_mesh():
    """A fixed bug: what the masks exclude is never seen, so nothing keeps the fit from filling it."""
    scene = ball(radius=0.9, sharpness=400.0)
    ticks = (torch.arange(32) + 0.5) / 16 - 1
    grid = torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    scene.occupancy.allow_only(grid.norm(dim=-1) < 0.4, dilation=0)
    mesh = marching_cubes(SceneSurface(scene, cameras()), 48, 20.0)
    assert np.abs(mesh.vertices).max() < 0.55


def test_the_mesh_has_the_silhouette_that_rays_see():
    scene = ball(radius=0.5, sharpness=400.0)
    level = surface_level(scene, RenderSettings(), cameras())
    mesh = marching_cubes(SceneSurface(scene, cameras()), 64, level)
    radius = np.linalg.norm(mesh.vertices, axis=1).mean()
    offsets = torch.linspace(0.3, 0.7, 400)
    origins = torch.stack([offsets, torch.zeros(400), torch.full((400,), 3.0)], -1)
    directions = torch.tensor([0.0, 0.0, -1.0]).expand(400, 3).contiguous()
    opacity, _ = ray_peaks(scene, RenderSettings(), origins, directions)
    seen = offsets[np.flatnonzero(opacity > 0.5)[-1]]
    assert abs(radius - float(seen)) < 0.01


@pytest.mark.parametrize("cells", [23, 30, 60])
def test_every_vertex_of_the_mesh_lies_where_the_field_has_the_level(cells):
    """A fixed bug: logarithms between nodes that were not the field's made thin parts thinner."""
    scene = rod(1.2)
    surface = SceneSurface(scene, cameras())
    mesh = marching_cubes(surface, cells, 20.0)
    # But for its ends, which the box cuts off.
    inside = mesh.vertices[np.abs(mesh.vertices[:, 2]) < 0.99]
    np.testing.assert_allclose(surface.density(inside.astype(np.float32)), 20.0, rtol=2e-3)


@pytest.mark.parametrize("radius", [1.2, 1.6, 2.5])
def test_a_thin_rod_is_as_wide_in_the_mesh_as_where_rays_reach_its_level(radius):
    scene = rod(radius)
    level = surface_level(scene, RenderSettings(), cameras())
    mesh = marching_cubes(SceneSurface(scene, cameras()), 30, level)
    offsets = torch.linspace(-0.5, 0.5, 2001)
    origins = torch.stack([offsets, torch.full((2001,), -3.0), torch.full((2001,), 0.03)], -1)
    directions = torch.tensor([0.0, 1.0, 0.0]).expand(2001, 3).contiguous()
    _, peak = ray_peaks(scene, RenderSettings(), origins, directions)
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx((peak > level).mean(), rel=0.02)


def rod(radius):
    """An upright rod in the box's middle, its radius in voxels."""
    scene = ball()
    field = scene.field
    x = torch.linspace(-1, 1, field.size) / field.voxel
    with torch.no_grad():
        field.density_planes.zero_()
        field.density_planes[0, :, :, 0] = 12 * (radius - torch.hypot(x[:, None], x[None, :]))
    refresh(scene)
    return scene


def test_a_fog_without_any_surface_is_an_error_with_a_way_out():
    """Every ray is more than half opaque, none is nearly so: there is nothing to be a mesh."""
    scene = ball(radius=0.5, sharpness=0.0)
    with torch.no_grad():
        scene.field.density_planes[0] = 0.55
    fill_everywhere(scene)
    narrow = [replace(camera, fx=800.0, fy=800.0) for camera in cameras()]
    with pytest.raises(EmptySurfaceError, match="start anew with a longer time limit"):
        surface_level(scene, RenderSettings(), narrow)


def test_a_surface_is_seen_where_cameras_look_at_it_and_nothing_is_before_it():
    scene, camera = ball(radius=0.5, sharpness=400.0), cameras()[0]
    surface = SceneSurface(scene, [camera] * 3)
    towards = camera.position / np.linalg.norm(camera.position)
    aside = np.cross(towards, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    facing, behind, half = towards, -towards, 0.5 * towards + 0.75**0.5 * aside
    normals = np.stack([facing, behind, half, facing])
    points = 0.5 * np.stack([facing, behind, half, -0.4 * facing])  # the last is within the ball
    np.testing.assert_array_equal(surface.seen(points, normals), [True, False, True, False])
    # The grid's cells are coarse: a surface does not hide itself, though its cell may reach beyond it.
    assert surface.seen(0.33 * facing[None], facing[None])
    narrow = replace(camera, fx=640.0, fy=640.0)  # its photo ends 0.2 units from the axis
    np.testing.assert_array_equal(
        SceneSurface(scene, [narrow] * 3).seen(points, normals), [True, False, False, False]
    )


def test_what_fewer_than_three_photos_show_is_not_seen():
    scene = ball(radius=0.5, sharpness=400.0)
    normal = cameras()[1].position[None] / np.linalg.norm(cameras()[1].position)
    for count, seen in ((2, False), (3, True)):
        surface = SceneSurface(scene, cameras()[:count])
        assert surface.seen(0.5 * normal, normal) == seen


def test_the_diffuse_response_is_the_irradiance_that_no_fresnel_has_sent_back():
    scene = ball(environment=EnvironmentMap(16, 2.0))
    points = np.array([[0.5, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.5]])
    f0 = np.array([[0.04] * 3, [0.5] * 3, [1.0] * 3])
    response = SceneSurface(scene, cameras()).diffuse_response(points, 2 * points, f0)
    # An even light of 2 is an irradiance of 2 π; near the normal, little but F0 is sent back.
    np.testing.assert_allclose(response, 2 * (1 - f0), rtol=0.02, atol=1e-6)


def test_photos_are_finer_than_a_field_by_the_size_it_has_or_will_have():
    scene, some = ball(), cameras()
    assert has_finer_photos(scene, some, AssetSettings())
    assert not has_finer_photos(scene, some, AssetSettings(photo_detail=False))
    assert not has_finer_photos(scene, some, AssetSettings(), size=256)
    assert not has_finer_photos(scene, [], AssetSettings())
