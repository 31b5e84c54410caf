"""Things on a table, without masks: where photos show them, and that a job keeps to it."""

import dataclasses
import json

import numpy as np
import pytest
from PIL import Image

from solver.apart import ApartError
from solver.cameras.output import write_points
from solver.capture.formats.transforms import write_transforms
from solver.capture.photos import linear_to_srgb
from solver.fit import isolation
from solver.fit.cut_out import photos_as_fitted
from solver.fit.cut_out_standing import before_support, few_on_support, find_on_support, picture_of
from solver.fit.isolation import isolated
from solver.fit.presets import PAPER, settings_for
from solver.fit.standing_file import read_masks, read_standing, write_masks, write_standing
from solver.fit.standing_search import _Search, find_standing
from solver.fit.support import Support
from solver.job.folder import JobFolder
from solver.job.request import JobError, JobRequest
from tests.fit import table_scene as things
from tests.fit.table_scene import CENTRE, HEIGHT, RADIUS, REGION, WIDTH, table_scene
from tests.fit.test_fit import SMALL

SETTINGS = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, cut_out_before_far=False))


@pytest.fixture(scope="module")
def mirror():
    """A ball of gold: the capture, photos, true masks, and what is found."""
    capture, photos, shown = table_scene(things.ball, things.gold)
    return capture, photos, shown, find_on_support(capture, photos)


@pytest.fixture(scope="module")
def glazed():
    """A red ring, likewise."""
    capture, photos, shown = table_scene(things.ring, things.red)
    return capture, photos, shown, find_on_support(capture, photos)


def overlap(masks, true):
    """Mean intersection over union."""
    return np.mean([(a & b).sum() / (a | b).sum() for a, b in zip(masks, true, strict=True)])


def shown_by(photos):
    return [photo.pixels[..., 3] > 0.5 for photo in photos]


def test_a_mirror_on_a_table_is_found_though_it_looks_like_table_and_room(mirror):
    _, _, shown, found = mirror
    assert overlap([o.shown for o in found.outlines], shown) > 0.88


def test_a_ring_is_found_and_the_table_is_seen_through_it(glazed):
    _, _, shown, found = glazed
    masks = [o.shown for o in found.outlines]
    assert overlap(masks, shown) > 0.9
    facing = max(range(len(shown)), key=lambda i: shown[i].sum())
    row, column = np.nonzero(shown[facing])
    middle = int(row.mean()), int(column.mean())
    assert not shown[facing][middle] and not masks[facing][middle]


def test_where_a_photo_is_not_sure_is_along_outlines_only(glazed):
    _, _, shown, found = glazed
    unsure = np.mean([o.unsure.mean() for o in found.outlines])
    assert 0 < unsure < 0.2 * np.mean([mask.mean() for mask in shown])


def test_photos_that_were_held_out_are_cut_out_by_what_is_known(mirror, glazed, monkeypatch):
    for (_, _, _, found), thing, paint in (
        (mirror, things.ball, things.gold), (glazed, things.ring, things.red)
    ):  # fmt: skip
        capture, photos, shown = table_scene(thing, paint, views=3, turn=0.4)
        cut = few_on_support(capture.cameras, photos, found.standing)
        assert overlap(shown_by(cut), shown) > 0.87
        monkeypatch.setattr("solver.fit.cut_out.load_photos", lambda *a, p=photos, **k: p)
        again = photos_as_fitted(capture, SETTINGS, True, None, None, found.standing)
        np.testing.assert_array_equal(again[0].pixels, cut[0].pixels)
        assert photos_as_fitted(capture, SETTINGS, False, None, None, found.standing) is photos


def test_photos_cut_out_are_as_they_were_over_what_is_behind_them(glazed):
    _, photos, _, found = glazed
    for photo, outline in list(zip(photos, found.outlines, strict=True))[:4]:
        cut = before_support(photo, outline)
        alpha = cut.pixels[..., 3:]
        straight = np.where(alpha > 0, cut.pixels[..., :3] / np.maximum(alpha, 1e-6), 0)
        laid = linear_to_srgb(straight) * alpha + (1 - alpha) * cut.behind.astype(np.float32)
        assert np.abs(laid - linear_to_srgb(photo.pixels[..., :3])).mean() < 0.01
        assert cut.has_alpha and cut.unsure is outline.unsure


@pytest.mark.parametrize("what", ["an empty table", "a wall", "few points", "alpha"])
def test_photos_stay_as_they_are_of(what, glazed):
    capture, photos, _, found = glazed
    if what == "an empty table":
        capture, photos, _ = table_scene(things.nothing)
    elif what == "a wall":
        capture = dataclasses.replace(capture, up=np.array([0.0, 1.0, 0.0]))
    elif what == "few points":
        capture = dataclasses.replace(capture, points=capture.points[:50])
    else:
        photos = [before_support(p, o) for p, o in zip(photos, found.outlines, strict=True)]
    assert find_on_support(capture, photos) is None


def test_a_region_says_what_of_all_that_stands_there_is_the_object():
    capture, photos, _ = table_scene(views=10)
    around = np.array([CENTRE - 0.4, CENTRE + 0.4])
    found = find_on_support(capture, photos, around)
    assert found.box is around and all(o.shown.any() for o in found.outlines)
    for nowhere in ([[-0.8, -0.8, 5], [0.8, 0.8, 6.5]], [[-0.8, -0.8, 0.5], [-0.5, -0.5, 0.8]]):
        assert find_on_support(capture, photos, np.array(nowhere, float)) is None


def test_a_lamp_that_a_polished_table_mirrors_elsewhere_in_each_photo_is_no_part_left_out(glazed):
    capture, photos, shown, _ = glazed
    rng, lit = np.random.default_rng(0), []
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    for photo, mask in zip(photos, shown, strict=True):
        pixels = photo.pixels.copy()
        at = rng.integers((HEIGHT - 16, 10), (HEIGHT - 8, WIDTH - 10))
        glare = (np.hypot(row - at[0], column - at[1]) < 7) & ~mask
        pixels[glare, :3] = 0.95
        lit.append(dataclasses.replace(photo, pixels=pixels))
    found = find_on_support(capture, lit)
    assert overlap([o.shown for o in found.outlines], shown) > 0.85


def test_nothing_is_found_rather_than_a_part_of_what_stands_there(glazed):
    capture, photos, shown, _ = glazed
    pictures = [picture_of(c, p) for c, p in zip(capture.cameras, photos, strict=True)]
    support = Support(np.array([0.0, 0.0, 1.0]), 0.0)
    told = []
    assert find_standing(support, pictures, REGION, told.append) is not None
    assert told == [0.25, 0.5, 0.75, 1.0]

    class Half(_Search):
        def turn(self, few):
            kept = super().turn(few)
            for mask in self.masks:
                mask[: HEIGHT // 2] = False
            return kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solver.fit.standing_search._Search", Half)
        assert find_standing(support, pictures, REGION) is None


def test_what_is_known_of_the_object_is_kept_in_a_file(tmp_path, mirror):
    capture, photos, _, found = mirror
    path = tmp_path / "standing.npz"
    assert read_standing(path) is None
    write_standing(path, found.standing)
    picture = picture_of(capture.cameras[5], photos[5])
    again = read_standing(path).outline(picture)
    assert overlap([again.shown], [found.standing.outline(picture).shown]) > 0.99
    assert [entry.name for entry in tmp_path.iterdir()] == ["standing.npz"]
    data = path.read_bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 0xFF
    np.savez(path, normal=np.array([{}], dtype=object))
    pickled = path.read_bytes()
    for broken in (pickled, b"", data[: len(data) // 2], b"PK" + data[2:50], bytes(flipped)):
        path.write_bytes(broken)
        with pytest.raises(JobError, match=r"standing\.npz.*start a new job"):
            read_standing(path)


def test_masks_are_pictures_that_say_where_they_are_not_sure(tmp_path, glazed):
    capture, _, _, found = glazed
    shapes = [(HEIGHT, WIDTH)] * len(capture.cameras)
    assert read_masks(tmp_path, capture.cameras, shapes) is None
    write_masks(tmp_path, capture.cameras, found.outlines)
    for wrote, read in zip(found.outlines, read_masks(tmp_path, capture.cameras, shapes), strict=True):
        np.testing.assert_array_equal(wrote.shown, read.shown)
        np.testing.assert_array_equal(wrote.unsure, read.unsure)
    assert read_masks(tmp_path, capture.cameras, [(5, 5)] * len(shapes)) is None
    name = f"{capture.cameras[3].name}.png"
    assert set(np.unique(np.asarray(Image.open(tmp_path / name)))) <= {0, 64, 191, 255}


class Heard:
    """A `Progress` that notes warnings."""

    def __init__(self):
        self.warnings = []

    def warning(self, text):
        self.warnings.append(text)


def job_in(folder, **request):
    return JobFolder.create(folder / "job", JobRequest(capture="/nowhere", **request))


def test_a_job_cuts_photos_out_once_and_goes_on_with_the_same(tmp_path, glazed, monkeypatch):
    capture, photos, shown, _ = glazed
    job, heard, told = job_in(tmp_path), Heard(), []
    first = isolated(job, SETTINGS, capture, photos, False, heard, told.append)
    assert overlap(shown_by(first.photos), shown) > 0.9
    assert told == sorted(told) and told[-1] == 1
    (warning,) = heard.warnings
    assert "region box" in warning and "'masks'" in warning
    assert len(list(job.masks_dir.glob("*.png"))) == len(photos)

    def never(*_):
        raise AssertionError("a job that goes on looks for nothing anew")

    monkeypatch.setattr(isolation, "find_on_support", never)
    again = isolated(job, SETTINGS, capture, photos, True, heard, told.append)
    for one, other in zip(first.photos, again.photos, strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)
        np.testing.assert_array_equal(one.unsure, other.unsure)
    (job.masks_dir / f"{capture.cameras[0].name}.png").unlink()
    with pytest.raises(JobError, match="masks.*put them back, or start a new job"):
        isolated(job, SETTINGS, capture, photos, True, heard, told.append)


def test_a_job_leaves_photos_alone_if_told_to_or_short_of_time(tmp_path, glazed):
    capture, photos, *_ = glazed
    off = dataclasses.replace(SETTINGS.fit, cut_out_standing=False)
    for name, settings, limit in (
        ("off", dataclasses.replace(SETTINGS, fit=off), None), ("short", SETTINGS, 1.0)
    ):  # fmt: skip
        job, heard = job_in(tmp_path / name, time_limit=limit), Heard()
        if name == "short":
            # Left by a start that had time, and was stopped before its first checkpoint.
            job.standing_path.touch()
        found = isolated(job, settings, capture, photos, False, heard, lambda done: None)
        assert found.photos is photos and not heard.warnings and found.capture is capture
        assert not job.masks_dir.exists() and not job.standing_path.exists()
    assert not PAPER.fit.use_masks
    assert settings_for("draft").fit.cut_out_standing


def test_without_sparse_points_a_job_says_so_and_goes_on(tmp_path, glazed, monkeypatch):
    capture, photos, *_ = glazed

    def none(*_):
        raise ApartError("no COLMAP")

    monkeypatch.setattr(isolation, "found_in_photos", none)
    heard = Heard()
    few = dataclasses.replace(capture, points=None)
    found = isolated(job_in(tmp_path), SETTINGS, few, photos, False, heard, lambda done: None)
    assert found.photos is photos
    assert heard.warnings == ["no sparse points (no COLMAP); the fit starts without them"]


def written(folder, capture, photos):
    """A capture's folder with photos, cameras and sparse points."""
    (folder / "photos").mkdir(parents=True)
    named = []
    for camera, photo in zip(capture.cameras, photos, strict=True):
        levels = np.round(linear_to_srgb(photo.pixels[..., :3]).clip(0, 1) * 255).astype(np.uint8)
        path = f"photos/{camera.name}.png"
        Image.fromarray(levels).save(folder / path)
        named.append(dataclasses.replace(camera, image_path=path))
    write_transforms(folder / "transforms.json", named, {"ply_file_path": "points.ply"})
    colours = np.zeros((len(capture.points), 3), np.uint8)
    write_points(folder / "points.ply", capture.points, colours)


def test_of_a_ball_on_a_table_a_job_makes_a_ball_alone(tmp_path):
    from solver.cli import main

    capture, photos, _ = table_scene(things.ball, things.red, views=20)
    written(tmp_path / "capture", capture, photos)
    small = ["field.sizes=24,40", "field.size_starts=0,0.4", "light.heights=16", "fit.rays=256",
             "field.hull_cells=48", "asset.texture_size=64", "asset.cells=48",
             "fit.cut_out_before_far=no", "field.turn_box=no", "render.pixel_grid=1",
             "render.diffuse_visibility=no"]  # fmt: skip
    sets = [part for setting in small for part in ("--set", setting)]
    job = tmp_path / "job"
    command = ["reconstruct", str(tmp_path / "capture"), "--out", str(job), "--set", "fit.steps=60"]
    assert main([*command, *sets]) == 0
    region = json.loads((job / "result" / "manifest.json").read_text())["region"]
    low, high = np.array(region["min"]), np.array(region["max"])
    # The box that was fitted is that of the ball, not the table's.
    assert (low < CENTRE - RADIUS + 0.06).all() and (high > CENTRE + RADIUS - 0.06).all()
    assert (high - low).max() < 2.9 * RADIUS
    report = json.loads((job / "result" / "report.json").read_text())
    assert any("everything standing there" in warning for warning in report["warnings"])
    held_out = table_scene(things.ball, things.red, views=3, turn=0.2)
    written(tmp_path / "held out", *held_out[:2])
    scores = tmp_path / "scores.json"
    command = ["evaluate", str(job), "--cameras", str(tmp_path / "held out"), "--out", str(scores)]
    assert main([*command, "--rays", "4"]) == 0
    # A white picture has 12 dB.
    assert json.loads(scores.read_text())["mean"]["psnr"] > 17
