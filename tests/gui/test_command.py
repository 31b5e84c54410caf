"""Without a window, in a real Blender that has the extension installed: its command, its sample, its preferences."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import fake_capture
import pytest

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "reconstruct.py"
COMMANDS = {
    "command": ("--command", "nmf", "reconstruct"),
    "sample": ("--python", str(SAMPLE), "--"),
}


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return fake_capture.write_capture(tmp_path_factory.mktemp("capture") / "photos", 5, 32)


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_a_capture_becomes_a_blend(blender, capture, tmp_path, words):
    out = tmp_path / "out.blend"
    blender("headless", "--", *words, str(capture), str(out), NMF_FAKE_MODE="normal")
    assert out.stat().st_size > 0


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_bad_input_is_told_in_the_exit_code(blender, tmp_path, words):
    told = blender("headless", "--", *words, str(tmp_path / "nothing"), str(tmp_path / "out.blend"), code=2)
    assert str(tmp_path / "nothing") in told


@pytest.mark.skipif(os.name == "nt", reason="there is no Ctrl-C for one process there")
@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_ctrl_c_ends_it_as_cancelled(begin_blender, capture, tmp_path, words):
    """A fixed bug: Blender passed over Ctrl-C, and a second one ended it with the code for bad input."""
    out = tmp_path / "out.blend"
    command = ["headless", "--", *words, str(capture), str(out)]
    with begin_blender(*command, NMF_FAKE_MODE="slow", NMF_FAKE_PAUSE="0.2") as process:
        told = []
        for line in process.stdout:
            told.append(line)
            if line.startswith("fit:"):
                break
        os.killpg(process.pid, signal.SIGINT)
        told += list(process.stdout)
        assert process.wait(30) == 3, "".join(told)
    assert "Cancelled." in "".join(told) and "Traceback" not in "".join(told)
    assert not out.exists()


def test_other_folders_in_the_preferences_are_looked_at_without_an_error(blender, tmp_path):
    script = tmp_path / "preferences.py"
    script.write_text(
        "import bpy, sys\n"
        "module = 'bl_ext.user_default.neural_microfacet_fields'\n"
        "preferences = bpy.context.preferences.addons[module].preferences\n"
        "runtime = sys.modules[module + '.nmf_addon.runtime']\n"
        "for name in ('python', 'runtime_folder'):\n"
        "    runtime.solver_state()\n"
        "    setattr(preferences, name, '/elsewhere')\n"
        "    assert not runtime._remembered, name\n"
    )
    blender("headless", "--", "--python", str(script))
