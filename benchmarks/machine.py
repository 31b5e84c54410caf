"""What ran a benchmark, and which code."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

from solver.threads import usable_cores

ROOT = Path(__file__).resolve().parent.parent


def machine() -> dict:
    """What ran it."""
    import torch

    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text().splitlines()
        name = next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), name)
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    return {
        "machine": name, "cores": os.cpu_count(), "gpu": gpu, "system": platform.system(),
        "threads": int(os.environ.get("OMP_NUM_THREADS", usable_cores())),
        "python": platform.python_version(), "torch": torch.__version__,
    }  # fmt: skip


def commit() -> str:
    """The commit of the code, with '+' if files were changed since."""
    run = lambda *a: subprocess.run(("git", *a), cwd=ROOT, capture_output=True, text=True).stdout  # noqa: E731
    changed = run("status", "--porcelain", "--untracked-files=no", "--", "solver").strip()
    return run("rev-parse", "--short", "HEAD").strip() + ("+" if changed else "")


def describe_machine() -> str:
    """Machine, threads, versions and commit in a line."""
    it = machine()
    return (
        f"{it['threads']} of {it['cores']} cores, {it['machine']}, {it['system']}, "
        f"Python {it['python']}, torch {it['torch']}, commit {commit()}"
    )
