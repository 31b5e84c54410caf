"""Photos of a video: the sharpest of each part, all or none; and cameras from them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage
from PIL import Image

from solver.cameras.folder import SolveFolder, photos_below
from solver.cameras.video_photos import CANDIDATES, FEWEST_FRAMES, sharpest, take_photos
from solver.capture.decoding import read_exr
from solver.capture.errors import CaptureError
from solver.capture.read import read_capture
from solver.capture.video import frames
from solver.job.control import Cancelled
from tests.cameras.box_scene import BoxScene, align, box_camera, orbit
from tests.capture.videos import plain, write_video

ROOT = Path(__file__).resolve().parents[2]


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "solver", *map(str, arguments)], cwd=ROOT, text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=300,
    )  # fmt: skip


def solve(*arguments):
    return run("solve", *arguments)


def _blurred(picture):
    return scipy.ndimage.uniform_filter(picture, (1, 9, 0))


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A walk around the box in 42 frames, of which every third from the second on is sharp."""
    scene, poses = BoxScene(), orbit()
    cameras = [box_camera(pose, f"frame_{3 * i + 1:06d}") for i, pose in enumerate(poses)]
    pictures = []
    for camera in cameras:
        picture = scene.photo(camera)[0]
        pictures += [_blurred(picture), picture, _blurred(picture)]
    folder = tmp_path_factory.mktemp("a walk")
    return write_video(folder / "Walk ü.mp4", pictures), cameras


def test_the_sharpest_frame_of_each_part_is_taken(walk):
    video, cameras = walk
    found = list(sharpest(video, len(cameras)))
    assert [frame.number for _, frame in found] == [3 * i + 1 for i in range(len(cameras))]
    shares = [share for share, _ in found]
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_parts_are_equal_and_few_frames_of_each_are_looked_at(tmp_path, monkeypatch):
    noise = np.random.default_rng(0).integers(0, 255, (120, 32, 32, 3), dtype=np.uint8)
    video = write_video(tmp_path / "a.mp4", list(noise))
    looked = []
    monkeypatch.setattr(
        "solver.cameras.video_photos._sharpness", lambda frame: looked.append(frame.number) or 0.0
    )
    numbers = [frame.number for _, frame in sharpest(video, 4)]
    assert [number // 30 for number in numbers] == [0, 1, 2, 3]
    assert len(looked) == 4 * CANDIDATES


def test_photos_of_a_span_are_named_by_the_clock_and_are_the_sharpest_in_it(walk, tmp_path):
    pictures = [frame.pixels() for frame in frames(walk[0])]
    # Nothing was recorded from 6 to 9.
    ticks = [*range(6), *range(10, 10 + len(pictures) - 6)]
    video = write_video(tmp_path / "a.mp4", pictures, ticks=ticks)
    names = take_photos(video, tmp_path / "photos", 4, lambda share, text: None, range(11, 23))
    assert names == tuple(f"frame_{number:06d}.jpg" for number in (11, 14, 17, 20))


def test_a_video_that_records_only_every_other_frame_at_times_has_photos_in_any_span(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (80, 32, 32, 3), dtype=np.uint8)
    ticks = [*range(40), *range(41, 121, 2)]
    video = write_video(tmp_path / "a.mp4", list(noise), ticks=ticks)
    for first in (50, 51):
        found = [frame.number for _, frame in sharpest(video, 6, range(first, first + 60))]
        assert len(found) == 6 and set(found) < set(ticks)


def test_all_frames_of_a_span_are_taken_if_that_many_are_asked_for(walk):
    taken = [frame.number for _, frame in sharpest(walk[0], 100, range(5, 12))]
    assert taken == list(range(5, 12))


def test_the_command_frames_takes_photos_and_leaves_nothing_when_it_cannot(walk, tmp_path):
    made = run("frames", walk[0], "--out", tmp_path / "a", "--photos", 5, "--span", 3, 20)
    assert made.returncode == 0 and "5 photos in" in made.stdout
    assert len(list((tmp_path / "a").iterdir())) == 5
    again = run("frames", walk[0], "--out", tmp_path / "a")
    assert again.returncode == 2 and "it already exists; give a new folder" in again.stderr
    empty = run("frames", walk[0], "--out", tmp_path / "b", "--span", 90, 99)
    assert empty.returncode == 2 and "too short" in empty.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_short_video_gives_no_more_photos_than_it_has_views(tmp_path):
    video = write_video(tmp_path / "a.mp4", [plain((i, 90, 90)) for i in range(30)])
    names = take_photos(video, tmp_path / "photos", 100, lambda done, text: None)
    assert len(names) == 30 // FEWEST_FRAMES


def test_two_frames_are_no_walk(tmp_path):
    video = write_video(tmp_path / "a.mp4", [plain((90, 90, 90))] * 2)
    with pytest.raises(CaptureError, match="too short"):
        take_photos(video, tmp_path / "photos", 100, lambda done, text: None)
    assert not (tmp_path / "photos").exists()


def test_photos_are_there_all_or_not_at_all_and_are_not_taken_twice(walk, tmp_path):
    video, _ = walk
    folder = tmp_path / "photos"

    def stop(done, text):
        if done > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        take_photos(video, folder, 14, stop)
    assert not folder.exists()
    names = take_photos(video, folder, 14, lambda done, text: None)
    assert len(names) == 14 and [path.name for path in tmp_path.iterdir()] == ["photos"]
    (folder / ".DS_Store").write_bytes(b"of the system's, in folders that somebody looked at")
    before = (folder / names[0]).stat().st_mtime_ns
    assert take_photos(video, folder, 14, stop) == names
    assert (folder / names[0]).stat().st_mtime_ns == before


def test_who_cancels_is_told_so_even_if_a_photo_is_held_by_somebody(walk, tmp_path, monkeypatch):
    video, _ = walk

    def held(*args, **kwargs):
        raise PermissionError(13, "Access is denied")

    def cancelled(done, text):
        monkeypatch.setattr(os, "unlink", held)
        raise Cancelled

    with pytest.raises(Cancelled):
        take_photos(video, tmp_path / "photos", 14, cancelled)
    monkeypatch.undo()
    assert len(take_photos(video, tmp_path / "photos", 14, lambda *told: None)) == 14


def test_an_hdr_video_gives_linear_photos_brighter_than_white(tmp_path):
    picture = np.full((48, 64, 3), round(0.75 * 65535), np.uint16)
    picture[:24] = round(0.95 * 65535)
    video = write_video(tmp_path / "a.mp4", [picture] * 9, matrix=9, said=9, transfer=18, primaries=9)
    names = take_photos(video, tmp_path / "photos", 3, lambda done, text: None)
    colour, alpha = read_exr(tmp_path / "photos" / names[0])
    assert alpha is None and names[0].endswith(".exr")
    assert np.allclose(colour[40], 1, atol=0.05)
    assert colour[4].min() > 2.5


def test_cameras_of_a_video_are_the_true_ones_and_read_as_a_capture(walk):
    video, truth = walk
    result = solve(video, "--video-photos", 14)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    folder = video.parent / "Walk ü cameras"
    assert result.stdout.splitlines()[-1] == str(folder / "transforms_train.json")
    assert "--photos" not in result.stdout
    capture = read_capture(folder)
    assert len(capture.cameras) == 14 and capture.warnings == ()
    stated = json.loads((folder / "transforms_train.json").read_text())
    assert all((folder / frame["file_path"]).is_file() for frame in stated["frames"])
    by_name = {camera.image_path.stem: camera for camera in capture.cameras}
    found = np.stack([by_name[camera.name].position for camera in truth])
    positions = np.stack([camera.position for camera in truth])
    scale, rotation, shift = align(found, positions)
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    moved = scale * found @ rotation.T + shift
    assert np.linalg.norm(moved - positions, axis=1).max() < 0.02 * size
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    stages = [event["name"] for event in events if event["ev"] == "stage"]
    assert stages == ["video", "features", "matching", "mapping", "adjustment"]
    overall = [event["overall"] for event in events if event["ev"] == "progress"]
    assert overall == sorted(overall) and overall[-1] == 1.0


def test_another_number_of_photos_is_taken_anew(walk, tmp_path):
    from solver.cameras.command import request_of

    video, _ = walk
    folder = SolveFolder(tmp_path / "cameras")
    assert not folder.take(request_of(video, folder, video_photos=14))
    folder.video_photos_dir.mkdir()
    assert folder.take(request_of(video, folder, video_photos=14))
    assert folder.video_photos_dir.exists()
    assert not folder.take(request_of(video, folder, video_photos=7))
    assert not folder.video_photos_dir.exists()


@pytest.mark.parametrize("count", ["2", "1001"])
def test_an_impossible_number_of_photos_is_refused_before_anything_is_written(walk, count, tmp_path):
    result = solve(walk[0], "--video-photos", count, "--out", tmp_path / "cameras")
    assert result.returncode == 2 and "3 to 1000" in result.stderr
    assert not (tmp_path / "cameras").exists()


@pytest.mark.parametrize("option", ["--masks", "--ignore"])
def test_pictures_that_need_names_of_photos_are_refused_before_these_are_taken(walk, option, tmp_path):
    (tmp_path / "hands").mkdir()
    Image.new("L", (32, 32)).save(tmp_path / "hands" / "frame_000001.png")
    result = solve(walk[0], option, tmp_path / "hands", "--out", tmp_path / "cameras")
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    assert "a video's photos have no" in result.stderr
    assert "solve a folder of photos" in result.stderr
    assert not (tmp_path / "cameras").exists()


def test_one_picture_for_all_photos_of_a_video_is_taken(walk, tmp_path):
    from solver.cameras.command import request_of

    Image.new("L", (32, 32)).save(tmp_path / "leg.png")
    given = str(tmp_path / "leg.png")
    assert request_of(walk[0], SolveFolder(tmp_path / "cameras"), ignored=given).ignored == given


def test_a_folder_with_only_a_video_names_it(tmp_path):
    (tmp_path / "Walk ü.MOV").write_bytes(b"")
    with pytest.raises(CaptureError, match="give the video itself, Walk ü.MOV"):
        photos_below(tmp_path, tmp_path / "cameras")


def test_a_file_that_is_no_video_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("no")
    result = solve(tmp_path / "notes.txt")
    assert (
        result.returncode == 2 and "not a known kind of video" in result.stderr and ".mp4" in result.stderr
    )
    (tmp_path / "a.mp4").write_text("no")
    result = solve(tmp_path / "a.mp4")
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    assert "cannot be read" in result.stderr
    assert not (tmp_path / "a cameras").exists()


def test_a_reconstruction_of_a_video_says_that_cameras_come_first(walk):
    with pytest.raises(CaptureError, match="solve its cameras first"):
        read_capture(walk[0])
