"""Worlds: the recovered light, and others to relight with."""

from __future__ import annotations

from pathlib import Path

import bpy


def build_world(name: str, path: Path) -> bpy.types.World:
    """A World lit by an equirectangular HDRI, unrotated, strength 1, linear Rec.709.

    Raises:
        RuntimeError: Blender cannot load the image.
    """
    image = bpy.data.images.load(str(path), check_existing=True)
    if path.suffix.lower() in (".exr", ".hdr"):
        image.colorspace_settings.name = "Linear Rec.709"
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


def relight(scene: bpy.types.Scene, path: Path) -> bpy.types.World:
    """Light the scene by another HDRI; the World it had stays in the file."""
    world = build_world(path.stem, path)
    if scene.world is not None:
        scene.world.use_fake_user = True
    scene.world = world
    return world
