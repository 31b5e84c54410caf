"""The extension's zip: Blender's own tool validates and builds it, and it installs and runs.

Tests in a real Blender need NMF_REAL_BLENDER (path of `real-blender.sh`) and root.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
TOOL = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
REAL_BLENDER = os.environ.get("NMF_REAL_BLENDER", "")
MODULE = "bl_ext.user_default.neural_microfacet_fields"


def run(command, **settings):
    """Run a program; its output in the failure message."""
    answer = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, encoding="utf-8",
        errors="replace", stdin=subprocess.DEVNULL, **settings,
    )  # fmt: skip
    assert answer.returncode == 0, answer.stdout[-3000:] + answer.stderr[-3000:]
    return answer.stdout


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The built zip."""
    folder = tmp_path_factory.mktemp("dist")
    run([sys.executable, TOOL, "build", "--source-dir", ROOT, "--output-dir", folder])
    return next(folder.glob("*.zip"))


def test_blenders_own_tool_finds_no_fault_with_manifest_or_zip(archive):
    run([sys.executable, TOOL, "validate", ROOT])
    run([sys.executable, TOOL, "validate", archive])


def test_the_zip_holds_what_runs_and_nothing_else(archive):
    with zipfile.ZipFile(archive) as file:
        names = file.namelist()
        size = sum(entry.file_size for entry in file.infolist())
        beside = sum(e.file_size for e in file.infolist() if not e.filename.endswith(".py"))
    for name in (
        "blender_manifest.toml", "__init__.py", "LICENSE", "solver/bootstrap.py",
        "solver/requirements.txt", "nmf_addon/setup_runtime.py", "operators/reconstruct.py",
    ):  # fmt: skip
        assert name in names
    modules = {
        path.relative_to(ROOT).as_posix()
        for folder in ("solver", "nmf_addon", "operators")
        for path in (ROOT / folder).rglob("*.py")
    }
    assert modules <= set(names)
    allowed = ("blender_manifest.toml", "__init__.py", "LICENSE", "README.md", "CHANGELOG.md")
    folders = ("solver/", "nmf_addon/", "operators/", "samples/reconstruct.py")
    strange = [n for n in names if n not in allowed and not n.startswith(folders)]
    assert strange == []
    assert not [n for n in names if n.endswith((".pyc", ".nbi", ".nbc", ".exr", ".png"))]
    assert beside < 4e4, "source alone: no wheels, no pictures"
    assert size < 2.05e6
    assert archive.stat().st_size < 1e6


def test_what_else_lies_in_the_checkout_stays_out_of_the_zip(archive, tmp_path):
    source, strange = (
        tmp_path / "source",
        [
            "job",
            "nmf_jobs",
            "out",
            "scan",
            "photos",
            "build",
            "sales",
            "sofa",
            "black_vase",
            "opal_ring",
            "sample_photos",
            "samsung",
            "soldering",
            "_old",
        ],
    )
    with zipfile.ZipFile(archive) as file:
        file.extractall(source)
        names = file.namelist()
    for name in [*strange, "Lamp", "benchmarks", "notes", "tests"]:
        (source / name / "deeper").mkdir(parents=True)
        (source / name / "deeper" / "photo.jpg").touch()
    run([sys.executable, TOOL, "build", "--source-dir", source, "--output-dir", tmp_path])
    with zipfile.ZipFile(next(tmp_path.glob("*.zip"))) as file:
        assert sorted(file.namelist()) == sorted(names)


def test_the_manifest_says_what_the_extension_needs():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["id"] == "neural_microfacet_fields"
    assert manifest["blender_version_min"] == "4.3.0"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert set(manifest["permissions"]) == {"files", "network"}
    assert "GNU GENERAL PUBLIC LICENSE" in (ROOT / "LICENSE").read_text(encoding="utf-8")


INSTALLED = f"""
import json, os, sys, importlib
import bpy
out = {{}}
out["enabled"] = {MODULE!r} in bpy.context.preferences.addons
addon = bpy.context.preferences.addons[{MODULE!r}]
addon.preferences.pip_arguments = "--no-deps"
out["preferences"] = addon.preferences.pip_arguments
out["operators"] = sorted(name for name in dir(bpy.ops.nmf))
out["scene"] = hasattr(bpy.types.Scene, "nmf")
names = importlib.import_module({MODULE!r} + ".nmf_addon.names")
out["runtime"] = str(names.user_folder("runtime"))
out["torch"] = "torch" in sys.modules
import addon_utils
addon_utils.disable({MODULE!r})
out["left"] = [n for n in dir(bpy.types) if n.startswith("NMF_")] + [
    n for n in ("nmf",) if hasattr(bpy.types.Scene, n)]
addon_utils.enable({MODULE!r})
out["again"] = hasattr(bpy.types.Scene, "nmf")
print("REPORT " + json.dumps(out))
"""


def check_installed(text: str) -> None:
    """What INSTALLED printed."""
    line = next(line for line in text.splitlines() if line.startswith("REPORT "))
    report = json.loads(line.removeprefix("REPORT "))
    assert report["enabled"] and report["scene"] and report["again"]
    assert report["preferences"] == "--no-deps"
    assert {"import_capture", "reconstruct", "cancel", "install_result"} <= set(report["operators"])
    assert report["left"] == []
    assert not report["torch"], "torch stays out of Blender's process"
    assert "/extensions/.user/user_default/neural_microfacet_fields" in report["runtime"].replace(
        os.sep, "/"
    )


def test_the_zip_installs_and_enables_in_blender_as_a_module(archive, tmp_path):
    program = (
        "import bpy\n"
        f"bpy.ops.extensions.package_install_files(filepath={str(archive)!r}, "
        "repo='user_default', enable_on_install=True)\n" + INSTALLED
    )
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    check_installed(run([sys.executable, "-c", program], env=environment, cwd=tmp_path))


@pytest.fixture(scope="module")
def real_blender(archive, tmp_path_factory):
    """Run a real Blender that has the zip installed and enabled; skipped where there is none."""
    if not Path(REAL_BLENDER).is_file():
        pytest.skip("no real Blender: NMF_REAL_BLENDER is not the path of real-blender.sh")
    user = tmp_path_factory.mktemp("user")

    def call(command, *arguments, **settings):
        return run(["bash", REAL_BLENDER, "--user", user, command, "--", *arguments], **settings)

    call("extension", "install-file", "--repo", "user_default", "--enable", archive)
    return call


@pytest.mark.real_blender
def test_the_zip_installs_and_enables_in_a_real_blender(real_blender, tmp_path):
    script = tmp_path / "installed.py"
    script.write_text(INSTALLED, encoding="utf-8")
    check_installed(real_blender("headless", "--python", script))


@pytest.mark.real_blender
def test_the_command_nmf_is_there_in_a_real_blender(real_blender):
    arguments = ["--python-exit-code", "1", "-c", "nmf", "reconstruct", "--help"]
    text = real_blender("headless", *arguments)
    assert "OUT.blend" in text and "--preset" in text
