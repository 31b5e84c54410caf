"""Dynamic batching (paper §3.4): rays by the samples they take, so that memory stays the same.

Early, rays go through fog and take many samples; later few. After NeRFAcc (Li et al., 2022).
"""

import math

import torch

from .settings import FitSettings

FIRST_RAYS = 100
SMOOTHING = 0.1
RETRACED_START, RETRACED_MEMORY = 1000, 20


LEFT_FREE = 2e9
"""bytes of a card for others, Blender among them"""
MEMORY_OF_A_CHUNK = 4e9
"""bytes of a card for a chunk of the paper's size, 200,000 samples and 1,000,000 secondary ones: eleven
took 30 GiB of an H200, with the graph (docs/decisions/0034)"""


def room_on(device: torch.device) -> int:
    """For how many chunks of the paper's size a device has free memory; one on the CPU."""
    if device.type != "cuda":
        return 1
    free, _ = torch.cuda.mem_get_info(device)
    return max(1, int((free - LEFT_FREE) / MEMORY_OF_A_CHUNK))


class Batching:
    """How many primary rays a step and a chunk take, and how many secondary rays are retraced.

    Args:
        room: for how many chunks at once, of those that `samples` allows, the device has memory.
        least: chunks of a step, where `samples` does not say.

    Attributes:
        share: of the rays that the settings say, where `samples` does not; less where there is no time.
    """

    def __init__(self, settings: FitSettings, retraced_rays: int, room: int = 1, least: int = 1):
        self.settings, self.first_retraced = settings, retraced_rays
        self.room, self.least = room, least
        self.share = 1.0
        self.restart()

    def restart(self) -> None:
        """Forget what was observed (at the start, and after each upsampling)."""
        self.rays_per_sample = 0.0
        self.chunk = FIRST_RAYS
        self.retraced = self.first_retraced
        self.recent: list[float] = []

    def chunks(self, each: int = 1) -> list[int]:
        """Pixels of every chunk of the next step, whose primary rays are `each` a pixel."""
        settings = self.settings
        if settings.samples <= 0:
            wanted = settings.rays * each
            count = max(self.least, math.ceil(wanted / settings.rays_at_once))
            rays = max(count, round(settings.rays * self.share))
            edges = [rays * i // count for i in range(count + 1)]
            return [last - first for first, last in zip(edges, edges[1:], strict=False)]
        most = max(settings.most_rays, settings.rays)
        held = max(1, self.chunk // each)
        total = min(max(held, settings.rays), most)
        chunk = min(held * self.room, total)
        whole, rest = divmod(total, chunk)
        return [chunk] * whole + ([rest] if rest else [])

    def retraced_of(self, share: float, primary: int) -> int:
        """Retraced rays of a chunk that is a `share` of its step and has so many primary ones."""
        if self.settings.samples <= 0 and self.settings.secondary_samples <= 0:
            return round(self.retraced * share)
        places = 1
        if self.settings.samples > 0:
            # Of how many chunks it takes the place.
            places = min(self.room, math.ceil(primary / max(1, self.chunk)))
        return self.retraced * places

    def observe(self, rays: int, samples: int, retraced: int, retraced_samples: int) -> None:
        """Take note of a chunk: its rays and samples, primary and retraced."""
        settings = self.settings
        if settings.samples > 0:
            ratio = rays / max(samples, 1)
            mean = SMOOTHING * ratio + (1 - SMOOTHING) * self.rays_per_sample
            self.rays_per_sample = ratio if self.rays_per_sample == 0 else min(mean, ratio)
            self.chunk = int(settings.samples * self.rays_per_sample) + 1
        if settings.secondary_samples > 0 and self.first_retraced > 0 and retraced > 0:
            self.recent = [*self.recent, retraced / max(retraced_samples, 1)][-RETRACED_MEMORY:]
            held = int(settings.secondary_samples * min(self.recent)) + 1
            # Until the memory is full, what was seen may not be the worst.
            full = len(self.recent) == RETRACED_MEMORY
            self.retraced = held if full else min(held, RETRACED_START)

    @property
    def settled(self) -> bool:
        """False while each step is to learn from the one before (see `observe`)."""
        settings = self.settings
        if settings.samples > 0 and self.rays_per_sample == 0:
            return False
        traces = settings.secondary_samples > 0 and self.first_retraced > 0
        return not traces or len(self.recent) == RETRACED_MEMORY

    def state(self) -> dict:
        """For a checkpoint."""
        return {
            "rays_per_sample": self.rays_per_sample, "chunk": self.chunk,
            "retraced": self.retraced, "recent": self.recent,
        }  # fmt: skip

    def restore(self, state: dict) -> None:
        self.rays_per_sample, self.chunk = state["rays_per_sample"], state["chunk"]
        self.retraced, self.recent = state["retraced"], list(state["recent"])
