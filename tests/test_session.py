"""What a long run leaves behind."""

import errno
import os
from pathlib import Path

import pytest
import torch

from solver.capture import triangulate
from solver.job.request import JobError
from solver.session import explain, passing_session, session


def test_a_temporary_folder_that_windows_does_not_let_go_of_costs_no_work(tmp_path, monkeypatch):
    """As where a virus scanner looks at a file in it."""

    def held(path, **how):
        raise OSError(errno.ENOTEMPTY, "The directory is not empty", str(path))

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(os, "rmdir", held)
    with passing_session("pictures", "copying photos", to_stdout=False) as run:
        run.told(1.0, "copied")
    assert run.code == 0

    monkeypatch.setattr(triangulate, "run_apart", lambda work, folder, *args, progress: folder)
    folders = [
        triangulate.triangulate([None] * 3, [], lambda done: None),
        triangulate.compare([], [], [], lambda done: None),
    ]
    assert len(os.listdir(tmp_path)) == 3 and all(map(Path.is_dir, folders))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EFBIG, errno.EDQUOT])
def test_a_disk_that_takes_no_more_is_told_with_the_folder(tmp_path, number):
    """A write that fails tells what it was, but not where."""
    paths = (tmp_path / name for name in ("events.jsonl", "status.json", "cancel"))
    with pytest.raises(OSError) as told, session(*paths, to_stdout=False, has_parent=False):
        raise OSError(number, os.strerror(number))
    code, message = explain(told.value)
    assert code == 2 and message.startswith(f"{tmp_path}: ") and "free space" in message


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EPERM])
def test_a_place_that_is_not_to_be_written_to_is_told_so(number):
    code, message = explain(OSError(number, os.strerror(number), "/there/file"))
    assert code == 2 and "space" not in message
    assert message.startswith("/there/file: ") and "make it writable" in message


@pytest.mark.parametrize(("path", "told"), [("C:\\job\\" + "x" * 300, True), ("C:\\gone", False)])
def test_a_path_that_windows_does_not_find_for_its_length_is_told_so(monkeypatch, path, told):
    with monkeypatch.context() as windows:
        windows.setattr(os, "name", "nt")
        for error in (
            FileNotFoundError(2, "No such file", path),
            FileNotFoundError(2, "", "a", None, path),
        ):
            code, message = explain(error)
            assert (code == 2 and "too long for this disk" in message) == told, message


@pytest.mark.parametrize("number", [8, 14, 1455])
def test_windows_errors_of_memory_are_told_so_in_any_language(number):
    """1455 is what loading PyTorch's libraries ends in where the paging file is small."""
    error = OSError(errno.EINVAL, "Die Auslagerungsdatei ist zu klein")
    error.winerror = number
    code, message = explain(error)
    assert code == 4 and message.startswith("Out of memory: ")
    error.winerror = 5
    assert explain(error)[0] != 4


@pytest.mark.parametrize(
    "said",
    [
        "DefaultCPUAllocator: not enough memory: you tried to allocate 7 bytes.",  # Windows
        "DefaultCPUAllocator: can't allocate memory: you tried to allocate 7 bytes.",
        "CUDA out of memory. Tried to allocate 7 bytes",
        "std::bad_alloc",
        "bad allocation",  # Windows
    ],
)
def test_libraries_errors_of_memory_are_told_so_on_every_system(said):
    code, message = explain(RuntimeError(said))
    assert code == 4 and message.startswith("Out of memory: ")


def test_more_memory_than_there_is_is_told_so():
    with pytest.raises(RuntimeError) as told:
        torch.empty(1 << 60, dtype=torch.uint8)
    assert explain(told.value)[0] == 4


@pytest.mark.parametrize("inside", ["", "deeper"])
def test_a_file_in_the_way_of_a_folder_is_told_so(tmp_path, inside):
    (tmp_path / "file").touch()
    with pytest.raises(OSError) as told:
        (tmp_path / "file" / inside).mkdir(parents=True)
    code, message = explain(told.value)
    assert code == 2 and "file" in message and "a file is in the way" in message
    assert "in the way" not in explain(FileExistsError(17, "File exists", str(tmp_path)))[1]


def test_of_two_processes_that_begin_at_once_one_is_refused_and_harms_nothing(tmp_path):
    names = ("events.jsonl", "status.json", "cancel")
    paths = [tmp_path / name for name in names]
    with session(*paths, to_stdout=False, has_parent=False) as first:
        paths[2].touch()
        before = paths[0].read_bytes(), paths[1].read_bytes()
        with pytest.raises(JobError, match="another process"):
            with session(*paths, to_stdout=False, has_parent=False):
                raise AssertionError
        assert (paths[0].read_bytes(), paths[1].read_bytes()) == before
        assert paths[2].exists()
    assert first.code == 0
    with session(*paths, to_stdout=False, has_parent=False):
        pass
