"""A run whose input is of no use leaves nothing of its own, and touches nothing of anybody else's."""

import os

import pytest

from solver.capture.errors import CaptureError
from solver.job.begun import Begun
from solver.job.folder import JobFolder
from solver.job.request import JobError, JobRequest
from solver.session import session

USELESS = CaptureError("a.jpg", "", "the photo cannot be read", "replace it")


def begin(root):
    """A job that is new in a folder, and what was made for it."""
    begun = Begun.before(JobFolder(root).request_path)
    return JobFolder.create(root, JobRequest(capture="/photos")), begun


def run(job, begun, work):
    paths = job.events_path, job.status_path, job.cancel_path
    with session(*paths, to_stdout=False, has_parent=False, begun=begun):
        work()


def end_by(error):
    def work():
        raise error

    return work


@pytest.mark.parametrize("error", [USELESS, JobError("no such job")])
def test_folders_that_were_made_go_with_what_is_in_them(tmp_path, error):
    job, begun = begin(tmp_path / "renders of ü" / "first" / "job")
    with pytest.raises(type(error)):
        run(job, begun, end_by(error))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_a_person_made_stays_with_what_was_there(tmp_path):
    (tmp_path / "job").mkdir()
    (tmp_path / "job" / ".DS_Store").write_bytes(b"of the file browser")
    job, begun = begin(tmp_path / "job")
    with pytest.raises(CaptureError):
        run(job, begun, end_by(USELESS))
    assert os.listdir(tmp_path / "job") == [".DS_Store"]


def test_what_has_work_in_it_stays_whole(tmp_path):
    job, begun = begin(tmp_path / "job")

    def work():
        job.masks_dir.mkdir()
        raise USELESS

    with pytest.raises(CaptureError):
        run(job, begun, work)
    assert {"job.json", "events.jsonl", "status.json", "masks"} == set(os.listdir(job.root))


def test_a_job_that_was_there_before_stays(tmp_path):
    job, _ = begin(tmp_path / "job")
    begun = Begun.before(job.request_path)
    assert begun is None
    with pytest.raises(CaptureError):
        run(job, begun, end_by(USELESS))
    assert JobFolder.open(job.root).request.capture == "/photos"


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("a fault")])
def test_what_is_no_fault_of_the_input_leaves_a_job_to_be_resumed(tmp_path, error):
    job, begun = begin(tmp_path / "job")
    with pytest.raises(type(error)):
        run(job, begun, end_by(error))
    assert job.request_path.exists()


def test_who_comes_second_takes_nothing_from_who_came_first(tmp_path):
    job, begun = begin(tmp_path / "job")

    def work():
        with pytest.raises(JobError, match="another process"):
            run(job, begun, lambda: None)
        assert {"job.json", "events.jsonl", "status.json"} == set(os.listdir(job.root))

    run(job, begun, work)
