"""A result that cannot be used is told in a sentence, and leaves nothing in the file."""

import json
import math
import re
import struct
from pathlib import Path

import bpy
import fake_result
import pytest

KINDS = ("objects", "meshes", "materials", "images", "worlds", "node_groups")


@pytest.fixture
def install(extension, result_job):
    """Install the finished job."""
    return lambda: extension("scene.install").install_result(bpy.context, result_job)


def edit(job, change):
    path = job / "result" / "manifest.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")


def blocks():
    return {kind: [block.name for block in getattr(bpy.data, kind)] for kind in KINDS}


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m["textures"]["f0"].pop("scale"),
        lambda m: m["textures"]["f0"].update(scale=0),
        lambda m: m["textures"]["f0"].update(scale="much"),
        lambda m: m["textures"].pop("normal"),
        lambda m: m["textures"]["albedo"].pop("colour_space"),
        lambda m: m["textures"]["albedo"].update(file=3),
        lambda m: m.update(textures=[]),
        lambda m: m.update(origin=[1, 2]),
        lambda m: m.update(placement=[[1, 0, 0, 0]]),
        lambda m: m.pop("environment"),
    ],
)
def test_a_manifest_that_lacks_something_is_told_and_changes_nothing(
    install, extension, result_job, change
):
    edit(result_job, change)
    before = blocks()
    with pytest.raises(extension("scene.result").JobError, match="manifest.json: it is incomplete"):
        install()
    assert blocks() == before


@pytest.mark.parametrize("name", ["albedo.png", "normal.png", "environment.exr"])
def test_a_picture_that_cannot_be_decoded_is_told_and_changes_nothing(install, result_job, name):
    (result_job / "result" / name).write_bytes(b"xx")
    before = blocks()
    with pytest.raises(RuntimeError, match=f"{name}: Blender cannot read this image"):
        bpy.ops.nmf.install_result(directory=str(result_job))
    assert blocks() == before


def test_a_damaged_result_leaves_the_one_that_was_installed_before(install, result_job):
    item = install().object
    before, vertices = blocks(), len(item.data.vertices)
    (result_job / "result" / "roughness.png").write_bytes(b"xx")
    with pytest.raises(RuntimeError, match="roughness.png"):
        install()
    assert blocks() == before and len(item.data.vertices) == vertices


def test_a_damaged_result_leaves_the_files_of_the_one_that_was_installed_before(install, result_job):
    """A fixed bug: they were written over, and the object was pink once its file was opened again."""
    install()
    files = {file: file.read_bytes() for file in (result_job / "textures").iterdir()}
    (result_job / "result" / "albedo.png").write_bytes(b"xx")
    fake_result.write_png(result_job / "result" / "normal.png", (128, 128, 250))
    with pytest.raises(RuntimeError, match=re.escape(str(Path("result", "albedo.png")))):
        install()
    assert len(files) == 7 and all(file.read_bytes() == was for file, was in files.items())


FIRST_FACE = 24 * 32  # bytes of the vertices before it


@pytest.mark.parametrize(
    "place, change",
    [(FIRST_FACE + 1, struct.pack("<i", 24)), (FIRST_FACE + 1, struct.pack("<i", -1)),
     (FIRST_FACE, b"\4"), (0, struct.pack("<f", math.nan))],
    ids=["a vertex too far", "a vertex below 0", "four corners", "no number"],
)  # fmt: skip
def test_a_mesh_with_damage_inside_is_told_and_changes_nothing(
    install, extension, result_job, place, change
):
    """A fixed bug: it got a traceback, or what it is not for an object."""
    path, before = result_job / "result" / "mesh.ply", blocks()
    head, mark, body = path.read_bytes().partition(b"end_header\n")
    path.write_bytes(head + mark + body[:place] + change + body[place + len(change) :])
    with pytest.raises(extension("scene.result").JobError, match="the mesh is damaged"):
        install()
    assert blocks() == before


def test_a_mesh_of_nothing_is_told(install, extension, result_job):
    path = result_job / "result" / "mesh.ply"
    head, mark, _ = path.read_bytes().partition(b"end_header\n")
    head = head.replace(b"vertex 24", b"vertex 0").replace(b"face 12", b"face 0")
    path.write_bytes(head + mark)
    with pytest.raises(extension("scene.result").JobError, match="the mesh is damaged"):
        install()


def test_a_damaged_hdri_does_not_become_the_light(install, tmp_path):
    world = install().world
    before = blocks()
    (tmp_path / "sky.exr").write_bytes(b"xx")
    with pytest.raises(RuntimeError, match="sky.exr: Blender cannot read"):
        bpy.ops.nmf.relight_hdri(filepath=str(tmp_path / "sky.exr"))
    assert bpy.context.scene.world == world and blocks() == before


def group_of(asset):
    tree = asset.material.node_tree
    return next(node.node_tree for node in tree.nodes if node.type == "GROUP")


def test_a_persons_own_node_group_of_our_groups_name_is_not_used(install):
    mine = bpy.data.node_groups.new("NMF Surface", "ShaderNodeTree")
    mine.interface.new_socket("Colour", in_out="INPUT", socket_type="NodeSocketColor")
    ours = group_of(install())
    assert ours != mine and len(mine.interface.items_tree) == 1
    assert group_of(install()) == ours, "made once"


def test_a_linked_node_group_is_not_used(install, tmp_path):
    install()
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.node_groups = ["NMF Surface"]
    assert bpy.data.node_groups["NMF Surface"].library
    assert group_of(install()).library is None
