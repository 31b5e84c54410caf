"""What this machine can do: a report a person can paste into a question."""

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from packaging.requirements import Requirement

from . import __version__
from .preflight.estimate import memory_of_machine
from .start import REQUIREMENTS

_MODULES = {
    "openimageio": "OpenImageIO", "pillow": "PIL", "PyMaxflow": "maxflow", "scikit-image": "skimage",
    "warp-lang": "warp",
}  # fmt: skip
"""what packages are imported as, where that is not their name"""
_LONGEST_LOADING = 120.0
"""seconds; the first time, a virus scanner reads along"""


def packages() -> list[str]:
    """Names of the packages that the solver needs on this machine, as its requirements have them."""
    lines = REQUIREMENTS.read_text(encoding="utf-8").splitlines()
    needed = [Requirement(line) for line in lines if line[:1].isalpha()]
    return [need.name for need in needed if need.marker is None or need.marker.evaluate()]


def loading_errors() -> list[str]:
    """A line for each package that is not there or does not load, as where a library of the system's is
    missing.

    Each loads in a process of its own: COLMAP's and torch's OpenMP runtimes do not go together everywhere.
    """
    with ThreadPoolExecutor(2) as pool:
        return [line for line in pool.map(_loading_error, packages()) if line]


def _loading_error(name: str) -> str:
    module = _MODULES.get(name, name.replace("-", "_"))
    isolated = ["-I"] if sys.flags.isolated else []
    try:
        loaded = subprocess.run(
            [sys.executable, *isolated, "-X", "utf8", "-c", f"import {module}"],
            stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace",
            timeout=_LONGEST_LOADING, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"{name} DOES NOT LOAD within {_LONGEST_LOADING:.0f} s"
    if loaded.returncode == 0:
        return ""
    said = loaded.stderr.strip().splitlines() or [f"it ended with code {loaded.returncode}"]
    return f"{name} DOES NOT LOAD: {said[-1]}"


def report() -> str:
    """Versions, devices, memory and disk as lines of text."""
    import torch

    from .fit.devices import idle_card
    from .kernels.backend import trouble_with_warp

    lines = [
        f"Neural Microfacet Fields {__version__}",
        f"Python {platform.python_version()}, {platform.platform()}",
        f"Cores {os.cpu_count()}, torch threads {torch.get_num_threads()}",
    ]
    memory = memory_of_machine()
    if memory is not None:
        lines.append(f"Memory {memory / 2**30:.0f} GiB")
    for name in packages():
        try:
            lines.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            lines.append(
                f"{name} MISSING: press Set Up Solver in Blender again, or install solver/requirements.txt"
            )
    if torch.cuda.is_available():
        free, total = torch.cuda.mem_get_info()
        lines.append(
            f"CUDA {torch.version.cuda}: {torch.cuda.get_device_name()}, "
            f"{free / 2**30:.1f} of {total / 2**30:.1f} GiB free"
        )
        trouble = trouble_with_warp("cuda")
        if trouble:
            lines.append(f"Its fast kernels DO NOT RUN; jobs take several times as long: {trouble}")
    else:
        lines.append("CUDA not available: the CPU is used")
        idle = idle_card()
        if idle is not None:
            lines.append(idle)
    if torch.backends.mps.is_available():
        lines.append("MPS available (--device mps)")
    lines.append(f"Free disk {shutil.disk_usage(os.getcwd()).free / 2**30:.0f} GiB")
    return "\n".join(lines)
