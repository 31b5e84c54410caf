"""A job that is installed once more replaces what it brought before, where that stands now."""

import shutil

import bpy
import fake_result
import numpy as np
import pytest


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
    assert tuple(image_of(item, "albedo").pixels[:3]) == (1, 0, 0)
    assert copy.data == item.data and item.data.vertices[0].co.x != 77
    nodes = bpy.context.scene.world.node_tree.nodes
    light = next(n.image for n in nodes if n.type == "TEX_ENVIRONMENT")
    assert light.pixels[0] == 3.0


def test_a_folder_that_is_no_job_is_told_apart_from_an_unfinished_one(install, tmp_path):
    with pytest.raises(RuntimeError, match="this is no job folder; choose the folder of one job"):
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
