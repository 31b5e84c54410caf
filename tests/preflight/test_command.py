"""The command `check`: a line a finding or one JSON, and code 2 for what cannot be read."""

import json
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from solver.capture.read import read_capture
from solver.capture.reduced import load_reduced
from solver.fit.errors import SettingsError
from solver.job.events import parse_event
from solver.preflight.check import check
from tests.cli.command import solver as run
from tests.preflight.captures import ROOT, around, blurred, capture_at, only, write


def solver(*arguments, command="check"):
    return run(command, *arguments)


def test_the_command_prints_a_line_a_finding_or_one_json(pictures, tmp_path):
    write(tmp_path, pictures, only(at5=blurred(3.0)))
    before = sorted(tmp_path.iterdir())
    lines = solver(tmp_path)
    assert lines.returncode == 0 and lines.stderr == ""
    assert lines.stdout.splitlines()[0].startswith("warning: IMG_005: the photo is blurred")
    assert lines.stdout.splitlines()[-1].startswith("estimate: preset draft")
    source = tmp_path / "transforms_train.json"
    assert lines.stdout.splitlines()[-2] == f"cameras: 24 of {source} (transforms.json)"
    content = json.loads(solver(tmp_path, "--json", "--preset", "standard").stdout)
    assert content["findings"][0]["photo"] == "IMG_005"
    assert set(content["findings"][0]) == {"level", "photo", "text"}
    assert content["estimate"]["preset"] == "standard" and content["estimate"]["seconds"] > 0
    assert content["estimate"]["note"] == "on the processor; other work slows it down"
    refused = solver(tmp_path, "--device", "mps" if sys.platform != "darwin" else "cuda")
    assert refused.returncode == 2 and "this machine has no such device" in refused.stderr
    assert sorted(tmp_path.iterdir()) == before


WITH_ALL_EVENTS = (
    "import runpy; from solver.job.progress import Progress; Progress.EVENT_INTERVAL = 0;"
    "runpy.run_module('solver', run_name='__main__', alter_sys=True)"
)
"""the solver, which also tells of photos that take less time than it waits between two events"""


@contextmanager
def listening(folder, program=("-m", "solver")):
    """A check whose events are read as a parent does, and that hears its parent."""
    command = [sys.executable, *program, "check", str(folder), "--events"]
    pipes = {name: subprocess.PIPE for name in ("stdin", "stdout", "stderr")}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes) as process:
        process.stdin.write('{"cmd": "hello"}\n')
        process.stdin.flush()
        yield process, map(parse_event, process.stdout)


def test_a_parent_is_told_how_far_a_check_is_and_then_what_it_found(pictures, tmp_path):
    write(tmp_path, pictures, only(at5=blurred(3.0)))
    with listening(tmp_path, ("-c", WITH_ALL_EVENTS)) as (process, events):
        told = list(events)
        assert process.stderr.read() == ""
    assert process.returncode == 0
    assert [event.kind for event in told if event.kind != "progress"] == [
        "hello",
        "stage",
        "result",
        "bye",
    ]
    done = [event.data["overall"] for event in told if event.kind == "progress"]
    assert done == sorted(done) and done[-1] > 0
    texts = [event.data["text"] for event in told if event.kind == "progress"]
    assert texts[-1].startswith("photo ") and texts[-1].endswith(" of 24")
    report = json.loads(solver(tmp_path, "--json").stdout)
    assert told[-2].data["report"] == report and report["findings"][0]["photo"] == "IMG_005"


def test_a_check_is_cancelled_by_its_parent(pictures, tmp_path):
    write(tmp_path, pictures)
    with listening(tmp_path) as (process, events):
        next(event for event in events if event.kind == "stage")
        process.stdin.write('{"cmd": "cancel"}\n')
        process.stdin.flush()
        kinds = {event.kind for event in events}
    assert process.returncode == 3 and "result" not in kinds and "bye" in kinds


def test_what_cannot_be_read_ends_with_code_2_and_one_sentence(pictures, tmp_path):
    write(tmp_path, pictures)
    (tmp_path / "IMG_003.png").write_bytes((tmp_path / "IMG_003.png").read_bytes()[:400])
    for arguments in ([tmp_path], [tmp_path / "nowhere"], [tmp_path, "--preset", "fast"]):
        result = solver(*arguments)
        assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    with pytest.raises(SettingsError):
        check(capture_at(around(4)), "fast")


def test_a_card_that_lies_idle_is_told_unless_somebody_chose_the_processor(pictures, tmp_path, monkeypatch):
    write(tmp_path, pictures)
    module = sys.modules[check.__module__]
    monkeypatch.setattr(module, "choose_device", lambda device: "cpu")
    monkeypatch.setattr(module, "idle_card", lambda: "a card is not used")
    capture = read_capture(tmp_path)
    told = [f for f in check(capture).findings if f.text == "a card is not used"]
    assert [(finding.level, finding.photo) for finding in told] == [("note", None)]
    assert "a card is not used" not in str(check(capture, device="cpu").findings)


def test_what_the_persons_settings_answer_is_not_advised(pictures, tmp_path):
    def darker(colour, mask):
        return (0.3 * colour).astype(colour.dtype), mask

    write(tmp_path, pictures, only(at5=darker))
    capture = read_capture(tmp_path)
    assert "fit.exposure=gain" in str(check(capture).findings)
    evened = check(capture, overrides={"fit.exposure": "gain"})
    assert "fit.exposure=gain" not in str(evened.findings)
    turned = check(capture, overrides={"light.turntable": "yes"})
    assert turned.estimate.seconds > 1.5 * evened.estimate.seconds
    fewer = check(capture, overrides={"fit.steps": "100"})
    assert fewer.estimate.seconds < evened.estimate.seconds


HEIC = ROOT / "tests" / "capture" / "data" / "heif"


def test_photos_that_blender_cannot_show_are_copied_as_their_cameras_saw_them(pictures, tmp_path):
    write(tmp_path, pictures)
    cameras = json.loads((tmp_path / "transforms_train.json").read_text())
    for frame, name in zip(cameras["frames"], ("plain.heic", "alpha.heic"), strict=False):
        (tmp_path / frame["file_path"]).unlink()
        frame["file_path"] = name
        shutil.copy(HEIC / name, tmp_path)
        frame.update(w=80, h=48, cx=40, cy=24)
    (tmp_path / "transforms_train.json").write_text(json.dumps(cameras))
    result = solver(tmp_path, "--out", tmp_path / "out", "--events", command="pictures")
    assert result.returncode == 0, result.stderr
    events = [json.loads(line) for line in result.stdout.splitlines()]
    made = next(event for event in events if event["ev"] == "result")["pictures"]
    assert made == {
        str(tmp_path / "plain.heic"): str(tmp_path / "out" / "plain.jpg"),
        str(tmp_path / "alpha.heic"): str(tmp_path / "out" / "alpha.png"),
    }
    for photo, picture in made.items():
        colour, alpha = load_reduced(Path(photo), 800)
        copied, copied_alpha = load_reduced(Path(picture), 800)
        assert np.abs(copied.astype(float) - colour).mean() < 3
        assert (alpha is None) == (copied_alpha is None)
    again = solver(tmp_path, "--out", tmp_path / "out", command="pictures")
    assert again.returncode == 2 and "it is not empty; give a new folder" in again.stderr
