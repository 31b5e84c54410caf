"""Set Up Solver and Check Solver: background processes, watched by a timer.

The build script is `setup_runtime.py`, run by a Python outside Blender's process; the check is the
solver's own `doctor`.
"""

import os
import re
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path

import bpy

from . import runtime
from .callbacks import start_timer, stop_timer
from .jobs.process import end_group, solver_command, start_group
from .names import REPOSITORY

SCRIPT = REPOSITORY / "nmf_addon" / "setup_runtime.py"
CANCELLED = 3  # the script's exit code
ERROR_LINES = 8


@dataclass
class SetupState:
    """How far the set-up, or the check of the solver that is set up, is.

    Attributes:
        is_check: it only asks the solver what it can do, and `log` is the answer.
        error: what the process said last, if it failed.
    """

    is_check: bool = False
    running: bool = False
    cancelling: bool = False
    fraction: float = 0.0
    text: str = ""
    error: str = ""
    log: list[str] = field(default_factory=list)


_TEMPORARY = ("/AppTranslocation/", "/Volumes/Blender")
"""in paths where macOS shows a Blender that nobody has moved to Applications, until it quits: an
environment that was made with a Python from there would be gone"""

_state = SetupState()
_process: subprocess.Popen | None = None


def setup_state() -> SetupState:
    """The state of this Blender session's last set-up or check."""
    return _state


def base_python(chosen: str = "") -> Path:
    """A Python to build with: the person's choice, else Blender's own as a program of its own.

    Never Blender's executable: it would open another Blender.

    Raises:
        RuntimeMissing: none was found.
    """
    if chosen:
        if Path(chosen).is_file():
            return Path(chosen)
        raise runtime.RuntimeMissing(f"{chosen}: there is no such Python; correct Build With.")
    candidates = [Path(sys.executable), Path(getattr(sys, "_base_executable", "") or "")]
    names = [f"python3.{sys.version_info.minor}", "python3", "python.exe", "python"]
    folders = [Path(prefix) / "bin" for prefix in (sys.prefix, sys.base_prefix)]
    folders += [Path(sys.prefix)] if os.name == "nt" else [Path("/usr/bin"), Path("/usr/local/bin")]
    candidates += [folder / name for folder in folders for name in names]
    for candidate in candidates:
        if candidate.stem.lower().startswith("python") and candidate.is_file():
            if any(part in str(candidate) for part in _TEMPORARY):
                raise runtime.RuntimeMissing(
                    "Blender is running from its disk image or download, where nothing lasts; quit "
                    "it, move it to Applications with the Finder, and start it there."
                )
            return candidate
    raise runtime.RuntimeMissing(
        "No Python was found to build with; install Python 3.11 or 3.13 and choose it in the preferences."
    )


def start_setup(
    folder: Path, python: Path, wheelhouse: str = "", pip_arguments: str = "",
    requirements: Path = runtime.REQUIREMENTS, check: Path | None = runtime.BOOTSTRAP,
) -> None:  # fmt: skip
    """Start building; `setup_state` tells how far it is.

    Raises:
        OSError: the Python cannot be started.
    """
    command = [
        str(python), "-I", "-u", "-X", "utf8", str(SCRIPT), str(folder), str(requirements),
        "--watch-stdin", f"--pip-arguments={pip_arguments}",
    ]  # fmt: skip
    command += ["--wheelhouse", wheelhouse] if wheelhouse else []
    command += ["--check", str(check)] if check is not None else []
    _follow(command, SetupState(running=True, text="Starting"))


def start_check(python: Path) -> None:
    """Start the solver to hear its versions, devices and memory; `setup_state().log` will have them.

    Raises:
        OSError: the Python cannot be started.
    """
    command = solver_command(python, runtime.bootstrap_script(), ["doctor"])
    _follow(command, SetupState(is_check=True, running=True, text="Starting the solver"))


def _follow(command: list[str], state: SetupState) -> None:
    global _process, _state
    _process = start_group(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=runtime.clean_environment(), text=True, encoding="utf-8", errors="replace",
    )  # fmt: skip
    _state = state
    threading.Thread(target=_read, args=(_process, _state), daemon=True).start()
    start_timer(_tick, 0.3)


def _read(process: subprocess.Popen, state: SetupState) -> None:
    """Follow a process's lines: 'progress FRACTION TEXT', anything else is log."""
    for line in process.stdout:
        told = re.fullmatch(r"progress (-?\d+\.\d+) (.+)", line.rstrip())
        if told:
            state.fraction, state.text = max(state.fraction, float(told[1])), told[2]
        elif line.strip():
            state.log.append(line.rstrip())
    code = process.wait()
    if code == CANCELLED or state.cancelling:
        state.text = "Cancelled"
    elif code != 0:
        tail = "\n".join(state.log[-ERROR_LINES:])
        state.error = tail or f"It ended with code {code}"
    runtime.forget()
    state.running = False


def cancel_setup() -> None:
    """Stop building, what was there before stays; or stop asking."""
    if _process is None or _process.poll() is not None:
        return
    _state.cancelling, _state.text = True, "Cancelling"
    _process.stdin.close()
    if _state.is_check:  # which writes nothing and does not listen
        end_group(_process, kill=True)


def _tick() -> float | None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PREFERENCES", "VIEW_3D"}:
                area.tag_redraw()
    return 0.3 if _state.running else None


def unregister() -> None:
    global _process, _state
    cancel_setup()
    stop_timer(_tick)
    if _process is not None:
        try:
            _process.wait(5)
        except subprocess.TimeoutExpired:
            end_group(_process, kill=True)
    _process, _state = None, SetupState()
