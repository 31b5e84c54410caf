"""The solver's own Python: found, or built by "Set up solver". Never imported by Blender."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path

from .names import REPOSITORY, user_folder

REQUIREMENTS = REPOSITORY / "solver" / "requirements.txt"
BOOTSTRAP = REPOSITORY / "solver" / "bootstrap.py"
PYTHON_VARIABLE, BOOTSTRAP_VARIABLE = "NMF_SOLVER_PYTHON", "NMF_SOLVER_BOOTSTRAP"
RECORD = "runtime.json"


class RuntimeMissing(RuntimeError):
    """There is no Python with the solver's packages yet."""


def environment_python(folder: Path) -> Path:
    """The Python of a virtual environment."""
    if os.name == "nt":
        return folder / "Scripts" / "python.exe"
    return folder / "bin" / "python"


def managed_runtime() -> Path:
    """Where "Set up solver" builds."""
    return user_folder("runtime")


def solver_python(chosen: str = "") -> Path:
    """The Python to run the solver with.

    In this order: the person's choice in the preferences, the environment variable
    NMF_SOLVER_PYTHON, the runtime built by "Set up solver", this very Python if it has torch (the
    bpy wheel in the solver's environment).

    Raises:
        RuntimeMissing: none of them is there.
    """
    for candidate in (chosen, os.environ.get(PYTHON_VARIABLE, "")):
        if candidate:
            if Path(candidate).is_file():
                return Path(candidate)
            raise RuntimeMissing(
                f"The solver's Python {candidate} does not exist; correct it in the preferences."
            )
    runtime = managed_runtime()
    if (runtime / RECORD).is_file() and environment_python(runtime / "environment").is_file():
        return environment_python(runtime / "environment")
    if Path(sys.executable).stem.startswith("python") and importlib.util.find_spec("torch"):
        return Path(sys.executable)
    raise RuntimeMissing("The solver is not set up yet; press Set up solver in the preferences.")


def bootstrap_script() -> Path:
    """The script that starts the solver; tests put a stand-in here."""
    return Path(os.environ.get(BOOTSTRAP_VARIABLE, BOOTSTRAP))


def runtime_record() -> dict:
    """What "Set up solver" wrote about the runtime; {} if there is none."""
    try:
        return json.loads((managed_runtime() / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def clean_environment() -> dict[str, str]:
    """This process's environment without what Blender's packaging may have put into it."""
    dropped = ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "VIRTUAL_ENV")
    return {key: value for key, value in os.environ.items() if key not in dropped}
