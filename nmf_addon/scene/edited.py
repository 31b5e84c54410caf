"""Whether a person has changed what a result was installed as; blocks have a mark of what they were."""

import hashlib
from collections.abc import Iterator

import bpy
import numpy as np
from bpy.types import Image, Material, Mesh, World

from .cameras import photo_path
from .images import images_of

AS_MADE = "nmf_as_made"
"""fingerprint of a mesh, material or World as it was installed, and of a picture's file"""
_SETTINGS = ("BOOLEAN", "ENUM", "FLOAT", "INT", "STRING")
_RAYS = "camera", "diffuse", "glossy", "transmission", "shadow", "scatter"
"""what sees a World as made; Cycles cannot be asked while it is off"""
_NO_EDITS = (
    "is_active_output", "paint_active_slot", "paint_clone_slot", "preview_render_type", "use_preview_world",
    "use_nodes",  # Blender 6.0 has none, and 5.1 warns who asks
)  # fmt: skip


def mark_as_made(block: Mesh | Material | World) -> None:
    """Remember a data-block as it is now, and the pictures that it shows."""
    for image in images_of(block):
        image[AS_MADE] = _of_file(image)
    block[AS_MADE] = fingerprint_of(block)


def is_edited(block: Mesh | Material | World) -> bool:
    """True if a data-block is another than when it was marked, or shows a picture that was painted on;
    False of one that never was marked."""
    if AS_MADE not in block:
        return False
    return block[AS_MADE] != fingerprint_of(block) or any(map(is_painted, images_of(block)))


def is_painted(image: Image) -> bool:
    """True if a picture, or the file that it shows, is another than when it was marked."""
    made = image.get(AS_MADE, "")
    return image.is_dirty or (made != "" and _of_file(image) not in ("", made))


def _of_file(image: Image) -> str:
    try:
        data = image.packed_file.data if image.packed_file else photo_path(image).read_bytes()
    except OSError:
        return ""
    return hashlib.sha1(data).hexdigest()


def fingerprint_of(block: Mesh | Material | World) -> str:
    """Of what a person can change in a data-block and would miss; not its name, nor how its nodes lie.

    Of pictures it tells which there are, as they were made: see `is_painted`.
    """
    parts = _of_mesh(block) if isinstance(block, Mesh) else _of_nodes(block)
    return hashlib.sha1("\n".join(parts).encode()).hexdigest()


def _of_mesh(mesh: Mesh) -> Iterator[str]:
    yield _of_array(mesh.vertices, "co", np.empty(3 * len(mesh.vertices), dtype=np.float32))
    yield _of_array(mesh.loops, "vertex_index", np.empty(len(mesh.loops), dtype=np.int32))
    yield f"{len(mesh.polygons)} faces, shape keys: {mesh.shape_keys is not None}"
    yield f"materials: {[material and material.get(AS_MADE) for material in mesh.materials]}"
    yield _of_array(mesh.polygons, "material_index", np.empty(len(mesh.polygons), dtype=np.int32))
    for name in ("use_seam", "use_edge_sharp"):
        yield _of_array(mesh.edges, name, np.empty(len(mesh.edges), dtype=bool))
    for layer in mesh.uv_layers:
        yield _of_array(layer.uv, "vector", np.empty(2 * len(layer.uv), dtype=np.float32))
    yield f"layers: {len(mesh.uv_layers)} {len(mesh.color_attributes)}"
    yield f"groups: {any(vertex.groups for vertex in mesh.vertices)}"


def _of_array(items: bpy.types.bpy_prop_collection, name: str, values: np.ndarray) -> str:
    items.foreach_get(name, values)
    return hashlib.sha1(values.tobytes()).hexdigest()


def _of_nodes(block: Material | World) -> Iterator[str]:
    yield f"{_settings_of(block)}"
    seen = getattr(block, "cycles_visibility", None)
    without = None if isinstance(block, Material) else [f"{ray} True" for ray in _RAYS]
    yield f"{_settings_of(seen) if seen else without}"
    tree = block.node_tree
    drivers = tree.animation_data.drivers if tree.animation_data else []
    driven = {driver.data_path for driver in drivers}
    yield f"drivers: {sorted((driver.data_path, driver.array_index) for driver in drivers)}"
    for node in tree.nodes:
        yield f"{node.bl_idname} {node.mute} {_settings_of(node)}"
        for socket in node.inputs:
            name = "default_value"
            if hasattr(socket, name) and socket.path_from_id(name) not in driven:
                yield f"{socket.identifier} {_plain(socket.default_value)}"
    for link in tree.links:
        ends = (link.from_node, link.from_socket, link.to_node, link.to_socket)
        yield " ".join(end.bl_idname if hasattr(end, "mute") else end.identifier for end in ends)


def _settings_of(node: bpy.types.bpy_struct) -> list[str]:
    """What one node or data-block has and not all have; of a picture of the person's, its name."""
    common = {*node.bl_rna.base.properties.keys(), *_NO_EDITS}
    own = [p for p in node.bl_rna.properties if p.identifier not in common and p.type in _SETTINGS]
    told = [f"{p.identifier} {_plain(getattr(node, p.identifier))}" for p in own]
    image = getattr(node, "image", None)
    return told if image is None else [*told, image.get(AS_MADE, image.name)]


def _plain(value: object) -> str:
    try:
        return str([round(number, 6) for number in value])
    except TypeError:
        return str(value)
