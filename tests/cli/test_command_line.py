"""The command line as a person uses it: a tiny reconstruction, kill and resume, bad input."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage
from PIL import Image

from solver.asset.export import export_result
from solver.capture.photos import linear_to_srgb, read_exr
from solver.job.folder import JobError, JobFolder
from tests.capture.test_capture import make_capture, set_pose
from tests.capture.test_triangulate import camera_at, photo_of

ROOT = Path(__file__).resolve().parents[2]
DUCK = ROOT / "samples" / "duck"
TINY = [
    "--set", "fit.steps=24", "--set", "fit.rays=128", "--set", "field.sizes=24,32",
    "--set", "field.size_starts=0,0.5", "--set", "light.heights=16,32",
    "--set", "field.hull_cells=48", "--set", "field.occupancy_cells=32", "--set", "asset.cells=48",
    "--set", "asset.triangles=2000", "--set", "asset.texture_size=128",
    "--set", "fit.checkpoint_every=0.5", "--set", "render.secondary_rays=4",
]  # fmt: skip


def solver(*arguments, **options):
    command = [sys.executable, "-m", "solver", *map(str, arguments)]
    return subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=600,
        **options,
    )


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    root = tmp_path_factory.mktemp("space and ü") / "job"
    result = solver("reconstruct", DUCK, "--out", root, *TINY)
    assert result.returncode == 0, result.stderr
    # Off a terminal there is nothing but errors, and the last line names the manifest.
    assert result.stdout.splitlines() == [str(root / "result" / "manifest.json")]
    assert result.stderr == ""
    return root


def test_the_result_holds_all_that_the_manifest_names(job):
    manifest = json.loads((job / "result" / "manifest.json").read_text())
    files = [manifest["mesh"], manifest["environment"]["file"], manifest["glb"]]
    files += [entry["file"] for entry in manifest["textures"].values()]
    files += list(manifest["report"].values())
    for name in files:
        assert (job / "result" / name).stat().st_size > 100, name
    kinds = [json.loads(line)["ev"] for line in (job / "events.jsonl").read_text().splitlines()]
    assert (
        kinds[0] == "hello" and kinds[-1] == "bye" and "result" in kinds and "checkpoint" in kinds
    )
    assert json.loads((job / "status.json").read_text())["state"] == "done"


def test_a_second_job_in_the_same_folder_is_refused(job):
    result = solver("reconstruct", DUCK, "--out", job, *TINY)
    assert result.returncode == 2 and "--resume" in result.stderr


def test_render_writes_every_buffer_of_the_contract(job, tmp_path):
    content = json.loads((DUCK / "transforms_test.json").read_text())
    content["frames"] = content["frames"][:3]
    for frame in content["frames"]:
        frame["file_path"] = str(DUCK / frame["file_path"]) + ".png"
    cameras = tmp_path / "three.json"
    cameras.write_text(json.dumps(content))
    out = tmp_path / "out ö"
    result = solver("render", job, "--cameras", cameras, "--out", out, "--rays", 4)
    assert result.returncode == 0, result.stderr
    names = {path.name for path in out.iterdir()}
    suffixes = (".png", "_linear.exr", "_normal.exr", "_albedo.exr", "_roughness.exr", "_f0.exr")
    assert names == {f"r_{i}{suffix}" for i in range(3) for suffix in suffixes}
    colour, alpha = read_exr(out / "r_0_linear.exr")
    assert alpha.max() > 0.9 and (colour[alpha == 0] == 0).all()
    normal, _ = read_exr(out / "r_0_normal.exr")
    length = np.linalg.norm(normal, axis=-1)
    assert np.all((np.abs(length - 1) < 1e-3) | (length == 0))
    bright = solver(
        "render", job, "--cameras", cameras, "--out", tmp_path / "relit", "--rays", 4,
        "--environment", DUCK / "relight_sunset.exr",
    )  # fmt: skip
    assert bright.returncode == 0, bright.stderr
    other, _ = read_exr(tmp_path / "relit" / "r_0_linear.exr")
    assert np.abs(other - colour).mean() > 1e-3


@pytest.fixture(scope="module")
def cameras(tmp_path_factory):
    """Three of the sample's held-out cameras with all truth that belongs to them."""
    folder = tmp_path_factory.mktemp("few")
    content = json.loads((DUCK / "transforms_test.json").read_text())
    relit = {path.name for path in (DUCK / "relight_sunset").glob("r_*.png")}
    content["frames"] = [
        f for f in content["frames"] if Path(f["file_path"]).name + ".png" in relit
    ]
    content["frames"] = content["frames"][:3]
    for name in ("env.exr", "relight_sunset.exr", "relight_studio.exr"):
        shutil.copy(DUCK / name, folder)
    for frame in content["frames"]:
        name = Path(frame["file_path"]).name
        for part in ("test", "relight_sunset", "relight_studio"):
            (folder / part).mkdir(exist_ok=True)
            for path in (DUCK / part).glob(f"{name}[._]*"):
                shutil.copy(path, folder / part)
    path = folder / "transforms_test.json"
    path.write_text(json.dumps(content))
    return path


def test_evaluate_scores_all_that_has_a_truth_and_agrees_with_what_render_writes(
    job, cameras, tmp_path
):
    few = ["--cameras", cameras, "--rays", 8]
    result = solver("evaluate", job, *few, "--out", tmp_path / "m.json")
    assert result.returncode == 0, result.stderr
    scores = json.loads((tmp_path / "m.json").read_text())
    names = {
        "psnr", "ssim", "ms_ssim", "flip", "normal_mae", "normal_mae_masked", "albedo_mae",
        "roughness_mae", "f0_mae", "environment_relative_rmse", "environment_mae_tonemapped",
        "relight_psnr", "relight_flip",
    }  # fmt: skip
    assert names <= set(scores["mean"]) and set(scores["relight"]) == {"studio", "sunset"}
    assert "lpips" not in scores["mean"] or scores["mean"]["lpips"] < 1
    # An independent scorer: from the files that `render` writes, with nothing of ours.
    out = tmp_path / "out"
    assert solver("render", job, *few, "--out", out).returncode == 0
    psnr, mae = [], []
    for name in scores["views"]:
        photo = np.asarray(Image.open(DUCK / "test" / f"{name}.png")).astype(float) / 255
        truth = photo[..., :3] * photo[..., 3:] + 1 - photo[..., 3:]
        render = np.asarray(Image.open(out / f"{name}.png")).astype(float) / 255
        psnr.append(-10 * np.log10(((render - truth) ** 2).mean()))
        normal, expected = (
            read_exr(p)[0].astype(float)
            for p in (out / f"{name}_normal.exr", DUCK / "test" / f"{name}_normal.exr")
        )
        length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(expected, axis=-1)
        cosine = (normal * expected).sum(-1) / np.maximum(length, 1e-9)
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        angle[np.linalg.norm(normal, axis=-1) == 0] = 90
        mae.append((angle * photo[..., 3]).sum() / photo[..., 3].sum())
    assert abs(np.mean(psnr) - scores["mean"]["psnr"]) < 0.01
    assert abs(np.mean(mae) - scores["mean"]["normal_mae"]) < 0.05


def test_two_jobs_are_composed_under_another_jobs_light(job, cameras, tmp_path):
    common = ["--cameras", cameras, "--rays", 4]
    two = solver(
        "compose", job, job, "--place", "0,0,0", "--place=-1,1,0,0.5,90", "--environment", job,
        "--out", tmp_path / "two", *common,
    )  # fmt: skip
    assert two.returncode == 0, two.stderr
    assert solver("compose", job, "--out", tmp_path / "one", *common).returncode == 0
    both = read_exr(tmp_path / "two" / "r_0_linear.exr")[1]
    alone = read_exr(tmp_path / "one" / "r_0_linear.exr")[1]
    assert (both >= alone - 0.02).all() and (both > alone + 0.5).sum() > 50
    wrong = solver("compose", job, "--place", "0,0", "--out", tmp_path / "no", *common)
    assert wrong.returncode == 2 and "X,Y,Z" in wrong.stderr


def test_the_paper_preset_goes_all_the_way_and_keeps_its_neural_term(cameras, tmp_path):
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
    result = solver("reconstruct", DUCK, "--out", root, "--preset", "paper", *sizes)
    assert result.returncode == 0, result.stderr
    scores = []
    for extra in ([], ["--without-neural"]):
        out = tmp_path / f"metrics{len(extra)}.json"
        result = solver("evaluate", root, "--cameras", cameras, "--rays", 4, "--out", out, *extra)
        assert result.returncode == 0, result.stderr
        scores.append(json.loads(out.read_text())["mean"]["psnr"])
    assert scores[0] > scores[1] > 5


def test_snapshots_are_laid_side_by_side(tmp_path):
    root = tmp_path / "job"
    result = solver("reconstruct", DUCK, "--out", root, *TINY, "--set", "fit.snapshots=1,10,24")
    assert result.returncode == 0, result.stderr
    names = {path.name for path in (root / "snapshots").iterdir()}
    assert {"snapshots.png", "render_000010.png", "weights_000024.png"} <= names


def test_export_copies_the_result_and_overwrites_nothing(job, tmp_path):
    assert solver("export", job, "--out", tmp_path / "asset").returncode == 0
    assert (tmp_path / "asset" / "mesh.ply").is_file()
    assert solver("export", job, "--out", tmp_path / "asset").returncode == 2


def test_blenders_way_of_starting_finds_points_in_photos_without_masks(tmp_path):
    angles = np.linspace(0, 1.2, 6)
    rough = scipy.ndimage.gaussian_filter(np.random.default_rng(3).random((300, 300)), 1.5)
    frames = []
    for angle in angles:
        camera = camera_at(angle)
        shown = linear_to_srgb(photo_of(camera, 0.5 + 4 * (rough - 0.5)).pixels[..., :3])
        picture = Image.fromarray((255 * np.clip(shown, 0, 1)).astype(np.uint8))
        picture.save(tmp_path / f"{camera.name}.png")
        frames.append(
            {"file_path": f"{camera.name}.png", "transform_matrix": camera.camera_to_world.tolist()}
        )
    lens = {"w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy}
    lens |= {"cx": camera.cx, "cy": camera.cy, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(lens))
    command = [sys.executable, "-I", ROOT / "solver" / "bootstrap.py", "reconstruct"]
    command += [
        tmp_path / "transforms.json",
        "--out",
        tmp_path / "job",
        *TINY,
        "--set",
        "fit.steps=2",
    ]
    subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, timeout=300, check=False)
    events = [
        json.loads(line) for line in (tmp_path / "job" / "events.jsonl").read_text().splitlines()
    ]
    assert "fit" in [event.get("name") for event in events if event["ev"] == "stage"]
    assert not [event["text"] for event in events if event["ev"] == "warning"]
    assert max(e["fraction"] for e in events if e.get("stage") == "geometry") > 0.3


@pytest.mark.parametrize("level, words", [(0, None), (255, "as white, so masks cannot be made")])
def test_a_plain_backdrop_makes_masks_or_a_warning(level, words, tmp_path):
    """The sample before black, and before white with half of its photos white as well."""
    content = json.loads((DUCK / "transforms_train.json").read_text())
    content["frames"] = content["frames"][::6]
    for number, frame in enumerate(content["frames"]):
        image = Image.open(DUCK / f"{frame['file_path']}.png").resize((50, 50))
        pixels = np.asarray(image).astype(float)
        alpha = pixels[..., 3:] / 255
        over = pixels[..., :3] * alpha + level * (1 - alpha)
        if level and number % 2:
            over[:, :25] = level
        frame["file_path"] = f"{number}.png"
        Image.fromarray(np.round(over).astype(np.uint8)).save(tmp_path / f"{number}.png")
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        content.pop(key, None)
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    result = solver("reconstruct", tmp_path, "--out", tmp_path / "job", *TINY)
    events = (tmp_path / "job" / "events.jsonl").read_text(encoding="utf-8")
    if words is None:
        assert result.returncode == 0, result.stderr
        state = json.loads((tmp_path / "job" / "checkpoint" / "state.json").read_text())
        assert state["use_masks"] and state["background"] == "black"
        assert '"ev": "warning"' not in events
    else:
        assert words in events


def test_large_photos_are_made_smaller_for_fit_and_report(tmp_path):
    job = tmp_path / "job"
    result = solver(
        "reconstruct", DUCK, "--out", job, *TINY, "--set", "photos.most_pixels=2500",
        "--set", "fit.steps=4",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    shown = Image.open(job / "preview" / "render.png")
    assert shown.height == 50
    manifest = json.loads((job / "result" / "manifest.json").read_text())
    assert manifest["region"]["max"][0] < 2


def test_a_killed_job_resumes_to_the_same_kind_of_result(tmp_path):
    root = tmp_path / "job"
    long = [*TINY, "--set", "fit.steps=4000"]
    process = subprocess.Popen(
        [sys.executable, "-m", "solver", "reconstruct", DUCK, "--out", root, *long], cwd=ROOT,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for(lambda: (root / "checkpoint" / "state.json").exists(), process)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = json.loads((root / "checkpoint" / "state.json").read_text())["step"]
    assert 0 < before < 4000
    # A shorter schedule, so that the test need not wait for 4000 steps.
    state = json.loads((root / "checkpoint" / "state.json").read_text())
    state["settings"]["fit"]["steps"] = before + 5
    (root / "checkpoint" / "state.json").write_text(json.dumps(state))
    result = solver("reconstruct", DUCK, "--out", root, "--resume")
    assert result.returncode == 0, result.stderr
    assert json.loads((root / "checkpoint" / "state.json").read_text())["step"] == before + 5
    assert (root / "result" / "manifest.json").is_file()


def test_cancel_leaves_a_checkpoint_and_closing_stdin_ends_the_process(tmp_path):
    for name, hang_up in (("cancel", False), ("close", True)):
        root = tmp_path / name
        process = subprocess.Popen(
            [sys.executable, "-m", "solver", "reconstruct", DUCK, "--out", root, *TINY, "--set", "fit.steps=9000"],
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        wait_for(lambda root=root: (root / "checkpoint" / "state.json").exists(), process)
        asked = time.monotonic()
        if hang_up:
            process.stdin.close()
        else:
            process.stdin.write(b'{"cmd": "cancel"}\n')
            process.stdin.flush()
        assert process.wait(20) == 3
        if hang_up:
            # Two seconds are promised; a machine that runs other things besides gets some more.
            assert time.monotonic() - asked < 5.0
        assert (root / "checkpoint" / "scene.safetensors").is_file()
        assert not (root / "result" / "manifest.json").exists()
        for stream in (process.stdout, process.stderr):
            stream.close()


def wait_for(condition, process, seconds=300):
    until = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, f"the solver ended with {process.returncode}"
        assert time.monotonic() < until
        time.sleep(0.05)


def cut_in_half(path):
    file = make_capture(path) / "transforms_train.json"
    file.write_text(file.read_text()[: len(file.read_text()) // 2])
    return path


def without_photos(path):
    for i in range(1, 4):
        (make_capture(path) if i == 1 else path).joinpath(f"r_{i}.png").unlink()
    return path


def with_photo(path, size):
    make_capture(path, edit=lambda c: c.update(w=8, h=8))
    Image.new("RGBA", size).save(path / "r_2.png")
    return path


BAD = {
    "missing folder": lambda path: path / "nowhere",
    "empty folder": lambda path: path,
    "JSON cut in half": cut_in_half,
    "photos missing": without_photos,
    "no camera_angle_x": lambda path: make_capture(path, edit=lambda c: c.pop("camera_angle_x")),
    "singular matrix": lambda path: make_capture(
        path, edit=set_pose(np.diag([1.0, 0, 1, 1]).tolist())
    ),
    "NaN in a pose": lambda path: make_capture(
        path, edit=set_pose(np.full((4, 4), np.nan).tolist())
    ),
}
BAD_PHOTOS = {
    "a photo of another size": lambda path: with_photo(path, (9, 8)),
    "a transparent photo": lambda path: with_photo(path, (8, 8)),
}


@pytest.mark.parametrize("case", [*BAD, *BAD_PHOTOS])
def test_bad_input_ends_with_code_2_and_one_sentence(case, tmp_path):
    folder = tmp_path / "capture of ü"
    folder.mkdir()
    path = {**BAD, **BAD_PHOTOS}[case](folder)
    result = solver("reconstruct", path, "--out", tmp_path / "job")
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr
    # What is wrong with the camera file is found before a job is made.
    assert (tmp_path / "job").exists() == (case in BAD_PHOTOS)


def test_an_unknown_setting_is_named(tmp_path):
    for text in ("fit.speed=1", "nothing.at=2", "fit.steps=many", "fit"):
        result = solver("reconstruct", DUCK, "--out", tmp_path / "job", "--set", text)
        assert result.returncode == 2 and text.split("=")[0] in result.stderr
        assert not (tmp_path / "job").exists()


def test_doctor_reports():
    result = solver("doctor")
    assert result.returncode == 0 and "torch" in result.stdout and "MISSING" not in result.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "standard"], "preset 'draft', not 'standard'"), (["--seed", 3], "seed 0, not 3"),
        (["--set", "fit.steps=99"], "overrides"), (["--device", "cuda"], "device 'auto', not 'cuda'"),
    ],
)  # fmt: skip
def test_what_is_resumed_is_what_was_asked(job, options, words):
    before = (job / "job.json").read_bytes()
    result = solver("reconstruct", DUCK, "--out", job, "--resume", *options)
    assert result.returncode == 2 and words in result.stderr, result.stderr
    assert (job / "job.json").read_bytes() == before


def test_another_capture_is_not_resumed_in_this_ones_job(job, tmp_path):
    other = make_capture(tmp_path)
    result = solver("reconstruct", other, "--out", job, "--resume")
    assert result.returncode == 2 and "was begun with the capture" in result.stderr


def test_one_camera_can_be_rendered_but_never_over_its_photo(job, tmp_path):
    content = json.loads((DUCK / "transforms_test.json").read_text())
    content["frames"] = content["frames"][:1]
    (tmp_path / "test").mkdir()
    name = Path(content["frames"][0]["file_path"]).name + ".png"
    photo = shutil.copy(DUCK / "test" / name, tmp_path / "test")
    before = Path(photo).read_bytes()
    cameras = tmp_path / "transforms.json"
    cameras.write_text(json.dumps(content))
    few = ["--cameras", cameras, "--rays", 1]
    for command in (["render", job], ["compose", job]):
        result = solver(*command, *few, "--out", tmp_path / "test")
        assert result.returncode == 2 and "the photos of these cameras lie here" in result.stderr
    assert Path(photo).read_bytes() == before and len(list((tmp_path / "test").iterdir())) == 1
    assert solver("render", job, *few, "--out", tmp_path / "out").returncode == 0
    assert solver("render", job, *few, "--out", tmp_path / "out").returncode == 0


def test_cancel_is_heard_while_the_asset_is_made(tmp_path, job):
    again = tmp_path / "job"
    shutil.copytree(job, again)
    shutil.rmtree(again / "result")
    request = json.loads((again / "job.json").read_text())
    process = subprocess.Popen(
        [sys.executable, "-m", "solver", "run", str(again), "--events"], cwd=ROOT,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    for line in process.stdout:
        event = json.loads(line)
        if event["ev"] == "stage" and event["name"] == "asset":
            process.stdin.write("cancel\n")
            process.stdin.flush()
    assert process.wait(60) == 3 and request["preset"] == "draft"
    assert not (again / "result" / "manifest.json").exists()
    assert solver("reconstruct", DUCK, "--out", again, "--resume").returncode == 0


def test_numbers_that_are_none_are_told_so(job, tmp_path):
    for options, words in (
        (["--seed", "9" * 30], "whole number"), (["--time-limit", "soon"], "'soon' is no number"),
    ):  # fmt: skip
        result = solver("reconstruct", DUCK, "--out", tmp_path / "no", *options)
        assert result.returncode == 2 and words in result.stderr
    result = solver("render", job, "--cameras", DUCK, "--out", tmp_path / "no", "--rays", 0)
    assert result.returncode == 2 and "from 1 to" in result.stderr
    assert not (tmp_path / "no").exists()


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_before_a_job_begins_is_a_cancel():
    process = subprocess.Popen(
        [sys.executable, "-m", "solver", "check", str(DUCK)], cwd=ROOT, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode in (0, 3) and "Traceback" not in errors


def test_an_export_that_fails_leaves_nothing_that_looks_complete(job, tmp_path, monkeypatch):
    def full(source, target):
        target.mkdir()
        (target / "manifest.json").touch()
        raise shutil.Error([(str(source / "asset.glb"), str(target), "No space left on device")])

    monkeypatch.setattr(shutil, "copytree", full)
    with pytest.raises(
        JobError, match="asset.glb could not be written .No space left.*another folder"
    ):
        export_result(JobFolder.open(job), tmp_path / "asset")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    (tmp_path / "asset").mkdir()
    assert (export_result(JobFolder.open(job), tmp_path / "asset") / "manifest.json").is_file()
