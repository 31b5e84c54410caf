"""The job folder: creation, refusal, round trip, atomic writes."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import replacing
from solver.job.events import EventStream
from solver.job.folder import JobFolder, set_aside
from solver.job.request import JobError, JobRequest
from solver.job.status import read_status
from solver.replacing import write_json_atomic

number = st.floats(allow_nan=False, allow_infinity=False, width=32)
requests = st.builds(
    JobRequest,
    capture=st.text(min_size=1, max_size=40).filter(lambda text: text.isprintable()),
    preset=st.sampled_from(["draft", "standard"]),
    device=st.sampled_from(["auto", "cpu"]),
    seed=st.integers(0, 2**40),
    time_limit=st.none() | st.floats(1, 1e6),
    region=st.none() | st.just({"min": [-1.0, -2.0, -3.0], "max": [1.0, 2.0, 3.0]}),
    placement=st.none()
    | st.just([[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 6.0], [0.0, 0.0, 2.0, 7.0], [0.0, 0.0, 0.0, 1.0]]),
    overrides=st.dictionaries(st.text(max_size=10), st.text(max_size=10) | number, max_size=3),
    code_version=st.text(max_size=10),
)


def test_a_job_killed_while_a_checkpoint_takes_the_place_of_another_can_be_resumed(tmp_path):
    job = JobFolder(tmp_path)
    assert not job.has_checkpoint()
    write_json_atomic(job.checkpoint_dir / "state.json", {"step": 1})
    assert job.has_checkpoint()
    job.checkpoint_dir.rename(set_aside(job.checkpoint_dir))
    assert job.has_checkpoint()


@given(request=requests)
@settings(max_examples=60, deadline=None)
def test_a_request_comes_back_from_its_file_as_it_was(request, tmp_path_factory):
    root = tmp_path_factory.mktemp("round") / "jöb with space"
    assert JobFolder.create(root, request).request == request
    assert JobFolder.open(root).request == request


def test_the_request_file_is_plain_json_with_the_documented_fields(tmp_path):
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/photos", time_limit=60.0))
    content = json.loads((tmp_path / "job" / "job.json").read_text(encoding="utf-8"))
    assert content == {
        "schema_version": 1, "capture": "/photos", "preset": "draft", "device": "auto", "seed": 0,
        "time_limit": 60.0, "photos": None, "masks": None, "ignored": None, "region": None, "placement": None, "overrides": {},
        "code_version": "",
    }  # fmt: skip
    assert sorted(entry.name for entry in job.root.iterdir()) == ["job.json"]


def test_a_job_may_be_created_around_its_capture_folder(tmp_path):
    (tmp_path / "job" / "capture").mkdir(parents=True)
    with pytest.raises(JobError, match="not empty"):
        JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"))
    JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"), may_hold=["capture"])


@pytest.mark.parametrize("complete", [False, True])
def test_a_folder_with_a_job_is_refused_and_left_alone(tmp_path, complete):
    job = JobFolder.create(tmp_path, JobRequest(capture="/first"))
    if complete:
        job.write_manifest({"mesh": "mesh.ply"})
    with pytest.raises(JobError, match="--resume") as refusal:
        JobFolder.create(tmp_path, JobRequest(capture="/second"))
    assert ("finished" in str(refusal.value)) and (("unfinished" in str(refusal.value)) != complete)
    assert job.request.capture == "/first"


def test_a_folder_with_other_things_is_refused_and_left_alone(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"mine")
    with pytest.raises(JobError, match="not empty.*new folder"):
        JobFolder.create(tmp_path, JobRequest(capture="/photos"))
    assert [entry.name for entry in tmp_path.iterdir()] == ["holiday.jpg"]


@pytest.mark.parametrize("left", [".DS_Store", "desktop.ini", "Thumbs.db"])
def test_a_folder_that_was_only_looked_at_is_an_empty_one(tmp_path, left):
    (tmp_path / left).touch()
    job = JobFolder.create(tmp_path, JobRequest(capture="/photos"))
    assert job.request.capture == "/photos" and (tmp_path / left).exists()


def test_a_file_in_the_folders_place_is_refused(tmp_path):
    (tmp_path / "job").write_text("mine")
    with pytest.raises(JobError, match="is a file"):
        JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"))


def test_opening_a_folder_without_a_job_is_refused(tmp_path):
    with pytest.raises(JobError, match="no job"):
        JobFolder.open(tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"capture": "/ph', "unreadable"),
        ("[1, 2]", "not a job request"),
        ("{}", "no 'capture'"),
        ('{"capture": "/p", "schema_version": 99}', "newer version"),
        ('{"capture": 3}', "'capture'"),
        ('{"capture": "/p", "seed": "one"}', "'seed'"),
        ('{"capture": "/p", "seed": true}', "'seed'"),
        ('{"capture": "/p", "time_limit": -5}', "'time_limit'"),
        ('{"capture": "/p", "time_limit": NaN}', "'time_limit'"),
        ('{"capture": "/p", "overrides": []}', "'overrides'"),
        ('{"capture": "/p", "region": {"min": [0, 0, 0]}}', "'region'"),
        ('{"capture": "/p", "region": {"min": [0, 0, 0], "max": [1, 1, 0]}}', "'region'"),
        ('{"capture": "/p", "region": {"min": [0, 0], "max": [1, 1]}}', "'region'"),
    ],
)
def test_a_damaged_request_is_refused_in_one_sentence_that_names_the_file(tmp_path, text, words):
    (tmp_path / "job.json").write_text(text, encoding="utf-8")
    with pytest.raises(JobError) as refusal:
        _ = JobFolder.open(tmp_path).request
    message = str(refusal.value)
    assert words in message and str(tmp_path / "job.json") in message
    assert "\n" not in message


def test_fields_of_a_later_minor_version_are_passed_over(tmp_path):
    (tmp_path / "job.json").write_text('{"capture": "/p", "colour": "teal"}', encoding="utf-8")
    assert JobFolder.open(tmp_path).request == JobRequest(capture="/p")


def test_a_result_is_complete_only_with_its_manifest(tmp_path):
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"))
    job.result_dir.mkdir()
    (job.result_dir / "mesh.ply").write_bytes(b"ply")
    assert not job.is_complete()
    with pytest.raises(JobError, match="resume"):
        job.manifest()
    job.write_manifest({"mesh": "mesh.ply"})
    assert job.is_complete()
    assert job.manifest() == {"schema_version": 1, "mesh": "mesh.ply"}


@pytest.mark.parametrize("text", ['{"mesh": ', "[]"])
def test_a_damaged_manifest_is_refused_by_name(tmp_path, text):
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"))
    job.result_dir.mkdir()
    job.manifest_path.write_text(text)
    with pytest.raises(JobError, match="manifest.json"):
        job.manifest()


def test_a_reader_of_an_atomic_file_never_sees_half_of_it(tmp_path):
    path, stop, seen = tmp_path / "status.json", threading.Event(), []
    write_json_atomic(path, {"n": 0, "ballast": "x" * 100_000})

    def read():
        # Windows replaces no file in the moments in which a reader has it: there are others, too.
        while not stop.wait(0.01 if os.name == "nt" else 0):
            seen.append(json.loads(replacing.read_replaced(path))["n"])

    reader = threading.Thread(target=read)
    reader.start()
    for n in range(1, 40):
        write_json_atomic(path, {"n": n, "ballast": "x" * 100_000})
    stop.set()
    reader.join()
    assert len(seen) > 1 and seen == sorted(seen)


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "job.json"
    write_json_atomic(path, {"n": 1})

    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(replacing, "replace_file", full)
    with pytest.raises(OSError, match="No space"):
        write_json_atomic(path, {"n": 2})
    assert json.loads(path.read_text()) == {"n": 1}
    assert os.listdir(tmp_path) == ["job.json"]


@pytest.mark.parametrize("is_folder", [False, True])
def test_what_a_reader_holds_on_windows_is_replaced_once_it_lets_go(tmp_path, monkeypatch, is_folder):
    source, target, denied = tmp_path / "new", tmp_path / "there", []
    source.mkdir() if is_folder else source.touch()
    replace, slept, clock = os.replace, [], [0.0]

    def held(*paths):
        if sum(slept) < (5.0 if is_folder else 0.5):
            denied.append(paths)
            raise PermissionError(13, "Access is denied")
        replace(*paths)

    def sleep(seconds):
        slept.append(seconds)
        clock[0] += seconds

    monkeypatch.setattr(os, "replace", held)
    monkeypatch.setattr(replacing.time, "sleep", sleep)
    monkeypatch.setattr(replacing.time, "monotonic", lambda: clock[0])
    replacing.replace_file(source, target)
    assert denied and os.listdir(tmp_path) == ["there"]
    slept.append(-1000.0)
    with pytest.raises(PermissionError):
        replacing.replace_file(target, source)


def test_what_a_reader_holds_on_windows_is_removed_once_it_lets_go(tmp_path, monkeypatch):
    path, unlink, denied = tmp_path / "manifest.json", Path.unlink, []

    def held(path, missing_ok=False):
        if len(denied) < 2:
            denied.append(path)
            raise PermissionError(13, "The process cannot access the file", str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", held)
    path.touch()
    replacing.remove_file(path)
    assert len(denied) == 2 and not path.exists()
    replacing.remove_file(path)


def test_a_file_that_is_being_replaced_on_windows_is_read_all_the_same(tmp_path, monkeypatch):
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/photos"))
    read, denied = Path.read_text, []

    def replaced(path, *args, **kwargs):
        if len(denied) < 2:
            denied.append(path)
            raise PermissionError(13, "Permission denied", str(path))
        return read(path, *args, **kwargs)

    monkeypatch.setattr(Path, "read_text", replaced)
    assert job.request.capture == "/photos"
    write_json_atomic(job.status_path, {"state": "running"})
    denied.clear()
    assert read_status(job.status_path) == {"state": "running"}
    assert len(denied) == 2


def test_the_job_modules_need_the_standard_library_alone():
    modules = "events", "folder", "status", "control"
    text = "import sys; " + "; ".join(f"import solver.job.{name}" for name in modules)
    text += "; print([m for m in ('torch', 'numpy', 'bpy', 'PIL') if m in sys.modules])"
    import subprocess

    answer = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=True,
        cwd=os.path.dirname(os.path.dirname(replacing.__file__)),
    )  # fmt: skip
    assert answer.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "rows",
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]],
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]],
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]],
        [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]],
        [[1, 0, 0, "a"], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[1, 0, 0, float("nan")], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    ],
    ids=["short", "projective", "mirrored", "uneven", "sheared", "flat", "text", "nan"],
)
def test_a_placement_that_is_no_similarity_is_refused(tmp_path, rows):
    with pytest.raises(JobError, match="placement"):
        JobFolder.create(tmp_path / "job", JobRequest(capture="/p", placement=rows))


def test_every_field_of_a_request_is_checked_when_read():
    names = {field.name for field in dataclasses.fields(JobRequest)} - {"schema_version"}
    for name in names:
        content = {"capture": "/p", name: object()}
        with pytest.raises(JobError, match=f"'{name}'"):
            JobRequest.from_json(content, Path("job.json"))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are text")
def test_a_path_that_is_not_text_is_kept_in_job_and_events(tmp_path):
    path = os.fsdecode(b"/photos/\xff\xe4")
    job = JobFolder.create(tmp_path / "job", JobRequest(capture=path))
    assert JobFolder.open(job.root).request.capture == path
    stream = io.StringIO()
    events = EventStream(job.events_path, stream)
    events.emit("warning", text=path)
    events.close()
    assert json.loads(stream.getvalue())["text"] == path
    assert sorted(entry.name for entry in job.root.iterdir()) == ["events.jsonl", "job.json"]
