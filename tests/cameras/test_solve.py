"""Cameras from photos: right, resumable, and clear about photos that cannot be placed."""

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from solver.cameras.command import request_of
from solver.cameras.diagnosis import Evidence, unplaced
from solver.cameras.folder import CAMERA_MODELS, SolveFolder, SolveRequest, photos_below
from solver.cameras.model import _camera
from solver.cameras.pairs import pairs_of
from solver.cameras.prepare import look_at, write_prepared
from solver.cameras.solve import Solver
from solver.capture.errors import CaptureError
from solver.capture.orientation import as_camera_saw
from solver.capture.read import read_capture
from tests.cameras.box_scene import BoxScene, align, box_camera, orbit, write_photos
from tests.cli.command import wait_for

pytest.importorskip("pycolmap")

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-m", "solver", "solve"]
SMALL = 400
"""longer side, in pixels, at which features are found where it only matters that cameras are"""
QUICK = f"""
from functools import partial

from solver.cameras import command
from solver.cli import main

command.request_of = partial(command.request_of, max_image_size={SMALL})
"""
QUICK_COMMAND = [sys.executable, "-c", f"{QUICK}\nraise SystemExit(main())", "solve"]


def solve(*arguments, command=COMMAND):
    return subprocess.run(
        [*command, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True,
        stdin=subprocess.DEVNULL, timeout=300,
    )  # fmt: skip


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Fourteen photos; one lies on its side with a note in its header, one in a folder of its own."""
    folder = tmp_path_factory.mktemp("photos of ü")
    cameras = write_photos(folder, orbit())
    lying = folder / "IMG_004.jpg"
    with Image.open(lying) as picture:
        turned = picture.transpose(Image.Transpose.ROTATE_90)
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise
    turned.save(lying, quality=95, exif=exif)
    (folder / "second walk").mkdir()
    (folder / "IMG_013.jpg").rename(folder / "second walk" / "IMG 013.jpg")
    return folder, cameras


@pytest.fixture(scope="module")
def solved(photos):
    folder, cameras = photos
    result = solve(folder)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.splitlines()[-1] == str(folder / "cameras" / "transforms_train.json")
    return folder, cameras, result


def test_solved_poses_are_the_true_ones_but_for_a_similarity(solved):
    folder, truth, _ = solved
    capture = read_capture(folder / "cameras")
    assert len(capture.cameras) == len(truth) and capture.warnings == ()
    by_name = {camera.image_path.stem.replace(" ", "_"): camera for camera in capture.cameras}
    found = [by_name[camera.name] for camera in truth]
    positions = np.stack([camera.position for camera in truth])
    scale, rotation, shift = align(np.stack([camera.position for camera in found]), positions)
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    for camera, other in zip(found, truth, strict=True):
        moved = scale * rotation @ camera.position + shift
        assert np.linalg.norm(moved - other.position) < 0.02 * size
        turn = rotation @ camera.camera_to_world[:3, :3] @ other.camera_to_world[:3, :3].T
        assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 1.0
        assert (camera.width, camera.height) == (other.width, other.height)
        assert abs(camera.fx / other.fx - 1) < 0.02
    # The world is upright, and what the cameras look at is in its middle.
    assert rotation[2, 2] > np.cos(np.radians(3))
    distances = [np.linalg.norm(camera.position) for camera in found]
    assert 1 < np.median(distances) < 6 and np.linalg.norm(capture.region.mean(0)) < 0.5


def test_the_folder_of_photos_and_that_of_cameras_read_as_one_capture(solved):
    folder, _, _ = solved
    below, direct = read_capture(folder), read_capture(folder / "cameras")
    assert below.source == direct.source
    assert [c.image_path for c in below.cameras] == [c.image_path for c in direct.cameras]
    stated = json.loads(direct.source.read_text())
    assert stated["ply_file_path"] == "points.ply"
    assert all(not Path(frame["file_path"]).is_absolute() for frame in stated["frames"])


def test_photos_through_a_fisheye_that_say_no_focal_length_are_solved(tmp_path):
    """A fixed bug: no photo was found to overlap any other."""
    for number, pose in enumerate(orbit(6, 60.0, 1.5)):
        camera = box_camera(pose)
        focal = camera.width / np.radians(150)
        lens = {"lens": "opencv_fisheye", "distortion": (0.0,) * 4}
        photo = replace(camera, fx=focal, fy=focal, **lens)
        Image.fromarray(BoxScene().photo(photo)[0]).save(tmp_path / f"{number}.jpg", quality=95)
    options = "--single-camera", "--camera-model", "OPENCV_FISHEYE", "--out", tmp_path / "found"
    result = solve(tmp_path, *options)
    assert result.returncode == 0 and "6 of 6 photos have a camera" in result.stdout, result.stderr
    found = read_capture(tmp_path / "found", photos=tmp_path).cameras[0]
    assert found.lens == "opencv_fisheye" and found.fx == pytest.approx(focal, rel=0.02)


def test_sparse_points_lie_on_the_box_and_its_floor(solved):
    folder, truth, _ = solved
    capture = read_capture(folder)
    assert len(capture.points) > 500
    names = {camera.name: camera for camera in truth}
    pairs = [(c, names[c.name]) for c in capture.cameras if c.name in names]
    scale, rotation, shift = align(*(np.stack([p[i].position for p in pairs]) for i in (0, 1)))
    points = scale * capture.points @ rotation.T + shift
    near = np.abs(points[:, :2]).max(axis=1) < 0.6
    assert near.sum() > 100
    assert (points[near, 2] > -0.03).mean() > 0.95 and (points[near, 2] < 0.93).mean() > 0.95
    assert {path.name for path in (folder / "cameras" / "sparse" / "0").iterdir()} >= {
        "cameras.bin", "images.bin", "points3D.bin",
    }  # fmt: skip


def test_the_model_of_colmap_names_and_sizes_the_photos_as_they_are(solved):
    import pycolmap

    folder, _, _ = solved
    model = pycolmap.Reconstruction(folder / "cameras" / "sparse" / "0")
    names = {image.name for image in model.images.values()}
    assert "second walk/IMG 013.jpg" in names and "IMG_000.jpg" in names
    assert {(c.width, c.height) for c in model.cameras.values()} == {(480, 360)}
    assert model.compute_mean_reprojection_error() < 1.0


def test_events_tell_stages_progress_and_the_result(solved):
    folder, _, _ = solved
    lines = (folder / "cameras" / "events.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    stages = [event["name"] for event in events if event["ev"] == "stage"]
    assert stages == ["features", "matching", "mapping", "adjustment"]
    overall = [event["overall"] for event in events if event["ev"] == "progress"]
    assert overall == sorted(overall) and overall[-1] == 1.0
    assert events[-2]["ev"] == "result" and events[-2]["placed"] == 14
    assert json.loads((folder / "cameras" / "status.json").read_text())["state"] == "done"


def test_a_second_solve_into_the_same_folder_changes_nothing(solved):
    folder, _, _ = solved
    before = (folder / "cameras" / "transforms_train.json").read_bytes()
    result = solve(folder)
    assert result.returncode == 2 and "already" in result.stderr
    assert (folder / "cameras" / "transforms_train.json").read_bytes() == before


def test_plain_photos_are_named_with_the_reason(tmp_path):
    for i in range(4):
        Image.fromarray(np.full((200, 300, 3), 100 + i, np.uint8)).save(tmp_path / f"wall {i}.png")
    result = solve(tmp_path)
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    assert all(f"wall {i}.png" in result.stderr for i in range(4))
    assert "too few features" in result.stderr and "texture" in result.stderr
    assert not (tmp_path / "cameras" / "transforms_train.json").exists()


@pytest.fixture(scope="module")
def small_photos(tmp_path_factory):
    """Twelve half-size photos, and one that shows something else."""
    folder = tmp_path_factory.mktemp("small")
    write_photos(folder, orbit(12, 150.0), scale=0.6)
    noise = np.random.default_rng(0).integers(0, 255, (27, 36, 3), dtype=np.uint8)
    other = Image.fromarray(noise).resize((288, 216), Image.Resampling.BICUBIC)
    other.save(folder / "IMG_900.jpg", quality=95)
    return folder


PLAIN = f"""{QUICK}
from solver.cameras import solve
from tests.capture.code_page import plain_colmap

solve.quiet_colmap = plain_colmap
raise SystemExit(main())
"""


def test_colmap_is_told_plain_letters_wherever_photos_and_cameras_lie(small_photos, tmp_path):
    folder = tmp_path / "写真 ł"
    shutil.copytree(small_photos, folder, ignore=shutil.ignore_patterns("IMG_900.jpg"))
    result = subprocess.run(
        [sys.executable, "-c", PLAIN, "solve", str(folder)], cwd=ROOT, capture_output=True,
        text=True, encoding="utf-8", stdin=subprocess.DEVNULL, timeout=300,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert len(read_capture(folder).cameras) == 12
    assert (folder / "cameras" / "sparse" / "0" / "points3D.bin").is_file()


def begin(folder, out, command=COMMAND):
    process = subprocess.Popen(
        [*command, str(folder), "--out", str(out), "--events"], cwd=ROOT, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    wait_for(lambda: _has_features(out), process)
    return process


def _has_features(out):
    return '"text": "features: photo' in _read(out / "events.jsonl")


def _read(path):
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _descriptors(out):
    with sqlite3.connect(out / "database.db") as database:
        return dict(database.execute("SELECT image_id, data FROM descriptors"))


def test_a_killed_solve_continues_with_what_it_had_and_names_the_photo_that_fits_nowhere(
    small_photos, tmp_path
):
    out = tmp_path / "elsewhere"
    process = begin(small_photos, out, QUICK_COMMAND)
    process.kill()
    process.communicate()
    before = _descriptors(out)
    assert len(before) >= 4
    (out / "events.jsonl").unlink()
    result = solve(small_photos, "--out", out, command=QUICK_COMMAND)
    assert result.returncode == 0, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert "1 of 13 photos" in result.stderr and "IMG_900.jpg" in result.stderr
    events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    texts = [e["text"] for e in events if e["ev"] == "progress" and e["stage"] == "features"]
    assert all(int(text.split()[-1]) > len(before) for text in texts if text[-1].isdigit())
    after = _descriptors(out)
    assert len(after) == 13 and all(after[number] == data for number, data in before.items())
    assert not (out / "work").exists()
    # The photos are elsewhere: the message says so, and with them the capture reads.
    assert f"--photos {small_photos}" in result.stdout
    assert len(read_capture(out, photos=small_photos).cameras) == 12
    with pytest.raises(CaptureError, match="photos"):
        read_capture(out)


@pytest.mark.parametrize("way", ["line", "file", "hang up", "signal"])
def test_cancel_ends_a_solve_within_seconds_and_it_can_go_on(way, small_photos, tmp_path):
    out = tmp_path / "cameras"
    process = begin(small_photos, out)
    asked = time.monotonic()
    if way == "line":
        process.stdin.write('{"cmd": "cancel"}\n')
        process.stdin.flush()
    elif way == "file":
        (out / "cancel").touch()
    elif way == "signal":
        if os.name == "nt":
            pytest.skip("there it ends a process at once")
        process.send_signal(signal.SIGTERM)
    else:
        process.stdin.close()
    assert process.wait(30) == 3
    assert time.monotonic() - asked < 8
    if way != "hang up":
        assert process.stdout.read().splitlines()[-1].endswith('"exit_code": 3}')
        assert json.loads((out / "status.json").read_text())["state"] == "cancelled"
    for stream in (process.stdin, process.stdout, process.stderr):
        stream.close()
    assert not (out / "transforms_train.json").exists()
    names = photos_below(small_photos, out)
    changed = tuple((small_photos / name).stat().st_mtime_ns for name in names)
    assert SolveFolder(out).take(SolveRequest(str(small_photos), names, changed)) is True


def test_a_solve_ends_before_a_disk_is_full_and_goes_on_when_there_is_room(
    small_photos, tmp_path, monkeypatch
):
    """COLMAP would abort the process."""
    folder = SolveFolder(tmp_path / "cameras")
    request = request_of(small_photos, folder)
    folder.take(request)
    left = [1 << 40] * 3 + [70 << 20]
    with monkeypatch.context() as full:
        full.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=left.pop(0)))
        with pytest.raises(CaptureError, match="disk is full: 70 MB .* run it again to continue"):
            Solver(folder, request, Mock(), SimpleNamespace(should_stop=False)).run()
    assert not folder.work_dir.exists()
    assert folder.take(request) is True
    with sqlite3.connect(folder.database_path) as database:
        assert database.execute("select count(*) from descriptors").fetchone()[0] > 0
    assert Solver(folder, request, Mock(), SimpleNamespace(should_stop=False)).run().placed == 12


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path):
    request = SolveRequest(str(tmp_path), ("a.png", "b.png", "c.png"))
    (tmp_path / "diary").mkdir()
    (tmp_path / "diary" / "today.txt").write_text("rain")
    with pytest.raises(CaptureError, match="not empty"):
        SolveFolder(tmp_path / "diary").take(request)
    with pytest.raises(CaptureError, match="file"):
        SolveFolder(tmp_path / "diary" / "today.txt").take(request)
    assert [path.name for path in (tmp_path / "diary").iterdir()] == ["today.txt"]


def test_a_folder_that_was_only_looked_at_is_an_empty_one(tmp_path):
    (tmp_path / ".DS_Store").touch()
    assert SolveFolder(tmp_path).take(SolveRequest("/photos", ("a.png", "b.png", "c.png"))) is False


def test_an_unfinished_solve_begins_anew_when_photos_were_added(tmp_path):
    folder = SolveFolder(tmp_path / "cameras")
    assert folder.take(SolveRequest("/photos", ("a.png", "b.png", "c.png"))) is False
    folder.database_path.write_text("old")
    assert folder.take(SolveRequest("/photos", ("a.png", "b.png", "c.png"))) is True
    assert folder.database_path.exists()
    assert folder.take(SolveRequest("/photos", ("a.png", "b.png", "c.png", "d.png"))) is False
    assert not folder.database_path.exists()
    with pytest.raises(CaptureError, match="other photos"):
        folder.take(SolveRequest("/elsewhere", ("a.png", "b.png", "c.png")))


def test_photos_are_ordered_as_people_count_and_masks_are_none(tmp_path):
    for name in ("IMG_10.jpg", "IMG_2.jpg", "IMG_1.png", "masks/IMG_1.png", "cameras/x.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.new("RGB", (4, 4)).save(tmp_path / name)
    names = photos_below(tmp_path, tmp_path / "cameras")
    assert names == ("IMG_1.png", "IMG_2.jpg", "IMG_10.jpg")
    roundabout = tmp_path / "masks" / ".."
    assert photos_below(roundabout, roundabout / "cameras") == names
    with pytest.raises(CaptureError, match="at least 3"):
        photos_below(tmp_path / "masks", tmp_path / "cameras")
    with pytest.raises(CaptureError, match="no such folder"):
        photos_below(tmp_path / "nowhere", tmp_path)


def photos_at(folder):
    folder.mkdir()
    for number in range(3):
        Image.new("RGB", (32, 32)).save(folder / f"IMG_{number}.png")
    return folder


@pytest.mark.parametrize("given", ["--masks", "--ignore", "a photo that is cut off"])
def test_a_solve_that_cannot_begin_leaves_nothing(given, tmp_path):
    photos = photos_at(tmp_path / "photos")
    (tmp_path / "empty").mkdir()
    if given.startswith("--"):
        options = [given, tmp_path / "empty"]
    else:
        options, photo = [], photos / "IMG_1.png"
        photo.write_bytes(photo.read_bytes()[:-30])
    result = solve(photos, *options)
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    assert ("IMG_1.png" if not options else "empty") in result.stderr
    assert sorted(path.name for path in photos.iterdir()) == ["IMG_0.png", "IMG_1.png", "IMG_2.png"]
    (photos / "cameras").mkdir()
    assert solve(photos, *options).returncode == 2
    assert list((photos / "cameras").iterdir()) == []


def test_a_folder_of_masks_is_no_folder_of_photos_and_has_to_fit_them(tmp_path):
    photos = photos_at(tmp_path / "photos")
    masks = photos / "silhouettes"
    masks.mkdir()
    Image.new("L", (32, 32)).save(masks / "other.png")
    result = solve(photos, "--masks", masks, "--out", tmp_path / "cameras")
    assert result.returncode == 2
    assert "silhouettes, masks: no mask there has a photo's name; name masks like" in result.stderr
    (masks / "other.png").rename(masks / "IMG_1.png")
    result = solve(photos, "--masks", masks, "--out", tmp_path / "cameras")
    assert "no mask for 2 of 3 photos (IMG_0.png, IMG_2.png)" in result.stderr
    assert photos_below(photos, None, masks) == ("IMG_0.png", "IMG_1.png", "IMG_2.png")


def test_cameras_are_not_written_where_the_photos_lie(tmp_path):
    photos = photos_at(tmp_path / "photos")
    for out in (photos, tmp_path):
        result = solve(photos, "--out", out)
        assert result.returncode == 2 and "the photos are in this folder" in result.stderr


def test_a_folder_that_may_not_be_read_is_told_as_that(tmp_path, monkeypatch):
    """As macOS does with Documents and Downloads for a program that it has not allowed there."""

    def denied(path="."):
        raise PermissionError(1, "Operation not permitted", str(path))

    monkeypatch.setattr(os, "listdir", denied)
    monkeypatch.setattr(os, "scandir", denied)
    with pytest.raises(CaptureError, match=r"cannot be read \(Operation not permitted\)"):
        photos_below(tmp_path)


def test_raw_and_heic_photos_with_copies_in_another_folder_are_not_taken_twice(tmp_path):
    originals = ("IMG_0.HEIC", "IMG_1.DNG", "IMG_2.heic")
    for name in (*originals, "JPEG/IMG_0.jpg", "JPEG/img_1.JPG", "JPEG/IMG_2.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(
        CaptureError,
        match="3 photos seem to be there twice, such as IMG_0.HEIC and IMG_0.jpg; give the",
    ):
        photos_below(tmp_path)
    assert len(photos_below(tmp_path / "JPEG")) == 3
    assert photos_below(tmp_path, tmp_path / "JPEG") == originals
    (tmp_path / "JPEG/img_1.JPG").unlink()
    with pytest.raises(CaptureError, match="2 photos seem to be there twice"):
        photos_below(tmp_path)
    (tmp_path / "JPEG/IMG_2.png").unlink()
    assert len(photos_below(tmp_path)) == 4, "one of three: its name may be chance"


def test_photos_of_the_same_names_in_two_folders_are_not_copies_if_all_are_developed(tmp_path):
    names = tuple(f"{day}/IMG_{number}.jpg" for day in ("day 1", "day 2") for number in range(2))
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert photos_below(tmp_path) == names


def test_few_photos_are_all_compared_and_many_in_number_proportional_to_them():
    assert len(pairs_of(40, "auto")) == 40 * 39 / 2
    for count in (2, 3, 130, 1000):
        pairs = pairs_of(count, "sequential")
        assert len(set(pairs)) == len(pairs) <= 25 * count + 400
        assert all(0 <= i < j < count for i, j in pairs)
        assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)
    assert (0, 999) in pairs_of(1000, "auto")


def test_each_reason_for_an_unplaced_photo_has_its_own_words():
    evidence = [Evidence(f"good{i}", 2000, (200, 300)) for i in range(6)]
    evidence += [Evidence("plain", 20), Evidence("alone", 1800), Evidence("weak", 1500, (16, 18))]
    evidence += [Evidence("apart", 1900, (90,))]
    problem, remedy = unplaced(evidence, {f"good{i}" for i in range(6)})
    assert problem.startswith("4 of 10 photos")
    for text in ("plain – too few features", "alone – no overlap", "weak – too few matches",
                 "apart – matches, but"):  # fmt: skip
        assert text in problem
    assert "take smaller steps" in remedy and "sharp" in remedy
    assert unplaced(evidence[:6], {f"good{i}" for i in range(6)}) == ("", "")
    many = [Evidence(f"p{i}", 0) for i in range(9)]
    assert "and 3 more" in unplaced(many, set())[0]


@pytest.mark.parametrize(
    "model, count, remedy",
    [
        ("OPENCV", 8, "set Lens Model to Simple Radial (--camera-model SIMPLE_RADIAL)."),
        ("SIMPLE_RADIAL", 4, "take more photos, from more sides."),
    ],
)
def test_a_lens_that_is_nonsense_is_told_with_a_way_out_for_blender_and_the_command_line(
    model, count, remedy
):
    assert model in CAMERA_MODELS
    camera = SimpleNamespace(model_name=model, params=[np.nan] * count)
    photo = SimpleNamespace(path=Path("a.jpg"), name="a.jpg", width=8, height=6, ignored=None)
    with pytest.raises(CaptureError) as error:
        _camera(photo, SimpleNamespace(camera=camera))
    assert str(error.value).endswith(f"could not be solved from these photos; {remedy}")


def test_what_is_masked_is_left_out_with_a_border(tmp_path):
    pixels = np.full((60, 80, 4), 200, np.uint8)
    pixels[:, :40, 3] = 0
    for i in range(3):
        Image.fromarray(pixels).save(tmp_path / f"{i}.png")
    (tmp_path / "masks").mkdir()
    mask = np.zeros((60, 80), np.uint8)
    mask[:30] = 255
    Image.fromarray(mask).save(tmp_path / "masks" / "1.png")
    names = ("0.png", "1.png", "2.png")
    first, second, _ = look_at(tmp_path, names, tmp_path / "masks", 80)
    (tmp_path / "p").mkdir()
    (tmp_path / "m").mkdir()
    for photo in (first, second):
        write_prepared(photo, tmp_path / "p", tmp_path / "m")
    inside = np.asarray(Image.open(tmp_path / "m" / "000001.png.png")) > 0
    assert not inside[:, :42].any() and inside[5:-5, 46:70].all()
    both = np.asarray(Image.open(tmp_path / "m" / "000002.png.png")) > 0
    assert not both[30:].any() and not both[:, :42].any() and both[5:20, 50:70].all()


@pytest.mark.parametrize("tag", [1, 2, 3, 4, 6, 8])
def test_features_are_sought_in_photos_turned_as_a_fit_turns_them(tmp_path, tag):
    exif = Image.Exif()
    exif[0x0112] = tag
    noise = np.random.default_rng(0).integers(0, 255, (6, 8), np.uint8).repeat(8, 0).repeat(8, 1)
    Image.fromarray(noise).save(tmp_path / "a.jpg", exif=exif, quality=98)
    photo = look_at(tmp_path, ("a.jpg",), None, 64)[0]
    write_prepared(photo, tmp_path, tmp_path)
    sought = np.asarray(Image.open(tmp_path / "000001.png")).astype(float)
    fitted = as_camera_saw(noise, tag, photo.width, photo.height)
    assert sought.shape == fitted.shape and np.abs(sought - fitted).mean() < 3


def test_large_photos_are_reduced_and_their_focal_length_is_read(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 8
    exif.get_ifd(0x8769)[0xA405] = 27
    picture = Image.new("RGB", (400, 300), (80, 90, 100))
    for i in range(3):
        picture.save(tmp_path / f"{i}.jpg", exif=exif)
    photo = look_at(tmp_path, ("0.jpg",), None, 200)[0]
    assert (photo.width, photo.height) == (300, 400)
    assert (photo.small_width, photo.small_height) == (150, 200)
    assert photo.focal == pytest.approx(27 / 36 * 400)
    (tmp_path / "p").mkdir()
    write_prepared(photo, tmp_path / "p", tmp_path)
    assert Image.open(tmp_path / "p" / "000001.png").size == (150, 200)
    assert not (tmp_path / "000001.png.png").exists()


def test_small_photos_are_enlarged_but_never_beyond_what_was_asked_for(tmp_path):
    for name, size in (("tiny", (120, 90)), ("small", (400, 300)), ("large", (1000, 500))):
        Image.new("RGB", size, (90, 90, 90)).save(tmp_path / f"{name}.png")
    names = ("tiny.png", "small.png", "large.png")

    def sought(longest):
        found = look_at(tmp_path, names, None, longest)
        return [(photo.small_width, photo.small_height) for photo in found]

    assert sought(1600) == [(480, 360), (800, 600), (1000, 500)]
    assert sought(600) == [(480, 360), (600, 450), (600, 300)]
