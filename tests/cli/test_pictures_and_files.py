"""What comes of a finished job: render, compose, evaluate, export."""

import json
import shutil
import weakref
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from solver.asset.export import export_result
from solver.capture.photos import read_exr
from solver.fit import evaluate
from solver.job.folder import JobFolder
from solver.job.request import JobError
from tests.cli.command import DUCK, solver

ASSET = (
    "mesh.ply",
    "albedo.png",
    "f0.png",
    "roughness.png",
    "normal.png",
    "base_colour.png",
    "metallic.png",
    "environment.exr",
    "asset.glb",
)


def test_render_writes_every_buffer_of_the_contract(job, tmp_path, duck):
    content = json.loads((duck / "transforms_test.json").read_text())
    content["frames"] = content["frames"][:3]
    for frame in content["frames"]:
        frame["file_path"] = str(duck / frame["file_path"]) + ".png"
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
        "--environment", duck / "relight_sunset.exr",
    )  # fmt: skip
    assert bright.returncode == 0, bright.stderr
    other, _ = read_exr(tmp_path / "relit" / "r_0_linear.exr")
    assert np.abs(other - colour).mean() > 1e-3


def test_one_camera_can_be_rendered_but_never_over_its_photo(job, tmp_path, duck):
    content = json.loads((duck / "transforms_test.json").read_text())
    content["frames"] = content["frames"][:1]
    (tmp_path / "test").mkdir()
    name = Path(content["frames"][0]["file_path"]).name + ".png"
    photo = shutil.copy(duck / "test" / name, tmp_path / "test")
    before = Path(photo).read_bytes()
    cameras = tmp_path / "transforms.json"
    cameras.write_text(json.dumps(content))
    few = ["--cameras", cameras, "--rays", 1]
    for command in (["render", job], ["compose", job]):
        result = solver(*command, *few, "--out", tmp_path / "test")
        assert result.returncode == 2 and "the photos of these cameras are here" in result.stderr
    assert Path(photo).read_bytes() == before and len(list((tmp_path / "test").iterdir())) == 1
    assert solver("render", job, *few, "--out", tmp_path / "out").returncode == 0
    assert solver("render", job, *few, "--out", tmp_path / "out").returncode == 0


def test_cameras_that_never_took_a_photo_can_be_rendered_if_they_say_how_large(job, tmp_path, duck):
    content = json.loads((duck / "transforms_test.json").read_text())
    content["frames"] = [{**content["frames"][0], "file_path": "path/0001"}]
    cameras = tmp_path / "path.json"
    size = {"w": 24, "h": 16}
    cameras.write_text(json.dumps({k: v for k, v in content.items() if k not in size}))
    result = solver("render", job, "--cameras", cameras, "--rays", 1, "--out", tmp_path / "out")
    assert result.returncode == 2 and "add w and h" in result.stderr
    cameras.write_text(json.dumps({**content, **size}))
    result = solver("render", job, "--cameras", cameras, "--rays", 1, "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    with Image.open(tmp_path / "out" / "0001.png") as picture:
        assert picture.size == (24, 16)


def test_evaluate_scores_all_that_has_a_truth_and_agrees_with_what_render_writes(
    job, large_cameras, tmp_path
):
    few = ["--cameras", large_cameras, "--rays", 8]
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


def test_evaluate_keeps_no_view_it_has_scored(job, cameras, monkeypatch):
    rendered, views = evaluate.render_cameras, []

    def watched(*arguments):
        for camera, view in rendered(*arguments):
            views.append(weakref.ref(view))
            assert sum(view() is not None for view in views) <= 3
            yield camera, view

    monkeypatch.setattr(evaluate, "render_cameras", watched)
    assert evaluate.evaluate_job(JobFolder.open(job), cameras, rays=1)["mean"]["albedo_mae"] > 0
    assert len(views) == 9  # three by their own light, and by two others


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


def test_export_copies_the_result_and_overwrites_nothing(job, tmp_path):
    assert solver("export", job, "--out", tmp_path / "asset").returncode == 0
    assert (tmp_path / "asset" / "mesh.ply").is_file()
    assert solver("export", job, "--out", tmp_path / "asset").returncode == 2
    (tmp_path / "looked at").mkdir()
    (tmp_path / "looked at" / ".DS_Store").write_bytes(b"the Finder's")
    assert solver("export", job, "--out", tmp_path / "looked at").returncode == 0
    assert (tmp_path / "looked at" / "mesh.ply").is_file()


def test_an_empty_folder_that_is_exported_to_stays_the_same_folder(job, tmp_path):
    """A link, a mount or where somebody is cannot be replaced by another folder."""
    (tmp_path / "target").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "target", target_is_directory=True)
    inode = (tmp_path / "target").stat().st_ino
    assert solver("export", job, "--out", tmp_path / "link").returncode == 0
    assert (tmp_path / "link").is_symlink() and (tmp_path / "target").stat().st_ino == inode
    names = {path.name for path in (job / "result").iterdir()}
    assert {path.name for path in (tmp_path / "target").iterdir()} == names


def test_export_touches_nothing_beside_its_folder(job, tmp_path):
    (tmp_path / "asset.part").mkdir()
    (tmp_path / "asset.part" / "mine.txt").write_text("precious")
    assert solver("export", job, "--out", tmp_path / "asset").returncode == 0
    assert (tmp_path / "asset.part" / "mine.txt").read_text() == "precious"
    assert {path.name for path in tmp_path.iterdir()} == {"asset", "asset.part"}
    inside = JobFolder.open(shutil.copytree(job, tmp_path / "job")).result_dir / "copy"
    assert solver("export", tmp_path / "job", "--out", inside).returncode == 0
    assert (inside / "manifest.json").is_file() and not (inside / "copy").exists()


def test_cameras_that_changed_since_are_refused_for_a_bake_and_where_a_job_goes_on(job, duck, tmp_path):
    photos = shutil.copytree(duck, tmp_path / "photos")
    copy = shutil.copytree(job, tmp_path / "job")
    request = json.loads((copy / "job.json").read_text()) | {"capture": str(photos)}
    (copy / "job.json").write_text(json.dumps(request))
    bake = ["export", copy, "--set", "asset.texture_size=64", "--out"]
    assert solver(*bake, tmp_path / "right").returncode == 0
    file = photos / "transforms_train.json"
    content = json.loads(file.read_text())
    for frame in content["frames"]:
        x, y, *others = frame["transform_matrix"]
        frame["transform_matrix"] = [[-number for number in y], x, *others]
    file.write_text(json.dumps(content))
    (copy / "result" / "manifest.json").rename(copy / "manifest.json")
    results = [solver("run", copy)]
    (copy / "manifest.json").rename(copy / "result" / "manifest.json")
    results.append(solver(*bake, tmp_path / "wrong"))
    for result in results:
        assert result.returncode == 2 and len(result.stderr.splitlines()) == 1
        assert "Cameras stand elsewhere than when the job began (r_" in result.stderr
    assert not (tmp_path / "wrong").exists()


def test_a_capture_that_was_moved_is_taken_up_once_it_is_the_jobs_own(job, duck, tmp_path):
    before, now = tmp_path / "before", tmp_path / "now"
    copy = shutil.copytree(job, tmp_path / "job")
    request = json.loads((copy / "job.json").read_text()) | {"capture": str(before)}
    (copy / "job.json").write_text(json.dumps(request))
    shutil.copytree(duck, now)
    resumed = ("--out", copy, "--resume")
    few = shutil.copytree(duck, tmp_path / "few")
    moved = shutil.copytree(duck, tmp_path / "moved")
    content = json.loads((duck / "transforms_train.json").read_text())
    for frame in content["frames"]:
        frame["transform_matrix"][0][3] += 0.1
    (moved / "transforms_train.json").write_text(json.dumps(content))
    content["frames"] = content["frames"][:-2]
    (few / "transforms_train.json").write_text(json.dumps(content))
    for folder, problem in (
        (few, "18 photos, and the job began with 20"),
        (moved, "stand elsewhere"),
    ):
        refused = solver("reconstruct", folder, *resumed)
        assert refused.returncode == 2 and problem in refused.stderr
        assert json.loads((copy / "job.json").read_text()) == request
    assert solver("reconstruct", now, *resumed).returncode == 0
    assert json.loads((copy / "job.json").read_text())["capture"] == str(now)
    bake = ("export", copy, "--set", "asset.texture_size=64", "--out", tmp_path / "asset")
    assert solver(*bake).returncode == 0


def test_export_bakes_anew_what_a_setting_changes_and_nothing_else(job, tmp_path):
    before = {path: path.read_bytes() for path in job.rglob("*") if path.is_file()}
    few, same = tmp_path / "few", tmp_path / "same"
    some = ["--set", "asset.triangles=300", "--set", "asset.texture_size=64"]
    result = solver("export", job, "--out", few, *some)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"{few}\n" and result.stderr == ""
    manifest = json.loads((few / "manifest.json").read_text())
    assert Image.open(few / manifest["textures"]["albedo"]["file"]).size == (64, 64)
    assert len(trimesh.load(few / manifest["mesh"]).faces) <= 300
    files = {path.name for path in few.iterdir()}
    assert files == {"manifest.json", *ASSET} and "report" not in manifest
    assert manifest["region"] == json.loads(before[job / "result" / "manifest.json"])["region"]
    assert solver("export", job, "--out", same, "--set", "asset.triangles=2000").returncode == 0
    for name in ASSET:
        assert (same / name).read_bytes() == before[job / "result" / name], name
    assert {path: path.read_bytes() for path in job.rglob("*") if path.is_file()} == before


def test_what_cannot_be_baked_anew_is_told(job, tmp_path):
    def refused(root, setting):
        result = solver("export", root, "--out", tmp_path / "asset", "--set", setting)
        assert result.returncode == 2 and len(result.stderr.splitlines()) == 1
        assert not (tmp_path / "asset").exists()
        return result.stderr

    assert "only the asset's can be changed" in refused(job, "fit.steps=9")
    assert "8 or more" in refused(job, "asset.cells=2")
    unfinished = tmp_path / "unfinished"
    unfinished.mkdir()
    shutil.copy(job / "job.json", unfinished)
    shutil.copytree(job / "checkpoint", unfinished / "checkpoint")
    assert "no complete result yet; resume it" in refused(unfinished, "asset.cells=64")


def test_an_export_that_fails_leaves_nothing_that_looks_complete(job, tmp_path, monkeypatch):
    def full(source, target, **_):
        target.mkdir()
        (target / "manifest.json").touch()
        raise shutil.Error([(str(source / "asset.glb"), str(target), "No space left on device")])

    monkeypatch.setattr(shutil, "copytree", full)
    with pytest.raises(JobError, match="asset.glb could not be written .No space left.*another folder"):
        export_result(JobFolder.open(job), tmp_path / "asset")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    (tmp_path / "asset").mkdir()
    assert (export_result(JobFolder.open(job), tmp_path / "asset") / "manifest.json").is_file()


def test_scores_are_not_written_to_a_folder(job, cameras, tmp_path):
    result = solver("evaluate", job, "--cameras", cameras, "--out", tmp_path)
    assert result.returncode == 2 and "this is a folder; name a file" in result.stderr
