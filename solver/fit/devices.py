"""Which of a machine's devices a fit runs on."""

import shutil
import subprocess

import torch

from .errors import SettingsError

_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)
"""Windows opens one for a moment where a program without any starts one that writes"""


def choose_device(name: str) -> str:
    """The torch device for 'auto', 'cpu', 'cuda' or 'mps'.

    Raises:
        SettingsError: the device is not there.
    """
    available = {"cpu": True, "cuda": torch.cuda.is_available() and _cuda_computes()}
    available["mps"] = torch.backends.mps.is_available()
    if name == "auto":
        return "cuda" if available["cuda"] else "cpu"
    if not available.get(name, False):
        there = ", ".join(key for key, value in available.items() if value)
        raise SettingsError(f"--device {name}: this machine has no such device; choose {there}.")
    return name


def _cuda_computes() -> bool:
    """False for a card that is there, but too old for this build of torch."""
    try:
        return float(torch.ones(1, device="cuda") + 1) == 2
    except RuntimeError:
        return False


def device_at_hand(name: str) -> str:
    """The torch device that a job was begun on, or else this machine's best: jobs move between machines."""
    try:
        return choose_device(name)
    except SettingsError:
        return choose_device("auto")


def card_of(device: str) -> str | None:
    """The name of the NVIDIA card that a device is; None for others."""
    return torch.cuda.get_device_name() if device == "cuda" else None


def idle_card() -> str | None:
    """What to do about an NVIDIA card that is there where `choose_device` finds none to use, a sentence;
    None if there is none."""
    name = _name_of_card()
    if name is None:
        return None
    if torch.version.cuda is None:
        return (
            f"{name} is not used, since the solver's PyTorch is for processors only; with one for CUDA, "
            "jobs take a fraction of the time (see Devices in the manual)"
        )
    return f"{name} is not used: PyTorch for CUDA {torch.version.cuda} cannot; a newer driver may help"


def _name_of_card() -> str | None:
    """Of the first NVIDIA card, as its driver has it; None where there is no card or no driver."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return None
    words = [program, "--query-gpu=name", "--format=csv,noheader"]
    try:
        told = subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace",
            timeout=10, check=True, creationflags=_NO_WINDOW,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return next(iter(told.stdout.strip().splitlines()), None)
