"""A solver process and what the panel knows of it, with a stand-in that misbehaves in every way."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import bpy
import killed
import pytest

HERE = Path(__file__).resolve().parent


@pytest.fixture
def job(tmp_path, part):
    """A new job folder."""
    folder = sys.modules["neural_microfacet_fields.solver.job.folder"]
    return folder.JobFolder.create(tmp_path / "jöb 1", folder.JobRequest(capture="/photos"))


@pytest.fixture
def start(job, part, fake_solver):
    """Start the stand-in on the job; it is ended after the test."""
    started = []

    def run(mode):
        fake_solver(mode)
        process = part("jobs.process").start_job(
            Path(sys.executable), HERE / "fake_solver.py", job, part("runtime").clean_environment()
        )
        started.append(process)
        return process

    yield run
    for process in started:
        process.close()
        process.popen.kill()
        process.popen.wait()
        process.popen.stdout.close()


def wait(process, part, seconds=20.0, after=None):
    """Take in all events like the monitor does; returns the model and the exit code."""
    model, end = part("jobs.model").JobModel(), time.monotonic() + seconds
    while process.exit_code is None:
        assert time.monotonic() < end, model
        for event in process.messages():
            model.apply(event)
            if after is not None:
                after(event, model)
        process.escalate()
        time.sleep(0.005)
    model.ended(process.exit_code, process.said_bye, part("jobs.process").log_tail(process.job))
    return model, process.exit_code


def test_a_job_runs_to_its_result_with_every_stage_in_order(start, part, job):
    seen, overall = [], []

    def note(event, model):
        if event.kind == "stage":
            seen.append(event.data["name"])
        overall.append(model.overall)

    model, code = wait(start("normal"), part, after=note)
    assert (code, model.state, model.overall, model.error) == (0, "done", 1.0, "")
    assert seen == ["photos", "compile", "geometry", "fit", "asset", "report"]
    assert overall == sorted(overall)
    assert model.psnr == 24.0 and model.preview_version == 1
    assert job.is_complete() and (job.preview_dir / "render.png").is_file()


def test_blocking_and_watching_give_the_same_events(start, part):
    events = []
    code = part("jobs.process").run_blocking(start("normal"), events.append)
    assert code == 0
    assert events[0].kind == "log" or events[0].kind == "hello"
    assert [e.kind for e in events][-1] == "bye"
    assert "banner" not in str(events), "what a library prints is no event"


def test_garbage_on_the_stream_is_passed_over(start, part):
    model, code = wait(start("garbage"), part)
    assert (code, model.state, model.overall) == (0, "done", 1.0)


def test_a_flood_of_events_is_taken_in_by_and_by(start, part):
    process = start("flood")
    time.sleep(0.3)
    assert len(process.messages()) <= 200
    assert wait(process, part)[1] == 0


def test_a_grandchild_that_holds_the_pipe_does_not_hold_up_the_end(start, part):
    begun = time.monotonic()
    assert wait(start("holds"), part)[1] == 0
    assert time.monotonic() - begun < 7


@pytest.mark.parametrize(
    ("mode", "code", "text", "error"),
    [
        ("fail", 2, "The solver stopped", "upside down"),
        ("oom", 4, "Out of memory", "draft preset"),
        ("raise", 1, "The solver crashed", "ZeroDivisionError"),
        ("die", 139, "The solver crashed", "Segmentation fault"),
        ("killed", killed.EXIT_CODE, "The solver crashed", killed.WORDS),
    ],
)
def test_each_way_to_fail_is_told_apart(start, part, mode, code, text, error):
    model, exit_code = wait(start(mode), part)
    assert (exit_code, model.state, model.text) == (code, "failed", text)
    assert error in model.error
    assert model.seconds_left is None


def test_bad_input_is_no_crash_also_where_no_event_has_told_of_it(part):
    model = part("jobs.model").JobModel()
    model.ended(2, said_bye=False, log_tail="photos: it has too few photos; give at least 3.")
    assert model.text == "The solver stopped" and model.error.startswith("photos: it has too few")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("answer", [ProcessLookupError, PermissionError])
def test_a_child_that_has_just_ended_needs_no_end(start, part, monkeypatch, answer):
    """What macOS answers for a group of processes that have ended, but were not waited for."""

    def gone(group, signal):
        raise answer

    process = start("slow")
    monkeypatch.setattr(os, "killpg", gone)
    part("jobs.process").end_group(process.popen, kill=True)
    monkeypatch.undo()
    process.cancel()
    wait(process, part)


@pytest.mark.parametrize("answer", [FileNotFoundError(), subprocess.CalledProcessError(128, "taskkill")])
def test_a_child_ends_even_where_windows_does_not_end_its_group(start, part, monkeypatch, answer):
    def no_taskkill(command, **settings):
        assert command[0] == "taskkill"
        raise answer

    process = start("hang")
    monkeypatch.setattr(subprocess, "CREATE_NO_WINDOW", 0, raising=False)
    monkeypatch.setattr(subprocess, "run", no_taskkill)
    with monkeypatch.context() as on_windows:
        on_windows.setattr(os, "name", "nt")
        part("jobs.process").end_group(process.popen, kill=True)
    assert process.popen.wait(10) != 0


def test_a_program_that_does_not_start_is_named_where_the_system_does_not(part, job, monkeypatch):
    """As on Windows: "%1 is not a valid Win32 application", and no file."""

    def refused(*arguments, **settings):
        raise OSError(8, "no valid application")

    monkeypatch.setattr(subprocess, "Popen", refused)
    with pytest.raises(OSError, match="no valid application") as raised:
        part("jobs.process").start_job(Path("a", "python"), Path("solver.py"), job, {})
    assert Path(raised.value.filename) == Path("a", "python")


@pytest.mark.parametrize(
    ("code", "text"), [(0xC0000005, "code 0xC0000005"), (0xC000012D, "no memory left")]
)
def test_what_windows_says_of_a_crash_can_be_looked_up(part, code, text):
    model = part("jobs.model").JobModel()
    model.ended(code, False, "")
    assert model.text == "The solver crashed" and text in model.error


def test_cancel_is_heard_at_once_and_leaves_a_checkpoint(start, part, job):
    process = start("slow")

    def cancel(event, model):
        if event.kind == "metric" and process.cancel_asked_at is None:
            process.cancel()

    model, code = wait(process, part, after=cancel)
    assert (code, model.state, process.said_bye) == (3, "cancelled", True)
    assert time.monotonic() - process.cancel_asked_at < 2
    assert job.has_checkpoint() and model.resumable
    assert wait(start("slow"), part)[0].state == "done", "and it can be resumed"


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_child_that_ignores_cancel_is_terminated_then_killed(start, part, monkeypatch):
    module = part("jobs.process")
    monkeypatch.setattr(module, "TERMINATE_AFTER", 0.3)
    monkeypatch.setattr(module, "KILL_AFTER", 0.8)
    asked = []
    monkeypatch.setattr(
        module, "end_group",
        lambda popen, kill, end=module.end_group: (asked.append(kill), end(popen, kill)),
    )  # fmt: skip
    process = start("hang")

    def cancel(event, model):
        if event.kind == "stage":
            process.cancel()
            model.cancelling = True

    model, code = wait(process, part, after=cancel)
    assert asked == [False, True] and code == -9
    assert model.state == "cancelled", "the person asked for it, so it is no failure"


def test_a_child_whose_parent_is_killed_ends_within_two_seconds(job, part, fake_solver):
    """Blender is killed: nobody closes anything in order."""
    fake_solver("slow")
    package = Path(sys.modules["neural_microfacet_fields"].__file__).parent
    program = f"""
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-I", {str(HERE / "fake_solver.py")!r}, "run",
    {str(job.root)!r}, "--events"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
child.stdin.write(b'{{"cmd": "hello"}}\\n'); child.stdin.flush()
for line in child.stdout:
    if b'"metric"' in line:
        print(child.pid, flush=True)
        time.sleep(60)
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, cwd=package, text=True
    )
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    status = sys.modules["neural_microfacet_fields.solver.job.status"]
    end = time.monotonic() + 2.0
    while status.process_is_alive(status.read_status(job.status_path)):
        assert time.monotonic() < end, f"{pid} is still there"
        time.sleep(0.02)
    assert job.has_checkpoint()


def test_a_python_that_cannot_be_started_is_an_error_not_a_job(job, part, tmp_path):
    with pytest.raises(OSError):
        part("jobs.process").start_job(tmp_path / "none", HERE / "fake_solver.py", job, {})


def test_the_childs_environment_has_nothing_of_blenders_python(part, monkeypatch):
    for name in ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH", "LD_PRELOAD"):
        monkeypatch.setenv(name, "/blender")
    monkeypatch.setenv("NMF_KEEP", "yes")
    environment = part("runtime").clean_environment()
    assert environment["NMF_KEEP"] == "yes" and "/blender" not in environment.values()


def test_a_long_log_is_set_aside(job, part, start, monkeypatch):
    monkeypatch.setattr(part("jobs.process"), "LOG_BYTES", 10)
    job.log_path.write_text("words of an earlier run\n")
    wait(start("normal"), part)
    assert "earlier run" in (job.root / "log.old.txt").read_text()
    assert "banner" in job.log_path.read_text()


@pytest.mark.parametrize(
    ("status", "files", "state", "resumable"),
    [
        ({}, (), "new", False),
        (
            {"state": "running", "pid": 2**22 + 1, "started": 1.0},
            ("checkpoint/state.json",),
            "lost",
            True,
        ),
        ({"state": "cancelled", "pid": 1}, ("checkpoint/state.json",), "cancelled", True),
        ({"state": "failed", "pid": 1}, (), "failed", False),
        ({"state": "running", "pid": "me"}, (), "elsewhere", False),
        ({"state": "done", "pid": 1}, ("result/manifest.json",), "done", False),
    ],
)
def test_a_folder_tells_what_became_of_its_job(job, part, status, files, state, resumable):
    if status.get("pid") == "me":
        module = sys.modules["neural_microfacet_fields.solver.job.status"]
        status |= {"pid": os.getpid(), "started": module.process_start_time(os.getpid())}
        status["time"] = time.time()
    job.status_path.write_text(json.dumps(status))
    for name in files:
        (job.root / name).parent.mkdir()
        (job.root / name).write_text("{}")
    model = part("jobs.model").model_of_folder(job)
    assert (model.state, model.resumable) == (state, resumable)


def test_a_job_interrupted_with_blender_is_offered_again_with_its_file(
    capture, monitor, fake_solver, tick, tmp_path
):
    fake_solver("killed")
    bpy.ops.nmf.reconstruct()
    tick()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert monitor.job is None and monitor.model.state == "new"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert (monitor.model.state, monitor.model.resumable) == ("lost", True)
    fake_solver("normal")
    assert bpy.ops.nmf.resume() == {"FINISHED"}
    tick()
    assert monitor.model.state == "done"


def test_a_result_does_not_go_into_another_file(capture, monitor, fake_solver, tick):
    fake_solver("normal", pause=0.05)
    bpy.ops.nmf.reconstruct()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    tick()
    assert monitor.model.state == "done" and "Install Result" in monitor.model.text
    assert not bpy.data.meshes


def test_a_result_waits_while_blender_lets_nothing_be_changed(
    capture, monitor, fake_solver, tick, part, monkeypatch
):
    """As when a render has just begun, which nothing that can be asked tells."""
    module = part("jobs.monitor")
    real, refused = module._install_result, []

    def install(job):
        if len(refused) < 3:
            refused.append(job)
            raise RuntimeError(
                'Error: Calling operator "bpy.ops.nmf.install_result" error, can\'t modify blend data in '
                "this state (drawing/rendering)"
            )
        real(job)

    monkeypatch.setattr(module, "_install_result", install)
    bpy.ops.nmf.reconstruct()
    tick()
    assert len(refused) == 3 and monitor.model.text == "Done"
    assert [i for i in bpy.data.objects if i.get("nmf_job")]


def test_a_result_waits_for_object_mode(capture, monitor, fake_solver, tick):
    mesh = bpy.data.meshes.new("mine")
    item = bpy.data.objects.new("mine", mesh)
    bpy.context.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.waits_to_install)
    for _ in range(3):
        monitor.tick()
    assert monitor.waits_to_install and "Object Mode" in monitor.model.text
    assert not [i for i in bpy.data.objects if i.get("nmf_job")]
    bpy.ops.object.mode_set(mode="OBJECT")
    tick()
    assert [i for i in bpy.data.objects if i.get("nmf_job")] and monitor.model.text == "Done"


def test_a_monitor_that_fails_says_so_and_hangs_up(capture, monitor, fake_solver, part, monkeypatch):
    fake_solver("slow")
    bpy.ops.nmf.reconstruct()
    process = monitor.process
    monkeypatch.setattr(monitor, "tick", lambda: 1 // 0)
    assert part("jobs.monitor")._tick() is None
    assert not monitor.running and monitor.model.state == "lost"
    assert process.popen.wait(5) == 3
