"""USD: our materials keep their F0, so that metals stay metals.

Blender writes of Principled only what is metallic, which ours is not: what would be left is a plastic
of 4 %. UsdPreviewSurface's specular workflow takes F0 as it is; Blender's importer takes that for a tint.
"""

from __future__ import annotations

from importlib.util import find_spec

import bpy

from .material import f0_of, tint_with_f0

F0_TEXTURE = "F0_Texture"


class NMF_USD_hook(getattr(bpy.types, "USDHook", object)):
    """Called by Blender for each material that it exports to USD"""

    bl_idname = "nmf_usd_hook"
    bl_label = "F0 of Neural Microfacet Fields"

    @staticmethod
    def on_material_export(export_context, bl_material, usd_material) -> bool:
        """Write F0 where the material is one of ours; True if so."""
        f0 = f0_of(bl_material)
        return f0 is not None and write_f0(export_context, usd_material, *f0)

    @staticmethod
    def on_import(import_context) -> bool:
        """Read F0 again where `on_material_export` wrote it; True if so."""
        stage, found = import_context.get_stage(), False
        for path, blocks in import_context.get_prim_map().items():
            texture = stage.GetPrimAtPath(path).GetChild(F0_TEXTURE)
            for block in blocks if texture else ():
                if isinstance(block, bpy.types.Material):
                    read_f0(block, texture.GetAttribute("inputs:scale").Get()[0])
                    found = True
        return found


def write_f0(export_context, usd_material, image: bpy.types.Image, scale: float) -> bool:
    """Give the UsdPreviewSurface of a material `scale` × an image as its F0; False if it has none."""
    from pxr import Gf, Sdf, UsdShade

    surface, *_ = usd_material.ComputeSurfaceSource()
    coordinates = _coordinates(surface) if surface else None
    if not coordinates or surface.GetIdAttr().Get() != "UsdPreviewSurface":
        return False  # the person asked for none with textures
    texture = UsdShade.Shader.Define(
        export_context.get_stage(), usd_material.GetPath().AppendChild(F0_TEXTURE)
    )
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(_asset_path(export_context, image))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(scale, scale, scale, 1))
    for axis in ("wrapS", "wrapT"):
        texture.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("repeat")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    surface.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    )
    return True


def read_f0(material: bpy.types.Material, scale: float) -> None:
    """Make `scale` × the picture that an imported material is tinted with its F0."""
    nodes = material.node_tree.nodes
    principled = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    links = principled.inputs["Specular Tint"].links if principled else ()
    picture = links[0].from_node if links else None
    if picture is not None and picture.type != "TEX_IMAGE":  # what multiplies it
        picture = next((link.from_node for link in picture.inputs[0].links), None)
    if picture is not None and picture.type == "TEX_IMAGE":
        tint_with_f0(principled, picture.outputs["Color"], scale)


def _asset_path(export_context, image: bpy.types.Image) -> str:
    """Export an image as the person's settings say; returns its path as USD writes it."""
    if hasattr(export_context, "export_texture"):
        return export_context.export_texture(image)
    return bpy.path.abspath(image.filepath, library=image.library)  # before Blender 4.4


def _coordinates(surface):
    """The texture coordinates that the albedo is looked up by; None if it is no texture."""
    albedo = surface.GetInput("diffuseColor")
    sources = albedo.GetConnectedSources()[0] if albedo else None
    if not sources:
        return None
    lookup = sources[0].source.GetInput("st").GetConnectedSources()[0]
    return lookup[0].source.GetOutput(lookup[0].sourceName) if lookup else None


def register() -> None:
    """Hook into USD export, if this Blender can: without pxr, as in the bpy wheel, an export with a hook
    ends the process."""
    if hasattr(bpy.types, "USDHook") and find_spec("pxr") is not None:
        bpy.utils.register_class(NMF_USD_hook)


def unregister() -> None:
    """Undo `register`."""
    if getattr(NMF_USD_hook, "is_registered", False):
        bpy.utils.unregister_class(NMF_USD_hook)
