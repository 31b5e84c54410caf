"""Camera files and folders dropped into a real Blender's window."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import fake_capture
import pytest


def _libraries(folder):
    """Of `drag_source.py`, for the Python of the real Blender, which has its own and none of this one's."""
    xlib = pytest.importorskip("Xlib", reason="python-xlib drags files, and is not installed")
    import six

    shutil.copytree(Path(xlib.__file__).parent, folder / "Xlib")
    shutil.copy(six.__file__, folder / "six.py")
    return folder


@pytest.fixture(scope="module")
def report(tmp_path_factory, screenshots, in_window):
    """What `drop_steps.py` saw."""
    folder = tmp_path_factory.mktemp("drops")
    cup, urn = (fake_capture.write_capture(folder / name, 4, 64) for name in ("cup", "urn"))
    urn.write_text(json.dumps({**json.loads(urn.read_text()), "k1": -0.2}))
    pots = [cup.with_name(f"{name}.json") for name in ("jug", "pot")]
    for path in pots:
        shutil.copy(cup, path)
    in_window(
        "drop_steps.py", "dropped_last.png",
        NMF_GUI_CAPTURES=os.pathsep.join(map(str, [cup, *pots, urn])),
        NMF_GUI_DRAG_SOURCE=str(Path(__file__).with_name("drag_source.py")),
        NMF_GUI_DRAG_LIBRARIES=str(_libraries(tmp_path_factory.mktemp("libraries"))),
    )  # fmt: skip
    return json.loads((screenshots / "dropped.json").read_text())


def test_a_camera_file_dropped_into_the_3d_view_is_imported_and_one_undo_takes_it_back(report):
    assert report["view"] == [True, ["Capture cup"]]
    assert report["undone"] == []


def test_a_folder_dropped_into_the_3d_view_changes_nothing(report):
    _, captures = report["folder"]
    assert captures == []


def test_a_camera_file_dropped_onto_the_tab_is_imported(report):
    assert report["tab"] == [True, ["Capture cup"]]


def test_several_camera_files_of_a_folder_dropped_at_once_are_as_many_captures(report):
    assert report["two"] == [True, ["Capture cup", "Capture cup.001", "Capture cup.002"]]


def test_a_folder_dropped_into_the_file_browser_of_the_import_is_imported(report):
    taken, captures = report["browser"]
    assert taken and captures == [*report["two"][1], "Capture urn"]


def test_undistorted_copies_follow_an_import_and_one_undo_takes_all_of_it_back(report):
    assert report["copies"] is True
    assert report["browser undone"] == report["two"][1]
