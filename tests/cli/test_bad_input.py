"""Input that cannot be used: code 2 and one sentence. And what the machine can do."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from solver import cli, doctor
from solver.arguments import unpack_archives
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from tests.capture.test_capture import make_capture, set_pose
from tests.cli.command import ROOT, solver


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


def with_photo_cut_off(path):
    make_capture(path)
    photo = path / "r_2.png"
    photo.write_bytes(photo.read_bytes()[:-30])
    return path


def archive_that_is_cut_off(path):
    file = Path(shutil.make_archive(str(path / "scan"), "zip", make_capture(path / "o")))
    shutil.rmtree(path / "o")
    file.write_bytes(file.read_bytes()[:-40])
    return file


def without_poses(content):
    for frame in content["frames"]:
        frame["transform_matrix"] = np.full((4, 4), np.nan).tolist()


BAD = {
    "missing folder": lambda path: path / "nowhere",
    "empty folder": lambda path: path,
    "JSON cut in half": cut_in_half,
    "photos missing": without_photos,
    "no camera_angle_x": lambda path: make_capture(path, edit=lambda c: c.pop("camera_angle_x")),
    "singular matrix": lambda path: make_capture(path, edit=set_pose(np.diag([1.0, 0, 1, 1]).tolist())),
    "NaN in all poses": lambda path: make_capture(path, edit=without_poses),
    "an archive that is cut off": archive_that_is_cut_off,
}


BAD_PHOTOS = {
    "a photo of another size": lambda path: with_photo(path, (9, 8)),
    "a transparent photo": lambda path: with_photo(path, (8, 8)),
    "a photo that is cut off": with_photo_cut_off,
}


@pytest.mark.parametrize("case", [*BAD, *BAD_PHOTOS])
def test_bad_input_ends_with_code_2_and_one_sentence_and_leaves_nothing(case, tmp_path):
    folder = tmp_path / "capture of ü"
    folder.mkdir()
    path = {**BAD, **BAD_PHOTOS}[case](folder)
    result = solver("reconstruct", path, "--out", tmp_path / "job")
    assert result.returncode == 2
    others = "Warning: ", "libpng error: "  # that library has a line of its own
    told = [line for line in result.stderr.splitlines() if not line.startswith(others)]
    assert len(told) == 1
    assert "Traceback" not in result.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["capture of ü"]


def test_an_archive_is_checked_as_its_folder_is(tmp_path):
    folder = make_capture(tmp_path / "scan ü")
    archive = shutil.make_archive(str(tmp_path / "downloads" / "scan ü"), "zip", folder)
    ours, theirs = solver("check", archive, "--json"), solver("check", folder, "--json")
    assert ours.returncode == theirs.returncode == 0
    assert ours.stdout.replace(f"downloads{os.sep}scan ü", "scan ü") == theirs.stdout
    assert f"scan ü.zip is an archive; it is unpacked to {tmp_path}" in ours.stderr


def test_archives_of_pictures_and_of_cameras_are_taken_as_their_folders(tmp_path):
    folder = make_capture(tmp_path / "scan")
    given = {}
    for name in ("photos", "masks", "ignored", "cameras"):
        given[name] = Path(shutil.make_archive(str(tmp_path / "of" / name), "zip", folder))
    options = SimpleNamespace(capture=folder, **given)
    unpack_archives(options)
    assert vars(options) == {
        "capture": folder, **{name: path.with_suffix("") for name, path in given.items()}
    }  # fmt: skip


def test_a_terminal_has_a_bar_while_an_archive_is_unpacked(tmp_path, capsys, monkeypatch):
    shutil.make_archive(str(tmp_path / "scan"), "zip", make_capture(tmp_path / "o"))
    for bars in (1, 0):
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        unpack_archives(SimpleNamespace(capture=tmp_path / "scan.zip"))
        said = capsys.readouterr().err
        assert ("unpacking" in said, "100%" in said) == (bool(bars),) * 2
        assert "it is unpacked to" in said.splitlines()[-1]


@pytest.mark.parametrize("before", ["an empty folder", "a job"])
def test_what_was_there_before_bad_input_stays(before, tmp_path):
    folder = with_photo_cut_off(tmp_path / "capture")
    root, options = tmp_path / "job", []
    root.mkdir()
    if before == "a job":
        JobFolder.create(root, JobRequest(capture=str(folder)))
        options = ["--resume"]
    result = solver("reconstruct", folder, "--out", root, *options)
    assert result.returncode == 2 and "r_2.png" in result.stderr
    assert (root / "job.json").exists() == (before == "a job")
    assert options or list(root.iterdir()) == []


def test_an_unknown_setting_is_named(tmp_path, duck):
    for text in ("fit.speed=1", "nothing.at=2", "fit.steps=many", "fit"):
        result = solver("reconstruct", duck, "--out", tmp_path / "job", "--set", text)
        assert result.returncode == 2 and text.split("=")[0] in result.stderr
        assert not (tmp_path / "job").exists()


def test_numbers_that_are_none_are_told_so(job, tmp_path, duck):
    for options, words in (
        (["--seed", "9" * 30], "whole number"), (["--time-limit", "soon"], "'soon' is not a number"),
    ):  # fmt: skip
        result = solver("reconstruct", duck, "--out", tmp_path / "no", *options)
        assert result.returncode == 2 and words in result.stderr
    result = solver("render", job, "--cameras", duck, "--out", tmp_path / "no", "--rays", 0)
    assert result.returncode == 2 and "from 1 to" in result.stderr
    result = solver("solve", duck, "--out", tmp_path / "no", "--seed", 1 << 31)
    assert result.returncode == 2 and "from 0 to" in result.stderr
    assert not (tmp_path / "no").exists()


def test_doctor_reports():
    result = solver("doctor")
    assert result.returncode == 0 and "torch" in result.stdout and "MISSING" not in result.stdout
    assert result.stdout.endswith("All packages load.\n")


def test_doctor_names_packages_that_do_not_load(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "packages", lambda: ["numpy", "a-missing-package"])
    assert cli.main(["doctor"]) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("a-missing-package DOES NOT LOAD: ModuleNotFoundError")


def test_a_device_that_is_not_there_is_told_before_a_folder_is_made(tmp_path, duck):
    missing = "cuda" if sys.platform == "darwin" else "mps"
    result = solver("reconstruct", duck, "--out", tmp_path / "job", "--device", missing)
    assert result.returncode == 2 and not (tmp_path / "job").exists()
    assert result.stderr.startswith(f"--device {missing}: this machine has no such device; choose ")


def test_a_package_that_is_missing_is_told_before_a_folder_is_made(tmp_path, duck):
    """A fixed bug: what was left asked for --resume."""
    code = (
        "import sys; sys.modules['xatlas'] = None; from solver.start import start; "
        f"sys.argv[1:] = ['reconstruct', {str(duck)!r}, '--out', {str(tmp_path / 'job')!r}]; "
        "sys.exit(start())"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, text=True, capture_output=True, timeout=60
    )
    assert result.returncode == 2 and "lacks the package 'xatlas'" in result.stderr
    assert not (tmp_path / "job").exists()


@pytest.mark.parametrize("how", [["-m", "solver"], ["solver/bootstrap.py"]], ids=" ".join)
def test_a_python_without_the_packages_is_told_which_and_how_to_get_them(how):
    # -S: without the folder of installed packages.
    result = subprocess.run(
        [sys.executable, "-S", *how, "doctor"], cwd=ROOT, text=True, capture_output=True, timeout=60
    )
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    assert "lacks the package '" in result.stderr and "requirements.txt" in result.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' names are text")
def test_a_name_that_is_no_text_is_refused_and_nothing_is_made(tmp_path, duck):
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/bad\xff"))
    make_capture(folder)
    for arguments in (
        ["check", folder],
        ["reconstruct", duck, "--out", folder / "job"],
        ["solve", folder],
    ):
        result = solver(*arguments)
        assert result.returncode == 2 and len(result.stderr.splitlines()) == 1, result.stderr
        assert r"bad\udcff" in result.stderr and "rename it" in result.stderr
    assert not (folder / "job").exists() and not (folder / "cameras").exists()
    there = subprocess.run(
        [sys.executable, "-m", "solver", "check", "."], cwd=folder, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert there.returncode == 2 and "rename it" in there.stderr


@pytest.mark.skipif(os.name == "nt", reason="there such a name is none, like others")
def test_a_name_that_is_too_long_for_the_disk_is_told(tmp_path):
    for arguments in (["check", tmp_path / ("x" * 300)], ["run", tmp_path / ("x" * 300)]):
        result = solver(*arguments)
        assert result.returncode == 2 and "too long for this disk" in result.stderr, result.stderr
