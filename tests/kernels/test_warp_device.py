"""What goes to Warp is what its kernels were written for."""

from types import SimpleNamespace

import pytest
import torch

from solver.kernels import hashing_warp, warp_folder
from solver.kernels.hashing import uniform_torch
from solver.kernels.warm_up import compile_kernels
from solver.kernels.warp_device import launch, trouble_on
from tests.kernels.paths import WITHOUT_CARD


def test_a_kernel_refuses_tensors_of_another_type():
    from solver.kernels.warp_device import _touch

    values = torch.zeros(3)
    launch(_touch, 3, values)
    assert (values == 1).all()
    with pytest.raises(TypeError, match="float64 instead of torch.float32"):
        launch(_touch, 3, values.double())
    with pytest.raises(TypeError, match="1.0 instead of a tensor"):
        hashing_warp.uniform(torch.arange(3), 1.0, torch.empty(3, 1))


def test_warp_runs_on_the_processor():
    assert not trouble_on(torch.device("cpu"))


def test_launches_again_with_the_same_shape_laid_out_otherwise():
    keys, columns = 4096 * torch.arange(6), torch.empty(4, 6)
    for out in (torch.empty(6, 4), columns.T, torch.empty(6, 4)):
        hashing_warp.uniform(keys, torch.tensor([3]), out)
        assert torch.equal(out, uniform_torch(keys, 3, 4))


@WITHOUT_CARD
def test_warp_runs_on_the_card_and_finds_all_kernels_compiled():
    assert not trouble_on(torch.device("cuda"))
    compile_kernels("cuda")


def test_launches_again_with_other_numbers_tensors_and_sizes():
    for count, columns in ((5, 3), (2, 7), (0, 1)):
        keys = torch.arange(count) * 4096
        ours = torch.empty(count, columns)
        hashing_warp.uniform(keys, torch.tensor([2**32 - count]), ours)
        assert torch.equal(ours, uniform_torch(keys, 2**32 - count, columns))


def test_a_device_that_warp_cannot_use_is_told(monkeypatch):
    for error, said in ((IndexError(), "IndexError"), (RuntimeError("too old\nby far"), "too old")):

        def no_such_device(*_, error=error, **__):
            raise error

        monkeypatch.setattr("solver.kernels.warp_device.launch", no_such_device)
        assert trouble_on(torch.device("cpu")) == said


@pytest.mark.parametrize(
    "system, own, environment, cache, is_told",
    [
        ("nt", "C:/Users/Jürgen/AppData/Local", "C:/nmf/environment", "C:/nmf/warp", False),
        ("nt", "C:/Users/Jürgen/AppData/Local", "C:/Users/Jürgen/nmf/environment", None, True),
        ("nt", "C:/Users/Ann/AppData/Local", "C:/Users/Ann/nmf/environment", None, False),
        ("posix", "", "/home/jürgen/nmf/environment", None, False),
    ],
)
def test_kernels_on_windows_are_kept_where_its_compilers_can_open_them(
    monkeypatch, system, own, environment, cache, is_told
):
    monkeypatch.setattr(warp_folder, "os", SimpleNamespace(name=system, environ={"LOCALAPPDATA": own}))
    monkeypatch.setattr(warp_folder.sys, "prefix", environment)
    found = warp_folder.kernel_cache()
    assert (None if found is None else found.as_posix()) == cache
    assert ("choose a Folder" in warp_folder.first_aid()) == is_told
