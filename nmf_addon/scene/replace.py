"""A job that is installed once more: what it brings takes the place of what it brought before."""

import os
from pathlib import Path

import bpy
from bpy.types import ID, Material, Mesh, Scene, World

from ...solver.job.folder import JobFolder
from ...solver.job.request import JobError
from .applied import apply_as_to
from .edited import AS_MADE, fingerprint_of, is_edited
from .images import images_of

JOB = "nmf_job"
"""path of the job's folder, on all that was installed from it"""
CAPTURE = "nmf_capture"
"""that of its capture when it began, which tells jobs of one name apart; empty of a result alone"""


def installed_before(job: JobFolder, scene: Scene) -> bpy.types.Object | None:
    """The object that a job was installed as, if it still is in a scene; that of `scene`, if it has one."""
    for item in (*scene.objects, *bpy.data.objects):
        editable = item.type == "MESH" and not item.library and not item.data.library
        if editable and is_of(item, job) and item.users_scene:
            return item
    return None


def is_of(block: ID, job: JobFolder) -> bool:
    """True if a data-block was installed from a job, also one that has moved since."""
    path = Path(block.get(JOB, ""))
    if path == job.root or (JOB in block and os.path.realpath(path) == os.path.realpath(job.root)):
        return True
    moved = path.name == job.root.name and not path.exists()
    return moved and block.get(CAPTURE) in (None, _capture_of(job))


def mark(job: JobFolder, *blocks: ID) -> None:
    """Remember what data-blocks were installed from."""
    capture = _capture_of(job)
    for block in blocks:
        block[JOB], block[CAPTURE] = str(job.root), capture


def _capture_of(job: JobFolder) -> str:
    try:
        return JobFolder.open(job.root).request.capture
    except JobError:
        return ""


def check_not_edited(item: bpy.types.Object) -> None:
    """Raise `JobError` if the mesh of an object is in Edit Mode or the like, in whatever scene: there
    Blender would drop the object together with its mesh."""
    meshes = item.data, *_copies(item)
    users = [other for other in bpy.data.objects if other.data in meshes and other.users_scene]
    for other in users:
        if other.mode != "OBJECT":
            raise JobError(
                f"{other.name} is in {other.mode.replace('_', ' ').title()} Mode in the scene "
                f"{other.users_scene[0].name}: switch to Object Mode there, then install it again."
            )


def edited_of(item: bpy.types.Object) -> list[ID]:
    """What an object was installed with, and a person has edited since; materials also with their mesh,
    which no other textures fit."""
    meshes = [item.data] if is_edited(item.data) else []
    materials = [m for m in _materials(item) if meshes or is_edited(m)]
    return [*meshes, *filter(is_edited, _worlds(item)), *materials]


def _materials(item: bpy.types.Object) -> list[Material]:
    return [m for m in item.data.materials if m is not None and _is_ours(m, item[JOB])]


def _copies(item: bpy.types.Object) -> list[Mesh]:
    """Copies of an object's mesh (Shift+D) that show its material, and that nobody has edited."""
    shown = set(_materials(item))
    return [
        mesh for mesh in bpy.data.meshes
        if mesh != item.data and mesh.users and _is_ours(mesh, item[JOB])
        and AS_MADE in mesh and shown.intersection(mesh.materials) and not is_edited(mesh)
    ]  # fmt: skip


def _worlds(item: bpy.types.Object) -> list[World]:
    # A full copy of the scene has an object and a light of its own.
    job, here = item[JOB], item.users_scene
    copies = [s for s in bpy.data.scenes if s not in here and any(_is_ours(i, job) for i in s.objects)]
    kept = {s.world for s in copies} - {s.world for s in here}
    return [w for w in bpy.data.worlds if _is_ours(w, job) and w not in kept]


def renewals(item: bpy.types.Object, mesh: Mesh) -> list[tuple[Mesh, Mesh]]:
    """Copies of an object's mesh, and last that, each with a new one to which is applied what was to it."""
    alike = fingerprint_of(item.data)
    pairs = [(copy, mesh if copy[AS_MADE] == alike else mesh.copy()) for copy in _copies(item)]
    pairs.append((item.data, mesh))
    for new, earlier in {new: earlier for earlier, new in pairs}.items():
        apply_as_to(earlier, new)
    return pairs


def replace_asset(
    item: bpy.types.Object, meshes: list[tuple[Mesh, Mesh]], material: Material, world: World,
    edited: list[ID],
) -> list[str]:  # fmt: skip
    """Put new meshes, a material and World in the place of those that an object was installed with.

    Whatever else uses the earlier ones uses the new ones then.

    Args:
        meshes: `renewals` of the object.
        edited: `edited_of` the object, before what is new has taken the place of its pictures.

    Returns: names under which the file keeps those that a person has edited.
    """
    earlier_mesh, materials, worlds = item.data, _materials(item), _worlds(item)
    slots = list(earlier_mesh.materials)
    images = {image for block in (*materials, *worlds) for image in images_of(block)}
    pairs = [(bpy.data.meshes, *pair) for pair in meshes]
    pairs += [(bpy.data.materials, earlier, material) for earlier in materials]
    pairs += [(bpy.data.worlds, earlier, world) for earlier in worlds]
    for blocks, earlier, new in pairs:
        _supersede(blocks, earlier, new, earlier in edited)
    if earlier_mesh in edited:
        for number, shown in enumerate(slots):
            earlier_mesh.materials[number] = shown
    for image in images:
        if image.users == 0 and AS_MADE in image:
            bpy.data.images.remove(image)
    for image in {*images_of(material), *images_of(world)}:
        image.name = Path(image.filepath).name
    return [earlier.name for earlier in edited]


def _is_ours(block: ID, job: str) -> bool:
    return block.get(JOB) == job and not block.library


def _supersede(blocks, earlier: ID, new: ID, keep: bool) -> None:
    name = earlier.name
    earlier.user_remap(new)
    if keep:
        earlier.name, earlier.use_fake_user = f"{name} before", True
        del earlier[JOB]
    else:
        blocks.remove(earlier)
    new.name = name
