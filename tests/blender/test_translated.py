"""A Blender whose interface speaks another language, which names new nodes and words errors in that."""

import types

import bpy
import pytest


@pytest.mark.parametrize("word", ["Fehler", "エラー", "Error"])
def test_an_error_is_told_without_the_word_before_it(extension, monkeypatch, word):
    reports = extension("reports")
    translations = types.SimpleNamespace(pgettext_rpt={"Error": word}.get)
    app = types.SimpleNamespace(app=types.SimpleNamespace(translations=translations))
    monkeypatch.setattr(reports, "bpy", app)
    assert reports.reason_of(RuntimeError(f"{word}: no such file\n")) == "no such file"
    assert reports.reason_of(RuntimeError("Error: no such file")) == "no such file"


def in_german(tree):
    for number, node in enumerate(tree.nodes):
        node.name = f"Knoten {number}"


def test_nodes_are_known_whatever_their_names_are(result_job, tmp_path):
    """Blender names new ones in the person's language; the names are no edit of theirs."""
    assert bpy.ops.nmf.install_result(directory=str(result_job)) == {"FINISHED"}
    item, scene = bpy.context.view_layer.objects.active, bpy.context.scene
    hdri = result_job / "result" / "environment.exr"
    for tree in (item.active_material.node_tree, scene.world.node_tree, *bpy.data.node_groups):
        in_german(tree)
    counts = len(bpy.data.materials), len(bpy.data.worlds), len(bpy.data.node_groups)
    assert bpy.ops.nmf.install_result(directory=str(result_job)) == {"FINISHED"}
    assert counts == (len(bpy.data.materials), len(bpy.data.worlds), len(bpy.data.node_groups))
    assert bpy.ops.nmf.relight_hdri(filepath=str(hdri)) == {"FINISHED"}
    in_german(scene.world.node_tree)
    light = scene.world
    assert bpy.ops.nmf.relight_hdri(filepath=str(hdri)) == {"FINISHED"}
    assert scene.world == light
