""" "Set up solver": builds the private environment in a background process, watched by a timer.

The build script is `setup_runtime.py`, run by a Python outside Blender's process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import bpy

from .names import REPOSITORY
from .runtime import REQUIREMENTS, clean_environment, managed_runtime

SCRIPT = REPOSITORY / "nmf_addon" / "setup_runtime.py"


@dataclass
class SetupState:
    """How far the set-up is."""

    running: bool = False
    fraction: float = 0.0
    text: str = ""
    error: str = ""


_state = SetupState()
_process: subprocess.Popen | None = None


def setup_state() -> SetupState:
    """The state of the set-up of this Blender session."""
    return _state


def base_python() -> Path:
    """Blender's own Python as a program of its own (never Blender's executable)."""
    executable = Path(sys.executable)
    if executable.stem.lower().startswith("python"):
        return executable
    name = "python.exe" if os.name == "nt" else f"python3.{sys.version_info.minor}"
    for folder in (Path(sys.prefix) / "bin", Path(sys.base_prefix) / "bin", Path("/usr/bin")):
        if (folder / name).is_file():
            return folder / name
    return executable


def start_setup(wheelhouse: str, pip_arguments: str) -> None:
    """Start building; `setup_state` tells how far it is."""
    global _process, _state
    _state = SetupState(running=True, text="Starting")
    command = [
        str(base_python()), "-I", "-u", str(SCRIPT), str(managed_runtime()), str(REQUIREMENTS),
        "--pip-arguments", pip_arguments,
    ]  # fmt: skip
    if wheelhouse:
        command += ["--wheelhouse", wheelhouse]
    _process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=clean_environment(), text=True, encoding="utf-8", errors="replace",
    )  # fmt: skip
    threading.Thread(target=_read, args=(_process, _state), daemon=True).start()
    bpy.app.timers.register(_tick, first_interval=0.3, persistent=True)


def _read(process: subprocess.Popen, state: SetupState) -> None:
    """Follow the script's lines: 'progress FRACTION TEXT', anything else is log."""
    lines: list[str] = []
    for line in process.stdout:
        words = line.rstrip().split(" ", 2)
        if words[0] == "progress" and len(words) == 3:
            state.fraction, state.text = float(words[1]), words[2]
        else:
            lines.append(line.rstrip())
    code = process.wait()
    if code != 0:
        state.error = "\n".join(lines[-8:]) or f"The set-up ended with code {code}"
    state.running = False


def cancel_setup() -> None:
    """Stop building; what was there before stays."""
    if _process is not None and _process.poll() is None:
        _process.terminate()


def _tick() -> float | None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PREFERENCES", "VIEW_3D"}:
                area.tag_redraw()
    return 0.3 if _state.running else None


def unregister() -> None:
    """Stop building when the extension goes."""
    cancel_setup()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
