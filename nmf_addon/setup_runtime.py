"""Build the solver's private Python environment. Run as a program; imports nothing of ours.

    python setup_runtime.py FOLDER REQUIREMENTS [--wheelhouse DIR] [--pip-arguments TEXT]
                                                [--check SCRIPT] [--watch-stdin]

Builds FOLDER/building and renames it to FOLDER/environment when complete, so an interrupted set-up
leaves the old environment working. Prints lines `progress FRACTION TEXT`; the rest is log. With
--watch-stdin its end means that Blender is gone or the person cancelled: the step under way is ended and
`building` removed.
"""

import argparse
import ctypes
import errno
import hashlib
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import threading
import time
from collections.abc import Callable
from pathlib import Path

CANCELLED = 3
NEWEST = (3, 13)
"""version of Python that there are all packages for"""
DEEPEST = ("n" * 59, "n" * 59, "n" * 59, "n" * 9)
"""as long a path as the longest of the packages' files has in an environment: a licence in PyTorch"""
PATIENCE = 20.0
"""seconds for which a virus scanner on Windows may hold what was just written"""
_children: list[subprocess.Popen] = []
_cancelled = threading.Event()


class StepFailed(Exception):
    """A step did not work; its output was printed."""


def main() -> int:
    """Build; returns the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("requirements", type=Path)
    parser.add_argument("--wheelhouse", type=Path)
    parser.add_argument("--pip-arguments", default="")
    parser.add_argument("--check", type=Path, help="script that must run in the new environment")
    parser.add_argument("--watch-stdin", action="store_true")
    options = parser.parse_args()
    if sys.version_info < (3, 11):  # noqa: UP036  (whatever Python the person chose)
        print(f"The solver needs Python 3.11 or newer; {sys.executable} is older.")
        return 1
    if options.watch_stdin:
        threading.Thread(target=_watch_stdin, daemon=True).start()
    new = options.folder / "building"
    try:
        build(options, new)
    except StepFailed as error:
        if not _cancelled.is_set():
            print(error)
        return CANCELLED if _cancelled.is_set() else 1
    except OSError as error:
        print(f"{error.filename or options.folder}: {error.strerror}")
        return 1
    finally:
        shutil.rmtree(new, ignore_errors=True)
    say(1.0, "Done")
    return 0


def build(options: argparse.Namespace, new: Path) -> None:
    """All steps.

    Raises:
        StepFailed, OSError.
    """
    shutil.rmtree(new, ignore_errors=True)
    options.folder.mkdir(parents=True, exist_ok=True)
    check_room_for_paths(new)
    check_system_libraries()
    say(0.01, "Creating the environment")
    command = [sys.executable, "-I", "-m", "venv", str(new)]
    failure = "The environment could not be created; choose another Python as Build With."
    run(command, failure)
    if not python_of(new).is_file():  # a Python on Windows that comes without its launcher
        raise StepFailed(failure)
    install(options, new)
    say(0.92, "Checking")
    if options.check:
        # The new environment must start the solver, in the new process's own words.
        failure = "The packages were installed, but the solver does not start with them."
        run(solver_command(options, new, "doctor"), failure)
        compile_loops(options, new)
    write_record(options, new)
    if _cancelled.is_set():
        raise StepFailed("Cancelled")
    put_in_place(new, options.folder / "environment", options.folder / "previous")


def check_room_for_paths(new: Path) -> None:
    """Make and remove a file as deep in the environment as the packages' files go.

    Windows allows paths of 259 characters unless somebody has switched longer ones on; pip would find
    out after the download.

    Raises:
        StepFailed: there is no room. OSError: nothing can be written there.
    """
    deepest = new.joinpath(*DEEPEST)
    try:
        deepest.parent.mkdir(parents=True)
        deepest.touch()
    except OSError as error:
        if error.errno not in (errno.ENOENT, errno.ENAMETOOLONG):
            raise
        raise StepFailed(
            f"{new.parent}: the packages' files would have longer paths than this system allows; choose "
            "a Folder with a shorter path in the preferences, such as C:\\nmf."
        ) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def check_system_libraries(load: Callable[[str], object] = ctypes.CDLL) -> None:
    """Make sure that this Python, which the environment's starts, finds what compiled packages need.

    Args:
        load: loads a library by its file's name.

    Raises:
        StepFailed: Windows has none of it; packages would be downloaded, and not load.
    """
    if os.name != "nt":
        return
    try:
        for name in ("msvcp140.dll", "vcruntime140_1.dll"):
            load(name)
    except OSError as error:
        raise StepFailed(
            "Windows lacks Microsoft's Visual C++ libraries, which the solver's packages need; install "
            "https://aka.ms/vs/17/release/vc_redist.x64.exe, and press Set Up Solver again."
        ) from error


def install(options: argparse.Namespace, new: Path) -> None:
    """pip, with a share of its work done for each line of it."""
    command = [
        str(python_of(new)), "-I", "-m", "pip", "install", "--disable-pip-version-check",
        "--no-input", "--progress-bar", "off", "-r", str(options.requirements),
    ]  # fmt: skip
    if options.wheelhouse:
        command += ["--no-index", "--find-links", str(options.wheelhouse)]
    command += words_of(options.pip_arguments)
    lines = options.requirements.read_text(encoding="utf-8").splitlines()
    expected = max(2 * sum(line[:1].isalpha() for line in lines), 1)  # with what those need
    seen = 0

    def listen(line: str) -> None:
        nonlocal seen
        words = line.split()
        if line.startswith(("Collecting ", "Processing ")) and len(words) > 1:
            seen += 1
            # The share left shrinks but never ends, however many packages come along.
            share = 1 - 0.5 ** (2.0 * seen / expected)
            end = "==" if line.startswith("Collecting") else "-"  # a requirement or a wheel's file
            name = words[1].rpartition("/")[2].partition(end)[0]
            say(0.05 + 0.65 * share, f"Fetching {name}")
        elif line.startswith("  Downloading "):
            size = line[line.rfind("(") :] if line.rstrip().endswith(")") else ""
            name = words[1].rpartition("/")[2].partition("-")[0]
            say(-1.0, f"Fetching {name} {size}".strip())
        elif line.startswith("Installing collected"):
            say(0.75, "Installing the packages")

    failure = f"pip could not install the packages; see above. {why_without_packages()}".strip()
    run(command, failure, listen)


def compile_loops(options: argparse.Namespace, new: Path) -> None:
    """Have the solver compile its loops, so that the first reconstruction need not; one that can't now does
    then, or says why.

    Raises:
        StepFailed: the set-up was cancelled.
    """
    say(0.95, "Compiling the solver's loops, about a minute")
    failure = "The solver's loops could not be compiled; the first reconstruction tries again."
    try:
        run(solver_command(options, new, "compile"), failure)
    except StepFailed as error:
        if _cancelled.is_set():
            raise
        print(error, flush=True)


def solver_command(options: argparse.Namespace, new: Path, word: str) -> list[str]:
    """The solver's command `word`, by the new environment."""
    return [str(python_of(new)), "-I", "-X", "utf8", str(options.check), word]


def why_without_packages() -> str:
    """Why there are no packages for this computer or Python, one sentence; empty where there are."""
    if sys.version_info[:2] > NEWEST:
        newest = ".".join(map(str, NEWEST))
        return (
            f"Not all of them exist for Python {platform.python_version()}; choose one from 3.11 to "
            f"{newest} as Build With in the preferences."
        )
    if sys.platform == "darwin" and platform.machine() == "x86_64":
        return "They no longer exist for Intel Macs; on a Mac with an Apple chip, use Blender for that."
    if sys.platform == "darwin" and int(platform.mac_ver()[0].partition(".")[0] or 14) < 14:
        return "They need macOS 14 or newer."
    if sysconfig.get_platform() in ("win32", "win-arm64"):
        return (
            "They need a 64-bit Python for Intel and AMD processors; install one and choose it as "
            "Build With in the preferences."
        )
    return ""


def words_of(text: str) -> list[str]:
    """A command line's words; quoted ones may hold blanks, and backslashes are those of Windows' paths.

    Raises:
        StepFailed: a quote is not closed.
    """
    splitter = shlex.shlex(text, posix=True, punctuation_chars=False)
    splitter.whitespace_split, splitter.commenters, splitter.escape = True, "", ""
    try:
        return list(splitter)
    except ValueError as error:
        raise StepFailed(f"pip Arguments: a quote is not closed in '{text}'; close it.") from error


def run(command: list[str], failure: str, listen=None) -> None:
    """Run a step, print its output, and let `listen` see each line.

    Raises:
        StepFailed: with `failure` and the exit code.
    """
    if _cancelled.is_set():
        raise StepFailed("Cancelled")
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, encoding="utf-8", errors="replace",
    )  # fmt: skip
    _children.append(process)
    with process:
        for line in process.stdout:
            print(line.rstrip(), flush=True)
            if listen is not None:
                listen(line)
    _children.remove(process)
    if process.returncode != 0 or _cancelled.is_set():
        raise StepFailed(f"{failure} (exit code {process.returncode})")


def write_record(options: argparse.Namespace, new: Path) -> None:
    """`runtime.json` inside the environment: what it holds, and of which requirements."""
    command = [str(python_of(new)), "-I", "-c", _VERSIONS]
    answer = subprocess.run(
        command, capture_output=True, stdin=subprocess.DEVNULL, encoding="utf-8", errors="replace"
    )
    if answer.returncode != 0:
        raise StepFailed(
            f"The packages do not load together: {answer.stderr.strip()[-500:]} (see requirements)"
        )
    versions = answer.stdout
    content = {
        "python": platform.python_version(), **json.loads(versions),
        "requirements": hashlib.sha256(options.requirements.read_bytes()).hexdigest(),
    }  # fmt: skip
    (new / "runtime.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def put_in_place(new: Path, final: Path, old: Path) -> None:
    """Rename the complete environment to its place; the one that was there goes."""
    shutil.rmtree(old, ignore_errors=True)
    if final.exists():
        rename(final, old)
    try:
        rename(new, final)
    except (OSError, StepFailed):
        if old.exists():
            rename(old, final)
        raise
    shutil.rmtree(old, ignore_errors=True)


def rename(source: Path, target: Path) -> None:
    """Rename a folder; Windows does so only once nobody has a file in it open.

    Raises:
        StepFailed: somebody has. OSError: another reason.
    """
    end = time.monotonic() + PATIENCE
    while True:
        try:
            source.rename(target)
            return
        except PermissionError as error:
            if time.monotonic() > end:
                raise StepFailed(
                    f"{source}: it cannot be renamed ({error.strerror}); close what uses it, such as a "
                    "solver of another Blender, then press Set Up Solver again."
                ) from error
            time.sleep(0.1)


def python_of(environment: Path) -> Path:
    return environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def say(fraction: float, text: str) -> None:
    """Print a line of progress; a negative fraction leaves the bar where it is."""
    print(f"progress {fraction:.3f} {text}", flush=True)


def _watch_stdin() -> None:
    # os.read: a buffered reader would hold a lock at the interpreter's end.
    while os.read(0, 4096):
        continue
    _cancelled.set()
    for process in list(_children):
        process.kill()


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
