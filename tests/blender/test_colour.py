"""Another OpenColorIO configuration: one with the names of ACES, one with none that we know.

Blender reads it as it starts, so these tests start one.
"""

import json
import os
import subprocess
import sys
import types
from pathlib import Path

import bpy
import pytest

HERE = Path(__file__).resolve().parent
CONFIGURATION = """\
ocio_profile_version: 2
strictparsing: true
roles:
  scene_linear: Working
  rendering: Working
  data: {raw}
  default: {srgb}
  default_byte: {srgb}
  default_float: {linear}
  default_sequencer: {srgb}
  color_picking: {srgb}
  texture_paint: {srgb}
  matte_paint: {srgb}
  aces_interchange: Working
  cie_xyz_d65_interchange: Working
file_rules:
  - !<Rule> {{name: Default, colorspace: {srgb}}}
displays:
  sRGB - Display:
    - !<View> {{name: Film, colorspace: {srgb}}}
    - !<View> {{name: {view}, colorspace: {srgb}}}
active_displays: [sRGB - Display]
active_views: [Film, {view}]
colorspaces:
  - !<ColorSpace>
    name: Working
    encoding: scene-linear
  - !<ColorSpace>
    name: {linear}
    encoding: scene-linear
    to_scene_reference: !<MatrixTransform> {{matrix: [0.6, 0.4, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}
  - !<ColorSpace>
    name: {srgb}
    encoding: sdr-video
    to_scene_reference: !<ExponentWithLinearTransform> {{gamma: 2.4, offset: 0.055, direction: forward}}
  - !<ColorSpace>
    name: {raw}
    isdata: true
    encoding: data
"""
ACES = {"srgb": "sRGB - Texture", "linear": "Linear Rec.709 (sRGB)", "raw": "Raw", "view": "Un-tone-mapped"}
UNKNOWN = {"srgb": "Bildschirm", "linear": "Licht", "raw": "Zahlen", "view": "Kino"}
SCRIPT = """
import json, runpy, sys
conftest = runpy.run_path("conftest.py")
import bpy
import importlib, importlib.util
spec = importlib.util.spec_from_file_location(
    "nmf", conftest["ROOT"] / "__init__.py", submodule_search_locations=[str(conftest["ROOT"])])
package = sys.modules["nmf"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
bpy.ops.wm.read_factory_settings(use_empty=True)
package.register()
bpy.ops.nmf.install_result(directory=sys.argv[1])
match = importlib.import_module("nmf.nmf_addon.scene.match_solver").match_solver
left = match(bpy.context.scene)
spaces = {i.name: i.colorspace_settings.name for i in bpy.data.images}
view = bpy.context.scene.view_settings.view_transform
print("ANSWER" + json.dumps([spaces, left, view, bpy.context.scene.cycles.filter_width]), flush=True)
"""


def install_and_match(names, job, tmp_path):
    """Colour spaces of the installed images, what Match Solver says, its view, its pixel filter."""
    path = tmp_path / "config.ocio"
    path.write_text(CONFIGURATION.format(**names), encoding="utf-8")
    answer = subprocess.run(
        [sys.executable, "-X", "utf8", "-c", SCRIPT, str(job)], cwd=HERE, capture_output=True, text=True,
        encoding="utf-8", errors="replace", stdin=subprocess.DEVNULL,
        env={**os.environ, "OCIO": str(path)},
    )  # fmt: skip
    assert "ANSWER" in answer.stdout, answer.stdout + answer.stderr
    return json.loads(answer.stdout.partition("ANSWER")[2].splitlines()[0])


@pytest.mark.parametrize("names", [ACES, UNKNOWN], ids=["ACES", "unknown"])
def test_pictures_have_their_colour_space_in_another_configuration(names, result_job, tmp_path):
    spaces, *_ = install_and_match(names, result_job, tmp_path)
    assert {file.split("_", 1)[-1]: space for file, space in spaces.items()} == {
        "albedo.png": names["srgb"], "f0.png": names["srgb"], "roughness.png": names["raw"],
        "normal.png": names["raw"], "base_colour.png": names["srgb"], "metallic.png": names["raw"],
        "environment.exr": names["linear"],
    }  # fmt: skip


def test_match_solver_finds_the_plain_view_of_another_configuration(result_job, tmp_path):
    _, left, view, width = install_and_match(ACES, result_job, tmp_path)
    assert (left, view, width) == ("", "Un-tone-mapped", 1.5)


def test_match_solver_says_what_it_could_not_set_and_sets_the_rest(result_job, tmp_path):
    _, left, view, width = install_and_match(UNKNOWN, result_job, tmp_path)
    assert left.startswith("The view transform stays 'Film'") and view == "Film" and width == 1.5


def test_match_solver_changes_nothing_without_cycles(extension):
    class Scene:
        render = bpy.context.scene.render

    engine = Scene.render.engine = "BLENDER_WORKBENCH"
    with pytest.raises(RuntimeError, match="Cycles is switched off"):
        extension("scene.match_solver").match_solver(Scene)
    assert Scene.render.engine == engine


def test_match_solver_shows_and_saves_light_as_srgb(extension):
    scene = bpy.context.scene
    scene.display_settings.display_device = "Rec.1886"
    scene.view_settings.view_transform = "AgX"
    scene.render.image_settings.color_management = "OVERRIDE"
    scene.cycles.use_fast_gi = True
    assert extension("scene.match_solver").match_solver(scene) == ""
    assert scene.display_settings.display_device == "sRGB"
    assert scene.view_settings.view_transform == "Standard"
    assert scene.render.image_settings.color_management == "FOLLOW_SCENE"
    assert not scene.cycles.use_fast_gi


@pytest.mark.parametrize(
    ("name", "number", "told"),
    [
        ("ACEScg", "lin_ap1_scene", True),
        ("Linear Rec.709", "lin_rec709_scene", False),
        ("Working", "", False),
    ],
)
def test_match_solver_tells_a_working_space_that_is_not_the_solvers(
    extension, monkeypatch, name, number, told
):
    space = types.SimpleNamespace(working_space=name, working_space_interop_id=number)
    module = extension("scene.match_solver")
    data = types.SimpleNamespace(data=types.SimpleNamespace(colorspace=space))
    monkeypatch.setattr(module, "bpy", data)
    left = module.match_solver(bpy.context.scene)
    assert left.startswith(f"The working space stays '{name}'") if told else left == ""
