"""What a time limit leaves: seconds for the fit; mesh, textures and report of a size to go with them."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from ..asset.photo_detail import MOST_VIEWS
from ..capture.camera import Camera
from ..job.events import clock
from ..job.progress import Progress
from ..render.scene import Scene
from .clock import LEAST_STEPS_FROM_FOG
from .report import MOST_PIXELS, VIEWS
from .settings import Settings
from .trainer import Trainer

# Mesh, textures and report take as long as this many lookups of the surface a texel, and that many
# for what does not depend on the textures (measured: 18 s where a lookup takes 0.29 µs).
_LOOKUPS_PER_TEXEL = 30.0
_OTHER_LOOKUPS = 30_000_000
# A photo whose detail textures get (measured: 0.25 s of 1024² texels where a lookup takes 0.29 µs).
_LOOKUPS_PER_TEXEL_OF_A_PHOTO = 0.8
# Without masks each pixel of the report shows something, and the surface is looked at from all photos
# (measured on *fox*: 40 to 60 s with the rest, the more the longer the fit was).
_LOOKUPS_PER_SHOWN_PIXEL, _LOOKUPS_PER_PHOTO = 800, 1_100_000
# A light of which a floor is close by is looked up for its far twin (measured, 6 s).
_LOOKUPS_OF_FLOOR = 20_000_000
# A step of a fog, of draft's 1024 rays (measured: 0.3 s where a lookup takes 0.29 µs).
_LOOKUPS_PER_FOG_STEP = 1_000_000
_SECONDS_BESIDE_A_CARD = 8.0
"""mesh and UVs are made by the processor, however fast a card is (measured, *draft*)"""
_TRIAL = 30_000
FINISHING = 0.3
"""of a time limit that mesh, textures and report may take: with more, they get smaller"""
_HURRIES = (1.0, 1.0), (0.5, 0.25), (0.5, 0.0625)
_LEAST_TEXTURE = 256
LEAST_FIT, LEAST_FIT_FROM_FOG = 0.2, 0.4
"""share of a time limit that is the fit's at least"""
FEWEST_RAYS = 0.5
"""share of a step's rays that are left where a limit is short and a fit starts as a fog"""
FEW_STEPS, FEW_STEPS_FROM_FOG = 0.05, 0.2
"""share of a fit's steps below which a person is told; of fits that start as a fog, 7 % left a block and
25 % an object (docs/decisions/0019)"""


@dataclass(frozen=True)
class Finish:
    """What follows a fit, and how long it is estimated to take.

    Attributes:
        texture_size: texels per edge. report_pixels: of a view of the report, at most.
        seconds, lookup: for all of that, and for a lookup of the surface here; 0 where there is no limit.
        photo_detail: whether the albedo gets detail from photos.
    """

    texture_size: int
    report_pixels: int
    seconds: float
    lookup: float
    photo_detail: bool = False

    def what_is_less(self, settings: Settings) -> str | None:
        """What is smaller for a limit's sake, one clause; None: nothing is."""
        less = []
        if self.texture_size < settings.asset.texture_size:
            less.append(f"textures have {self.texture_size} texels per edge (`export` bakes finer ones)")
        if self.report_pixels < MOST_PIXELS:
            less.append("the report's pictures are small")
        return f"because of the time limit, {' and '.join(less)}" if less else None


def finish_within(
    limit: float | None, scene: Scene, settings: Settings, cameras: Sequence[Camera] = (),
    finer_photos: int = 0,
) -> Finish:  # fmt: skip
    """Mesh, textures and report as a time limit leaves room for them; a trial of lookups tells how long
    they take.

    Args:
        limit: seconds for the whole job; None: there is none, and nothing is tried.
        cameras: of the photos, where these have no masks.
        finer_photos: how many there are whose detail the albedo gets.
    """
    lookup = 0.0 if limit is None else _seconds_of_a_lookup(scene)
    finer_photos = min(finer_photos, MOST_VIEWS)
    for shrink, fewer in _HURRIES:
        detail = finer_photos > 0 and shrink == 1
        size = max(round(settings.asset.texture_size * shrink), _LEAST_TEXTURE)
        size, pixels = min(size, settings.asset.texture_size), round(MOST_PIXELS * fewer)
        lookups = _LOOKUPS_PER_TEXEL * size**2 + _OTHER_LOOKUPS
        lookups += _LOOKUPS_PER_TEXEL_OF_A_PHOTO * size**2 * finer_photos * detail
        shown = sum(min(c.width * c.height, pixels) for c in cameras[:VIEWS])
        lookups += _LOOKUPS_PER_SHOWN_PIXEL * shown + _LOOKUPS_PER_PHOTO * len(cameras)
        if scene.environment.floor is not None:
            lookups += _LOOKUPS_OF_FLOOR
        beside = 0.0 if limit is None or scene.device.type == "cpu" else _SECONDS_BESIDE_A_CARD
        finish = Finish(size, pixels, lookups * lookup + beside, lookup, detail)
        # Of what the processor does beside a card, smaller textures and pictures spare nothing.
        if limit is None or finish.seconds - beside <= FINISHING * limit:
            break
    return finish


def _seconds_of_a_lookup(scene: Scene) -> float:
    generator = torch.Generator().manual_seed(0)
    points = scene.field.from_box(torch.rand(_TRIAL, 3, generator=generator).to(scene.device))
    best = math.inf
    with torch.no_grad():
        factors = scene.normal_tables()
        for _ in range(3):
            # Not the monotonic clock: that of Windows stands still for 16 ms, longer than a card takes.
            started = time.perf_counter()
            float(scene.surface(points, None, factors).normals.sum())
            best = min(best, time.perf_counter() - started)
    return best / _TRIAL


def seconds_to_fit(limit: float, left: float, finishing: float, fog: bool) -> float:
    """Seconds of a job's time limit that go to the fit.

    What follows it cannot be shortened at will, so a limit may be too short for both. Then it is not kept,
    rather than that nothing comes of it: there is a least share for the fit, the more where a fog must
    become an object first.

    Args:
        limit: seconds for all. left: of those. finishing: what follows is estimated to take.
        fog: the fit starts as one.
    """
    return max(left - finishing, (LEAST_FIT_FROM_FOG if fog else LEAST_FIT) * limit)


def seconds_from_fog(lookup: float) -> float:
    """Seconds until a fog may have become an object, where a lookup takes so many."""
    return LEAST_STEPS_FROM_FOG * _LOOKUPS_PER_FOG_STEP * lookup


def limit_of_fit(whole: float, left: float, finish: Finish, trainer: Trainer, progress: Progress) -> float:
    """Seconds for the fit, of those `left` of the `whole` limit; a step takes fewer rays where a fog would
    need more to become an object."""
    limit = seconds_to_fit(whole, left, finish.seconds, trainer.fog)
    longer = limit
    if trainer.fog:
        needed = seconds_from_fog(finish.lookup)
        trainer.batching.share = min(1.0, max(limit / needed, FEWEST_RAYS))
        longer = max(limit, trainer.batching.share * needed)
    if longer > left - finish.seconds:
        progress.warning(
            f"a time limit of {clock(whole)} is too short for a fit with mesh and textures; it will take "
            f"about {clock(whole - left + longer + finish.seconds)}"
        )
    return limit


def too_few_steps(done: int, planned: int, fog: bool) -> str | None:
    """What to tell of a fit that had time for few of its steps; None: it had enough.

    Args:
        fog: it started as one (see `Trainer`).
    """
    told = f"there was time for {done} of {planned} steps"
    anew = "start anew with a longer time limit"
    if fog and done < FEW_STEPS_FROM_FOG * planned:
        return f"{told}, too few for an object to form without masks; {anew}, or add masks"
    return f"{told}; for a better result, {anew}" if done < FEW_STEPS * planned else None
