"""USD export: metals stay metals, and nothing else changes."""

import importlib
import json
import sys
from pathlib import Path

import bpy
import fake_result
import pytest


@pytest.fixture
def pxr(unregistered, monkeypatch):
    """Blender's own USD library, which the bpy wheel brings but does not put on the path."""
    if "pxr" not in sys.modules:
        for folder in Path(bpy.utils.resource_path("LOCAL"), "python").rglob("site-packages"):
            monkeypatch.setattr(sys, "path", [*sys.path, str(folder)])
    library = pytest.importorskip("pxr", reason="this Blender has no pxr")
    importlib.import_module("pxr.UsdShade")
    unregistered.register()
    return library


@pytest.fixture
def metal(tmp_path):
    """A finished job: a cube of silver."""
    root = tmp_path / "silver"
    fake_result.write_result(root)
    edit_scale(root, 0.95)
    return root


def edit_scale(root, scale):
    """What a result's F0 texture is multiplied by."""
    path = root / "result" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["textures"]["f0"]["scale"] = scale
    path.write_text(json.dumps(manifest))


def export(tmp_path, **settings):
    """The stage of an export, and its preview surfaces by their material's name."""
    from pxr import Usd, UsdShade

    path = tmp_path / "usd" / "x.usda"
    path.parent.mkdir()
    assert bpy.ops.wm.usd_export(filepath=str(path), **settings) == {"FINISHED"}
    stage = Usd.Stage.Open(str(path))
    materials = [UsdShade.Material(p) for p in stage.Traverse() if p.IsA(UsdShade.Material)]
    return stage, {m.GetPrim().GetName(): m.ComputeSurfaceSource()[0] for m in materials}


def add_plastic():
    """A cube of a material that is not ours."""
    bpy.ops.mesh.primitive_cube_add()
    material = bpy.data.materials.new("plastic")
    material.use_nodes = True
    bpy.context.object.data.materials.append(material)


def test_a_metal_keeps_its_f0_in_usd(pxr, metal, tmp_path):
    bpy.ops.nmf.install_result(directory=str(metal))
    stage, surfaces = export(tmp_path)
    surface = surfaces["silver"]
    assert surface.GetInput("useSpecularWorkflow").Get() == 1
    texture = pxr.UsdShade.Shader(
        surface.GetInput("specularColor").GetConnectedSources()[0][0].source
    )
    assert texture.GetIdAttr().Get() == "UsdUVTexture"
    assert texture.GetInput("scale").Get()[:3] == pytest.approx([0.95] * 3)
    assert texture.GetInput("sourceColorSpace").Get() == "sRGB"
    file = Path(stage.GetRootLayer().realPath).parent / texture.GetInput("file").Get().path
    assert file.read_bytes() == (metal / "result" / "f0.png").read_bytes()
    albedo = surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source
    coordinates = [t.GetInput("st").GetConnectedSources()[0][0].source for t in (albedo, texture)]
    assert coordinates[0].GetPath() == coordinates[1].GetPath()


def test_other_materials_are_exported_as_they_are(pxr, metal, tmp_path):
    bpy.ops.nmf.install_result(directory=str(metal))
    add_plastic()
    stage, surfaces = export(tmp_path)
    surface = surfaces["plastic"]
    assert stage and surface and surface.GetInput("metallic").Get() == 0
    assert not surface.GetInput("useSpecularWorkflow") and not surface.GetInput("specularColor")


def test_a_usd_without_preview_surfaces_is_exported(pxr, metal, tmp_path):
    bpy.ops.nmf.install_result(directory=str(metal))
    stage, surfaces = export(tmp_path, generate_preview_surface=False)
    assert stage and not surfaces["silver"].GetInput("useSpecularWorkflow")


@pytest.mark.parametrize("scale", [0.95, 1.0])
def test_a_metal_that_is_imported_again_is_a_metal(pxr, metal, tmp_path, scale):
    edit_scale(metal, scale)
    bpy.ops.nmf.install_result(directory=str(metal))
    stage, _ = export(tmp_path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.wm.usd_import(filepath=stage.GetRootLayer().realPath) == {"FINISHED"}
    nodes = bpy.data.materials["silver"].node_tree.nodes
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    tint = principled.inputs["Specular Tint"].links[0].from_node
    colour, factor = (socket for socket in tint.inputs if socket.type == "RGBA")
    assert colour.links[0].from_node.image.filepath.endswith("f0.png")
    assert factor.default_value[0] == pytest.approx(scale / 0.04)


@pytest.mark.parametrize("missing", ["pxr", "hook"])
def test_the_extension_registers_where_usd_cannot_be_hooked(
    unregistered, part, monkeypatch, missing
):
    usd = part("scene.usd")
    if missing == "pxr":
        monkeypatch.setattr(usd, "find_spec", lambda name: None)
    else:
        monkeypatch.setattr(usd, "bpy", type("bpy", (), {"types": object, "utils": bpy.utils}))
    unregistered.register()
    assert not usd.NMF_USD_hook.is_registered
    unregistered.unregister()
