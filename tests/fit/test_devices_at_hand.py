"""Which device a job runs on, and what is said of a card that it cannot run on."""

import subprocess
import sys

import pytest
import torch

from solver.fit import devices
from solver.fit.devices import card_of, choose_device, device_at_hand, idle_card
from solver.fit.errors import SettingsError


@pytest.fixture
def no_device(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)


@pytest.fixture
def driver(no_device, monkeypatch, tmp_path):
    """A driver's program that says what it is told to, and ends with a code."""

    def says(words, code=0):
        program = tmp_path / "nvidia_smi.py"
        program.write_text(f"import sys\nprint({words!r})\nsys.exit({code})\n", encoding="utf-8")
        real = subprocess.run
        monkeypatch.setattr(devices.shutil, "which", lambda name: str(program))
        monkeypatch.setattr(devices.subprocess, "run", lambda w, **o: real([sys.executable, *w], **o))

    return says


def test_without_a_card_jobs_run_on_the_processor_and_cards_are_refused(no_device):
    assert choose_device("auto") == choose_device("cpu") == device_at_hand("cuda") == "cpu"
    with pytest.raises(SettingsError, match="--device cuda: this machine has no such device; choose cpu"):
        choose_device("cuda")
    assert card_of("cpu") is None


def test_a_card_that_torch_is_not_made_for_is_told_with_the_way_out(driver, monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", None)
    driver("NVIDIA GeForce RTX 4070\nNVIDIA T4\n")
    assert idle_card().startswith(
        "NVIDIA GeForce RTX 4070 is not used, since the solver's PyTorch is for p"
    )


def test_a_card_whose_driver_is_too_old_is_told(driver, monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    driver("NVIDIA T4")
    assert idle_card() == "NVIDIA T4 is not used: PyTorch for CUDA 13.0 cannot; a newer driver may help"


@pytest.mark.parametrize(("words", "code"), [("no devices were found", 6), ("", 0)])
def test_a_driver_without_a_card_is_nothing_to_tell(driver, words, code):
    driver(words, code)
    assert idle_card() is None


def test_no_driver_is_nothing_to_tell(no_device, monkeypatch):
    monkeypatch.setattr(devices.shutil, "which", lambda name: None)
    assert idle_card() is None
