"""Solving where photos are to be ignored in places: no features there, and the solved cameras know it."""

import json
import os
import sqlite3

import numpy as np
import pytest
from PIL import Image

from solver.cameras.command import request_of
from solver.cameras.folder import SolveFolder, photos_below
from solver.cameras.output import write_cameras
from solver.cameras.prepare import look_at, write_prepared
from solver.cameras.solve import Solved, Solver
from solver.capture.orientation import as_camera_saw
from solver.capture.read import read_capture
from solver.cli import main
from tests.cameras.box_scene import align, box_camera, orbit, write_photos
from tests.cameras.test_solve import photos_at, solve
from tests.capture.videos import plain, write_video

pytest.importorskip("pycolmap")

HAND = np.s_[120:, 190:]
"""rows and columns of the box scene's photos, at 0.6 of their size, before which there is a hand"""


@pytest.fixture(scope="module")
def handled(tmp_path_factory):
    """Twelve photos with the same patch before all, the one picture of it among them, and their solve."""
    folder = tmp_path_factory.mktemp("hand of ü")
    truth = write_photos(folder, orbit(12, 150.0), scale=0.6)
    patch = np.random.default_rng(3).integers(0, 255, (24, 25, 3), np.uint8)
    patch = patch.repeat(4, 0).repeat(4, 1)
    for camera in truth:
        pixels = np.array(Image.open(camera.image_path))
        pixels[HAND] = patch[: pixels[HAND].shape[0], : pixels[HAND].shape[1]]
        Image.fromarray(pixels).save(camera.image_path, quality=95)
    picture = np.zeros(pixels.shape[:2], np.uint8)
    picture[HAND] = 255
    Image.fromarray(picture).save(folder / "hand.png")
    result = solve(folder, "--ignore", folder / "hand.png")
    assert result.returncode == 0, result.stderr
    assert result.stderr == "" and "--ignore" not in result.stdout
    return folder, truth


def keypoints(folder):
    """[N, 2] columns and rows of all photos' features, at the size at which they were found."""
    with sqlite3.connect(folder / "cameras" / "database.db") as database:
        rows = database.execute("SELECT cols, data FROM keypoints").fetchall()
    return np.concatenate([np.frombuffer(d, "<f4").reshape(-1, n)[:, :2] for n, d in rows])


def test_features_in_ignored_parts_are_gone_and_cameras_are_the_true_ones(handled):
    folder, truth = handled
    factor = 800 / truth[0].width
    column, row = keypoints(folder).T / factor
    assert len(column) > 1000
    assert not ((row > HAND[0].start) & (column > HAND[1].start)).any()
    found = [camera.position for camera in read_capture(folder).cameras]
    positions = np.stack([camera.position for camera in truth])
    scale, rotation, shift = align(np.stack(found), positions)
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    for position, camera in zip(found, truth, strict=True):
        moved = scale * rotation @ position + shift
        assert np.linalg.norm(moved - camera.position) < 0.05 * size


def test_solved_cameras_name_pictures_below_the_photos_so_nobody_says_it_twice(handled):
    folder, truth = handled
    assert json.loads((folder / "cameras" / "solve.json").read_text())["ignored"] == str(
        folder / "hand.png"
    )
    for capture in (
        read_capture(folder),
        read_capture(folder / "cameras"),
        read_capture(folder / "cameras", photos=folder),
    ):
        assert [c.ignored_path for c in capture.cameras] == [folder / "hand.png"] * len(truth)


def test_pictures_elsewhere_are_not_named_by_the_cameras_but_told(tmp_path, monkeypatch, capsys):
    photos = photos_at(tmp_path / "photos")
    (tmp_path / "leg.png").write_bytes((photos / "IMG_0.png").read_bytes())
    monkeypatch.setattr(Solver, "run", lambda self: Solved(3, 3, 9, ""))
    assert main(["solve", str(photos), "--ignore", str(photos / ".." / "leg.png")]) == 0
    assert f"Reconstruct with --ignore {tmp_path / 'leg.png'}, since" in capsys.readouterr().out
    camera = box_camera(np.eye(4), "c", photos / "IMG_0.png")
    cameras = [
        type(camera)(**{**vars(camera), "ignored_path": path})
        for path in (tmp_path / "leg.png", photos / "hands" / "IMG_0.png", None)
    ]
    write_cameras(SolveFolder(photos / "cameras"), photos, cameras)
    frames = json.loads((photos / "cameras" / "transforms_train.json").read_text())["frames"]
    assert [f.get("ignored_path") for f in frames] == [None, "../hands/IMG_0.png", None]


def sought(photo, folder):
    """[H, W] bool: where features are taken from a photo."""
    write_prepared(photo, folder, folder)
    return np.asarray(Image.open(folder / f"{photo.file}.png")) > 0


def test_what_is_ignored_is_left_out_with_a_border_and_with_what_masks_leave_out(tmp_path):
    photos = tmp_path / "photos"
    photos.mkdir()
    for i in range(3):
        Image.new("RGB", (80, 60), (200, 200, 200)).save(photos / f"{i}.png")
    left, top = np.zeros((2, 120, 160), np.uint8)
    left[:, :80] = 255
    top[:60] = 255
    for name, picture in (("hands", left), ("masks", top)):
        (tmp_path / name).mkdir()
        Image.fromarray(picture).save(tmp_path / name / "1.png")
    names = ("0.png", "1.png", "2.png")
    first, second, _ = look_at(photos, names, None, 80, tmp_path / "hands")
    assert first.ignored is None
    write_prepared(first, tmp_path, tmp_path)
    assert not (tmp_path / "000001.png.png").exists()
    inside = sought(second, tmp_path)
    assert not inside[:, :44].any() and inside[:, 44:].all()
    _, second, _ = look_at(photos, names, tmp_path / "masks", 80, tmp_path / "hands")
    both = sought(second, tmp_path)
    assert not both[:, :44].any() and not both[26:].any() and both[:26, 44:].all()


@pytest.mark.parametrize("lies", ["as the photo", "upright", "by its own tag"])
@pytest.mark.parametrize("tag", [1, 3, 6, 8])
def test_what_is_ignored_turns_with_photos_as_a_fit_turns_it(tmp_path, tag, lies):
    exif = Image.Exif()
    exif[0x0112] = tag
    picture = np.zeros((48, 64), np.uint8)
    picture[:16, :24] = 255
    Image.new("RGB", (64, 48), (90, 90, 90)).save(tmp_path / "a.jpg", exif=exif)
    seen = as_camera_saw(picture, tag, *((48, 64) if tag >= 5 else (64, 48)))
    saved = Image.fromarray(np.ascontiguousarray(seen if lies == "upright" else picture))
    options = {"exif": exif} if lies == "by its own tag" else {}
    saved.save(tmp_path / "ignore.jpg", quality=98, **options)
    (photo,) = look_at(tmp_path, ("a.jpg",), None, 64, tmp_path / "ignore.jpg")
    inside = sought(photo, tmp_path)
    assert inside.shape == seen.shape
    assert not inside[seen > 0].any() and inside.mean() > 0.7


def test_large_photos_and_one_smaller_picture_for_all_are_reduced_alike(tmp_path):
    picture = np.zeros((75, 100), np.uint8)
    picture[:, 50:] = 255
    Image.fromarray(picture).save(tmp_path / "leg.png")
    for i in range(3):
        Image.new("RGB", (1200, 900), (90, 90, 90)).save(tmp_path / f"{i}.jpg")
    for photo in look_at(tmp_path, ("0.jpg", "1.jpg", "2.jpg"), None, 400, tmp_path / "leg.png"):
        inside = sought(photo, tmp_path)
        assert inside.shape == (300, 400)
        assert inside[:, :196].all() and not inside[:, 196:].any()


def test_dynamic_masks_beside_photos_are_found_by_themselves_and_are_no_photos(tmp_path):
    photos = photos_at(tmp_path / "photos")
    Image.fromarray(np.eye(32, dtype=np.uint8) * 255).save(photos / "dynamic_mask_IMG_1.png")
    names = photos_below(photos)
    assert names == ("IMG_0.png", "IMG_1.png", "IMG_2.png")
    found = look_at(photos, names, None, 32)
    assert [photo.ignored for photo in found] == [None, photos / "dynamic_mask_IMG_1.png", None]


def test_what_blender_and_network_drives_write_beside_photos_are_no_photos(tmp_path):
    """A fixed bug: solved once more, pictures of the last job were taken for photos."""
    photos = photos_at(tmp_path / "photos")
    job = photos / "nmf_jobs" / "photos_cameras" / "photos"
    for folder in (job, photos / "@eaDir" / "IMG_0.png"):
        folder.mkdir(parents=True)
        Image.new("L", (32, 32)).save(folder / "frame_000001.png")
    assert photos_below(photos) == ("IMG_0.png", "IMG_1.png", "IMG_2.png")
    for name in ("a.png", "b.png"):
        Image.new("L", (32, 32)).save(job / name)
    assert photos_below(job) == ("a.png", "b.png", "frame_000001.png")


def test_given_pictures_are_no_photos_wherever_they_lie(tmp_path):
    photos = photos_at(tmp_path / "photos")
    (photos / "hands").mkdir()
    for file in ("leg.png", "hands/IMG_1.png"):
        Image.new("L", (32, 32)).save(photos / file)
    names = ("IMG_0.png", "IMG_1.png", "IMG_2.png")
    assert photos_below(photos, None, None, photos / "hands") == (*names, "leg.png")
    assert photos_below(photos, None, None, photos / "leg.png")[1:] == names
    (photos / "hands" / "IMG_1.png").unlink()
    assert photos_below(photos, None, None, photos / "hands" / ".." / "leg.png") == names


def test_pictures_that_are_of_no_use_are_named_with_what_to_do(tmp_path):
    photos = photos_at(tmp_path / "photos")
    other = tmp_path / "other"
    other.mkdir()
    Image.new("L", (32, 32)).save(other / "hand.png")
    Image.new("L", (32, 20)).save(tmp_path / "flat.png")
    Image.new("L", (32, 32), 255).save(tmp_path / "white.png")
    (tmp_path / "text.png").write_text("white where a hand is")
    for given, problem in (
        ("nowhere", "nowhere, ignore: there is no such folder or picture; check its path"),
        ("other", "other, ignore: no mask there has a photo's name; name masks like the photos"),
        ("text.png", "text.png: this is no PNG, JPEG"),
        ("flat.png", "ignored_path: the mask is 32 × 20 pixels, its photo 32 × 32; export both"),
        ("white.png", "ignored_path: all of the photo 'IMG_0.png' is to be ignored; make only"),
    ):
        result = solve(photos, "--ignore", tmp_path / given, "--out", tmp_path / f"of {given}")
        assert result.returncode == 2 and problem in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1


def test_masks_of_another_shape_are_refused_before_photos_are_prepared(tmp_path):
    photos = photos_at(tmp_path / "photos")
    masks = tmp_path / "masks"
    masks.mkdir()
    for photo in photos.rglob("IMG_*.png"):
        Image.new("L", (32, 20), 255).save(masks / photo.name)
    result = solve(photos, "--masks", masks, "--out", tmp_path / "cameras")
    assert result.returncode == 2
    assert "mask_path: the mask is 32 × 20 pixels, its photo 32 × 32; export both" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_solve_goes_on_with_the_same_pictures_and_begins_anew_with_others(tmp_path):
    photos = photos_at(tmp_path / "photos")
    Image.new("L", (32, 32)).save(tmp_path / "leg.png")
    folder = SolveFolder(tmp_path / "cameras")
    request = request_of(photos, folder, ignored=str(tmp_path / "leg.png"))
    assert folder.take(request) is False
    folder.database_path.write_text("features")
    assert folder.take(request) is True and folder.database_path.exists()
    assert folder.take(request_of(photos, folder)) is False
    assert not folder.database_path.exists()


def repainted(path):
    """A picture written anew, at another time."""
    Image.new("L", (32, 32), 1).save(path)
    os.utime(path, ns=(0, 1_700_000_000_000_000_000))


@pytest.mark.parametrize("given", ["masks", "ignored", "ignored for all", "beside"])
def test_a_solve_whose_pictures_were_repainted_meanwhile_finds_features_anew(given, tmp_path):
    photos, folder = photos_at(tmp_path / "photos"), SolveFolder(tmp_path / "cameras")
    picture = tmp_path / "hands" / "IMG_1.png"
    if given == "beside":
        picture = photos / "dynamic_mask_IMG_1.png"
    picture.parent.mkdir(exist_ok=True)
    Image.new("L", (32, 32)).save(picture)
    options = {
        "masks": {"masks": str(picture.parent)}, "ignored": {"ignored": str(picture.parent)},
        "ignored for all": {"ignored": str(picture)}, "beside": {},
    }[given]  # fmt: skip
    assert folder.take(request_of(photos, folder, **options)) is False
    folder.database_path.write_text("features")
    assert folder.take(request_of(photos, folder, **options)) is True
    repainted(picture)
    assert folder.take(request_of(photos, folder, **options)) is False
    assert not folder.database_path.exists()
    folder.database_path.write_text("features")
    assert folder.take(request_of(photos, folder, **options)) is True
    if given == "ignored for all":
        return  # without it there is no such request
    picture.unlink()
    assert folder.take(request_of(photos, folder, **options)) is False


def test_photos_of_a_video_stay_when_what_is_ignored_in_them_was_repainted(tmp_path):
    folder, ignored = SolveFolder(tmp_path / "cameras"), tmp_path / "leg.png"
    video = write_video(tmp_path / "walk.mp4", [plain((90, 90, 90))] * 9)
    Image.new("L", (32, 32)).save(ignored)
    folder.take(request_of(video, folder, 3, ignored=str(ignored)))
    folder.video_photos_dir.mkdir()
    folder.database_path.write_text("features")
    repainted(ignored)
    assert folder.take(request_of(video, folder, 3, ignored=str(ignored))) is False
    assert folder.video_photos_dir.exists() and not folder.database_path.exists()
