"""Objects before plain white or black: alpha from what stands out, where that fits together."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.capture.backdrop import backdrop_of, border_of, object_before
from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.photos import Photo, linear_to_srgb, srgb_to_linear
from solver.capture.plain_surroundings import surroundings_of
from solver.fit.common_masks import mended
from solver.fit.cut_out import cut_out, cut_out_of_colour
from solver.fit.ray_bank import RayBank
from solver.fit.start import background_of, new_trainer
from tests.capture.test_capture import pose
from tests.fit.test_fit import SMALL

SIZE, RADIUS, FINE = 64, 0.6, 4
ROWS = np.repeat(np.arange(SIZE * FINE), SIZE * FINE)[:, None]
SWEEP = (0.55 + 0.25 * ROWS / (SIZE * FINE)) * np.array([1.0, 0.95, 0.9])
"""a paper sweep that gets brighter towards its foot"""


def ball(backdrop, paint=None, views=12):
    """Photos of a coloured ball before a backdrop (sRGB, one level or [H·W·16, 3]), and its true coverage.

    Args:
        paint: changes the ball's sRGB colours [N, 3] at points [N, 3] of it that a camera sees.
    """
    cameras, photos, coverages = [], [], []
    for i in range(views):
        camera = Camera(f"c{i}", None, pose(2 * np.pi * i / views), SIZE, SIZE, 120.0, 120.0, 32.0, 32.0)
        row, column = (np.mgrid[0 : SIZE * FINE, 0 : SIZE * FINE] + 0.5) / FINE
        origins, directions = camera.rays(column.ravel(), row.ravel())
        along = -(origins * directions).sum(1)
        square = RADIUS**2 - (origins**2).sum(1) + along**2
        points = origins + (along - np.sqrt(np.maximum(square, 0)))[:, None] * directions
        colour = 0.25 + 0.4 * np.abs(points / RADIUS)
        if paint is not None:
            colour = paint(points, colour, camera)
        hit = square > 0
        colour = np.where(hit[:, None], colour, backdrop)

        def means(values):
            return values.reshape(SIZE, FINE, SIZE, FINE, -1).mean((1, 3))

        codes = np.round(means(colour) * 255) / 255
        pixels = np.concatenate([srgb_to_linear(codes), np.ones((SIZE, SIZE, 1))], -1)
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), False, False))
        coverages.append(means(hit.astype(float))[..., 0])
    region = np.array([[-1.0] * 3, [1.0] * 3])
    return Capture("memory", tuple(cameras), region), photos, coverages


@pytest.mark.parametrize("name, level", [("white", 1.0), ("black", 0.0)])
def test_an_object_before_plain_white_or_black_gets_its_coverage_as_alpha(name, level):
    capture, photos, coverages = ball(level)
    found = cut_out(capture, photos)
    assert background_of(photos) == background_of(found) == name
    for photo, original, truth in zip(found, photos, coverages, strict=True):
        assert photo.has_alpha and photo.backdrop == name
        alpha = photo.pixels[..., 3]
        assert ((alpha > 0.5) == (truth > 0.5)).mean() > 0.995
        edge = (truth > 0.05) & (truth < 0.95)
        assert np.abs(alpha - truth)[edge].mean() < 0.08
        # Laid over the backdrop again, it is the photo.
        straight = photo.pixels[..., :3] / np.maximum(alpha, 1e-4)[..., None]
        over = linear_to_srgb(straight) * alpha[..., None] + level * (1 - alpha[..., None])
        np.testing.assert_allclose(over, linear_to_srgb(original.pixels[..., :3]), atol=0.03)


def test_radiances_before_black_are_kept():
    capture, photos, _ = ball(0.0)
    bright = [
        dataclasses.replace(p, is_hdr=True, pixels=p.pixels * np.float32((9, 9, 9, 1))) for p in photos
    ]
    for photo, original in zip(cut_out(capture, bright), bright, strict=True):
        whole = photo.pixels[..., 3] == 1
        assert photo.has_alpha and photo.pixels[whole].max() > 1.5
        np.testing.assert_array_equal(photo.pixels[whole], original.pixels[whole])


def test_what_is_as_plain_as_the_backdrop_within_the_object_is_not_taken_for_either():
    def highlight(points, colour, camera):
        towards = camera.position / np.linalg.norm(camera.position)
        return np.where((points @ towards > 0.9 * RADIUS)[:, None], 1.0, colour)

    capture, photos, _ = ball(1.0, highlight)
    bank = RayBank(list(capture.cameras), cut_out(capture, photos))
    batch = bank.batch(torch.arange(len(bank)))
    white = (batch.colour > 0.99).all(-1)
    assert (white & (batch.alpha == 1)).sum() > 100
    assert not batch.alpha_known[white & (batch.alpha == 1)].any()
    assert batch.alpha_known[~white].all() and batch.alpha_known[batch.alpha == 0].all()


def test_an_object_that_loses_a_part_to_its_backdrop_is_left_as_it_is():
    def half_white(points, colour, camera):
        return np.where((points[:, 0] > 0.1)[:, None], 1.0, colour)

    capture, photos, _ = ball(1.0, half_white)
    assert cut_out(capture, photos) is photos


def test_photos_with_alpha_or_before_anything_else_stay_as_they_are():
    capture, photos, _ = ball(ROWS // 24 % 2 * 0.3 + 0.3)
    assert background_of(photos) == "room" and cut_out(capture, photos) is photos
    capture, photos, _ = ball(1.0)
    assert cut_out(capture, found := cut_out(capture, photos)) is found
    mixed = [dataclasses.replace(photos[0], has_alpha=True), *photos[1:]]
    assert cut_out(capture, mixed) is mixed
    # What is transparent is no black.
    some = [*cut_out(capture, photos)[1:], photos[0]]
    assert background_of(some) == "room"


def test_an_object_before_an_unevenly_lit_sweep_gets_its_coverage_as_alpha():
    capture, photos, coverages = ball(SWEEP)
    found = cut_out(capture, photos)
    assert background_of(photos) == "room" and background_of(found) == "white"
    for photo, truth in zip(found, coverages, strict=True):
        alpha = photo.pixels[..., 3]
        assert ((alpha > 0.5) == (truth > 0.5)).mean() > 0.99
        edge = (truth > 0.05) & (truth < 0.95)
        assert np.abs(alpha - truth)[edge].mean() < 0.15


def test_what_looks_like_the_backdrop_in_one_photo_is_told_by_the_others():
    def chrome(points, colour, camera):
        mirrors = (camera.name == "c3") & (points[:, 2:] > 0.1) & (points[:, 2:] < 0.5)
        return np.where(mirrors, SWEEP, colour)

    capture, photos, coverages = ball(SWEEP, chrome, views=20)
    alone = surroundings_of(linear_to_srgb(photos[3].pixels[..., :3])).shown
    truth = coverages[3] > 0.5
    assert (truth & ~alone).sum() > 0.2 * truth.sum()
    alpha = cut_out(capture, photos)[3].pixels[..., 3]
    assert (truth & (alpha < 0.5)).sum() < 0.05 * truth.sum()


def test_what_stands_out_from_the_backdrop_beside_the_object_is_none_of_it():
    capture, photos, coverages = ball(SWEEP)
    masks = [coverage > 0.5 for coverage in coverages]
    folded = [mask.copy() for mask in masks]
    folded[0][60, 10:50] = True
    for mask, whole in zip(mended(capture.cameras, folded, capture.region), masks, strict=True):
        np.testing.assert_array_equal(mask, whole)


def test_dust_on_the_backdrop_is_no_object():
    colour = np.ones((50, 60, 3))
    colour[20:35, 20:40] = 0.3
    colour[5, 5] = 0.2
    assert backdrop_of([border_of(colour)]) == "white"
    assert backdrop_of([border_of(colour[20:35, 20:40])]) is None
    shown = object_before(colour, "white")
    assert shown.sum() == 15 * 20 and not shown[5, 5]


@pytest.mark.parametrize("level", [0.0, 1.0, SWEEP])
def test_a_fit_before_a_plain_backdrop_finds_the_shape(level):
    capture, photos, coverages = ball(level)
    photos = cut_out(capture, photos)
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    assert trainer.use_masks and not trainer.fog
    losses = [trainer.advance(i / 60)["image"] for i in range(60)]
    assert np.mean(-10 * np.log10(losses[-5:])) > 20


@pytest.mark.parametrize("backdrop, cut", [(1.0, False), (0.0, False), (SWEEP, True)])
def test_held_out_photos_lose_a_coloured_backdrop_but_keep_white_and_black(backdrop, cut):
    """Renders are laid over white or black, as the photos are then."""
    capture, photos, coverage = ball(backdrop)
    found = cut_out_of_colour(capture, photos)
    assert all(photo.has_alpha for photo in found) == cut
    if cut:
        alpha = np.stack([photo.pixels[..., 3] for photo in found])
        assert np.abs(alpha - coverage).mean() < 0.01
    else:
        assert found is photos
