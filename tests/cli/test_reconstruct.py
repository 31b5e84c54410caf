"""A tiny reconstruction as a person starts it, of captures of every kind."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageFilter

from solver.capture.formats.transforms import write_transforms
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.photos import linear_to_srgb
from tests.capture.far_scene import far_scene
from tests.capture.printed_table import camera_at, shaken, write_table
from tests.cli.command import DUCK, ROOT, TINY, solver


def test_the_result_holds_all_that_the_manifest_names(job):
    manifest = json.loads((job / "result" / "manifest.json").read_text())
    files = [manifest["mesh"], manifest["environment"]["file"], manifest["glb"]]
    files += [entry["file"] for entry in manifest["textures"].values()]
    files += list(manifest["report"].values())
    for name in files:
        assert (job / "result" / name).stat().st_size > 50, name
    kinds = [json.loads(line)["ev"] for line in (job / "events.jsonl").read_text().splitlines()]
    assert kinds[0] == "hello" and kinds[-1] == "bye" and "result" in kinds and "checkpoint" in kinds
    assert json.loads((job / "status.json").read_text())["state"] == "done"


def test_a_warning_is_told_off_a_terminal_and_every_warning_of_a_job_is_in_its_report(job, tmp_path):
    again = shutil.copytree(job, tmp_path / "job")
    shutil.rmtree(again / "result")
    request = json.loads((again / "job.json").read_text())
    (again / "job.json").write_text(json.dumps(request | {"device": "mps"}))
    before = '{"v": 1, "t": 1.0, "ev": "warning", "text": "a & b are blurred"}\n'
    with (again / "events.jsonl").open("a") as events:
        events.write(2 * before)
    result = solver("run", again)
    assert result.returncode == 0
    now = "this machine has no 'mps'; the job continues on 'cpu'"
    assert result.stderr == f"Warning: {now}.\n"
    report = json.loads((again / "result" / "report.json").read_text())
    assert report["warnings"] == ["a & b are blurred", now]
    page = (again / "result" / "report.html").read_text()
    assert page.count("<li>a &amp; b are blurred.</li>") == 1
    assert "<ul>" not in (job / "result" / "report.html").read_text()


def test_a_report_says_why_it_does_not_show_photos_that_were_held_out(job, tmp_path, duck):
    again, duck = shutil.copytree(job, tmp_path / "job"), shutil.copytree(duck, tmp_path / "duck")
    shutil.rmtree(again / "result")
    (duck / "transforms_test.json").write_text("{}")
    request = json.loads((again / "job.json").read_text())
    (again / "job.json").write_text(json.dumps(request | {"capture": str(duck)}))
    result = solver("run", again)
    assert result.returncode == 0, result.stderr
    report = json.loads((again / "result" / "report.json").read_text())
    (warning,) = report["warnings"]
    assert "held-out photos cannot be shown" in warning and "transforms_test.json" in warning
    assert any("training photos" in name for name in report)
    before = json.loads((job / "result" / "report.json").read_text())
    assert before["warnings"] == [] and any("held-out views" in name for name in before)


def test_the_paper_preset_goes_all_the_way_and_keeps_its_neural_term(cameras, tmp_path, duck):
    small = [
        "--set",
        "fit.samples=20000",
        "--set",
        "fit.warm_up=5",
        "--set",
        "fit.preview_every=999",
    ]
    small += ["--set", "fit.secondary_samples=20000", "--set", "render.min_weight=0.01"]
    # Masks make it a quick fit; from fog, as the preset has it: tests/fit/test_method.py.
    small += ["--set", "fit.use_masks=yes", "--set", "field.hull_start=yes"]
    root = tmp_path / "job"
    sizes = [*TINY, "--set", "fit.steps=60", *small]
    result = solver("reconstruct", duck, "--out", root, "--preset", "paper", *sizes)
    assert result.returncode == 0, result.stderr
    scores = []
    for extra in ([], ["--without-neural"]):
        out = tmp_path / f"metrics{len(extra)}.json"
        result = solver("evaluate", root, "--cameras", cameras, "--rays", 4, "--out", out, *extra)
        assert result.returncode == 0, result.stderr
        scores.append(json.loads(out.read_text())["mean"]["psnr"])
    assert scores[0] > scores[1] > 5


def test_snapshots_are_laid_side_by_side(tmp_path, duck):
    root = tmp_path / "job"
    result = solver("reconstruct", duck, "--out", root, *TINY, "--set", "fit.snapshots=1,10,24")
    assert result.returncode == 0, result.stderr
    names = {path.name for path in (root / "snapshots").iterdir()}
    assert {"snapshots.png", "render_000010.png", "weights_000024.png"} <= names


def test_blenders_way_of_starting_finds_points_in_photos_without_masks(tmp_path):
    write_table(tmp_path, [camera_at(angle) for angle in np.linspace(0, 1.2, 6)])
    command = [sys.executable, "-I", ROOT / "solver" / "bootstrap.py", "reconstruct"]
    command += [tmp_path / "transforms.json", "--out", tmp_path / "job", *TINY]
    command += ["--set", "fit.steps=2"]
    subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, timeout=300, check=False)
    events = [json.loads(line) for line in (tmp_path / "job" / "events.jsonl").read_text().splitlines()]
    assert "fit" in [event.get("name") for event in events if event["ev"] == "stage"]
    assert not [event["text"] for event in events if event["ev"] == "warning"]
    assert max(e["fraction"] for e in events if e.get("stage") == "geometry") > 0.3


def test_cameras_that_are_off_are_adjusted_once_and_a_job_that_goes_on_keeps_them(tmp_path):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]
    file = write_table(tmp_path, cameras, told=shaken(cameras, 0.7, 0.01))
    arguments = ["reconstruct", file, "--out", tmp_path / "job", *TINY, "--set", "fit.steps=2"]
    first = solver(*arguments)
    assert "photos and cameras disagreed by" in first.stderr
    assert ", so cameras were adjusted" in first.stderr
    kept = (tmp_path / "job" / "cameras.json").read_text()
    assert set(json.loads(kept)) == {camera.name for camera in cameras}
    again = solver(*arguments, "--resume")
    assert "adjusted" not in again.stderr
    assert (tmp_path / "job" / "cameras.json").read_text() == kept
    (tmp_path / "job" / "cameras.json").write_text(kept[:100])
    broken = solver(*arguments, "--resume")
    assert broken.returncode == 2 and "cameras.json" in broken.stderr


def test_cameras_of_another_convention_end_with_what_to_do(tmp_path):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]
    turned = [replace(c, camera_to_world=pose_opengl_from_opencv(c.camera_to_world)) for c in cameras]
    file = write_table(tmp_path, cameras, told=turned)
    result = solver("reconstruct", file, "--out", tmp_path / "job", *TINY)
    assert result.returncode == 2
    assert "transforms.json" in result.stderr and "negate the second and third" in result.stderr


def write_small_photos(folder, change):
    """Every sixth photo of the sample, 50 × 50, as `change(number, image)` makes it."""
    content = json.loads((DUCK / "transforms_train.json").read_text())
    content["frames"] = content["frames"][::6]
    for number, frame in enumerate(content["frames"]):
        image = Image.open(DUCK / f"{frame['file_path']}.png").resize((50, 50))
        frame["file_path"] = f"{number}.png"
        change(number, image).save(folder / f"{number}.png")
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        content.pop(key, None)
    (folder / "transforms.json").write_text(json.dumps(content))


@pytest.mark.parametrize("level, words", [(0, None), (255, "are white too, so no masks can be made")])
def test_a_plain_backdrop_makes_masks_or_a_warning(level, words, tmp_path):
    """The sample before black, and before white with half of its photos white as well."""

    def laid_over(number, image):
        pixels = np.asarray(image).astype(float)
        alpha = pixels[..., 3:] / 255
        over = pixels[..., :3] * alpha + level * (1 - alpha)
        if level and number % 2:
            over[:, :25] = level
        return Image.fromarray(np.round(over).astype(np.uint8))

    write_small_photos(tmp_path, laid_over)
    result = solver("reconstruct", tmp_path, "--out", tmp_path / "job", *TINY)
    events = (tmp_path / "job" / "events.jsonl").read_text(encoding="utf-8")
    if words is None:
        assert result.returncode == 0, result.stderr
        state = json.loads((tmp_path / "job" / "checkpoint" / "state.json").read_text())
        assert state["use_masks"] and state["background"] == "black"
        assert '"ev": "warning"' not in events
    else:
        assert words in events


def test_what_is_to_be_ignored_is_given_kept_and_not_compared(tmp_path):
    """A black post before the object, on a part of each photo that masks know nothing of."""
    photos, given = tmp_path / "photos", tmp_path / "posts"
    photos.mkdir()
    given.mkdir()

    def with_post(number, image):
        pixels = np.asarray(image).copy()
        column = 10 + 5 * (number % 4)
        pixels[20:, column : column + 12] = (0, 0, 0, 0)
        post = np.zeros(pixels.shape[:2], np.uint8)
        post[20:, column : column + 12] = 255
        Image.fromarray(post).save(given / f"{number}.png")
        return Image.fromarray(pixels)

    write_small_photos(photos, with_post)
    scores = {}
    for name, options in (("ignoring", ("--ignore", given)), ("carved", ())):
        result = solver("reconstruct", photos, *options, "--out", tmp_path / name, *TINY)
        report = tmp_path / name / "result" / "report.json"
        # With posts that masks show as background nothing may be left in common.
        scores[name] = 0.0
        if report.is_file():
            numbers = json.loads(report.read_text())
            scores[name] = next(numbers[key] for key in numbers if key.startswith("PSNR"))
        else:
            assert result.returncode == 2 and "masks" in result.stderr, result.stderr
    assert json.loads((tmp_path / "ignoring" / "job.json").read_text())["ignored"] == str(given)
    assert scores["ignoring"] > 15 and scores["ignoring"] > scores["carved"], scores
    result = solver("reconstruct", photos, "--ignore", photos, "--out", tmp_path / "ignoring", "--resume")
    assert result.returncode == 2 and "was begun with the ignored" in result.stderr


def test_large_photos_are_made_smaller_for_fit_and_report(tmp_path):
    job = tmp_path / "job"
    result = solver(
        "reconstruct", DUCK, "--out", job, *TINY, "--set", "photos.most_pixels=2500", "--set", "fit.steps=4"
    )
    assert result.returncode == 0, result.stderr
    shown = Image.open(job / "preview" / "render.png")
    assert shown.height == 50
    manifest = json.loads((job / "result" / "manifest.json").read_text())
    assert manifest["region"]["max"][0] < 2


def test_a_limit_too_short_is_told_with_what_it_will_take_and_what_it_left(tmp_path, duck):
    result = solver(
        "reconstruct", duck, "--out", tmp_path / "job", "--time-limit", 1, *TINY,
        "--set", "fit.steps=100000",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    short, few, small = result.stderr.splitlines()
    assert "a time limit of 0:01 is too short" in short and "it will take about 0:" in short
    assert "of 100000 steps; " in few
    assert small == "Warning: because of the time limit, the report's pictures are small."


def test_photos_without_a_mask_among_others_are_told(tmp_path):
    write_small_photos(tmp_path, lambda number, image: image if number else image.convert("RGB"))
    result = solver("reconstruct", tmp_path, "--out", tmp_path / "job", *TINY)
    assert "no mask for 1 of 10 photos (0), so" in result.stderr


def test_masks_that_do_not_fit_together_are_told(tmp_path):
    def masked(number, image):
        kind = ImageFilter.MinFilter if number % 2 else ImageFilter.MaxFilter
        image.putalpha(image.getchannel("A").filter(kind(3)))
        return image

    write_small_photos(tmp_path, masked)
    result = solver("reconstruct", tmp_path, "--out", tmp_path / "job", *TINY)
    assert result.returncode == 0, result.stderr
    assert re.search(r"outlines of masks do not fit together: \d+% of the pixels along", result.stderr)
    result = solver(
        "reconstruct", tmp_path, "--out", tmp_path / "all", *TINY, "--set", "fit.doubt_outlines=no"
    )
    assert "outlines of masks" not in result.stderr


@pytest.fixture(scope="module")
def before_far(tmp_path_factory):
    """A ball before what is far away, forty photos of it and twelve more that are held out."""
    folder = tmp_path_factory.mktemp("far")
    for split, views, turn in (("train", 40, 0.0), ("test", 12, 0.4)):
        capture, photos, _ = far_scene(views, turn=turn)
        cameras = []
        for camera, photo in zip(capture.cameras, photos, strict=True):
            path = folder / split / f"{camera.name}.png"
            path.parent.mkdir(exist_ok=True)
            codes = np.round(linear_to_srgb(photo.pixels[..., :3]) * 255).astype(np.uint8)
            Image.fromarray(codes).save(path)
            cameras.append(replace(camera, image_path=path))
        write_transforms(folder / f"transforms_{split}.json", cameras)
    return folder


def test_an_object_before_what_is_far_away_is_told_from_it_fitted_resumed_and_scored(before_far, tmp_path):
    job = tmp_path / "job"
    assert solver("reconstruct", before_far, "--out", job, *TINY).returncode == 0
    state = json.loads((job / "checkpoint" / "state.json").read_text())
    assert state["use_masks"] and state["background"] == "white"
    first = (job / "surroundings.exr").read_bytes()
    report = (job / "result" / "report.json").read_text()
    shutil.rmtree(job / "result")
    resumed = solver("run", job)
    assert resumed.returncode == 0, resumed.stderr
    # The panorama is made anew, and held-out photos are cut out before it as they were.
    assert (job / "surroundings.exr").read_bytes() == first
    seconds = {"seconds"}
    again = json.loads((job / "result" / "report.json").read_text())
    assert {k: v for k, v in again.items() if k not in seconds} == {
        k: v for k, v in json.loads(report).items() if k not in seconds
    }
    test, out = before_far / "transforms_test.json", tmp_path / "metrics.json"
    assert solver("evaluate", job, "--cameras", test, "--rays", 4, "--out", out).returncode == 0
    assert json.loads(out.read_text())["mean"]["psnr"] > 15


def test_a_check_says_that_what_is_behind_an_object_is_far_away(before_far):
    result = solver("check", before_far / "transforms_train.json")
    assert result.returncode == 0
    assert "behind the object is scenery that is far away" in result.stdout
    assert "masks show the object between" in result.stdout
