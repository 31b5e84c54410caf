"""The start from a visual hull: factors of a volume, and the hull they stand for."""

import numpy as np
import pytest
import scipy.ndimage
import torch

from solver.field.field import MicrofacetField
from solver.fit import visual_hull
from solver.fit.visual_hull import (
    carve,
    decompose,
    hull_box,
    signed_distance,
    start_from_hull,
    whole_hull,
)
from solver.kernels.vm import vm_sum
from tests.cameras.box_scene import box_camera, look_at


@pytest.mark.parametrize("whole_cells", [False, True])
def test_a_hull_is_the_same_on_one_thread_and_on_several(whole_cells, monkeypatch):
    eyes = np.array([[4, 0, 0.3], [0.3, 4, 0], [0, 0.3, 4], [3, 3, 1]])
    cameras = [box_camera(look_at(eye, np.zeros(3))) for eye in eyes]
    rows, columns = np.mgrid[:90, :120]
    masks = [(rows - 45) ** 2 + (columns - 55 - i) ** 2 < 400 for i in range(len(cameras))]
    region = np.array([[-1.5] * 3, [1.5] * 3])
    hulls = []
    for threads, each in ((1, 10**9), (4, 1)):
        monkeypatch.setattr(visual_hull, "usable_cores", lambda threads=threads: threads)
        monkeypatch.setattr(visual_hull, "CELLS_A_THREAD", each)
        hulls.append(carve(cameras, masks, region, 20, 0.5, whole_cells))
    assert 0 < hulls[0].sum() < hulls[0].size and np.array_equal(*hulls)


def grid(size, low=-1.0, high=1.0):
    ticks = torch.linspace(low, high, size)
    return torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)


def test_a_volume_that_is_a_sum_of_products_is_decomposed_without_a_rest():
    torch.manual_seed(0)
    planes, lines = torch.randn(3, 9, 9, 2), torch.randn(3, 9, 2)
    nodes = torch.stack(torch.meshgrid(*[torch.arange(9.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    target = vm_sum(nodes, planes, lines).view(9, 9, 9)
    found = decompose(target, 9)
    torch.testing.assert_close(vm_sum(nodes, *found).view(9, 9, 9), target, atol=1e-3, rtol=1e-3)


def test_a_grid_smaller_than_its_components_starts_as_the_volume_and_all_of_them_can_learn():
    torch.manual_seed(0)
    target = torch.randn(6, 6, 6)
    planes, lines = (factor.requires_grad_() for factor in decompose(target, 16))
    nodes = torch.stack(torch.meshgrid(*[torch.arange(6.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    found = vm_sum(nodes, planes, lines)
    torch.testing.assert_close(found.view(6, 6, 6), target, atol=1e-3, rtol=1e-3)
    found.square().sum().backward()
    assert (planes.grad.abs().amax((0, 1, 2)) + lines.grad.abs().amax((0, 1)) > 0).all()


def test_the_signed_distance_is_that_of_cells_centres_from_the_face_between_them():
    half = np.zeros((40, 12, 12), bool)
    half[:20] = True
    expected = np.arange(40) - 19.5
    np.testing.assert_allclose(signed_distance(half)[8:32, 6, 6], expected[8:32], atol=0.01)


@pytest.mark.parametrize("size", [40, 65])
def test_the_start_has_the_hulls_shape(size):
    torch.manual_seed(0)
    field = MicrofacetField(torch.zeros(3), 1.0, size)
    centres = grid(48, -1 + 1 / 48, 1 - 1 / 48)
    # A box and a ball that touch: no sum of few products.
    distance = torch.minimum(
        (centres - torch.tensor([0.3, 0.2, 0.0])).norm(dim=-1) - 0.4,
        (centres + torch.tensor([0.3, 0.3, 0.2])).abs().amax(-1) - 0.35,
    )
    start_from_hull(field, distance, 100.0, -12.0, 12.0)
    raw = field.raw_density(centres.reshape(-1, 3) * 0.5 + 0.5).view(48, 48, 48)
    clear = distance.abs() > 0.03
    assert ((raw > 0) == (distance < 0))[clear].float().mean() > 0.999


REGION = np.array([[-1.0] * 3, [1.0] * 3])
SLAB, ROD = ((-0.3, -0.3, -0.4), (0.3, 0.3, -0.3)), ((0.1, 0.05, -0.4), (0.1, 0.05, 0.5))


def silhouettes(thickness):
    """Cameras around a slab with an upright rod, and masks of both by many points of theirs.

    Args:
        thickness: of the rod, world units.
    """
    random = np.random.default_rng(0)
    slab = random.uniform(*SLAB, (20_000, 3))
    rod = np.linspace(*ROD, 2000) + thickness * random.uniform(-0.5, 0.5, (2000, 3))
    cameras, masks = [], []
    for i in range(16):
        turn = 2 * np.pi * i / 16
        place = np.array([3.5 * np.cos(turn), 3.5 * np.sin(turn), 1.5 - 2 * (i % 2)])
        camera = box_camera(look_at(place, np.zeros(3)), f"c{i}", None, 0.6)
        pixel, _ = camera.project(np.concatenate([slab, rod]))
        column, row = pixel.astype(int).T
        mask = np.zeros((camera.height, camera.width), bool)
        mask[row, column] = True
        cameras.append(camera)
        masks.append(scipy.ndimage.binary_closing(mask, iterations=2) | mask)
    return cameras, masks


@pytest.mark.parametrize("thickness", [0.004, 0.02, 0.06])
def test_parts_thinner_than_a_cell_are_in_the_box_and_in_the_hull(thickness):
    cameras, masks = silhouettes(thickness)
    box = hull_box(cameras, lambda: masks, REGION, 48)
    assert (box[0] <= SLAB[0]).all() and box[1, 2] >= ROD[1][2]
    assert (box[1] - box[0] < (0.75, 0.75, 1.05)).all()
    cells = 32
    hull, reached = whole_hull(cameras, lambda: masks, REGION, cells)
    centres = carve(cameras, masks, REGION, cells)
    rod = np.floor((np.linspace(*ROD, 200) + 1) / 2 * cells).astype(int)
    assert reached[tuple(rod.T)].all()
    if thickness < 0.01:
        assert centres[tuple(rod.T)].mean() < 0.9
    assert (reached == carve(cameras, masks, REGION, cells, whole_cells=True)).all()
    # Nothing that the centres have is lost, and next to them nothing is added.
    assert not (centres & ~hull).any()
    assert hull.sum() < 1.1 * centres.sum() + 2 * len(np.unique(rod, axis=0)) * 9


def test_a_plate_thinner_than_any_cell_is_an_object():
    cameras, masks = silhouettes(0.02)
    only = [mask & False for mask in masks]
    for camera, mask in zip(cameras, only, strict=True):
        plate = np.random.default_rng(1).uniform((-0.3, -0.001, -0.3), (0.3, 0.001, 0.3), (20_000, 3))
        column, row = camera.project(plate)[0].astype(int).T
        mask[row, column] = True
    box = hull_box(cameras, lambda: only, REGION, 48)
    assert box is not None and (box[1] - box[0])[0] > 0.59
    assert whole_hull(cameras, lambda: only, box, 32)[0].any()
