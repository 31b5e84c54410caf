"""A finished tiny reconstruction, and cameras with all truth."""

import json
import shutil
from pathlib import Path

import pytest

from solver.kernels.warm_up import compile_kernels
from tests.cli.command import DUCK, TINY, solver


@pytest.fixture(scope="session")
def job(tmp_path_factory, duck):
    # A process that compiles kernels computes with other roundings than those that find them on disk.
    compile_kernels()
    root = tmp_path_factory.mktemp("space and ü") / "job"
    result = solver("reconstruct", duck, "--out", root, *TINY)
    assert result.returncode == 0, result.stderr
    # Off a terminal there is nothing but errors, and the last line names the manifest.
    assert result.stdout.splitlines() == [str(root / "result" / "manifest.json")]
    assert result.stderr == ""
    return root


@pytest.fixture(scope="session")
def cameras(tmp_path_factory, duck):
    """Three of the small sample's held-out cameras with all truth that belongs to them."""
    return _with_truth(duck, 3, tmp_path_factory.mktemp("few"))


@pytest.fixture(scope="session")
def large_cameras(tmp_path_factory):
    """Two of the sample's own, likewise: some scores need as many pixels."""
    return _with_truth(DUCK, 2, tmp_path_factory.mktemp("large"))


def _with_truth(capture, count, folder):
    """The first held-out cameras of a capture that have photos under all lights, in a folder of their own."""
    content = json.loads((capture / "transforms_test.json").read_text())
    relit = {path.name for path in (capture / "relight_sunset").glob("r_*.png")}
    content["frames"] = [f for f in content["frames"] if Path(f["file_path"]).name + ".png" in relit]
    content["frames"] = content["frames"][:count]
    for name in ("env.exr", "relight_sunset.exr", "relight_studio.exr"):
        shutil.copy(capture / name, folder)
    for frame in content["frames"]:
        name = Path(frame["file_path"]).name
        for part in ("test", "relight_sunset", "relight_studio"):
            (folder / part).mkdir(exist_ok=True)
            for path in (capture / part).glob(f"{name}[._]*"):
                shutil.copy(path, folder / part)
    path = folder / "transforms_test.json"
    path.write_text(json.dumps(content))
    return path
