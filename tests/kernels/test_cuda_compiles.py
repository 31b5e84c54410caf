"""Kernels compile for graphics cards where there is none: Warp brings NVIDIA's compiler along."""

import importlib

import pytest
import warp as wp


@pytest.mark.parametrize("family", ["vm", "march", "integral", "visibility"])
@pytest.mark.parametrize("architecture", [75, 90])
def test_kernels_compile_for_cards_from_turing_to_hopper(family, architecture, tmp_path):
    module = importlib.import_module(f"solver.kernels.{family}_warp")
    wp.compile_aot_module(
        module, device="cpu", arch=architecture, module_dir=tmp_path, use_ptx=True
    )
    made = list(tmp_path.glob("*.ptx"))
    assert made and f".target sm_{architecture}" in made[0].read_text()
