"""What photos say nothing of is not drawn, does not carve, and is not compared."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.capture.capture import Capture
from solver.capture.frames import texel_directions
from solver.capture.photos import Photo, at_sizes_of
from solver.fit.before_far import at_size, cut_out_before_far
from solver.fit.common_masks import fit_together
from solver.fit.cut_out import cut_out
from solver.fit.cut_out_standing import find_on_support
from solver.fit.evaluate import image_scores
from solver.fit.exposure import brought_to, photo_views
from solver.fit.held_cells import held_by_silhouettes
from solver.fit.hollows import Carving
from solver.fit.ray_bank import RayBank
from solver.fit.schedule import picture_settings
from solver.fit.start import masks_of, new_trainer
from solver.fit.visual_hull import carve
from solver.metrics.image import psnr, ssim
from solver.render.image import render_view
from solver.render.scene import StepTables
from tests.capture.far_scene import far_colour, far_scene
from tests.fit.table_scene import table_scene
from tests.fit.test_fit import SIZE, SMALL, ball_capture

HAND = np.zeros((SIZE, SIZE), bool)
HAND[10:, 12:22] = True
"""what is before the ball, from the lower edge of the photos up"""


def before_a_hand(ignored, every=2, views=10, alpha=0.0):
    """The ball's capture with a black hand in some photos, of which masks say what `alpha` is."""
    capture, photos = ball_capture(views)
    for i in range(0, views, every):
        pixels = photos[i].pixels.copy()
        pixels[HAND] = (0, 0, 0, alpha)
        photos[i] = Photo(pixels, True, False, told=~HAND if ignored else None)
    return at_sizes_of(photos, capture), photos


def bank_of(capture, photos):
    return RayBank(list(capture.cameras), photos)


def told_among(bank, photos):
    told = [np.ones(SIZE * SIZE, bool) if p.told is None else p.told.ravel() for p in photos]
    return torch.from_numpy(np.concatenate(told))


@pytest.mark.parametrize("restricted", [False, True])
@pytest.mark.parametrize("photo", [None, 0, 1])
def test_what_photos_say_nothing_of_is_never_drawn(photo, restricted):
    capture, photos = before_a_hand(ignored=True)
    bank, generator = bank_of(capture, photos), torch.Generator().manual_seed(0)
    if restricted:
        bank.restrict(torch.from_numpy(np.concatenate([p.pixels[..., 3].ravel() >= 0 for p in photos])))
    drawn = bank.draw(20_000, generator, photo)
    assert told_among(bank, photos)[drawn].all()
    first, last = (0, len(bank)) if photo is None else bank.first_pixel[photo : photo + 2]
    assert first <= drawn.min() and drawn.max() < last
    drawn_at_all = len(torch.unique(drawn)) / int(told_among(bank, photos)[first:last].sum())
    assert drawn_at_all > 0.8, "all that is told is"


def test_photos_that_say_something_everywhere_are_drawn_as_before():
    capture, photos = ball_capture()
    everywhere = [dataclasses.replace(p, told=np.ones((SIZE, SIZE), bool)) for p in photos]
    for likely in (None, torch.arange(10 * SIZE * SIZE) % 3 == 0):
        drawn = []
        for some in (photos, everywhere):
            bank, generator = bank_of(capture, some), torch.Generator().manual_seed(0)
            if likely is not None:
                bank.restrict(likely)
            drawn.append(torch.cat([bank.draw(500, generator), bank.draw(500, generator, 3)]))
        assert torch.equal(*drawn)


def test_a_photo_is_known_again_by_what_it_says():
    (capture, photos), (_, others) = before_a_hand(True), before_a_hand(True)
    for photo in others:
        if photo.told is not None:
            photo.pixels[HAND] = 1
    banks = bank_of(capture, photos), bank_of(capture, others)
    torch.testing.assert_close(banks[0].mean_colours, banks[1].mean_colours)


def test_a_hull_is_not_carved_by_what_photos_say_nothing_of():
    whole_capture, whole_photos = ball_capture()
    region = whole_capture.region
    for whole_cells in (False, True):
        hulls = [
            carve(list(capture.cameras), masks_of(photos), region, 32, 0.2, whole_cells)
            for capture, photos in (
                (whole_capture, whole_photos), before_a_hand(True), before_a_hand(False),
            )
        ]  # fmt: skip
        whole, ignoring, carved = (int(hull.sum()) for hull in hulls)
        assert not (hulls[0] & ~hulls[1]).any() and whole <= ignoring < 1.25 * whole
        assert carved < 0.8 * whole


def test_what_no_photo_says_anything_of_is_not_in_the_hull():
    capture, photos = ball_capture()
    nothing = np.ones((SIZE, SIZE), bool)
    nothing[:, SIZE // 2 :] = False
    photos = [dataclasses.replace(photo, told=nothing) for photo in photos[:1] * 10]
    cameras = list(
        at_sizes_of(photos, dataclasses.replace(capture, cameras=capture.cameras[:1] * 10)).cameras
    )
    hull = carve(cameras, masks_of(photos), capture.region, 32, fewest=0.2)
    alone = carve(cameras, masks_of(photos), capture.region, 32)
    assert 0 < hull.sum() < 0.6 * alone.sum()


def test_masks_fit_together_though_a_hand_hides_what_others_show():
    capture, photos = before_a_hand(ignored=True)
    shown = [photo.pixels[..., 3] > 0.5 for photo in photos]
    assert fit_together(capture.cameras, shown, capture.region)
    capture, photos = before_a_hand(ignored=False)
    assert not fit_together(capture.cameras, shown, capture.region)


def test_where_a_hand_ends_is_no_silhouette_and_it_is_no_colour_of_the_object():
    region = np.array([[-0.7] * 3, [0.7] * 3])
    whole, whole_photos = ball_capture()
    hull = carve(list(whole.cameras), masks_of(whole_photos), region, 32)
    held = {}
    for ignored in (True, False):
        capture, photos = before_a_hand(ignored, every=1)
        held[ignored] = held_by_silhouettes(list(capture.cameras), photos, hull, region)
    by_all = held_by_silhouettes(list(whole.cameras), whole_photos, hull, region)
    assert not (held[True] & ~by_all).any()
    capture, photos = before_a_hand(True, every=1, alpha=1.0)
    carving = Carving(list(capture.cameras), photos, hull, region, held[True])
    spread = carving.lids.spread[~np.isnan(carving.lids.spread)]
    assert len(spread) and spread.max() < 0.02
    _, dark = before_a_hand(False, every=1, alpha=1.0)
    seen = Carving(list(capture.cameras), dark, hull, region, held[True]).lids.spread
    assert np.nanmax(seen) > 0.1


def on_white(ignored, ring):
    """The ball before plain white, without alpha; black around a circle of what a lens sees, or not."""
    capture, photos = ball_capture(12)
    row, column = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    told = np.hypot(row, column) < SIZE / 2 - 1
    opaque = []
    for photo in photos:
        pixels = photo.pixels.copy()
        pixels[..., :3] += 1 - pixels[..., 3:]
        pixels[..., 3] = 1
        if ring:
            pixels[~told, :3] = 0
        opaque.append(Photo(pixels, False, False, told=told if ignored else None))
    return at_sizes_of(opaque, capture), opaque, photos


def test_an_object_before_white_is_cut_out_though_all_around_a_fisheyes_image_is_black():
    capture, photos, truth = on_white(ignored=True, ring=True)
    cut = cut_out(capture, photos)
    assert all(photo.has_alpha and photo.backdrop == "white" for photo in cut)
    for photo, true in zip(cut, truth, strict=True):
        off = (photo.pixels[..., 3] > 0.5) != (true.pixels[..., 3] > 0.5)
        assert not off[photo.told].any()
    capture, photos, _ = on_white(ignored=False, ring=True)
    assert cut_out(capture, photos)[0].backdrop == "black", "and all of the picture the object"


def agreement_of(capture, photos, truth):
    """Mean PSNR of a short fit's pictures with photos as they would be without a hand."""
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    for i in range(80):
        trainer.advance(i / 80)
    scene, scores = trainer.scene, []
    settings = picture_settings(trainer.settings)
    for camera, photo in list(zip(capture.cameras, truth, strict=True))[:4]:
        near = camera.seen_from(scene.origin)
        with torch.no_grad():
            view = render_view(scene, StepTables.seen_by(near, scene), settings, near)
        whole = np.concatenate([view.radiance, view.opacity[..., None]], -1)
        scores.append(psnr(whole, photo.pixels))
    return float(np.mean(scores))


def test_a_fit_of_photos_with_a_hand_that_is_ignored_is_as_good_as_without_it():
    capture, truth = ball_capture()
    clean = agreement_of(capture, truth, truth)
    ignoring, not_ignoring = (agreement_of(*before_a_hand(ignored), truth) for ignored in (True, False))
    assert ignoring > clean - 1.0, (clean, ignoring, not_ignoring)
    assert ignoring > not_ignoring + 3.0, (clean, ignoring, not_ignoring)


def test_pictures_are_compared_where_the_photo_says_something():
    random = np.random.default_rng(0)
    truth = random.uniform(0, 1, (40, 48, 3))
    prediction = np.clip(truth + random.normal(0, 0.05, truth.shape), 0, 1)
    told = np.ones((40, 48), bool)
    told[:, 30:] = False
    spoilt = np.where(told[..., None], truth, 0.0)
    assert psnr(prediction, spoilt, told) == pytest.approx(psnr(prediction[:, :30], truth[:, :30]))
    assert psnr(prediction, spoilt) < psnr(prediction, spoilt, told) - 5
    # Of windows that reach beyond, the prediction is taken for true there.
    assert ssim(prediction, truth) == pytest.approx(ssim(prediction, spoilt, told), abs=0.01)
    everywhere, whole = np.ones_like(told), image_scores(prediction, truth)
    assert image_scores(prediction, truth, everywhere) == pytest.approx(whole, rel=1e-5)
    scores = image_scores(prediction, spoilt, told)
    assert scores["flip"] == pytest.approx(whole["flip"], rel=0.1)


def test_exposure_and_detail_look_at_nothing_that_a_photo_says_nothing_of():
    capture, photos = before_a_hand(ignored=True, alpha=1.0)
    views = photo_views(capture.cameras, photos, None)
    assert not views[0].pixels[HAND].any() and views[1].pixels is photos[1].pixels
    true = ball_capture()[1][0].pixels
    view = dataclasses.make_dataclass("View", ["radiance", "surrounded"])(
        true[..., :3] / 2, true[..., :3] / 2
    )
    exposed = brought_to(view, photos[0], "white", "gain")
    np.testing.assert_allclose(exposed.radiance, true[..., :3], atol=1e-5)


def test_masks_of_another_size_are_looked_up():
    capture, _ = before_a_hand(ignored=True)
    camera = capture.cameras[0]
    np.testing.assert_array_equal(camera.told_at((64, 64)), at_size(camera.told, (64, 64)))
    assert camera.told_at((SIZE, SIZE)) is camera.told
    assert isinstance(capture, Capture) and capture.cameras[1].told_at((3, 3)) is None


def with_a_black_corner(capture, photos):
    """The same photos, black in a corner that is to be ignored, another one in each."""
    height, width = photos[0].pixels.shape[:2]
    spoilt = []
    for i, photo in enumerate(photos):
        hidden = np.zeros((height, width), bool)
        hidden[: height // 4, : width // 2] = True
        hidden = np.rot90(hidden, 2) if i % 2 else hidden
        pixels = photo.pixels.copy()
        pixels[hidden, :3] = 0
        spoilt.append(dataclasses.replace(photo, pixels=pixels, told=~hidden))
    return at_sizes_of(spoilt, capture), spoilt


def test_what_is_far_away_is_found_though_corners_are_ignored():
    capture, photos, coverages = far_scene(views=48)
    found = cut_out_before_far(*with_a_black_corner(capture, photos))
    off = [
        (((photo.pixels[..., 3] > 0.5) != (cover > 0.5)) & photo.told & ~photo.unsure).sum()
        for photo, cover in zip(found.photos, coverages, strict=True)
    ]
    assert np.mean(off) < 0.1 * np.mean([(cover > 0.5).sum() for cover in coverages])
    panorama = found.panorama
    towards = texel_directions(*panorama.known.shape)[panorama.known]
    assert np.abs(panorama.colour[panorama.known] - far_colour(towards)).max() < 0.15, "no black"


def test_what_stands_on_a_table_is_found_though_corners_are_ignored():
    capture, photos, shown = table_scene()
    seeing, spoilt = with_a_black_corner(capture, photos)
    found = find_on_support(seeing, spoilt)
    overlaps = [
        (own.shown & true & photo.told).sum() / ((own.shown | true) & photo.told).sum()
        for own, true, photo in zip(found.outlines, shown, spoilt, strict=True)
    ]
    assert np.mean(overlaps) > 0.85
