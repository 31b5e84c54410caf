"""The command `check`: a line a finding or one JSON, and code 2 for what cannot be read."""

import json
import subprocess
import sys

import pytest

from solver.fit.errors import SettingsError
from solver.preflight.check import check
from tests.preflight.captures import ROOT, around, blurred, capture_at, only, write


def solver(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "solver", "check", *map(str, arguments)], cwd=ROOT, text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=120,
    )  # fmt: skip


def test_the_command_prints_a_line_a_finding_or_one_json(pictures, tmp_path):
    write(tmp_path, pictures, only(at5=blurred(3.0)))
    before = sorted(tmp_path.iterdir())
    lines = solver(tmp_path)
    assert lines.returncode == 0 and lines.stderr == ""
    assert lines.stdout.splitlines()[0].startswith("warning: IMG_005: the photo is blurred")
    assert lines.stdout.splitlines()[-1].startswith("estimate: preset draft")
    content = json.loads(solver(tmp_path, "--json", "--preset", "standard").stdout)
    assert content["findings"][0]["photo"] == "IMG_005"
    assert set(content["findings"][0]) == {"level", "photo", "text"}
    assert content["estimate"]["preset"] == "standard" and content["estimate"]["seconds"] > 0
    assert "estimate" in content["estimate"]["note"]
    assert sorted(tmp_path.iterdir()) == before


def test_what_cannot_be_read_ends_with_code_2_and_one_sentence(pictures, tmp_path):
    write(tmp_path, pictures)
    (tmp_path / "IMG_003.png").write_bytes((tmp_path / "IMG_003.png").read_bytes()[:400])
    for arguments in ([tmp_path], [tmp_path / "nowhere"], [tmp_path, "--preset", "fast"]):
        result = solver(*arguments)
        assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    with pytest.raises(SettingsError):
        check(capture_at(around(4)), "fast")
