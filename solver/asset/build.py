"""From a fitted field to the files of the asset."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.colour import linear_to_srgb
from ..capture.frames import scale_and_rotation, unit
from ..light.turned import turned
from .bake import fill_texture, gather
from .files import write_exr, write_fine_png, write_ply, write_png
from .gltf import write_glb
from .metallic import metallic_workflow
from .photo_detail import FINER, Surface, View, with_photo_detail
from .settings import AssetSettings
from .surface import SurfaceField, extract_surface
from .tangent import encode_normals, texel_frames
from .unknown import spread_into_unknown, with_unknown
from .unwrap import rasterise, unwrap

TURN = 1e-5
"""rad; less moves no light by a hundredth of a texel"""
TEXTURES = {
    "albedo": {"file": "albedo.png", "colour_space": "sRGB"},
    "f0": {"file": "f0.png", "colour_space": "sRGB"},
    "roughness": {"file": "roughness.png", "colour_space": "Non-Color"},
    "normal": {"file": "normal.png", "colour_space": "Non-Color", "space": "tangent"},
    "base_colour": {"file": "base_colour.png", "colour_space": "sRGB"},
    "metallic": {"file": "metallic.png", "colour_space": "Non-Color"},
}
"""as the manifest names them; f0 is written with its scale"""


def build_asset(
    field: SurfaceField, environment: np.ndarray, level: float, folder: Path,
    settings: AssetSettings, progress: Callable[[float, str], None], name: str,
    placement: np.ndarray, views: Sequence[View] = (),
) -> dict[str, Any]:  # fmt: skip
    """Write mesh.ply, textures, environment.exr and asset.glb; returns their part of the manifest.

    The mesh and the light are in the field's world; the GLB stands where `placement` puts it, and where
    that turns it, the light is written once more as it then is, as environment_upright.exr.

    Args:
        environment: [H, W, 3] linear Rec.709 radiance, Blender's equirect convention.
        level: extinction per world unit at which the surface stands (`from_scene.surface_level`).
        name: of the object in asset.glb.
        placement: [4, 4] similarity from the field's world to the GLB's, which has +Z up until it is
            written.
        views: photos, and cameras in the field's world, whose detail the albedo gets.

    Raises:
        EmptySurfaceError: the field has no surface.
    """
    folder.mkdir(parents=True, exist_ok=True)
    progress(0.0, "marching cubes")
    mesh = extract_surface(field, level, settings)
    progress(0.25, "smooth normals")
    vertices = np.asarray(mesh.vertices, dtype=np.float32)
    facing = np.asarray(mesh.vertex_normals, dtype=np.float32)
    at_vertices = gather(field, vertices, facing, settings)
    progress(0.3, "UV unwrap")
    unwrapped = unwrap(mesh, at_vertices.normals, settings.texture_size)
    texels = rasterise(unwrapped, settings.texture_size)
    progress(0.5, "baking")
    points = texels.interpolate(unwrapped, unwrapped.positions)
    outward = unit(texels.interpolate(unwrapped, unwrapped.normals), 1e-12)
    spacing = float(np.sqrt(mesh.area / len(points)))
    if spacing > FINER * field.voxel:
        views = ()
    baking = 0.2 if views else 0.35
    samples = gather(field, points, outward, settings, lambda done: progress(0.5 + baking * done, "baking"))
    known = field.known(vertices, facing)
    around = spread_into_unknown(mesh, at_vertices, known)
    samples = with_unknown(
        samples, around, known, unwrapped, texels,
        lambda chosen: field.known(points[chosen], outward[chosen]),
    )  # fmt: skip
    if views:
        surface = Surface(points, outward, spacing, field.voxel, samples.f0)
        samples = with_photo_detail(
            samples, surface, field.diffuse_response(points, samples.normals, samples.f0), views,
            lambda done: progress(0.7 + 0.15 * done, "detail of the photos"),
        )  # fmt: skip
    progress(0.85, "writing files")

    def texture(values: np.ndarray) -> np.ndarray:
        return fill_texture(settings.texture_size, texels.row, texels.column, values)

    f0_scale = float(max(samples.f0.max(), 1e-3))
    albedo, f0 = texture(samples.albedo), texture(samples.f0 / f0_scale)
    roughness = texture(np.sqrt(samples.alpha)[:, None])
    normal = texture(encode_normals(samples.normals, texel_frames(unwrapped, texels)))
    metallic = metallic_workflow(albedo, f0 * f0_scale)
    write_ply(folder / "mesh.ply", unwrapped)
    write_png(folder / "albedo.png", linear_to_srgb(albedo))
    write_png(folder / "base_colour.png", linear_to_srgb(metallic.base_colour))
    write_png(folder / "metallic.png", metallic.metalness)
    write_png(folder / "f0.png", linear_to_srgb(f0))
    write_png(folder / "roughness.png", roughness)
    # In 8 bits a slow tilt is a staircase, each step of which a mirror shows.
    write_fine_png(folder / "normal.png", normal)
    write_exr(folder / "environment.exr", {"RGB": environment})
    progress(0.95, "writing files")
    write_glb(
        folder / "asset.glb", unwrapped.placed(placement), metallic, roughness, normal, name,
        mesh.is_watertight,
    )  # fmt: skip
    parts = {
        "mesh": "mesh.ply",
        "textures": {**TEXTURES, "f0": {**TEXTURES["f0"], "scale": f0_scale}},
        "environment": {"file": "environment.exr", "colour_space": "Linear Rec.709"},
        "glb": "asset.glb",
        "placement": placement.tolist(),
        "triangles": len(unwrapped.faces),
    }
    rotation = scale_and_rotation(placement)[1]
    if not np.allclose(rotation, np.eye(3), atol=TURN):
        upright = {**parts["environment"], "file": "environment_upright.exr"}
        write_exr(folder / upright["file"], {"RGB": turned(environment, rotation)})
        parts["environment_upright"] = upright
    return parts
