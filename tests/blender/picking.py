"""What a person picks, for tests."""

import bmesh
import bpy


def select_two_vertices(item: bpy.types.Object) -> None:
    """Select the first and the eighth vertex of a mesh in Edit Mode, and no other."""
    mesh = bmesh.from_edit_mesh(item.data)
    mesh.verts.ensure_lookup_table()
    for vertex in mesh.verts:
        vertex.select = vertex.index in (0, 7)
    mesh.select_flush_mode()
    bmesh.update_edit_mesh(item.data)
