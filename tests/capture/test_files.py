"""Files that camera files lie beside, or are said to be: what is no file at all never ends."""

import os

import pytest

from solver.capture.errors import CaptureError
from solver.capture.files import head_of, read_bytes, read_lines

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such files")


@pytest.fixture(params=["pipe", "device"])
def endless(tmp_path, request):
    file = tmp_path / "trajectories.txt"
    os.mkfifo(tmp_path / "pipe")
    file.symlink_to(tmp_path / "pipe" if request.param == "pipe" else os.devnull)
    return file


def test_pipes_and_devices_are_not_read(endless):
    with pytest.raises(CaptureError, match=r"cannot be read \(this is no file, but a pipe"):
        read_bytes(endless)
    with pytest.raises(CaptureError, match=r"cannot be read \(this is no file, but a pipe"):
        list(read_lines(endless))
    assert head_of(endless) == b""
