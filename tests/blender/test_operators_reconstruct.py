"""Reconstruct, Resume, Cancel and what the person is told, by their operators."""

from __future__ import annotations

import importlib
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import bpy
import fake_capture
import pytest

ROOT = Path(__file__).resolve().parents[2]


def folder_of(scene) -> Path:
    return Path(bpy.path.abspath(scene.nmf.job))


def test_the_job_is_written_from_what_the_panel_says(capture, monitor, fake_solver, tick, tmp_path):
    settings = bpy.context.scene.nmf
    settings.preset, settings.device, settings.seed = "standard", "cpu", 7
    settings.use_time_limit, settings.time_limit, settings.exposure = True, 2.5, "gain"
    settings.turntable, settings.texture_size = "yes", "2048"
    bpy.ops.nmf.add_region_box()
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    assert settings.job.startswith("//nmf_jobs"), "the .blend and its jobs can be moved together"
    request = json.loads((folder_of(bpy.context.scene) / "job.json").read_text(encoding="utf-8"))
    assert (request["preset"], request["device"], request["seed"]) == ("standard", "cpu", 7)
    assert request["time_limit"] == 150.0
    assert request["overrides"] == {
        "fit.exposure": "gain", "light.turntable": "yes", "asset.texture_size": "2048",
    }  # fmt: skip
    assert all(low < high for low, high in zip(*request["region"].values(), strict=True))
    camera_file = Path(request["capture"])
    assert camera_file.parent == tmp_path / "nmf_jobs" / folder_of(bpy.context.scene).name / "capture"
    assert len(json.loads(camera_file.read_text(encoding="utf-8"))["frames"]) == 3
    tick()
    assert monitor.model.state == "done"


def test_what_the_panel_has_at_first_is_what_presets_say(capture, fake_solver, tick):
    bpy.ops.nmf.reconstruct()
    tick()
    request = json.loads((folder_of(bpy.context.scene) / "job.json").read_text(encoding="utf-8"))
    assert request["overrides"] == {}


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="Blender itself has no torch")
@pytest.mark.parametrize("name", ["exposure", "turntable", "texture_size"])
def test_the_solver_knows_whatever_the_panel_offers(name, package):
    overrides = importlib.import_module(f"{package.__name__}.nmf_addon.properties").chosen_overrides
    settings, offered = bpy.context.scene.nmf, []
    for item in settings.bl_rna.properties[name].enum_items:
        setattr(settings, name, item.identifier)
        offered.append(overrides(settings))
    # In a process of its own: one that has both Blender and torch may never end.
    program = (
        "import json, sys; from solver.fit.presets import DRAFT, settings_for\n"
        "found = [settings_for('draft', overrides) for overrides in json.loads(sys.argv[1])]\n"
        "assert DRAFT in found and len(set(found)) == len(found)"
    )
    command = [sys.executable, "-c", program, json.dumps(offered)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr


def test_each_reconstruction_has_a_folder_of_its_own(capture, fake_solver, tick, tmp_path):
    (tmp_path / "nmf_jobs").mkdir()
    names = []
    for _ in range(3):
        bpy.ops.nmf.reconstruct()
        tick()
        names.append(folder_of(bpy.context.scene).name)
    assert len(set(names)) == 3
    assert sorted(p.name for p in (tmp_path / "nmf_jobs").iterdir()) == sorted(names)
    assert len([item for item in bpy.data.objects if item.get("nmf_job")]) == 3


def test_without_a_saved_file_jobs_go_to_the_extensions_folder(extension, fake_solver, tick, tmp_path):
    path = fake_capture.write_capture(tmp_path / "photos")
    bpy.ops.nmf.import_capture(filepath=str(path))
    bpy.ops.nmf.reconstruct()
    folder = folder_of(bpy.context.scene)
    assert extension("names").user_folder("jobs") == folder.parent
    tick()


def test_photos_that_are_gone_are_named_and_nothing_is_written(capture, tmp_path):
    photo = next((tmp_path / "phötos of it").rglob("r_1.png"))
    photo.rename(photo.with_name("away.png"))
    with pytest.raises(RuntimeError, match="r_1.png"):
        bpy.ops.nmf.reconstruct()
    jobs = tmp_path / "nmf_jobs"
    assert not jobs.exists() or not list(jobs.iterdir())


def test_operators_explain_why_they_cannot_run(extension):
    for name, words in {
        "reconstruct": "Import a capture first", "cancel": "No job is running",
        "resume": "no job to resume", "open_report": "no finished job", "open_job_folder": "no job",
    }.items():  # fmt: skip
        with pytest.raises(RuntimeError, match=words):
            getattr(bpy.ops.nmf, name)()


def test_cancelled_resumed_done(capture, monitor, fake_solver, tick):
    fake_solver("slow")
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.model.psnr is not None)
    assert bpy.ops.nmf.cancel() == {"FINISHED"}
    assert not bpy.ops.nmf.cancel.poll(), "once is enough"
    tick()
    assert (monitor.model.state, monitor.model.resumable) == ("cancelled", True)
    assert not [item for item in bpy.data.objects if item.get("nmf_job")]
    assert bpy.ops.nmf.resume() == {"FINISHED"}
    tick()
    assert monitor.model.state == "done"
    assert len([item for item in bpy.data.objects if item.get("nmf_job")]) == 1


def test_the_error_report_has_what_is_needed_and_no_folders_of_the_person(
    part, capture, monitor, fake_solver, tick, package
):
    fake_solver("raise")
    bpy.ops.nmf.reconstruct()
    tick()
    text = sys.modules[package.__name__ + ".operators.job_files"].error_report()
    assert "ZeroDivisionError" in text and bpy.app.version_string in text and '"preset"' in text
    assert str(monitor.job.root) not in text and str(Path.home()) + "/" not in text
    request = json.loads(monitor.job.request_path.read_text(encoding="utf-8"))
    request |= {"capture": "/jäne/scan", "photos": "/jäne/photos"}
    monitor.job.request_path.write_text(json.dumps(request), encoding="utf-8")
    text = sys.modules[package.__name__ + ".operators.job_files"].error_report()
    assert '"CAPTURE"' in text and '"PHOTOS"' in text and json.dumps("jäne")[1:-1] not in text


def test_the_error_report_knows_folders_as_json_writes_them(
    capture, monitor, fake_solver, tick, package, monkeypatch
):
    """On Windows the request holds C:\\\\Users\\\\…"""
    bpy.ops.nmf.reconstruct()
    tick()
    monkeypatch.setattr(Path, "home", lambda: Path("C:\\Users\\jane"))
    request = monitor.job.request_path
    request.write_text(json.dumps({"preset": "C:\\Users\\jane\\photos"}), encoding="utf-8")
    text = sys.modules[package.__name__ + ".operators.job_files"].error_report()
    assert "photos" in text and "jane" not in text


def test_a_job_is_resumed_by_the_name_it_was_given(part, tmp_path):
    create = part("jobs.create")
    assert create.last_job_root("my duck_job", tmp_path) is None
    made = [create.new_job_root("my duck_job", tmp_path)]
    made[0].mkdir()
    assert create.last_job_root("my duck_job", tmp_path) == made[0]
    made.append(create.new_job_root("my duck_job", tmp_path))
    made[1].mkdir()
    assert create.last_job_root("my duck_job", tmp_path) == made[1] != made[0]
    for name in ("aux", "Con.blend", "lpt1"):
        assert create.new_job_root(name, tmp_path).name == f"_{name}", "a device on Windows"
    assert create.new_job_root("auxiliary", tmp_path).name == "auxiliary"
    assert create.new_job_root("long name " * 25, tmp_path).name == ("long_name_" * 6)[:-1]


def test_a_result_that_cannot_be_installed_is_told(capture, monitor, fake_solver, tick, extension):
    bpy.ops.nmf.reconstruct()
    tick(lambda: not monitor.running)
    (monitor.job.result_dir / "mesh.ply").write_bytes(b"ply")
    monitor.waits_to_install = True
    monitor.tick()
    assert monitor.model.state == "failed" and "mesh.ply" in monitor.model.error


def test_a_script_without_a_window_is_told_that_its_job_ends_with_it(capture, fake_solver, capfd):
    """A fixed bug: the job was cancelled when the script ended, without a word."""
    assert bpy.app.background and bpy.ops.nmf.reconstruct() == {"FINISHED"}
    assert "The job ends with this script" in capfd.readouterr().out
