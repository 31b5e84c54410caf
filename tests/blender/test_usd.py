"""Export to USD: metals stay metals."""

import importlib
import sys
from pathlib import Path

import bpy
import fake_result
import pytest

GOLD = (255, 200, 90)


@pytest.fixture
def pxr(monkeypatch):
    """Blender's own USD library, which the bpy wheel brings but does not put on the path."""
    if "pxr" not in sys.modules:
        for folder in Path(bpy.utils.resource_path("LOCAL"), "python").rglob("site-packages"):
            monkeypatch.setattr(sys, "path", [*sys.path, str(folder)])
    library = pytest.importorskip("pxr", reason="this Blender has no pxr")
    importlib.import_module("pxr.UsdShade")
    return library


@pytest.fixture
def gold(tmp_path):
    """A finished job: a cube of gold."""
    root = tmp_path / "gold"
    fake_result.write_result(root)
    for name, colour in (
        ("base_colour", GOLD),
        ("metallic", (255, 255, 255)),
        ("albedo", (0, 0, 0)),
    ):
        fake_result.write_png(root / "result" / f"{name}.png", colour)
    return root


def test_a_metal_is_a_metal_in_usd_and_when_it_is_imported_again(extension, pxr, gold, tmp_path):
    extension("scene.install").install_result(bpy.context, gold)
    path = tmp_path / "usd" / "x.usda"
    path.parent.mkdir()
    assert bpy.ops.wm.usd_export(filepath=str(path)) == {"FINISHED"}
    stage = pxr.Usd.Stage.Open(str(path))
    prims = [prim for prim in stage.Traverse() if prim.IsA(pxr.UsdShade.Material)]
    surface = pxr.UsdShade.Material(prims[0]).ComputeSurfaceSource()[0]
    for name, file in (("diffuseColor", "base_colour.png"), ("metallic", "metallic.png")):
        texture = pxr.UsdShade.Shader(surface.GetInput(name).GetConnectedSources()[0][0].source)
        exported = path.parent / texture.GetInput("file").Get().path
        assert exported.read_bytes() == (gold / "result" / file).read_bytes()

    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.wm.usd_import(filepath=str(path)) == {"FINISHED"}
    nodes = bpy.data.materials["gold"].node_tree.nodes
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    assert principled.inputs["Metallic"].links and principled.inputs["Base Color"].links
