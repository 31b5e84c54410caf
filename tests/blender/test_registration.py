"""Register, unregister, register: nothing stays behind, and what is there is well described."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).resolve().parents[2]


def traces() -> dict[str, list]:
    """Everything of ours that Blender knows, by kind."""
    types = [name for name in dir(bpy.types) if name.startswith("NMF_")]
    handlers = [
        f"{kind}: {function.__module__}"
        for kind in dir(bpy.app.handlers)
        if isinstance(getattr(bpy.app.handlers, kind), list)
        for function in getattr(bpy.app.handlers, kind)
        if "nmf" in function.__module__ or "microfacet" in function.__module__
    ]
    menu = [
        function.__module__
        for function in getattr(bpy.types.TOPBAR_MT_file_import.draw, "_draw_funcs", [])
        if "microfacet" in function.__module__
    ]
    return {
        "types": types,
        "operators": [n for n in dir(bpy.ops.nmf)] if hasattr(bpy.ops, "nmf") else [],
        "properties": [
            f"{kind.__name__}.{name}"
            for kind in (bpy.types.Scene, bpy.types.Object, bpy.types.Collection)
            for name in ("nmf",)
            if hasattr(kind, name)
        ],
        "handlers": handlers,
        "menu": menu,
        "subclasses": sorted(
            cls.__name__
            for kind in (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup)
            for cls in kind.__subclasses__()
            if cls.__name__.startswith("NMF_") and getattr(cls, "is_registered", False)
        ),
    }


def test_the_root_package_imports_without_blender():
    program = (
        "import importlib.util, sys; sys.modules['bpy'] = None; "
        f"spec = importlib.util.spec_from_file_location('x', {str(ROOT / '__init__.py')!r}, "
        f"submodule_search_locations=[{str(ROOT)!r}]); "
        "module = importlib.util.module_from_spec(spec); spec.loader.exec_module(module); "
        "print(callable(module.register), callable(module.unregister))"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["True", "True"]


def test_register_unregister_register_leaves_nothing_behind(unregistered):
    package, before = unregistered, traces()
    assert before["types"] == [] and before["operators"] == [], "nothing of ours at the start"
    package.register()
    first = traces()
    assert len(first["types"]) > 15 and first["handlers"] and first["menu"] and first["properties"]
    package.unregister()
    assert traces() == before
    package.register()
    assert traces() == first
    package.unregister()
    assert traces() == before


def test_the_command_line_command_comes_and_goes(unregistered, monkeypatch):
    known = []
    with monkeypatch.context() as patch:
        patch.setattr(bpy.utils, "register_cli_command", lambda name, run: known.append(name) or name)
        patch.setattr(bpy.utils, "unregister_cli_command", known.remove)
        unregistered.register()
        assert known == ["nmf"]
        unregistered.unregister()
        assert known == []


def test_timers_end_with_the_extension(package, part, capture, fake_solver, monitor):
    fake_solver("slow")
    module = part("jobs.monitor")
    bpy.ops.nmf.reconstruct()
    process = monitor.process
    assert bpy.app.timers.is_registered(module._tick)
    package.unregister()
    assert not bpy.app.timers.is_registered(module._tick)
    assert process.popen.wait(5) == 3, "the child notices that its parent hung up"
    assert process.job.has_checkpoint()
    package.register()


def test_a_registration_that_fails_half_way_is_taken_back(unregistered, part, monkeypatch):
    package, before = unregistered, traces()

    def fail():
        raise RuntimeError("no previews today")

    with monkeypatch.context() as patch:
        patch.setattr(part("thumbnails"), "register", fail)
        with pytest.raises(RuntimeError, match="no previews"):
            package.register()
    assert traces() == before
    package.register()
    package.unregister()


def test_every_operator_and_setting_says_what_it_does(extension):
    checked = 0
    for name in dir(bpy.ops.nmf):
        rna = getattr(bpy.ops.nmf, name).get_rna_type()
        assert rna.name and len(rna.description) > 10, name
        assert not rna.description.rstrip().endswith("."), name
        checked += 1
    for prop in bpy.types.Scene.bl_rna.properties["nmf"].fixed_type.properties:
        if prop.identifier not in ("rna_type", "name"):
            assert prop.name and prop.description, prop.identifier
            assert not prop.description.endswith("."), prop.identifier
            checked += 1
    assert checked > 15


def test_a_dropped_transforms_file_is_ours_to_import(extension):
    handler = bpy.types.NMF_FH_capture
    assert handler.bl_import_operator == "nmf.import_capture"
    extensions = handler.bl_file_extensions.split(";")
    assert {".json", ".r3d"} <= set(extensions)
    assert ".zip" not in extensions, "Blender installs extensions from those"
