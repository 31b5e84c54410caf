"""Build the solver's private Python environment. Run as a program; imports nothing of ours.

    python setup_runtime.py FOLDER REQUIREMENTS [--wheelhouse DIR] [--pip-arguments TEXT]

Builds beside and renames when complete, so an interrupted set-up leaves the old runtime working.
Prints lines `progress FRACTION TEXT`.
"""

import argparse
import hashlib
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
from pathlib import Path


def say(fraction: float, text: str) -> None:
    """Print a line of progress."""
    print(f"progress {fraction:.3f} {text}", flush=True)


def python_of(environment: Path) -> Path:
    """The Python of a virtual environment."""
    return environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def main() -> int:
    """Build; returns the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("requirements", type=Path)
    parser.add_argument("--wheelhouse", type=Path)
    parser.add_argument("--pip-arguments", default="")
    options = parser.parse_args()
    if sys.version_info < (3, 11):  # noqa: UP036  (whatever Python the person chose)
        print("The solver needs Python 3.11 or newer.")
        return 1
    folder = options.folder
    new, old, final = folder / "building", folder / "previous", folder / "environment"
    record = folder / "runtime.json"
    shutil.rmtree(new, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    say(0.02, "Creating the environment")
    subprocess.run([sys.executable, "-I", "-m", "venv", "--copies", str(new)], check=True)
    command = [
        str(python_of(new)), "-I", "-m", "pip", "install", "--disable-pip-version-check",
        "--no-input", "--progress-bar", "off", "-r", str(options.requirements),
    ]  # fmt: skip
    if options.wheelhouse:
        command += ["--no-index", "--find-links", str(options.wheelhouse)]
    command += shlex.split(options.pip_arguments)
    wanted = sum(1 for line in options.requirements.read_text().splitlines() if line[:1].isalpha())
    seen = 0
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as pip:
        for line in pip.stdout:
            print(line.rstrip(), flush=True)
            if line.startswith("Collecting "):
                seen += 1
                name = line.split()[1]
                say(min(0.1 + 0.6 * seen / max(3 * wanted, 1), 0.7), f"Downloading {name}")
            elif line.startswith("Installing collected"):
                say(0.75, "Installing")
    if pip.returncode != 0:
        shutil.rmtree(new, ignore_errors=True)
        return pip.returncode
    say(0.95, "Checking")
    versions = subprocess.run(
        [str(python_of(new)), "-I", "-c", _VERSIONS], check=True, capture_output=True, text=True
    ).stdout
    content = {
        "python": platform.python_version(), **json.loads(versions),
        "requirements": hashlib.sha256(options.requirements.read_bytes()).hexdigest(),
    }  # fmt: skip
    record.unlink(missing_ok=True)
    shutil.rmtree(old, ignore_errors=True)
    if final.exists():
        final.rename(old)
    new.rename(final)
    record.write_text(json.dumps(content, indent=1), encoding="utf-8")
    shutil.rmtree(old, ignore_errors=True)
    say(1.0, "Done")
    return 0


_VERSIONS = """
import importlib.metadata, json
def version(name):
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
print(json.dumps({name: version(name) for name in ("torch", "numpy", "numba")}))
"""

if __name__ == "__main__":
    sys.exit(main())
