"""What runs commands for tests tells and leaves what `python -m solver` does."""

import pytest

from tests.cli.command import TINY, fresh_solver, solver


@pytest.mark.parametrize(
    "arguments", [["check", "nowhere ü"], ["--version"], ["doctor", "--nonsense"], ["--help"], []]
)
def test_a_command_ends_and_says_what_it_does_in_a_fresh_python(arguments):
    ours, fresh = solver(*arguments), fresh_solver(*arguments)
    assert (ours.returncode, ours.stdout, ours.stderr) == (fresh.returncode, fresh.stdout, fresh.stderr)
    assert ours.stdout or ours.stderr


def test_a_reconstruction_is_the_one_of_a_fresh_python(job, duck, tmp_path):
    again = fresh_solver("reconstruct", duck, "--out", tmp_path / "job", *TINY)
    assert again.returncode == 0, again.stderr
    for name in ("mesh.ply", "albedo.png", "environment.exr"):
        assert (tmp_path / "job" / "result" / name).read_bytes() == (job / "result" / name).read_bytes()
