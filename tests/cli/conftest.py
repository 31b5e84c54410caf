"""A finished tiny reconstruction, and cameras with all truth."""

import json
import shutil
from pathlib import Path

import pytest

from solver.kernels.warm_up import compile_kernels
from tests.cli.command import DUCK, TINY, solver


@pytest.fixture(scope="session")
def job(tmp_path_factory):
    # A process that compiles kernels computes with other roundings than those that find them on disk.
    compile_kernels()
    root = tmp_path_factory.mktemp("space and ü") / "job"
    result = solver("reconstruct", DUCK, "--out", root, *TINY)
    assert result.returncode == 0, result.stderr
    # Off a terminal there is nothing but errors, and the last line names the manifest.
    assert result.stdout.splitlines() == [str(root / "result" / "manifest.json")]
    assert result.stderr == ""
    return root


@pytest.fixture(scope="session")
def cameras(tmp_path_factory):
    """Three of the sample's held-out cameras with all truth that belongs to them."""
    folder = tmp_path_factory.mktemp("few")
    content = json.loads((DUCK / "transforms_test.json").read_text())
    relit = {path.name for path in (DUCK / "relight_sunset").glob("r_*.png")}
    content["frames"] = [
        f for f in content["frames"] if Path(f["file_path"]).name + ".png" in relit
    ]
    content["frames"] = content["frames"][:3]
    for name in ("env.exr", "relight_sunset.exr", "relight_studio.exr"):
        shutil.copy(DUCK / name, folder)
    for frame in content["frames"]:
        name = Path(frame["file_path"]).name
        for part in ("test", "relight_sunset", "relight_studio"):
            (folder / part).mkdir(exist_ok=True)
            for path in (DUCK / part).glob(f"{name}[._]*"):
                shutil.copy(path, folder / part)
    path = folder / "transforms_test.json"
    path.write_text(json.dumps(content))
    return path
