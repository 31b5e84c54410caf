"""Worlds: the recovered light, and others to relight with."""

from pathlib import Path

import bpy
from bpy.types import Object, Scene, World

from .images import load_picture

HDRI = "nmf_hdri"
"""path of the picture that a World was made of by `relight`"""


def build_world(name: str, path: Path) -> World:
    """A World lit by an equirectangular HDRI, strength 1, linear Rec.709, unrotated.

    Raises:
        RuntimeError: Blender cannot read the picture; nothing is added.
    """
    linear = path.suffix.lower() in (".exr", ".hdr")
    image = load_picture(path, "Linear Rec.709" if linear else None)
    world = bpy.data.worlds.new(name)
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image, texture.projection = image, "EQUIRECTANGULAR"
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    texture.location, background.location, output.location = (-600, 0), (-250, 0), (0, 0)
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    return world


def turn_with(world: World, item: Object) -> None:
    """Look a World's light up in the axes of `item`, by drivers, so that it follows its turns."""
    tree = world.node_tree
    texture = next(node for node in tree.nodes if node.type == "TEX_ENVIRONMENT")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.vector_type = "TEXTURE"  # the inverse of the turn: from the world's axes to the item's
    coordinates.location, mapping.location = (-1000, 0), (-800, 0)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    for index, axis in enumerate("XYZ"):
        driver = mapping.inputs["Rotation"].driver_add("default_value", index).driver
        driver.type = "SUM"
        variable = driver.variables.new()
        variable.type = "TRANSFORMS"
        target = variable.targets[0]
        target.id, target.transform_type = item, f"ROT_{axis}"
        target.rotation_mode, target.transform_space = "XYZ", "WORLD_SPACE"


def turns_with(world: World) -> Object | None:
    """What a World's light turns with; None if that is gone, or it never did."""
    data = world.node_tree and world.node_tree.animation_data
    for curve in data.drivers if data else ():
        for variable in curve.driver.variables:
            if variable.type == "TRANSFORMS":
                return variable.targets[0].id
    return None


def _relit_before(path: Path) -> World | None:
    """The World that `relight` made of an HDRI, showing what the file holds now."""
    file = path.resolve()
    for world in bpy.data.worlds if file.is_file() else ():
        if world.get(HDRI) != str(file) or world.library:
            continue
        for node in world.node_tree.nodes:
            image = node.image if node.type == "TEX_ENVIRONMENT" else None
            # A person may have opened another picture in its place.
            if image is not None and Path(bpy.path.abspath(image.filepath)).resolve() == file:
                image.reload()
                return world
    return None


def relight(scene: Scene, path: Path) -> World:
    """Light the scene by another HDRI, once more by the same World; the one it had stays in the file.

    Raises:
        RuntimeError: Blender cannot read the picture; nothing is changed.
    """
    world = _relit_before(path) or build_world(path.stem, path)
    world[HDRI] = str(path.resolve())
    if scene.world is not None:
        scene.world.use_fake_user = True
    scene.world = world
    return world
