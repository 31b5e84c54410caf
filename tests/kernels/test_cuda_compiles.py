"""Kernels compile for graphics cards where there is none: Warp brings NVIDIA's compiler along."""

import importlib
from pathlib import Path

import pytest
import warp as wp

import solver.kernels
from solver.kernels.warm_up import WARP_FAMILIES

MODULES = Path(solver.kernels.__path__[0]).glob("*_warp.py")
FAMILIES = sorted(
    path.stem.removesuffix("_warp") for path in MODULES if "@wp.kernel" in path.read_text("utf-8")
)


def test_all_that_have_kernels_are_compiled_before_a_fit():
    assert set(FAMILIES) == set(WARP_FAMILIES)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("architecture", [75, 90])
def test_kernels_compile_for_cards_from_turing_to_hopper(family, architecture, tmp_path):
    module = importlib.import_module(f"solver.kernels.{family}_warp")
    wp.compile_aot_module(module, device="cpu", arch=architecture, module_dir=tmp_path, use_ptx=True)
    made = list(tmp_path.glob("*.ptx"))
    assert made and f".target sm_{architecture}" in made[0].read_text()
