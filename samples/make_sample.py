"""Render the sample capture: a glazed duck under an HDRI, 60 photos and 12 held-out views.

    python samples/make_sample.py [samples/duck]

needs the `bpy` wheel, which brings the light too: Blender's own studio HDRIs (Poly Haven, CC0),
box-filtered to 512 × 256. Everything else is made here, CC0. Layout and camera conventions are
those of NeRF-synthetic (`transforms_*.json`, camera_angle_x, OpenGL camera axes, +Z up); beside
each held-out view stands its truth: linear radiance, normals, albedo, roughness (README.md).
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

RESOLUTION = 200
TRAIN_VIEWS, TEST_VIEWS = 60, 12
CAMERA_ANGLE_X = 0.6911112070083618  # NeRF-synthetic's field of view
CAMERA_DISTANCE = 4.0311
LIGHT, RELIGHTS = "forest", ("sunset", "studio")
LIGHT_SAMPLES, TRUTH_SAMPLES = 96, 16
BLUE, CREAM, ORANGE, DARK = (0.02, 0.16, 0.30), (0.75, 0.62, 0.42), (0.80, 0.20, 0.02), (0.01,) * 3


def ellipsoid(location, scale, rotation=(0.0, 0.0, 0.0)):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=location)
    part = bpy.context.object
    part.scale, part.rotation_euler = scale, rotation
    return part


def make_duck() -> bpy.types.Object:
    """One closed, smooth mesh: ellipsoids fused by voxel remeshing."""
    parts = [
        ellipsoid((0.0, 0.0, -0.35), (0.85, 0.60, 0.50)),
        ellipsoid((0.42, 0.0, 0.38), (0.40, 0.38, 0.38)),
        ellipsoid((0.30, 0.0, 0.00), (0.36, 0.34, 0.40)),
        ellipsoid((0.84, 0.0, 0.32), (0.22, 0.17, 0.08)),
        ellipsoid((-0.82, 0.0, -0.12), (0.30, 0.24, 0.14), (0.0, 0.6, 0.0)),
        ellipsoid((-0.10, 0.52, -0.28), (0.46, 0.16, 0.26), (0.15, 0.15, 0.0)),
        ellipsoid((-0.10, -0.52, -0.28), (0.46, 0.16, 0.26), (-0.15, 0.15, 0.0)),
    ]
    bpy.ops.object.select_all(action="DESELECT")
    for part in parts:
        part.select_set(True)
    bpy.context.view_layer.objects.active = parts[0]
    bpy.ops.object.join()
    duck = bpy.context.object
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    remesh = duck.modifiers.new("fuse", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.018
    smooth = duck.modifiers.new("smooth", "SMOOTH")
    smooth.factor, smooth.iterations = 0.5, 25
    for modifier in ("fuse", "smooth"):
        bpy.ops.object.modifier_apply(modifier=modifier)
    bpy.ops.object.shade_smooth()
    paint(duck.data)
    return duck


def paint(mesh: bpy.types.Mesh) -> None:
    """Base colour and roughness as vertex attributes: glaze, bands, beak and eyes."""
    position = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", position)
    x, y, z = position.reshape(-1, 3).T

    def edge(value, width=0.03):
        return (1 / (1 + np.exp(-value / width * 4)))[:, None]

    wave = np.sin(9 * z + 2.0 * np.sin(3 * x)) * 0.1
    albedo = np.tile(np.float32(BLUE), (len(x), 1))
    roughness = 0.12 + 0.10 * (0.5 + 0.5 * np.sin(7 * x) * np.sin(6 * y + 1))[:, None]
    belly = edge(-0.45 - z + wave)
    albedo, roughness = blend(albedo, CREAM, belly), blend(roughness, 0.35, belly)
    collar = edge(0.05 - np.abs(z - 0.10 + 0.25 * (x - 0.35)), 0.015) * edge(x + 0.05)
    albedo, roughness = blend(albedo, CREAM, collar), blend(roughness, 0.20, collar)
    beak = edge(x - 0.76) * edge(z - 0.15)
    albedo, roughness = blend(albedo, ORANGE, beak), blend(roughness, 0.25, beak)
    eye_distance = np.minimum(*(np.hypot(np.hypot(x - 0.66, y - s * 0.24), z - 0.50) for s in (-1, 1)))
    eyes = edge(0.075 - eye_distance, 0.02)
    albedo, roughness = blend(albedo, DARK, eyes), blend(roughness, 0.08, eyes)
    colour = np.concatenate([albedo, np.ones_like(roughness)], axis=1).astype(np.float32)
    for name, values in (("albedo", colour), ("roughness", np.tile(roughness, (1, 4)))):
        attribute = mesh.attributes.new(name, "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", np.ascontiguousarray(values, np.float32).ravel())


def blend(base, over, share):
    return base * (1 - share) + np.asarray(over, dtype=np.float32) * share


def glaze_material() -> bpy.types.Material:
    material = bpy.data.materials.new("glaze")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = nodes["Principled BSDF"]
    principled.distribution = "GGX"
    for attribute, socket in (("albedo", "Base Color"), ("roughness", "Roughness")):
        node = nodes.new("ShaderNodeAttribute")
        node.attribute_name = attribute
        output = "Color" if attribute == "albedo" else "Fac"
        links.new(node.outputs[output], principled.inputs[socket])
    return material


def truth_material(kind: str) -> bpy.types.Material:
    """An emitter of what a pixel should know: 'albedo', 'roughness' or 'normal' as (n + 1)/2."""
    material = bpy.data.materials.new(kind)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.remove(nodes["Principled BSDF"])
    emission = nodes.new("ShaderNodeEmission")
    links.new(emission.outputs[0], nodes["Material Output"].inputs["Surface"])
    if kind == "normal":
        geometry, scale = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
        scale.operation = "MULTIPLY_ADD"
        scale.inputs[1].default_value = scale.inputs[2].default_value = (0.5,) * 3
        links.new(geometry.outputs["Normal"], scale.inputs[0])
        links.new(scale.outputs[0], emission.inputs["Color"])
    else:
        node = nodes.new("ShaderNodeAttribute")
        node.attribute_name = kind
        links.new(node.outputs["Color"], emission.inputs["Color"])
    return material


def make_light(name: str, path: Path) -> None:
    """Box-filter one of Blender's studio HDRIs to 512 × 256, mean luminance 0.7, as half EXR."""
    folder = Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world"
    pixels = OpenEXR.File(str(folder / f"{name}.exr")).channels()["RGB"].pixels.astype(np.float64)
    height, width = pixels.shape[:2]
    rows, columns = height // 256, width // 512
    pixels = np.maximum(pixels, 0)  # lossy compression left a few texels below zero
    pixels = pixels[: 256 * rows, : 512 * columns].reshape(256, rows, 512, columns, 3).mean((1, 3))
    weight = np.sin((np.arange(256) + 0.5) * math.pi / 256)[:, None]
    luminance = (pixels @ (0.2126, 0.7152, 0.0722) * weight).sum() / (weight.sum() * 512)
    write_exr(path, pixels * (0.7 / luminance))


def use_light(path: Path) -> None:
    world = bpy.data.worlds.new(path.stem)
    world.use_nodes = True
    texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(str(path))
    texture.image.colorspace_settings.name = "Linear Rec.709"
    world.node_tree.links.new(texture.outputs["Color"], world.node_tree.nodes["Background"].inputs["Color"])
    bpy.context.scene.world = world


def set_up_render() -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = True
    scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.blur_glossy = 0.0
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = RESOLUTION
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    camera = bpy.data.cameras.new("camera")
    camera.angle_x = CAMERA_ANGLE_X
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)


def poses(count: int, offset: float) -> list[np.ndarray]:
    """Cameras on a Fibonacci sphere, |z|/r < 0.9, looking at the origin."""
    golden = math.pi * (3 - math.sqrt(5))
    matrices = []
    for i in range(count):
        z = 0.9 - 1.8 * (i + offset) / count
        phi = golden * (i + 17 * offset)
        back = np.array([math.sqrt(1 - z * z) * math.cos(phi), math.sqrt(1 - z * z) * math.sin(phi), z])
        right = np.cross((0, 0, 1), back)
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3] = np.stack([right, np.cross(back, right), back, CAMERA_DISTANCE * back], axis=1)
        matrices.append(matrix)
    return matrices


def render(matrix: np.ndarray, samples: int, png: Path | None = None, exr: Path | None = None) -> None:
    """Render one view to `png` (sRGB, straight alpha) and `exr` (linear, premultiplied, half)."""
    scene = bpy.context.scene
    scene.camera.matrix_world = matrix.T.tolist()
    scene.cycles.samples = samples
    bpy.ops.render.render()
    image, result = scene.render.image_settings, bpy.data.images["Render Result"]
    for path, kind, depth in ((png, "PNG", "8"), (exr, "OPEN_EXR", "16")):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            image.file_format, image.color_mode, image.color_depth = kind, "RGBA", depth
            result.save_render(str(path))


def decode_normals(path: Path) -> None:
    """Turn a picture of (n + 1)/2 with alpha into unit normals, zero off the object."""
    pixels = OpenEXR.File(str(path)).channels()["RGBA"].pixels.astype(np.float64)
    normals = 2 * pixels[..., :3] - pixels[..., 3:]
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    on_object = (length > 1e-3) & (pixels[..., 3:] > 0)
    write_exr(path, np.where(on_object, normals / np.maximum(length, 1e-9), 0.0))


def write_exr(path: Path, pixels: np.ndarray) -> None:
    """Write [H, W, 3] as half floats."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels, np.float16)}).write(str(path))


def write_transforms(path: Path, folder: str, matrices: list[np.ndarray]) -> None:
    frames = [
        {"file_path": f"./{folder}/r_{i}", "transform_matrix": np.round(m, 9).tolist()}
        for i, m in enumerate(matrices)
    ]
    content = {"camera_angle_x": CAMERA_ANGLE_X, "w": RESOLUTION, "h": RESOLUTION, "frames": frames}
    path.write_text(json.dumps(content, indent=1) + "\n")


def main(out: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    out.mkdir(parents=True, exist_ok=True)
    set_up_render()
    duck = make_duck()
    duck.data.materials.append(glaze_material())
    lights = {"env": LIGHT, **{f"relight_{name}": name for name in RELIGHTS}}
    for stem, name in lights.items():
        make_light(name, out / f"{stem}.exr")
    train, test = poses(TRAIN_VIEWS, 0.5), poses(TEST_VIEWS, 0.25)
    write_transforms(out / "transforms_train.json", "train", train)
    write_transforms(out / "transforms_test.json", "test", test)
    use_light(out / "env.exr")
    for i, matrix in enumerate(train):
        render(matrix, LIGHT_SAMPLES, out / "train" / f"r_{i}.png")
        print(f"photo {i + 1} of {TRAIN_VIEWS}", file=sys.stderr, flush=True)
    for i, matrix in enumerate(test):
        stem = out / "test" / f"r_{i}"
        render(matrix, LIGHT_SAMPLES, stem.with_suffix(".png"), exr=Path(f"{stem}_hdr.exr"))
    for name in RELIGHTS:
        use_light(out / f"relight_{name}.exr")
        for i in range(0, TEST_VIEWS, 3):
            stem = out / f"relight_{name}" / f"r_{i}"
            render(test[i], LIGHT_SAMPLES, stem.with_suffix(".png"), exr=Path(f"{stem}_hdr.exr"))
    bpy.context.scene.cycles.use_denoising = False
    bpy.context.scene.view_settings.view_transform = "Raw"
    bpy.context.scene.world = None
    for kind in ("normal", "albedo", "roughness"):
        duck.data.materials[0] = truth_material(kind)
        for i, matrix in enumerate(test):
            path = out / "test" / f"r_{i}_{kind}.exr"
            render(matrix, TRUTH_SAMPLES, exr=path)
            if kind == "normal":
                decode_normals(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "duck").resolve())
