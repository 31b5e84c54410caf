"""Jobs that are killed, cancelled and taken up again, and by whom."""

import errno
import json
import os
import shutil
import subprocess
import sys
import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from solver.cli import main
from solver.fit.checkpoint import FORMAT
from solver.fit.reconstruct import run_job
from solver.job.control import Cancelled
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from tests.capture.test_capture import make_capture
from tests.cli.command import ROOT, TINY, solver, wait_for


def test_a_second_job_in_the_same_folder_is_refused(job, duck):
    result = solver("reconstruct", duck, "--out", job, *TINY)
    assert result.returncode == 2 and "--resume" in result.stderr


def test_a_killed_job_resumes_to_the_same_kind_of_result(tmp_path, duck):
    root = tmp_path / "job"
    long = [*TINY, "--set", "fit.steps=4000"]
    process = subprocess.Popen(
        [sys.executable, "-m", "solver", "reconstruct", duck, "--out", root, *long], cwd=ROOT,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for(lambda: (root / "checkpoint" / "state.json").exists(), process)
    process.kill()
    process.wait()
    before = json.loads((root / "checkpoint" / "state.json").read_text())["step"]
    assert 0 < before < 4000
    # A shorter schedule, so that the test need not wait for 4000 steps.
    state = json.loads((root / "checkpoint" / "state.json").read_text())
    state["settings"]["fit"]["steps"] = before + 5
    (root / "checkpoint" / "state.json").write_text(json.dumps(state))
    result = solver("reconstruct", duck, "--out", root, "--resume")
    assert result.returncode == 0, result.stderr
    assert json.loads((root / "checkpoint" / "state.json").read_text())["step"] == before + 5
    assert (root / "result" / "manifest.json").is_file()


def test_cancel_leaves_a_checkpoint_and_closing_stdin_ends_the_process(tmp_path, duck):
    overrides = dict(text.split("=") for text in [*TINY[1::2], "fit.steps=9000"])
    for name, hang_up in (("cancel", False), ("close", True)):
        root = tmp_path / name
        JobFolder.create(root, JobRequest(str(duck), overrides=overrides))
        process = subprocess.Popen(
            [sys.executable, "-m", "solver", "run", root], cwd=ROOT,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        wait_for(lambda root=root: (root / "checkpoint" / "state.json").exists(), process)
        asked = time.monotonic()
        if hang_up:
            process.stdin.close()
        else:
            process.stdin.write(b'{"cmd": "cancel"}\n')
            process.stdin.flush()
        assert process.wait(20) == 3
        if hang_up:
            # Two seconds are promised; a machine that runs other things besides gets some more.
            assert time.monotonic() - asked < 5.0
        assert (root / "checkpoint" / "scene.safetensors").is_file()
        assert not (root / "result" / "manifest.json").exists()
        for stream in (process.stdout, process.stderr):
            stream.close()


def test_a_list_of_captures_on_stdin_is_left_to_the_loop_that_reads_it(tmp_path, duck):
    """A fixed bug: `while read n; do … reconstruct $n …; done` lost its list, and its first job with it."""
    stdin, ours = os.pipe()
    os.write(ours, b"the next capture\ncancel\n")
    os.close(ours)
    few = ["--set", "fit.steps=2"]
    result = subprocess.run(
        [sys.executable, "-m", "solver", "reconstruct", duck, "--out", tmp_path / "job", *TINY, *few],
        cwd=ROOT, stdin=stdin, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    left = os.read(stdin, 999)
    os.close(stdin)
    assert result.returncode == 0, result.stderr
    assert left == b"the next capture\ncancel\n"


def test_cancel_is_heard_while_the_asset_is_made_and_a_result_from_before_is_complete_no_more(
    tmp_path, job, duck
):
    again = tmp_path / "job"
    shutil.copytree(job, again)
    progress, control = Mock(), SimpleNamespace(should_stop=False)

    def begun(stage, *_):
        # Not from another process: so small an asset may be done before a line on stdin is read.
        control.should_stop = stage == "asset"

    progress.stage.side_effect = begun
    with pytest.raises(Cancelled):
        run_job(JobFolder.open(again), progress, control)
    assert not (again / "result" / "manifest.json").exists()
    # As of a process that was killed while it wrote them.
    for name in (
        "mesh.ply.part",
        "albedo.part.png",
        "manifest.json.12.part",
        "report/view.part.png",
    ):
        (again / "result" / name).touch()
    assert solver("reconstruct", duck, "--out", again, "--resume").returncode == 0
    assert {path.name for path in (again / "result").rglob("*")} == {
        path.name for path in (job / "result").rglob("*")
    }


def test_a_fit_that_is_over_has_time_enough(tmp_path, job):
    again = tmp_path / "job"
    shutil.copytree(job, again)
    request = json.loads((again / "job.json").read_text())
    (again / "job.json").write_text(json.dumps({**request, "time_limit": 1.0}))
    progress, control = Mock(), SimpleNamespace(should_stop=False)
    progress.stage.side_effect = lambda stage, *_: setattr(control, "should_stop", stage == "asset")
    with pytest.raises(Cancelled):
        run_job(JobFolder.open(again), progress, control)
    assert not [told for told in progress.warning.call_args_list if "too short for a fit" in told.args[0]]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "standard"], "preset 'draft', not 'standard'"), (["--seed", 3], "seed 0, not 3"),
        (["--set", "fit.steps=99"], "overrides"), (["--device", "cuda"], "device 'auto', not 'cuda'"),
    ],
)  # fmt: skip
def test_what_is_resumed_is_what_was_asked(job, options, words, duck):
    before = (job / "job.json").read_bytes()
    result = solver("reconstruct", duck, "--out", job, "--resume", *options)
    assert result.returncode == 2 and words in result.stderr, result.stderr
    assert (job / "job.json").read_bytes() == before


def test_another_capture_is_not_resumed_in_this_ones_job(job, tmp_path):
    other = make_capture(tmp_path)
    result = solver("reconstruct", other, "--out", job, "--resume")
    assert result.returncode == 2 and "was begun with the capture" in result.stderr


def test_cancel_is_heard_while_photos_are_read(tmp_path, duck):
    job = JobFolder.create(tmp_path / "job", JobRequest(str(duck)))
    progress, control = Mock(), SimpleNamespace(should_stop=False)

    def read_one(*_):
        control.should_stop = True

    progress.fraction.side_effect = read_one
    with pytest.raises(Cancelled):
        run_job(job, progress, control)
    assert progress.fraction.call_count == 1
    assert [call.args[0] for call in progress.stage.call_args_list] == ["photos"]


@pytest.mark.parametrize(
    ("name", "damage"),
    [("state.json", lambda f: os.truncate(f, 1000)), ("scene.safetensors", lambda f: os.truncate(f, 1000)),
     ("scene.safetensors", os.remove), ("state.json", lambda f: f.write_text('{"step": 1}')),
     ("state.json", lambda f: f.write_text(f.read_text().replace(f'"format": {FORMAT}', '"format": 0')))],
)  # fmt: skip
def test_a_checkpoint_that_is_damaged_or_of_another_version_is_named_with_the_way_out(
    tmp_path, job, name, damage
):
    broken = tmp_path / "job"
    shutil.copytree(job, broken)
    damage(broken / "checkpoint" / name)
    result = solver("run", broken)
    assert result.returncode == 2 and "Traceback" not in result.stderr
    assert name in result.stderr and "delete the folder checkpoint" in result.stderr
    shutil.rmtree(broken / "checkpoint")
    assert solver("run", broken).returncode == 0


def test_a_checkpoint_can_be_read_by_whoever_can_read_the_rest_of_a_job(job):
    modes = {path.stat().st_mode for path in (job / "checkpoint").iterdir()}
    assert modes == {(job / "job.json").stat().st_mode}


def test_a_fit_of_exposures_does_not_go_on_without_some_of_its_photos_or_with_others(tmp_path, duck):
    capture = tmp_path / "capture"
    shutil.copytree(duck, capture, ignore=shutil.ignore_patterns("test*", "relight*", "*test.json"))
    few = [*TINY, "--set", "fit.steps=2", "--set", "fit.exposure=gain"]
    root = tmp_path / "job"
    assert solver("reconstruct", capture, "--out", root, *few).returncode == 0
    state = root / "checkpoint" / "state.json"
    state.write_text(state.read_text().replace('"done": true', '"done": false'))
    first, second = sorted((capture / "train").glob("*.png"))[:2]
    kept = first.read_bytes()
    shutil.copyfile(second, first)
    result = solver("run", root)
    assert result.returncode == 2 and "Traceback" not in result.stderr
    assert "exposures of other photos: 1 in the order" in result.stderr and "put back" in result.stderr
    first.write_bytes(kept)
    assert solver("run", root).returncode == 0
    state.write_text(state.read_text().replace('"done": true', '"done": false'))
    first.unlink()
    result = solver("run", root)
    assert result.returncode == 2 and "Traceback" not in result.stderr
    assert "exposures of" in result.stderr and "put back" in result.stderr


def test_photos_that_changed_while_a_job_rested_are_told(tmp_path, duck):
    capture = tmp_path / "capture"
    shutil.copytree(duck, capture, ignore=shutil.ignore_patterns("test*", "relight*", "*test.json"))
    root = tmp_path / "job"
    few = [*TINY, "--set", "fit.steps=2"]
    assert solver("reconstruct", capture, "--out", root, *few).returncode == 0
    first, second = sorted((capture / "train").glob("*.png"))[:2]
    shutil.copyfile(second, first)
    result = solver("run", root)
    assert result.returncode == 0
    assert result.stderr == (
        f"Warning: photos changed since the job began ({first.stem}), so its result mixes old and new "
        "ones.\n"
    )
    first.unlink()
    result = solver("run", root)
    assert result.returncode == 0 and "and continues with" in result.stderr, result.stderr


def test_a_reader_that_hangs_up_does_not_make_a_finished_run_a_failure(tmp_path, job):
    for unbuffered in ("", "1"):
        out, ours = os.pipe()
        os.close(out)
        result = subprocess.run(
            [sys.executable, "-m", "solver", "export", job, "--out", tmp_path / f"out{unbuffered}"],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=ours, stderr=subprocess.PIPE, timeout=300,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered}, check=False,
        )  # fmt: skip
        os.close(ours)
        assert result.returncode == 0 and not result.stderr, result.stderr
        assert (tmp_path / f"out{unbuffered}" / "manifest.json").is_file()


@pytest.mark.parametrize(("unbuffered", "code"), [("", 0), ("1", 1)])
def test_a_check_whose_reader_hangs_up_says_nothing_of_it(unbuffered, code, duck):
    out, ours = os.pipe()
    os.close(out)
    result = subprocess.run(
        [sys.executable, "-m", "solver", "check", duck], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=ours,
        stderr=subprocess.PIPE, text=True, timeout=300, env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        check=False,
    )  # fmt: skip
    os.close(ours)
    assert result.returncode == code and "Error" not in result.stderr, result.stderr


@pytest.mark.skipif(os.name == "nt", reason="closed by a shell of POSIX")
@pytest.mark.parametrize(
    ("command", "code"), [("check '{}'", 0), ("check nowhere", 2), ("doctor --nonsense", 2)]
)
def test_standard_streams_that_are_closed_change_nothing(command, code, duck):
    for closed in ("2>&-", "<&- >&- 2>&-"):
        shell = f'"{sys.executable}" -m solver {command.format(duck)} {closed}'
        done = subprocess.run(shell, shell=True, cwd=ROOT, timeout=300, stdout=subprocess.DEVNULL)
        assert done.returncode == code, closed


@pytest.mark.skipif(os.name == "nt", reason="closed by a shell of POSIX")
def test_no_file_gets_the_number_of_a_standard_stream_that_is_closed():
    script = "import os, solver.streams; solver.streams.open_standard_streams(); os._exit(os.dup(0) != 3)"
    assert (
        subprocess.run(f'"{sys.executable}" -c "{script}" <&- >&- 2>&-', shell=True, cwd=ROOT).returncode
        == 0
    )


@pytest.mark.skipif(os.name == "nt", reason="a device of POSIX")
def test_an_error_that_nobody_can_be_told_still_has_its_code():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "solver", "check", "nowhere"], cwd=ROOT, stderr=full, timeout=300
        )
    assert done.returncode == 2


@pytest.mark.skipif(os.name == "nt", reason="a device of POSIX")
@pytest.mark.parametrize("command", ["doctor", "export", "check"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_standard_output_that_is_full_is_told(command, unbuffered, tmp_path, job, duck):
    arguments = {"export": [job, "--out", tmp_path / "out"], "check": [duck], "doctor": []}[command]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "solver", command, *arguments], cwd=ROOT, stdin=subprocess.DEVNULL,
            stdout=full, stderr=subprocess.PIPE, text=True, timeout=300,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("standard output: writing failed (No space left on device); free")
    assert len(done.stderr.splitlines()) == 1


def test_without_a_buffer_a_reader_that_hangs_up_is_no_error_either():
    out, ours = os.pipe()
    os.close(out)
    result = subprocess.run(
        [sys.executable, "-m", "solver", "doctor"], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=ours,
        stderr=subprocess.PIPE, text=True, timeout=300, env=os.environ | {"PYTHONUNBUFFERED": "1"}, check=False,
    )  # fmt: skip
    os.close(ours)
    assert result.returncode == 1 and "Error" not in result.stderr, result.stderr


@pytest.mark.parametrize(
    ("command", "buffered", "code"),
    [("check", True, 0), ("check", False, 1), ("doctor", True, 1), ("doctor", False, 1),
     ("pictures", True, 0), ("pictures", False, 0)],
)  # fmt: skip
def test_a_reader_that_hangs_up_is_told_by_another_number_on_windows(
    command, buffered, code, tmp_path, duck, monkeypatch, capsys
):
    with (tmp_path / "pipe").open("wb") as pipe:

        class Closed:
            written = False

            def write(self, text):
                self.written = buffered
                if not buffered:
                    self.refuse()

            def flush(self):
                if self.written:
                    self.refuse()

            def refuse(self):
                raise OSError(errno.EINVAL, "Invalid argument")

            def fileno(self):
                return pipe.fileno()

        monkeypatch.setattr(sys, "stdout", Closed())
        arguments = {"check": [duck], "pictures": [duck, "--out", tmp_path / "out"]}.get(command, [])
        assert main([command, *map(str, arguments)]) == code
    assert "rror" not in capsys.readouterr().err


def test_a_pipe_that_breaks_elsewhere_is_told(monkeypatch, capsys):
    def broken(options):
        raise BrokenPipeError("a worker has gone")

    monkeypatch.setattr("solver.cli._doctor", broken)
    with pytest.raises(BrokenPipeError, match="a worker has gone"):
        main(["doctor"])


def test_a_decoder_is_another_job_wherever_this_one_is_run_later(tmp_path, job, duck):
    few = [*TINY, "--set", "fit.steps=2"]
    missing = solver("reconstruct", duck, "--out", tmp_path / "a", *few, "--set", "fit.decoder=nowhere")
    assert missing.returncode == 2 and "nowhere" in missing.stderr
    assert not (tmp_path / "a").exists()
    relative = os.path.relpath(job, ROOT)
    given = solver("reconstruct", duck, "--out", tmp_path / "b", *few, "--set", f"fit.decoder={relative}")
    assert given.returncode == 0, given.stderr
    assert JobFolder.open(tmp_path / "b").request.overrides["fit.decoder"] == str(job)
