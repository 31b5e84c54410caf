"""How long a reconstruction will take on this machine, and how much memory: an estimate.

Time is the preset's steps times what a step took on one core where it was measured (docs/benchmarks.md), of
which several share a part; on an NVIDIA card, what it took on an H200 (docs/decisions/0034). Memory is
what photos take up while rays are made of them, plus what a fit of the preset was seen to need beside them.
"""

import os
import sys
from dataclasses import asdict, dataclass, replace

from ..capture.capture import Capture
from ..capture.photos import MOST_AT_ONCE
from ..fit.clock import grid_cost
from ..fit.presets import settings_for
from ..fit.settings import FieldSettings, Settings
from ..threads import usable_cores

CORE_SECONDS = {"draft": 0.10, "standard": 0.15, "paper": 2.4}
"""seconds of a step on one core; the paper's is not measured but follows its rays"""
OVERHEAD = {"draft": 40.0, "standard": 100.0, "paper": 240.0}
"""seconds for kernels, hull, asset and report"""
CARD_SECONDS = {"draft": 0.0075, "standard": 0.0075, "paper": 0.015}
"""seconds of a step on an H200"""
CARD_OVERHEAD = {"draft": 27.0, "standard": 31.0, "paper": 60.0}
"""seconds beside the steps there, most of them the processor's"""
BASE_BYTES = {"draft": 1.3e9, "standard": 2.0e9, "paper": 4.0e9}
"""memory of a fit of few, small photos"""
WITHOUT_MASKS = 1.8
"""times as long takes a step without masks: a fog at first, and the room to the end"""
TURNED, TURNED_ON_A_CARD = 2.3, 6.0
"""times as long takes a step whose light turns with the cameras: tables for each photo it has pixels of; a
guess on a card, where it is not replayed then"""
SHARED = 0.5
"""of the time that a step takes on one core, what several share"""
FINDING_POINTS = 0.4
"""processor seconds it takes to find the sparse points that a photo without mask shows"""
FINDING_STANDING = 1.0
"""the same to find where a photo shows what stands on a support"""
LOADING = 0.25e-6
"""processor seconds a pixel of the photos takes until it is in the ray bank"""

ON_PROCESSOR = "on the processor; other work slows it down"
ON_A_CARD = "on {card}, as measured on an H200; a smaller card takes longer"

PHOTO_BYTES = 16  # float32 RGBA, kept for hull, previews and report
BANK_BYTES = 8  # half RGB and alpha
DIRECTION_BYTES = 12  # float32, once per lens
DECODING_BYTES = 32  # what a large photo takes until it is small
LIKELY_BYTES = 9  # with masks: which pixels are drawn, and their indices


@dataclass(frozen=True)
class Estimate:
    """Estimates, not promises.

    Attributes:
        seconds: wall time of the whole reconstruction, asset included.
        bytes: peak memory.
        photo_bytes: the photos' part of it.
        cores: of this machine that it may use.
        memory: bytes this machine has; None if that is not known.
    """

    preset: str
    seconds: float
    bytes: int
    photo_bytes: int
    cores: int
    memory: int | None
    note: str

    def as_json(self) -> dict:
        """For `--json`: the fields, and `text`, a sentence."""
        return {**asdict(self), "text": self.line()}

    def line(self) -> str:
        """For a terminal."""
        minutes = self.seconds / 60
        time = f"{minutes:.0f} minutes" if minutes < 90 else f"{minutes / 60:.1f} hours"
        if minutes < 1.5:
            time = "a minute"
        return (
            f"estimate: preset {self.preset} takes about {time} and {self.bytes / 1e9:.1f} GB of "
            f"memory ({self.note})"
        )


def estimate(
    capture: Capture, preset: str, masked: bool, cores: int | None = None, turned: bool = False,
    standing: bool = False, settings: Settings | None = None, card: str | None = None,
) -> Estimate:  # fmt: skip
    """Estimate a reconstruction of a capture.

    Args:
        masked: all photos have masks or alpha.
        cores: None: this machine's.
        turned: its light goes round with the cameras.
        standing: the object stands on something, by which photos without masks get some first.
        settings: the preset's with what a person changed; None: as it comes.
        card: the NVIDIA card it will run on; None: the processor.

    Raises:
        SettingsError: there is no such preset.
    """
    settings = settings or settings_for(preset)
    cores = cores or usable_cores()
    pixels = sum(camera.width * camera.height for camera in capture.cameras)
    fog, standing = not (masked or standing), standing and not masked
    a_step = CORE_SECONDS[preset] * (1 - SHARED + SHARED / cores)
    beside = OVERHEAD[preset]
    if card is not None:
        a_step, beside = CARD_SECONDS[preset], CARD_OVERHEAD[preset]
    fit = settings.fit.steps * a_step
    if fog:
        fit *= WITHOUT_MASKS * _share_of_coarser_grid(settings.field)
    if turned and settings.light.turntable != "no":
        fit *= TURNED if card is None else TURNED_ON_A_CARD
    seconds = fit + beside + pixels * LOADING
    if standing:
        seconds += len(capture.cameras) * FINDING_STANDING / cores
    if fog and capture.has_few_points and settings.field.hull_start:
        seconds += len(capture.cameras) * FINDING_POINTS / cores
    most = settings.photos.most_pixels
    fitted = tuple(camera.no_larger(most) for camera in capture.cameras)
    photos = photo_bytes(replace(capture, cameras=fitted), not fog)
    if any(small is not whole for small, whole in zip(fitted, capture.cameras, strict=True)):
        largest = max(camera.width * camera.height for camera in capture.cameras)
        photos += DECODING_BYTES * largest * min(MOST_AT_ONCE, cores)
    return Estimate(
        preset, round(seconds, 1), int(BASE_BYTES[preset]) + photos, photos, cores, memory_of_machine(),
        ON_PROCESSOR if card is None else ON_A_CARD.format(card=card),
    )  # fmt: skip


def _share_of_coarser_grid(field: FieldSettings) -> float:
    """Of the time of a step on the finest grid, what one takes where no masks hold the shape."""
    finest = field.sizes[-1]
    return grid_cost(min(finest, field.finest_without_masks)) / grid_cost(finest)


def photo_bytes(capture: Capture, masked: bool) -> int:
    """Peak memory of a capture's photos and the rays made of them, as `RayBank` makes them."""
    pixels, lenses = 0, {}
    for camera in capture.cameras:
        pixels += camera.width * camera.height
        lenses[camera.lens_key] = camera.width * camera.height
    # Colours and directions are there twice while they are joined.
    bank = 2 * (BANK_BYTES * pixels + DIRECTION_BYTES * sum(lenses.values()))
    return PHOTO_BYTES * pixels + bank + (LIKELY_BYTES * pixels if masked else 0)


def memory_of_machine() -> int | None:
    """Bytes of memory; None where that is not known."""
    if sys.platform == "win32":
        return _memory_of_windows()
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def _memory_of_windows() -> int | None:
    import ctypes

    class MemoryStatus(ctypes.Structure):
        _fields_ = [
            ("length", ctypes.c_uint32), ("load", ctypes.c_uint32), ("total", ctypes.c_uint64),
            ("others", ctypes.c_uint64 * 6),
        ]  # fmt: skip

    status = MemoryStatus(length=ctypes.sizeof(MemoryStatus))
    told = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return status.total if told else None
