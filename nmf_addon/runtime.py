"""The solver's own Python: found, or built by "Set up solver". Never imported by Blender."""

import importlib.util
import json
import os
import re
import sys
import time
from pathlib import Path

from .names import REPOSITORY, short_user_folder, user_folder

WINDOWS = os.name == "nt"
REQUIREMENTS = REPOSITORY / "solver" / "requirements.txt"
BOOTSTRAP = REPOSITORY / "solver" / "bootstrap.py"
PYTHON_VARIABLE, BOOTSTRAP_VARIABLE = "NMF_SOLVER_PYTHON", "NMF_SOLVER_BOOTSTRAP"
RUNTIME_VARIABLE = "NMF_RUNTIME_FOLDER"
ENVIRONMENT, RECORD = "environment", "runtime.json"
LONGEST_FOLDER = 60
"""characters of a runtime's folder on Windows: paths may have 259, and PyTorch's files take 190 below it"""
REMEMBER = 3.0  # seconds for which an answer about the disk is good enough for a panel
# What Blender's packaging (AppImage, Snap, Steam) or a shell may have set for its own Python.
DROPPED = (
    "PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP", "VIRTUAL_ENV", "LD_LIBRARY_PATH", "LD_PRELOAD",
    "DYLD_LIBRARY_PATH", "DYLD_INSERT_LIBRARIES",
)  # fmt: skip
_remembered: dict[tuple, tuple[float, Path | None, str]] = {}


class RuntimeMissing(RuntimeError):
    """There is no Python with the solver's packages; one sentence with the way out."""


def environment_python(folder: Path) -> Path:
    if WINDOWS:
        return folder / "Scripts" / "python.exe"
    return folder / "bin" / "python"


def managed_runtime(chosen_folder: str = "") -> Path:
    """Where "Set up solver" builds: the person's folder, or one that goes with the extension.

    On Windows the extension's folder lies so deep that packages have no room in it.
    """
    chosen = chosen_folder or os.environ.get(RUNTIME_VARIABLE, "")
    if chosen:
        return Path(chosen)
    folder = user_folder("runtime")
    if WINDOWS and len(str(folder)) > LONGEST_FOLDER:
        return short_user_folder() or folder
    return folder


def variable_python() -> str:
    """The Python that the environment variable names; "" if it does not."""
    return os.environ.get(PYTHON_VARIABLE, "")


def solver_python(chosen: str = "", runtime_folder: str = "") -> Path:
    """The Python to run the solver with.

    In this order: the person's choice in the preferences, the environment variable
    NMF_SOLVER_PYTHON, the runtime built by "Set up solver", this very Python if it has torch (the
    bpy wheel in the solver's environment).

    Raises:
        RuntimeMissing: none of them is there, or the one that was chosen cannot be run.
    """
    variable = f"the environment variable {PYTHON_VARIABLE}"
    for candidate, place in ((chosen, "the preferences"), (variable_python(), variable)):
        if candidate:
            a_program = not WINDOWS or Path(candidate).suffix.lower() == ".exe"
            if a_program and os.access(candidate, os.X_OK) and Path(candidate).is_file():
                return Path(candidate)
            what = "cannot be run" if Path(candidate).is_file() else "does not exist"
            raise RuntimeMissing(f"The solver's Python {candidate} {what}; correct it in {place}.")
    environment = managed_runtime(runtime_folder) / ENVIRONMENT
    if (environment / RECORD).is_file() and environment_python(environment).is_file():
        base = _base_of(environment)
        if base is None or base.is_dir():
            return environment_python(environment)
        raise RuntimeMissing(
            f"The Python that the solver was set up with is gone ({base}); press Set Up Solver again."
        )
    if Path(sys.executable).stem.startswith("python") and importlib.util.find_spec("torch"):
        return Path(sys.executable)
    raise RuntimeMissing("The solver is not set up yet; press Set Up Solver.")


def solver_state(chosen: str = "", runtime_folder: str = "") -> tuple[Path | None, str]:
    """`solver_python` for drawing: (Python, "") or (None, why not), remembered for a moment."""
    key = (chosen, runtime_folder)
    known = _remembered.get(key)
    if known is not None and time.monotonic() - known[0] < REMEMBER:
        return known[1:]
    try:
        answer: tuple[Path | None, str] = (solver_python(chosen, runtime_folder), "")
    except RuntimeMissing as error:
        answer = (None, str(error))
    _remembered[key] = (time.monotonic(), *answer)
    return answer


def forget() -> None:
    """Look again at the next question."""
    _remembered.clear()


def bootstrap_script() -> Path:
    """The script that starts the solver; tests put a stand-in here."""
    return Path(os.environ.get(BOOTSTRAP_VARIABLE, BOOTSTRAP))


def runtime_record(runtime_folder: str = "") -> dict:
    """What "Set up solver" wrote about the runtime; {} if there is none."""
    try:
        path = managed_runtime(runtime_folder) / ENVIRONMENT / RECORD
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def clean_environment() -> dict[str, str]:
    """This process's environment without what Blender's packaging may have put into it."""
    return {key: value for key, value in os.environ.items() if key not in DROPPED}


def _base_of(environment: Path) -> Path | None:
    """Folder of the Python that a virtual environment was made with (`home` of pyvenv.cfg)."""
    try:
        text = (environment / "pyvenv.cfg").read_text(encoding="utf-8")
    except OSError:
        return None
    home = re.search(r"^\s*home[ \t]*=[ \t]*(\S.*?)\s*$", text, re.MULTILINE)
    return home and Path(home[1])
