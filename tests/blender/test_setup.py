"""Set Up Solver, for real but without a network: a wheelhouse with one small package of ours."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest


@pytest.fixture
def wheelhouse(tmp_path):
    """A folder with a wheel of one module, and requirements that ask for it."""
    folder = tmp_path / "wheel house"
    folder.mkdir()
    info = "tiny_solver-1.0.dist-info"
    files = {
        "tiny_solver.py": "ANSWER = 42\n",
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: tiny-solver\nVersion: 1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = ""
    for name, text in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=")
        record += f"{name},sha256={digest.decode()},{len(text)}\n"
    with zipfile.ZipFile(folder / "tiny_solver-1.0-py3-none-any.whl", "w") as wheel:
        for name, text in {**files, f"{info}/RECORD": record + f"{info}/RECORD,,\n"}.items():
            wheel.writestr(name, text)
    (folder / "requirements.txt").write_text("# pinned\ntiny-solver==1.0\n")
    return folder


@pytest.fixture
def check(tmp_path):
    """A script that starts only where the package is, in place of the solver's bootstrap."""
    path = tmp_path / "check.py"
    path.write_text(
        "import sys, tiny_solver\nassert sys.argv[1] in ('doctor', 'compile')\n"
        "print(sys.argv[1], tiny_solver.ANSWER)\n"
    )
    return path


@pytest.fixture
def build(part, tmp_path, wheelhouse, check):
    """Start a set-up with the wheelhouse and wait for its end; returns the folder and the state."""
    monitor = part("setup_monitor")

    def run(condition=None, **changes):
        folder = tmp_path / "rüntime"
        options = {
            "wheelhouse": str(wheelhouse), "requirements": wheelhouse / "requirements.txt",
            "check": check, **changes,
        }  # fmt: skip
        monitor.start_setup(folder, monitor.base_python(), **options)
        end = time.monotonic() + 60
        while monitor.setup_state().running:
            assert time.monotonic() < end, monitor.setup_state()
            if condition is not None and condition(monitor.setup_state()):
                monitor.cancel_setup()
                condition = None
            time.sleep(0.01)
        return folder, monitor.setup_state()

    return run


def test_the_environment_is_built_checked_and_found(build, part, monkeypatch):
    fractions = []
    folder, state = build(lambda state: fractions.append(state.fraction))
    assert state.error == "" and state.text == "Done" and state.fraction == 1.0
    assert fractions == sorted(fractions) and len(set(fractions)) > 3
    assert "doctor 42" in state.log, "the check ran in the new environment"
    assert "compile 42" in state.log, "and the first reconstruction need not compile"
    runtime = part("runtime")
    monkeypatch.delenv("NMF_SOLVER_PYTHON")
    python = runtime.solver_python(runtime_folder=str(folder))
    assert folder in python.parents
    subprocess.run([python, "-I", "-c", "import tiny_solver"], check=True)
    assert runtime.runtime_record(str(folder))["python"].startswith(("3.11", "3.12", "3.13"))
    assert sorted(os.listdir(folder)) == ["environment"]


def test_a_solver_that_cannot_compile_yet_is_set_up_all_the_same(build, tmp_path):
    check = tmp_path / "no_compiler.py"
    check.write_text("import sys\nif sys.argv[1] == 'compile': sys.exit('the disk is full')\n")
    folder, state = build(check=check)
    assert state.error == "" and state.text == "Done"
    assert "the disk is full" in state.log
    assert "the first reconstruction tries again" in state.log[-1]
    assert sorted(os.listdir(folder)) == ["environment"]


def test_a_failed_or_cancelled_set_up_leaves_the_old_one_working(build, tmp_path, wheelhouse):
    folder, state = build()
    assert state.error == ""
    before = (folder / "environment" / "runtime.json").read_text()

    (tmp_path / "bad.txt").write_text("no-such-package-of-ours==1\n")
    _, state = build(requirements=tmp_path / "bad.txt")
    assert "pip could not install" in state.error and "no-such-package-of-ours" in state.error

    (tmp_path / "broken.py").write_text("raise SystemExit('no graphics driver')")
    _, state = build(check=tmp_path / "broken.py")
    assert "no graphics driver" in state.error and "does not start" in state.error

    _, state = build(lambda state: state.fraction > 0)
    assert (state.text, state.error) == ("Cancelled", "")
    assert sorted(os.listdir(folder)) == ["environment"]
    assert (folder / "environment" / "runtime.json").read_text() == before


def test_a_virus_scanner_may_hold_what_was_just_installed(part, tmp_path, monkeypatch):
    """As on Windows, where no folder can be renamed in which a file is open."""
    script, rename, held = part("setup_runtime"), Path.rename, {"building": 3}
    new, final, old = (tmp_path / name for name in ("building", "environment", "previous"))

    def patient(path, target):
        held[path.name] = held.get(path.name, 0) - 1
        if held[path.name] >= 0:
            raise PermissionError(13, "Access is denied", str(path))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", patient)
    for folder in (new, final):
        folder.mkdir()
        (folder / "which").write_text(folder.name)
    script.put_in_place(new, final, old)
    assert os.listdir(tmp_path) == ["environment"]
    assert (final / "which").read_text() == "building"

    monkeypatch.setattr(script, "PATIENCE", 0.0)
    new.mkdir()
    held["building"] = 99
    with pytest.raises(script.StepFailed, match="building: it cannot be renamed .*another Blender"):
        script.put_in_place(new, final, old)
    assert (final / "which").read_text() == "building", "the one before is back"


def test_the_set_up_ends_with_blender(part, wheelhouse, tmp_path):
    """Blender is killed: its end of stdin closes, pip and the half-built environment go."""
    script = part("setup_monitor").SCRIPT
    process = subprocess.Popen(
        [sys.executable, "-I", "-u", str(script), str(tmp_path / "runtime"),
         str(wheelhouse / "requirements.txt"), "--watch-stdin"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout.readline().startswith("progress")
    process.stdin.close()
    assert process.wait(60) == 3
    process.stdout.close()
    assert os.listdir(tmp_path / "runtime") == []


def test_the_base_python_is_a_python_never_blender(part, monkeypatch, tmp_path):
    monitor, runtime = part("setup_monitor"), part("runtime")
    assert monitor.base_python() == Path(sys.executable)
    monkeypatch.setattr(sys, "executable", "/opt/blender/blender")
    assert monitor.base_python().stem.startswith("python")
    monkeypatch.setattr(sys, "_base_executable", "", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(sys, "base_prefix", str(tmp_path))
    monkeypatch.setattr(monitor.Path, "is_file", lambda path: False)
    with pytest.raises(runtime.RuntimeMissing, match="install Python"):
        monitor.base_python()
    with pytest.raises(runtime.RuntimeMissing, match="no such Python"):
        monitor.base_python("/nowhere/python3")


def test_without_online_access_the_operator_says_where_to_allow_it():
    if bpy.app.online_access:
        bpy.context.preferences.system.use_online_access = False
    with pytest.raises(RuntimeError, match="Online access is off.*wheelhouse"):
        bpy.ops.nmf.setup_solver()


def test_a_runtime_whose_python_is_gone_is_not_taken(part, tmp_path, monkeypatch):
    runtime = part("runtime")
    monkeypatch.delenv("NMF_SOLVER_PYTHON")
    environment = tmp_path / "environment"
    python = runtime.environment_python(environment)
    python.parent.mkdir(parents=True)
    python.touch()
    (environment / "runtime.json").write_text("{}")
    (environment / "pyvenv.cfg").write_text(f"home = {tmp_path}\n")
    assert runtime.solver_python(runtime_folder=str(tmp_path)) == python
    (environment / "pyvenv.cfg").write_text(f"home = {tmp_path / 'blender 4.3'}\n")
    with pytest.raises(runtime.RuntimeMissing, match="Set Up Solver again"):
        runtime.solver_python(runtime_folder=str(tmp_path))
    (environment / "pyvenv.cfg").write_text("home =\nversion = 3.11\n")
    assert runtime._base_of(environment) is None


def test_on_windows_the_runtime_is_where_the_packages_paths_have_room(part, tmp_path, monkeypatch):
    runtime, names = part("runtime"), part("names")
    deep = Path("/" + "d" * runtime.LONGEST_FOLDER)
    monkeypatch.setattr(runtime, "user_folder", lambda name: deep)
    monkeypatch.setattr(runtime, "WINDOWS", False)
    assert runtime.managed_runtime() == deep
    monkeypatch.setattr(runtime, "WINDOWS", True)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    version = "{}.{}".format(*bpy.app.version)
    assert runtime.managed_runtime() == names.short_user_folder() == tmp_path / "nmf" / version
    assert runtime.managed_runtime("/chosen") == Path("/chosen")
    monkeypatch.delenv("LOCALAPPDATA")
    assert runtime.managed_runtime() == deep
    home = "C:\\Users\\A Name As Long As Can\\AppData\\Local\\nmf\\10.10"
    assert len(home) <= runtime.LONGEST_FOLDER
    longest = sum(len(name) + 1 for name in part("setup_runtime").DEEPEST)
    assert runtime.LONGEST_FOLDER + len("/building") + longest <= 259


def test_a_folder_too_deep_for_the_packages_is_refused_before_they_are_fetched(part, tmp_path):
    if os.name == "nt":
        with suppress(OSError):
            tmp_path.joinpath("l" * 200, "l" * 200).mkdir(parents=True)
            pytest.skip("longer paths are switched on")
        shutil.rmtree(tmp_path / ("l" * 200), ignore_errors=True)
    script, folder = part("setup_runtime"), tmp_path
    longest = os.pathconf(tmp_path, "PC_PATH_MAX") if hasattr(os, "pathconf") else 260
    while len(str(folder)) < longest - 150:
        folder = folder / ("d" * 100)
    folder.mkdir(parents=True)
    with pytest.raises(script.StepFailed, match="choose a Folder with a shorter path"):
        script.check_room_for_paths(folder / "building")
    assert os.listdir(folder) == []
    script.check_room_for_paths(tmp_path / "building")
    assert not (tmp_path / "building").exists()


@pytest.mark.parametrize(
    ("system", "machine", "mac", "built_for", "said"),
    [
        ("darwin", "x86_64", "14.5", "macosx-11.0-x86_64", "Intel Macs"),
        ("darwin", "arm64", "13.7.1", "macosx-11.0-arm64", "macOS 14 or newer"),
        ("darwin", "arm64", "26.1", "macosx-11.0-arm64", ""),
        ("win32", "ARM64", "", "win-arm64", "Build With"),
        ("win32", "AMD64", "", "win-amd64", ""),
        ("linux", "x86_64", "", "linux-x86_64", ""),
    ],
)
def test_a_computer_that_there_are_no_packages_for_is_told(
    part, tmp_path, monkeypatch, system, machine, mac, built_for, said
):
    script, told = part("setup_runtime"), []
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(script.platform, "machine", lambda: machine)
    monkeypatch.setattr(script.platform, "mac_ver", lambda: (mac, ("", "", ""), machine))
    monkeypatch.setattr(script.sysconfig, "get_platform", lambda: built_for)
    monkeypatch.setattr(script, "run", lambda command, failure, listen: told.append(failure))
    (tmp_path / "requirements.txt").write_text("torch==2.13.0\n")
    options = script.argparse.Namespace(
        requirements=tmp_path / "requirements.txt", wheelhouse=None, pip_arguments=""
    )
    script.install(options, tmp_path)
    before, _, why = told[0].partition("; see above.")
    assert before == "pip could not install the packages"
    assert said in why and bool(why) == bool(said)


@pytest.mark.parametrize("missing", ["", "msvcp140.dll", "vcruntime140_1.dll"])
def test_a_windows_without_the_packages_libraries_is_told_what_to_install(part, monkeypatch, missing):
    script, loaded = part("setup_runtime"), []

    def load(name):
        loaded.append(name)
        if name == missing:
            raise OSError(126, "The specified module could not be found")

    monkeypatch.setattr(script, "os", SimpleNamespace(name="posix"))
    script.check_system_libraries(load)
    assert not loaded, "it is a matter of Windows"
    monkeypatch.setattr(script, "os", SimpleNamespace(name="nt"))
    if not missing:
        return script.check_system_libraries(load)
    with pytest.raises(script.StepFailed, match=r"install https://\S+vc_redist.x64.exe"):
        script.check_system_libraries(load)


@pytest.mark.skipif(os.name == "nt", reason="macOS shows programs in such places")
@pytest.mark.parametrize(
    "place",
    [
        "/private/var/folders/zz/T/AppTranslocation/8F3A/d/Blender.app/Contents/Resources/5.0/python",
        "/Volumes/Blender/Blender.app/Contents/Resources/4.5/python",
    ],
)
def test_a_blender_that_is_gone_when_it_quits_is_not_built_with(part, monkeypatch, place):
    monitor, runtime = part("setup_monitor"), part("runtime")
    monkeypatch.setattr(sys, "executable", f"{place}/bin/python3.11")
    monkeypatch.setattr(monitor.Path, "is_file", lambda path: True)
    with pytest.raises(runtime.RuntimeMissing, match="move it to Applications"):
        monitor.base_python()
    assert monitor.base_python("/usr/bin/python3.11") == Path("/usr/bin/python3.11")


def test_a_python_that_is_too_new_for_some_packages_is_told(part, monkeypatch):
    script = part("setup_runtime")
    monkeypatch.setattr(sys, "version_info", (3, 14, 0, "final", 0))
    assert "from 3.11 to 3.13 as Build With" in script.why_without_packages()


def test_a_python_that_makes_environments_without_a_python_is_not_taken(part, tmp_path, monkeypatch):
    """As venv does on Windows where its launcher was left out."""
    script, steps = part("setup_runtime"), []
    monkeypatch.setattr(script, "run", lambda command, failure, listen=None: steps.append(command))
    with pytest.raises(script.StepFailed, match="choose another Python as Build With"):
        script.build(script.argparse.Namespace(folder=tmp_path), tmp_path / "building")
    assert len(steps) == 1


def test_the_persons_choice_comes_first(part, tmp_path, monkeypatch):
    runtime = part("runtime")
    chosen, variable = tmp_path / "chosen.exe", tmp_path / "variable.exe"
    for python in (chosen, variable):
        python.touch(0o700)
    monkeypatch.setenv("NMF_SOLVER_PYTHON", str(variable))
    assert runtime.solver_python(str(chosen)) == chosen
    assert runtime.solver_python() == variable
    chosen.unlink()
    with pytest.raises(runtime.RuntimeMissing, match="chosen.exe does not exist"):
        runtime.solver_python(str(chosen))


def test_a_python_that_does_not_start_is_named_where_the_system_does_not(part, monkeypatch):
    def refused(*arguments, **settings):
        raise OSError(8, "no valid application")

    monkeypatch.setattr(subprocess, "Popen", refused)
    with pytest.raises(OSError, match="no valid application") as raised:
        part("setup_monitor").start_check(Path("a", "python"))
    assert Path(raised.value.filename) == Path("a", "python")


def test_what_is_no_program_on_windows_is_told_before_it_is_started(part, tmp_path, monkeypatch):
    """There anything that can be read counts as executable."""
    runtime = part("runtime")
    monkeypatch.setattr(runtime, "WINDOWS", True)
    for name in ("python.exe", "Python.EXE"):
        (tmp_path / name).touch(0o700)
        assert runtime.solver_python(str(tmp_path / name)) == tmp_path / name
    link = tmp_path / "python.lnk"
    link.touch(0o700)
    with pytest.raises(runtime.RuntimeMissing, match="python.lnk cannot be run; correct it in the pref"):
        runtime.solver_python(str(link))


@pytest.fixture
def asked(part, tmp_path, monkeypatch):
    """Check a solver that is a script of these lines, until it has ended; returns the state."""
    monitor = part("setup_monitor")

    def run(text, cancel=False):
        script = tmp_path / "doctor.py"
        script.write_text(text)
        monkeypatch.setenv("NMF_SOLVER_BOOTSTRAP", str(script))
        assert bpy.ops.nmf.check_solver() == {"FINISHED"}
        state = monitor.setup_state()
        if cancel:
            assert not bpy.ops.nmf.check_solver.poll(), "one at a time"
            assert not bpy.ops.nmf.setup_solver.poll()
            bpy.ops.nmf.cancel_setup()
        end = time.monotonic() + 30
        while state.running:
            assert time.monotonic() < end, state
            time.sleep(0.01)
        return state

    return run


def test_the_check_tells_what_the_solver_can_do(asked):
    state = asked("import sys\nprint(sys.argv[1])\nprint('Cores 2')\n")
    assert (state.log, state.error) == (["doctor", "Cores 2"], "")


def test_a_line_that_only_begins_like_one_of_progress_ends_nothing(asked):
    """A fixed bug: the thread that reads lines ended, and the set-up ran forever."""
    state = asked("print('progress of downloads')\nprint('progress 0.500 Half')\n")
    assert (state.log, state.fraction, state.text) == (["progress of downloads"], 0.5, "Half")


def test_the_check_tells_why_a_solver_does_not_start(asked):
    assert "no module named torch" in asked("raise SystemExit('no module named torch')\n").error
    assert asked("raise SystemExit(7)\n").error == "It ended with code 7"


def test_the_check_does_not_hold_up_blender_and_can_be_cancelled(asked):
    began = time.monotonic()
    state = asked("import time\ntime.sleep(60)\n", cancel=True)
    assert time.monotonic() - began < 20
    assert (state.text, state.error) == ("Cancelled", "")


def test_the_pinned_requirements_name_a_version_each(part):
    lines = part("runtime").REQUIREMENTS.read_text(encoding="utf-8").splitlines()
    packages = [line for line in lines if line[:1].isalpha()]
    assert len(packages) > 5 and all("==" in line for line in packages)
    json.dumps(packages)


def test_pip_arguments_keep_the_backslashes_of_paths_and_blanks_in_quotes(part):
    words = part("setup_runtime").words_of(r'--find-links C:\wheels\torch --index-url "D:\my wheels"')
    assert words == ["--find-links", r"C:\wheels\torch", "--index-url", r"D:\my wheels"]
    with pytest.raises(Exception, match="pip Arguments: a quote is not closed in"):
        part("setup_runtime").words_of('--find-links "D:')
