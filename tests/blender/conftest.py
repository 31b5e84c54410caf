"""Blender as a module, with the extension loaded as a plain package and a stand-in for the solver.

Timers do not fire without Blender's event loop, so tests call the monitor's `tick` themselves.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import tempfile
import time
import types
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
PACKAGE = "neural_microfacet_fields"
sys.path[:0] = [str(ROOT), str(HERE)]
# Before Blender starts: nothing of the person's own configuration is read or written.
_user = tempfile.TemporaryDirectory(prefix="nmf-tests-")
os.environ["BLENDER_USER_RESOURCES"] = _user.name
os.environ["NMF_SOLVER_PYTHON"] = sys.executable
os.environ["NMF_SOLVER_BOOTSTRAP"] = str(HERE / "fake_solver.py")

bpy = pytest.importorskip("bpy", reason="Blender as a module (bpy) is not installed")

import fake_capture  # noqa: E402
import fake_result  # noqa: E402
from drawing import Layout  # noqa: E402


@pytest.fixture(scope="session")
def package():
    """The extension as package `neural_microfacet_fields`, not registered."""
    if PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            PACKAGE, ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
        )
        sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[PACKAGE])
    return sys.modules[PACKAGE]


@pytest.fixture(scope="session")
def part(package):
    """Import a module of `nmf_addon` by its name; nothing is registered."""
    return lambda name: importlib.import_module(f"{PACKAGE}.nmf_addon.{name}")


@pytest.fixture
def add_capture(tmp_path):
    """Import one more capture of three photos."""

    def add(name):
        path = fake_capture.write_capture(tmp_path / name)
        bpy.ops.nmf.import_capture("EXEC_DEFAULT", True, filepath=str(path))
        return bpy.context.scene.nmf.capture

    return add


@pytest.fixture(autouse=True)
def extension(package, part):
    """The extension, registered, in an empty file; called with a name, a module of `nmf_addon`."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    package.register()
    yield part
    process = part("jobs.monitor").monitor.process
    package.unregister()
    if process is not None and process.popen.poll() is None:
        process.popen.kill()
        process.popen.wait()
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture
def unregistered(extension, package):
    """The extension's package before it is registered."""
    package.unregister()
    return package


@pytest.fixture
def monitor(extension):
    """The job monitor."""
    return extension("jobs.monitor").monitor


@pytest.fixture
def duck():
    """The sample capture."""
    return ROOT / "samples" / "duck"


@pytest.fixture
def result_job(tmp_path):
    """A finished job: a cube."""
    fake_result.write_result(tmp_path / "jöb 1")
    return tmp_path / "jöb 1"


@pytest.fixture
def capture(extension, tmp_path):
    """A capture of three photos, imported; a file saved beside it, so jobs go to a known place."""
    path = fake_capture.write_capture(tmp_path / "phötos of it")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.ops.nmf.import_capture(filepath=str(path)) == {"FINISHED"}
    return bpy.context.scene.nmf.capture


@pytest.fixture
def fake_solver(monkeypatch):
    """Choose how the stand-in for the solver behaves."""

    def choose(mode: str, pause: float = 0.01):
        monkeypatch.setenv("NMF_FAKE_MODE", mode)
        monkeypatch.setenv("NMF_FAKE_PAUSE", str(pause))

    choose("normal")
    return choose


@pytest.fixture
def tick(monitor):
    """Be Blender's timer until `condition()` or the job's end; fails after `seconds`."""

    def run(condition=None, seconds: float = 20.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            again = monitor.tick()
            if condition() if condition else again is None:
                return
            time.sleep(0.01)
        pytest.fail(f"not within {seconds} s; the job is {monitor.model}")

    return run


@pytest.fixture
def task(extension):
    """The side task, and being Blender's timer until it ends."""
    item = extension("jobs.side_task").side_task

    def finish(condition=None, seconds=20.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            again = item.tick()
            if condition() if condition else again is None:
                return item
            time.sleep(0.01)
        pytest.fail(f"not within {seconds} s: {item.model}")

    item.finish = finish
    yield item
    if item.process is not None:
        item.process.popen.kill()


def context_of_width(width):
    """What panels ask of a context, in a region of a width in pixels."""
    return types.SimpleNamespace(
        scene=bpy.context.scene, region=types.SimpleNamespace(width=width),
        preferences=bpy.context.preferences, collection=bpy.context.collection,
        view_layer=bpy.context.view_layer,
    )  # fmt: skip


@pytest.fixture
def draw(extension):
    """Draw a panel; returns what it drew and all its words."""

    def run(name, width=280):
        panel = types.SimpleNamespace(layout=Layout())
        context = context_of_width(width)
        getattr(extension("panels"), f"NMF_PT_{name}").draw(panel, context)
        drawn = panel.layout.drawn
        words = " ".join(item[1] for item in drawn if item[0] in ("label", "progress"))
        return drawn, words

    return run
