"""Taking up a job: it has to be the one that is asked for."""

import shutil

import pytest

from solver.job.folder import JobFolder
from solver.job.request import JobError, JobRequest
from solver.job.resume import take_up


def test_a_job_of_an_archive_goes_on_when_only_the_archives_folder_is_left(tmp_path):
    (tmp_path / "scan" / "inside").mkdir(parents=True)
    for folder in (tmp_path / "scan", tmp_path / "scan" / "inside"):
        begun = JobFolder.create(tmp_path / f"job of {folder.name}", JobRequest(str(folder)))
        take_up(begun, {"capture": str(tmp_path / "scan.zip"), "photos": None}, None)
    (tmp_path / "there.zip").write_bytes(b"another")
    for other in ("there.zip", "sc.zip", "scan.png", "scans.zip", "inside.zip"):
        with pytest.raises(JobError, match="was begun with the capture"):
            take_up(begun, {"capture": str(tmp_path / other)}, None)


def test_a_job_whose_photos_were_moved_goes_on_with_them_where_they_are_now(tmp_path):
    before, now, third = (tmp_path / name for name in ("before", "now", "third"))
    for folder in (before, third):
        (folder / "masks").mkdir(parents=True)
    request = JobRequest(str(before), photos=str(before), masks=str(before / "masks"))
    job = JobFolder.create(tmp_path / "job", request)
    asked = {"capture": str(now), "photos": str(now), "masks": str(now / "masks")}
    with pytest.raises(JobError, match="was begun with the capture"):
        take_up(job, asked, None)
    assert job.request == request
    shutil.move(before, now)
    take_up(job, asked, 60.0)
    assert job.request == JobRequest(**asked, time_limit=60.0)
    with pytest.raises(JobError, match="was begun with the capture"):
        take_up(job, {"capture": str(third)}, None)


def test_a_moved_job_is_taken_up_by_the_cameras_in_it(tmp_path):
    job = JobFolder(tmp_path / "job")
    (job.root / "capture").mkdir(parents=True)
    (job.root / "capture" / "transforms_train.json").write_text("{}")
    for before in (tmp_path / "elsewhere" / "job" / "capture" / "transforms_train.json",
                   "C:\\films\\nmf_jobs\\job\\capture\\transforms_train.json"):  # fmt: skip
        job.ask(JobRequest(str(before)))
        own = job.root / "capture" / "transforms_train.json"
        assert job.capture_path == own
        take_up(job, {"capture": str(own)}, None)
    job.ask(JobRequest(str(tmp_path / "elsewhere" / "photos" / "transforms_train.json")))
    assert job.capture_path == tmp_path / "elsewhere" / "photos" / "transforms_train.json"
    other = tmp_path / "other" / "capture" / "transforms_train.json"
    other.parent.mkdir(parents=True)
    other.write_text("{}")
    job.ask(JobRequest(str(other)))
    assert job.capture_path == other, "it is there"
