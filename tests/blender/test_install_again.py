"""A job that is installed once more replaces what it brought before, where that stands now."""

import json
import shutil
import types
from pathlib import Path

import addon_utils
import bpy
import fake_result
import numpy as np
import pytest
from mathutils import Vector


def counts():
    kinds = ("objects", "meshes", "materials", "images", "worlds", "node_groups")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


@pytest.fixture
def install(result_job):
    """Install the finished job; the object it is."""

    def run(root=result_job):
        assert bpy.ops.nmf.install_result(directory=str(root)) == {"FINISHED"}
        return bpy.context.view_layer.objects.active

    return run


def image_of(item, label):
    return next(n.image for n in item.active_material.node_tree.nodes if n.label == label)


def test_a_job_installed_again_is_there_once(install):
    names = [block.name for block in (install().data, bpy.context.scene.world)]
    images = sorted(image.name for image in bpy.data.images)
    before = counts()
    item = install()
    assert counts() == before
    assert [block.name for block in (item.data, bpy.context.scene.world)] == names
    assert sorted(image.name for image in bpy.data.images) == images
    assert item.active_material.name == "jöb 1"


def test_a_job_installed_again_stays_where_the_person_put_it(install):
    item = install()
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    shelf.objects.link(item)
    bpy.context.scene.collection.objects.unlink(item)
    item.name, item.location = "Duck", (1, 2, 3)
    again = install()
    assert again == item and again.name == "Duck" and again.users_collection == (shelf,)
    np.testing.assert_array_equal(again.location, (1, 2, 3))


def test_a_job_installed_again_shows_what_it_holds_now(install, result_job):
    """Textures, light, mesh: also where they were packed, and in a linked duplicate."""
    item = install()
    copy = item.copy()
    bpy.context.scene.collection.objects.link(copy)
    copy.data.vertices[0].co.x = 77
    bpy.ops.file.pack_all()
    fake_result.write_png(result_job / "result" / "albedo.png", (255, 0, 0))
    fake_result.write_exr(result_job / "result" / "environment.exr", value=3.0)
    install()
    assert tuple(image_of(item, "Albedo").pixels[:3]) == (1, 0, 0)
    assert copy.data == item.data and item.data.vertices[0].co.x != 77
    nodes = bpy.context.scene.world.node_tree.nodes
    light = next(n.image for n in nodes if n.type == "TEX_ENVIRONMENT")
    assert light.pixels[0] == 3.0


def test_a_folder_that_is_no_job_is_told_apart_from_an_unfinished_one(install, tmp_path):
    with pytest.raises(RuntimeError, match="this is not a job folder; choose one"):
        install(tmp_path)
    (tmp_path / "job.json").write_text("{}")
    with pytest.raises(RuntimeError, match="no complete result yet; resume it"):
        install(tmp_path)


def test_a_deleted_result_can_be_installed_again(install):
    bpy.data.objects.remove(install())
    assert install().name == "jöb 1"


def test_a_job_that_was_moved_is_still_the_same(install, result_job):
    item = install()
    moved = result_job.parent / "elsewhere" / result_job.name
    shutil.copytree(result_job, moved)
    assert install(moved) != item, "a copy is another job"
    bpy.data.objects.remove(bpy.context.view_layer.objects.active)
    shutil.rmtree(result_job)
    assert install(moved) == item


def test_a_job_that_is_reached_by_a_link_is_still_the_same(install, result_job, tmp_path):
    """A fixed bug: its object was there twice."""
    item = install()
    link = tmp_path / "link"
    link.symlink_to(tmp_path, target_is_directory=True)
    assert install(link / result_job.name) == item
    assert image_of(item, "Albedo").name == "jöb 1_albedo.png"
    assert len(list((result_job / "textures").glob("*albedo.png"))) == 1


def test_a_light_that_was_deleted_with_its_object_does_not_stay_for_good(install):
    install()
    bpy.ops.object.delete()
    install()
    assert sum(world.use_fake_user or world.users > 0 for world in bpy.data.worlds) == 1


def test_nodes_that_lie_elsewhere_and_other_previews_are_no_edit(install):
    material = install().active_material
    material.preview_render_type = "CUBE"
    for node in material.node_tree.nodes:
        node.location.x += 100
        node.select = not node.select
    before = counts()
    install()
    assert counts() == before


def test_whether_nodes_are_used_which_blender_6_does_not_tell_is_no_edit(install):
    material = install().active_material
    material.use_nodes = bpy.context.scene.world.use_nodes = False
    before = counts()
    install()
    assert counts() == before


def test_a_full_copy_of_a_scene_is_left_alone_when_the_other_is_renewed(install):
    item, first = install(), bpy.context.scene
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.context.scene
    (copy,) = [i for i in second.objects if i.get("nmf_job")]
    lights = first.world, second.world
    assert lights[0] != lights[1] and copy != item
    copy.data.vertices[0].co.x = item.data.vertices[0].co.x = 77
    assert install() == copy
    assert copy.data.vertices[0].co.x != 77 and item.data.vertices[0].co.x == 77
    assert first.world == lights[0] and second.world != first.world


def test_a_light_that_another_scene_shares_is_renewed_there_too(install):
    install()
    first, names = bpy.context.scene, [world.name for world in bpy.data.worlds]
    other = bpy.data.scenes.new("other")
    other.world = first.world
    install()
    assert other.world == first.world
    assert [world.name for world in bpy.data.worlds] == names


def test_what_the_person_made_of_a_result_is_left_alone(install):
    item = install()
    copy = item.copy()
    copy.data = item.data.copy()
    copy.data.vertices[0].co.x = 77
    bpy.context.scene.collection.objects.link(copy)
    mine = bpy.data.materials.new("mine")
    copy.data.materials.append(mine)
    bpy.context.scene.world = bpy.data.worlds.new("my light")
    assert install() == item
    assert copy.data.vertices[0].co.x == 77 and copy.data.materials[1] == mine
    assert copy.data.materials[0] == item.active_material
    assert bpy.data.worlds["my light"].use_fake_user


def paint(item):
    item.active_material.node_tree.nodes["Principled BSDF"].inputs["Coat Weight"].default_value = 0.5
    return item.active_material


def rewire(item):
    tree = item.active_material.node_tree
    roughness = next(link for link in tree.links if link.to_socket.name == "Roughness")
    tree.links.remove(roughness)
    return item.active_material


def sculpt(item):
    item.data.vertices[0].co.x += 0.1
    return item.data


def add_slot(item):
    item.data.materials.append(bpy.data.materials.new("Sticker"))
    return item.data


def group_vertices(item):
    item.vertex_groups.new(name="Lid").add([0, 1], 1.0, "REPLACE")
    return item.data


def brighten(item):
    background = bpy.context.scene.world.node_tree.nodes["Background"]
    background.inputs["Strength"].default_value = 2.0
    return bpy.context.scene.world


def unwrap_anew(item):
    for corner in item.data.uv_layers[0].uv:
        corner.vector = 0.5 * corner.vector
    return item.data


def mark_seams(item):
    item.data.edges[0].use_seam = True
    return item.data


def own_picture(block, kind):
    node = next(node for node in block.node_tree.nodes if node.type == kind)
    node.image = bpy.data.images.new("mine", 8, 8)
    return block


def replace_a_texture(item):
    return own_picture(item.active_material, "TEX_IMAGE")


def replace_the_light(item):
    return own_picture(bpy.context.scene.world, "TEX_ENVIRONMENT")


def swap_pictures(item):
    nodes = [n for n in item.active_material.node_tree.nodes if n.type == "TEX_IMAGE"]
    nodes[0].image, nodes[1].image = nodes[1].image, nodes[0].image
    return item.active_material


def cull(item):
    item.active_material.use_backface_culling = True
    return item.active_material


def hide_from_cameras(item):
    bpy.context.scene.world.cycles_visibility.camera = False
    return bpy.context.scene.world


def show_texels(item):
    nodes = item.active_material.node_tree.nodes
    next(node for node in nodes if node.type == "TEX_IMAGE").interpolation = "Closest"
    return item.active_material


@pytest.mark.parametrize(
    "edit",
    [paint, rewire, sculpt, add_slot, group_vertices, brighten, unwrap_anew, mark_seams,
     replace_a_texture, replace_the_light, swap_pictures, cull, hide_from_cameras, show_texels],
)  # fmt: skip
def test_what_a_person_has_edited_stays_in_the_file_when_it_is_renewed(install, edit):
    block = edit(install())
    name = block.name
    item = install()
    assert block.name == f"{name} before" and block.use_fake_user
    now = {"Mesh": item.data, "Material": item.active_material, "World": bpy.context.scene.world}
    assert now[type(block).__name__].name == name
    before = counts()
    install()
    assert counts() == before, "only what was edited is kept"
    assert block.name == f"{name} before"


def test_what_was_edited_keeps_its_pictures_when_the_result_has_others(install, result_job):
    """A fixed bug: their files were written over, and no copy of them was left."""
    material = paint(install())
    image = image_of(bpy.context.view_layer.objects.active, "Albedo")
    before = Path(image.filepath).read_bytes()
    fake_result.write_png(result_job / "result" / "albedo.png", (255, 0, 0))
    for _ in range(2):
        shown = image_of(install(), "Albedo")
        assert material.name == "jöb 1 before"
        assert Path(image.filepath).read_bytes() == before
        assert tuple(shown.pixels[:3]) == (1, 0, 0)
    assert len(list((result_job / "textures").glob("*albedo.png"))) == 2


def test_a_mesh_that_was_edited_keeps_its_textures_when_the_result_has_others(install, result_job):
    """A fixed bug: it showed the new ones, which lie elsewhere on it."""
    item = install()
    mesh = sculpt(item)
    mesh.materials.append(bpy.data.materials.new("Mine"))
    image = image_of(item, "Albedo")
    before = Path(image.filepath).read_bytes()
    fake_result.write_png(result_job / "result" / "albedo.png", (255, 0, 0))
    for _ in range(2):
        shown = image_of(install(), "Albedo")
        assert tuple(shown.pixels[:3]) == (1, 0, 0)
        assert [m.name for m in mesh.materials] == ["jöb 1 before", "Mine"]
        nodes = mesh.materials[0].node_tree.nodes
        assert image in [node.image for node in nodes if node.type == "TEX_IMAGE"]
        assert Path(image.filepath).read_bytes() == before


def duplicate(item):
    """Shift+D."""
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    assert copy != item and copy.data != item.data
    assert copy.active_material == item.active_material
    return copy


def test_a_copy_of_an_object_is_renewed_with_it(install, result_job):
    """A fixed bug: it kept its mesh, with the new textures on it."""
    item = install()
    copy = duplicate(item)
    copy.location.x = 3
    before = counts()
    name = item.data.name
    fake_result.write_png(result_job / "result" / "albedo.png", (255, 0, 0))
    assert install() == item
    assert copy.data == item.data and item.data.name == name and copy.location.x == 3
    assert tuple(image_of(copy, "Albedo").pixels[:3]) == (1, 0, 0)
    assert counts() == {**before, "meshes": before["meshes"] - 1}


def test_a_light_that_was_edited_keeps_its_picture_when_its_object_is_gone(install, result_job):
    """A fixed bug: its file was written over when the result was installed again with another light."""
    install()
    world = brighten(bpy.context.view_layer.objects.active)
    image = next(n.image for n in world.node_tree.nodes if n.type == "TEX_ENVIRONMENT")
    before = Path(image.filepath).read_bytes()
    bpy.ops.object.delete()
    fake_result.write_exr(result_job / "result" / "environment.exr", value=3.0)
    install()
    assert bpy.context.scene.world != world and world.use_fake_user
    assert Path(image.filepath).read_bytes() == before


def test_a_result_that_is_in_another_scene_is_renewed_there_and_one_is_told(install, capfd):
    item = install()
    bpy.context.window.scene = bpy.data.scenes.new("Second")
    capfd.readouterr()
    bpy.ops.nmf.install_result(directory=item["nmf_job"])
    assert "Its object is in the scene Scene" in capfd.readouterr().out
    assert list(bpy.context.scene.objects) == []


def test_what_was_painted_and_saved_stays_and_the_result_is_as_it_was(install, result_job):
    """A fixed bug: it was saved into the result itself, or was gone when that was installed again."""
    item = install()
    image, material = image_of(item, "Albedo"), item.active_material
    before = (result_job / "result" / "albedo.png").read_bytes()
    image.pixels[0] = 1 - image.pixels[0]
    image.save()
    painted = Path(bpy.path.abspath(image.filepath)).read_bytes()
    assert painted != before == (result_job / "result" / "albedo.png").read_bytes()
    for _ in range(2):
        item = install()
        assert material.name == "jöb 1 before"
        assert Path(bpy.path.abspath(image.filepath)).read_bytes() == painted
        shown = image_of(item, "Albedo")
        assert Path(bpy.path.abspath(shown.filepath)).read_bytes() == before


def test_what_was_painted_in_another_file_stays(install, result_job):
    """A fixed bug: the same result installed in a second .blend wrote over the first one's paint."""
    image = image_of(install(), "Albedo")
    image.pixels[0] = 1 - image.pixels[0]
    image.save()
    file = Path(bpy.path.abspath(image.filepath))
    painted, made = file.read_bytes(), (result_job / "result" / "albedo.png").read_bytes()
    for _ in range(2):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        shown = image_of(install(), "Albedo")
        assert file.read_bytes() == painted
        assert Path(bpy.path.abspath(shown.filepath)).read_bytes() == made
    (result_job / "textures.json").write_text("{")  # as if nothing were known of what was made
    bpy.ops.wm.read_factory_settings(use_empty=True)
    install()
    assert file.read_bytes() == painted
    assert len(list((result_job / "textures").glob("*albedo.png"))) == 2


def test_a_result_that_is_made_anew_counts_as_nothing_painted(install, result_job):
    install()
    fake_result.write_result(result_job)
    (result_job / "result" / "albedo.png").write_bytes((result_job / "result" / "f0.png").read_bytes())
    before = counts()
    install()
    assert counts() == before
    assert len(list((result_job / "textures").glob("*albedo.png"))) == 1


def test_a_job_of_the_same_name_in_another_project_is_another_job(install, result_job, tmp_path):
    """A fixed bug: once the one's folder was gone, the other's result took its object."""
    item = install()
    mesh = item.data
    other = tmp_path / "other project" / result_job.name
    shutil.copytree(result_job, other)
    request = json.loads((other / "job.json").read_text())
    (other / "job.json").write_text(json.dumps({**request, "capture": "/other/capture"}))
    shutil.rmtree(result_job)
    assert install(other) != item and item.data == mesh


def test_a_file_that_was_saved_and_opened_has_nothing_edited(install, tmp_path):
    install()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    before = counts()
    install()
    assert counts() == before


def test_a_file_that_is_opened_with_cycles_off_has_nothing_edited(install, tmp_path):
    """A fixed bug: its light was kept as one that the person had edited."""
    install()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    addon_utils.disable("cycles")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
        assert not hasattr(bpy.context.scene.world, "cycles_visibility"), "else this tests nothing"
        before = counts()
        install()
        assert counts() == before
    finally:
        addon_utils.enable("cycles")
    install()
    assert counts() == before


def test_a_light_that_follows_its_capture_is_not_edited_by_that(install, extension):
    edited, world = extension("scene.edited"), extension("scene.world")
    install()
    light, frame = bpy.context.scene.world, bpy.data.objects.new("Frame", None)
    bpy.context.scene.collection.objects.link(frame)
    world.turn_with(light, frame)
    edited.mark_as_made(light)
    frame.rotation_euler = (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    mapping = light.node_tree.nodes["Mapping"].inputs["Rotation"]
    assert mapping.default_value[2] == pytest.approx(0.3)
    assert not edited.is_edited(light)
    mapping.driver_remove("default_value", 2)
    assert edited.is_edited(light)


def apply_transform(item):
    """Ctrl+A."""
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)


def corners(item):
    bpy.context.view_layer.update()
    return np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])


@pytest.mark.parametrize("scale", [(0.2, 0.2, 0.2), (2, 3, 4), (-2, 2, 2)])
def test_a_job_installed_again_stays_where_the_person_put_and_applied_it(install, scale):
    """A fixed bug: it had its first size, at the first place."""
    item = install()
    for turn in (0.3, 0.5):
        item.location, item.rotation_euler, item.scale = (1, 2, 3), (0.1, turn, 0), scale
        apply_transform(item)
        before = corners(item)
        assert install() == item
        np.testing.assert_allclose(corners(item), before, atol=1e-5)
        centre = before.mean(0)
        assert all((face.center - Vector(centre)) @ face.normal > 0 for face in item.data.polygons)


def test_a_mesh_that_was_sculpted_at_a_corner_moves_nothing_that_comes_after_it(install):
    item = install()
    before = corners(item)
    item.data.vertices[0].co *= 3
    np.testing.assert_array_equal(corners(install()), before)


def test_what_was_applied_to_a_mesh_counts_whatever_is_sculpted_at_a_corner_of_it(install):
    """A fixed bug: what came after it had its first size."""
    item = install()
    item.scale = (2, 3, 4)
    apply_transform(item)
    before = corners(item)
    item.data.vertices[0].co += Vector((0.7, 0.2, -0.4))
    np.testing.assert_allclose(corners(install()), before, atol=1e-5)


@pytest.mark.parametrize("applied", ["original", "copy"])
def test_a_copy_of_an_object_stays_as_large_whichever_of_them_was_applied(install, extension, applied):
    """A fixed bug: what was applied to the one was applied to the other, too, and counted twice there."""
    item, is_edited = install(), extension("scene.edited").is_edited
    copy = duplicate(item)
    pair = {"original": item, "copy": copy}
    for one in pair.values():
        one.scale = (2, 2, 2)
    bpy.ops.object.select_all(action="DESELECT")
    pair[applied].select_set(True)
    apply_transform(pair[applied])
    before = {name: corners(one) for name, one in pair.items()}
    for _ in range(2):
        assert install() == item
        for name, one in pair.items():
            np.testing.assert_allclose(corners(one), before[name], atol=1e-5)
            assert not is_edited(one.data) or applied == name == "copy"


def test_a_copy_that_tells_not_whether_it_was_edited_is_left_alone(install):
    """Of a result that was installed before that was remembered."""
    item = install()
    copy = duplicate(item)
    for one in (item, copy):
        del one.data["nmf_as_made"]
    copy.data.vertices[0].co.x = 77
    assert install() == item
    assert copy.data != item.data and copy.data.vertices[0].co.x == 77


class Leaf(dict):
    """An object that was installed from nothing, and whose scenes take time in all objects to tell."""

    type, library, data = "MESH", None, types.SimpleNamespace(library=None)

    @property
    def users_scene(self):
        raise AssertionError("its scenes were asked for")


def test_a_job_is_looked_for_without_asking_each_object_for_its_scenes(extension, result_job, monkeypatch):
    """A fixed bug: Undo, after which the tab looks for it, took seconds in a large scene."""
    replace = extension("scene.replace")
    job = extension("scene.result").job_of_result(result_job)
    leaves = types.SimpleNamespace(objects=[Leaf() for _ in range(3)])
    monkeypatch.setattr(replace, "bpy", types.SimpleNamespace(data=leaves))
    assert replace.installed_before(job, leaves) is None


def test_a_mesh_with_a_vertex_that_is_nowhere_moves_nothing_that_comes_after_it(install):
    item = install()
    before = corners(item)
    item.data.vertices[0].co.x = float("nan")
    np.testing.assert_array_equal(corners(install()), before)
