"""A finished job into the scene: object, material, World."""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Collection, Context, LayerCollection, Material, Mesh, Object, Scene, ViewLayer, World
from mathutils import Matrix

from ...solver.capture.placement import counted_from
from ...solver.job.folder import JobFolder
from ..names import JOBS_OF_UNSAVED, user_folder
from .adjusted_cameras import adjust_cameras
from .applied import remember_built
from .capture_collection import root_of, scene_of
from .edited import is_edited, mark_as_made
from .images import images_of, nothing_left_behind
from .job_space import job_space
from .light_axes import light_by
from .material import build_material
from .pictures import named_pictures
from .replace import check_not_edited, edited_of, installed_before, is_of, mark, renewals, replace_asset
from .result import job_of_result, read_manifest, read_ply
from .selection import make_active
from .world import build_world


@dataclass(frozen=True)
class InstalledAsset:
    """What an installation added, how many cameras it moved to where their photos fit, and names of what a
    person had edited and is no longer shown."""

    object: Object
    material: Material
    world: World
    manifest: dict
    moved_cameras: int = 0
    kept: tuple[str, ...] = ()


def install_result(
    context: Context, job_root: Path, collection: Collection | None = None
) -> InstalledAsset:
    """Add the asset of a job to the scene and light it by the recovered World.

    If it was installed before, the object stays as and where it is, and gets the new mesh and material;
    earlier ones that a person has edited stay in the file.
    Cameras that the job has adjusted to their photos move to where it has them.

    Args:
        job_root: the job's folder, its folder `result`, or a copy of that.
        collection: the capture it belongs to: the object is placed under its transform and in its
            scene. None: in the context's scene.

    Raises:
        JobError: no complete result, one of its files is missing or damaged, or what it was installed as is
            in Edit Mode; nothing is added.
        RuntimeError: Blender cannot read one of its pictures; nothing is added.
    """
    job = job_of_result(job_root)
    manifest = read_manifest(job)
    positions, normals, uvs, faces = read_ply(job.result_dir / manifest["mesh"])
    name = job.root.name
    scene = (collection and scene_of(collection, context.scene)) or context.scene
    earlier = installed_before(job, scene)
    if earlier is not None:
        check_not_edited(earlier)
    edited = [] if earlier is None else edited_of(earlier)
    data = bpy.data
    ours = (block for block in (*data.materials, *data.worlds) if is_of(block, job))
    blocks = {*edited, *filter(is_edited, ours)}
    kept = {Path(image.filepath).name for block in blocks for image in images_of(block)}
    pictures = named_pictures(job, manifest, kept)
    with nothing_left_behind(
        data.objects, data.meshes, data.materials, data.node_groups, data.images, data.worlds
    ):
        mesh = build_mesh(name, positions, normals, uvs, faces)
        remember_built(mesh)
        material = build_material(name, pictures, manifest["textures"])
        mesh.materials.append(material)
        renewed = [] if earlier is None else renewals(earlier, mesh)
        world = build_world(f"{name} Light", pictures["environment"])
        if job.root.is_relative_to(user_folder(JOBS_OF_UNSAVED, create=False)):
            # That goes with the extension, and what is made of the result may outlive that.
            for image in (*images_of(material), *images_of(world)):
                image.pack()
        item = earlier or _place(context, scene, job, mesh, manifest, collection)
    left = [] if earlier is None else replace_asset(earlier, renewed, material, world, edited)
    meshes = {mesh, *(new for _, new in renewed)}
    mark(job, item, material, world, *meshes)
    moved = adjust_cameras(job, collection) if collection is not None else 0
    _light(world, item, job, manifest, collection)
    for block in (world, material, *meshes):
        mark_as_made(block)
    shown = context.scene if context.scene in item.users_scene else item.users_scene[0]
    before = shown.world
    if before not in (None, world) and (is_edited(before) or not is_of(before, job)):
        before.use_fake_user = True
    shown.world = world
    make_active(item, _view_layer(context, shown))
    return InstalledAsset(item, material, world, manifest, moved, tuple(left))


def _place(
    context: Context, scene: Scene, job: JobFolder, mesh: Mesh,
    manifest: dict, collection: Collection | None,
) -> Object:  # fmt: skip
    item = bpy.data.objects.new(job.root.name, mesh)
    home = _home(collection, scene, _view_layer(context, scene))
    home.objects.link(item)
    if collection is None:
        # What stands the mesh upright where its capture is not there to do so.
        matrix = Matrix(manifest.get("placement", Matrix.Identity(4)))
        matrix = None if matrix == Matrix.Identity(4) else matrix
    else:
        item.parent = root_of(collection)
        matrix = _in_capture(job, manifest, collection)
    if matrix is not None:
        frame = bpy.data.objects.new(f"{item.name} Frame", None)
        frame.empty_display_type, frame.parent, frame.matrix_local = "ARROWS", item.parent, matrix
        home.objects.link(frame)
        item.parent = frame
    return item


def _light(
    world: World, item: Object, job: JobFolder, manifest: dict, collection: Collection | None
) -> None:
    """Let a result's light turn with its capture, or with what stands the result upright."""
    root = root_of(collection) if collection is not None else None
    above = item.parent
    if root is None or above is None or (above != root and above.parent == root):
        light_by(world, item, above, Matrix.Identity(4))
    else:
        matrix = _in_capture(job, manifest, collection)
        light_by(world, item, root, matrix or Matrix.Identity(4))


def _home(collection: Collection | None, scene: Scene, view_layer: ViewLayer) -> Collection:
    """The capture's collection; the scene's where that cannot be changed, or is not seen."""
    if collection is None or collection.library or collection.override_library:
        return scene.collection
    return collection if _is_shown(collection, view_layer.layer_collection) else scene.collection


def _is_shown(collection: Collection, layer: LayerCollection) -> bool:
    """True if what is in a collection is seen and rendered in a view layer, or in this part of one."""
    shown = layer.collection
    if layer.exclude or layer.hide_viewport or shown.hide_viewport or shown.hide_render:
        return False
    return shown == collection or any(_is_shown(collection, child) for child in layer.children)


def _view_layer(context: Context, scene: Scene) -> ViewLayer:
    return context.view_layer if scene == context.scene else scene.view_layers[0]


def _in_capture(job: JobFolder, manifest: dict, collection: Collection) -> Matrix | None:
    """Where in the capture's space the coordinates of a result are; None if they are the same."""
    matrix = job_space(job, collection)
    origin = np.array(manifest.get("origin", (0.0, 0.0, 0.0)), dtype=np.float64)
    if matrix is None and not origin.any():
        return None
    return Matrix(counted_from(np.eye(4) if matrix is None else matrix, origin))


def build_mesh(name, positions, normals, uvs, faces) -> Mesh:
    """A connected mesh: vertices doubled for UV seams are welded, the seams live in the UV map."""
    unique, welded = np.unique(positions, axis=0, return_inverse=True)
    corners = faces.ravel()
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(unique))
    mesh.vertices.foreach_set("co", unique.ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", welded.ravel()[corners].astype(np.int32))
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", np.ascontiguousarray(uvs[corners]).ravel())
    mesh.update(calc_edges=True)
    mesh.normals_split_custom_set(normals[corners])
    return mesh
