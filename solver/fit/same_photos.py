"""Photos of a job that goes on: whether they are those that it began with."""

from collections.abc import Sequence

from torch import Tensor

from ..capture.errors import listed
from ..job.request import JobError

COLOURS = "photos.mean_colours"
"""the checkpoint's tensor [P, 3] by which photos are known again; older jobs have none"""
SAME_COLOUR = 0.002
"""between two mean colours of a photo, sRGB-encoded: decoders differ by less, and another photo by more"""


def check_exposed(tensors: dict[str, Tensor], known: int, now: Tensor) -> None:
    """Make sure that photos are those whose exposures a fit knows.

    Args:
        tensors: the checkpoint's. known: exposures in it. now: mean colours [P, 3] of the photos.

    Raises:
        JobError: they are others, or not as many.
    """
    if known != len(now):
        raise JobError(
            f"The fit knows the exposures of {known} photos, but there are {len(now)} now; put back "
            "the missing ones, or start a new job."
        )
    off = _others(tensors, now)
    if off:
        raise JobError(
            f"The fit knows the exposures of other photos: {listed([str(i + 1) for i in off])} in the "
            "order of the cameras, counted from 1, changed since; put back those that were there, or start "
            "a new job."
        )


def what_changed(tensors: dict[str, Tensor], now: Tensor, names: Sequence[str]) -> str | None:
    """What to tell of photos that a job did not begin with, one clause; None: there are none such.

    Args:
        tensors: the checkpoint's. now: mean colours [P, 3] of the photos. names: theirs.
    """
    before = len(tensors.get(COLOURS, now))
    if before != len(now):
        return f"the job began with {before} photos and continues with {len(now)}, so its result mixes both"
    off = [names[i] for i in _others(tensors, now)]
    if not off:
        return None
    return (
        f"photos changed since the job began ({listed(off)}), so its result mixes old and new ones"
    )


def _others(tensors: dict[str, Tensor], now: Tensor) -> list[int]:
    """Numbers of the photos that are not those of the checkpoint, of as many."""
    before = tensors.get(COLOURS, now).to(now)
    return ((now - before).abs() > SAME_COLOUR).any(-1).nonzero()[:, 0].tolist()
