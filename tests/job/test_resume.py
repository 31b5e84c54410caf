"""Taking up a job: it has to be the one that is asked for."""

from types import SimpleNamespace

import pytest

from solver.job.request import JobError, JobRequest
from solver.job.resume import take_up


def test_a_job_of_an_archive_goes_on_when_only_the_archives_folder_is_left(tmp_path):
    (tmp_path / "scan" / "inside").mkdir(parents=True)
    for folder in (tmp_path / "scan", tmp_path / "scan" / "inside"):
        begun = SimpleNamespace(root=tmp_path, request=JobRequest(capture=str(folder)))
        take_up(begun, {"capture": str(tmp_path / "scan.zip"), "photos": None}, None)
    (tmp_path / "there.zip").write_bytes(b"another")
    for other in ("there.zip", "sc.zip", "scan.png", "scans.zip", "inside.zip"):
        with pytest.raises(JobError, match="was begun with the capture"):
            take_up(begun, {"capture": str(tmp_path / other)}, None)
