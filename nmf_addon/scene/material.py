"""The material: the solver's surface model in Cycles, and its nearest Principled relative elsewhere.

Two outputs. For Cycles: Diffuse(ρ(1 − F0)(1 − s(n·v))) + Metallic BSDF(F0, GGX), which is the
solver's model to 0.2 % under an environment (s, the hemispherical mean of (1 − v·h)^5, is fitted).
For EEVEE and what Blender exports to: Principled with metals as metals, and F0 as specular tint beside.
"""

from pathlib import Path

import bpy
from bpy.types import Material, Node, NodeSocket, NodeTree

from .images import load_picture

GROUP_NAME = "NMF Surface"
GROUP_INPUTS = {
    "Albedo": "NodeSocketColor", "F0": "NodeSocketColor", "Roughness": "NodeSocketFloat",
    "Normal": "NodeSocketVector",
}  # fmt: skip
GROUP_OUTPUT = "Surface"
SHOWN = ("base_colour", "metallic", "albedo", "roughness", "f0", "normal")
"""textures from top to bottom"""
PRINCIPLED_F0 = 0.04  # of Principled's index of refraction 1.5
MODEL_SCALE, MODEL_POWER, MODEL_OFFSET = 0.0271, 2.65, 0.0005


def build_material(name: str, pictures: dict[str, Path], textures: dict) -> Material:
    """A material of a result's textures.

    Args:
        pictures: files of "albedo", "roughness", "f0" and "normal"; of "base_colour" and "metallic", if the
            result has those.
        textures: what they are (`manifest["textures"]`).

    Raises:
        RuntimeError: Blender cannot read one of them.
    """
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    images = {}
    for row, key in enumerate(SHOWN):
        if key in pictures:
            images[key] = node = tree.nodes.new("ShaderNodeTexImage")
            node.image = load_picture(pictures[key], textures[key]["colour_space"])
            node.label, node.location = key.replace("_", " ").title(), (-900, 860 - 280 * row)

    f0_scale = float(textures["f0"]["scale"])
    f0 = _mix_multiply(tree, images["f0"].outputs["Color"], f0_scale)
    f0.location = (-560, -220)
    normal = tree.nodes.new("ShaderNodeNormalMap")
    normal.space = "TANGENT"
    normal.location = (-560, -540)
    tree.links.new(images["normal"].outputs["Color"], normal.inputs["Color"])

    exact = tree.nodes.new("ShaderNodeGroup")
    exact.node_tree = surface_group()
    exact.location = (-200, -120)
    sources = {
        "Albedo": images["albedo"].outputs["Color"], "F0": _colour_result(f0),
        "Roughness": images["roughness"].outputs["Color"], "Normal": normal.outputs["Normal"],
    }  # fmt: skip
    for socket, source in sources.items():
        tree.links.new(source, exact.inputs[socket])

    principled = _principled(tree, images, normal, f0_scale)
    portable_output = _output(tree, "ALL", principled.outputs["BSDF"], (420, 320))
    _output(tree, "CYCLES", exact.outputs[GROUP_OUTPUT], (420, -120))
    portable_output.is_active_output = True
    return material


def surface_group() -> NodeTree:
    """The node group "NMF Surface": the solver's surface model; made once per file.

    One that is linked from a library, or that has other sockets, is somebody else's.
    """
    for existing in bpy.data.node_groups:
        if existing.name.startswith(GROUP_NAME) and not existing.library and _has_sockets(existing):
            return existing
    group = bpy.data.node_groups.new(GROUP_NAME, "ShaderNodeTree")
    for name, kind in GROUP_INPUTS.items():
        group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
    group.interface.new_socket(GROUP_OUTPUT, in_out="OUTPUT", socket_type="NodeSocketShader")
    nodes, links = group.nodes, group.links
    inputs, output = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    inputs.location, output.location = (-1000, 0), (600, 0)

    transmitted = _vector_math(group, "SUBTRACT", (1.0, 1.0, 1.0), inputs.outputs["F0"])
    attenuated = _vector_math(group, "MULTIPLY", inputs.outputs["Albedo"], transmitted)
    share = _angular_share(group, inputs.outputs["Normal"])
    diffuse_colour = _vector_math(group, "MULTIPLY", attenuated, share)
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    links.new(diffuse_colour, diffuse.inputs["Color"])
    links.new(inputs.outputs["Normal"], diffuse.inputs["Normal"])

    metallic = nodes.new("ShaderNodeBsdfMetallic")
    metallic.distribution, metallic.fresnel_type = "GGX", "F82"
    metallic.inputs["Edge Tint"].default_value = (1, 1, 1, 1)
    links.new(inputs.outputs["F0"], metallic.inputs["Base Color"])
    links.new(inputs.outputs["Roughness"], metallic.inputs["Roughness"])
    links.new(inputs.outputs["Normal"], metallic.inputs["Normal"])

    both = nodes.new("ShaderNodeAddShader")
    links.new(diffuse.outputs[0], both.inputs[0])
    links.new(metallic.outputs[0], both.inputs[1])
    links.new(both.outputs[0], output.inputs[GROUP_OUTPUT])
    diffuse.location, metallic.location, both.location = (100, 150), (100, -150), (350, 0)
    return group


def _has_sockets(group: NodeTree) -> bool:
    sockets = {
        (item.name, item.in_out, item.socket_type)
        for item in group.interface.items_tree
        if item.item_type == "SOCKET"
    }
    ours = {(name, "INPUT", kind) for name, kind in GROUP_INPUTS.items()}
    return sockets == ours | {(GROUP_OUTPUT, "OUTPUT", "NodeSocketShader")}


def _angular_share(group: NodeTree, normal: NodeSocket):
    """1 − s(n·v) = 1 − 0.0005 − 0.0271·(1 − n·v)^2.65."""
    geometry, dot = group.nodes.new("ShaderNodeNewGeometry"), group.nodes.new("ShaderNodeVectorMath")
    dot.operation = "DOT_PRODUCT"
    group.links.new(geometry.outputs["Incoming"], dot.inputs[0])
    group.links.new(normal, dot.inputs[1])
    value = _math(group, "ABSOLUTE", dot.outputs["Value"])
    value = _math(group, "SUBTRACT", 1.0, value, clamp=True)
    value = _math(group, "POWER", value, MODEL_POWER)
    value = _math(group, "MULTIPLY", value, MODEL_SCALE)
    return _math(group, "SUBTRACT", 1.0 - MODEL_OFFSET, value)


def _math(tree, operation: str, *operands, clamp: bool = False):
    node = tree.nodes.new("ShaderNodeMath")
    node.use_clamp = clamp
    return _computed(tree, node, operation, operands)


def _vector_math(tree, operation: str, *operands):
    return _computed(tree, tree.nodes.new("ShaderNodeVectorMath"), operation, operands)


def _computed(tree, node: Node, operation: str, operands: tuple):
    node.operation = operation
    for socket, operand in zip(node.inputs, operands, strict=False):
        if isinstance(operand, (float, tuple)):
            socket.default_value = operand
        else:
            tree.links.new(operand, socket)
    return node.outputs[0]


def _principled(tree, images, normal, f0_scale: float):
    """Principled with base colour, metalness, and F0 as Specular Tint, through a Mix node, which glTF's
    exporter turns into specularColorFactor × texture without loss; USD, FBX and OBJ know no tint."""
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    node.location = (-40, 420)
    node.distribution = "GGX"
    node.inputs["IOR"].default_value = 1.5
    base = images.get("base_colour", images["albedo"])
    tree.links.new(base.outputs["Color"], node.inputs["Base Color"])
    if "metallic" in images:
        tree.links.new(images["metallic"].outputs["Color"], node.inputs["Metallic"])
    tree.links.new(images["roughness"].outputs["Color"], node.inputs["Roughness"])
    tree.links.new(normal.outputs["Normal"], node.inputs["Normal"])
    tint = _mix_multiply(tree, images["f0"].outputs["Color"], f0_scale / PRINCIPLED_F0)
    tint.location = (-300, 420)
    tree.links.new(_colour_result(tint), node.inputs["Specular Tint"])
    return node


def _mix_multiply(tree, colour, factor: float) -> Node:
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type = "RGBA", "MULTIPLY"
    node.clamp_result = False
    node.inputs["Factor"].default_value = 1.0
    a, b = (s for s in node.inputs if s.type == "RGBA")
    tree.links.new(colour, a)
    b.default_value = (factor, factor, factor, 1.0)
    return node


def _colour_result(mix: Node) -> NodeSocket:
    return next(socket for socket in mix.outputs if socket.type == "RGBA")


def _output(tree, target: str, surface, location) -> Node:
    node = tree.nodes.new("ShaderNodeOutputMaterial")
    node.target, node.location = target, location
    tree.links.new(surface, node.inputs["Surface"])
    return node
