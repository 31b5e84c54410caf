"""Photos and cameras of a job that goes on: whether they are those that it began with."""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from ..capture.camera import Camera
from ..capture.errors import listed
from ..job.request import JobError

COLOURS = "photos.mean_colours"
"""the checkpoint's tensor [P, 3] by which photos are known again"""
POSES = "photos.poses"
"""and that [P, 3, 4] of how they were taken, camera to world, as the field counts"""
SAME_PLACE = 1e-4
"""between two poses: of a rotation's numbers, and of places as a share of the farthest"""
SAME_COLOUR = 0.002
"""between two mean colours of a photo, sRGB-encoded: decoders differ by less, and another photo by more"""


def check_exposed(tensors: dict[str, Tensor], now: Tensor) -> None:
    """Make sure that photos are those whose exposures a fit knows.

    Args:
        tensors: the checkpoint's. now: mean colours [P, 3] of the photos.

    Raises:
        JobError: they are others, or not as many.
    """
    known = len(tensors[COLOURS])
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


def check_poses(before: Tensor, cameras: Sequence[Camera]) -> None:
    """Make sure that photos are taken to be from where they were when the job began.

    Args:
        before: the checkpoint's `POSES`.
        cameras: of the photos, as the field counts.

    Raises:
        JobError: they are not; as many as before.
    """
    if len(before) != len(cameras):
        return
    poses = before.cpu().double().numpy()
    units = np.array([1, 1, 1, max(np.abs(poses[..., 3]).max(), 1e-30)])
    now = np.stack([camera.camera_to_world[:3] for camera in cameras])
    off = (np.abs(now - poses) > SAME_PLACE * units).any((1, 2))
    names = [camera.name for camera, is_off in zip(cameras, off, strict=True) if is_off]
    if names:
        raise JobError(
            f"Cameras stand elsewhere than when the job began ({listed(names)}); put back the camera file "
            "that was there, or start a new job."
        )


def what_changed(tensors: dict[str, Tensor], now: Tensor, names: Sequence[str]) -> str | None:
    """What to tell of photos that a job did not begin with, one clause; None: there are none such.

    Args:
        tensors, now: as in `check_exposed`. names: of the photos.
    """
    before = len(tensors[COLOURS])
    if before != len(now):
        return f"the job began with {before} photos and continues with {len(now)}, so its result mixes both"
    off = [names[i] for i in _others(tensors, now)]
    if not off:
        return None
    return f"photos changed since the job began ({listed(off)}), so its result mixes old and new ones"


def _others(tensors: dict[str, Tensor], now: Tensor) -> list[int]:
    """Numbers of the photos that are not those of the checkpoint, of as many."""
    before = tensors[COLOURS].to(now)
    return ((now - before).abs() > SAME_COLOUR).any(-1).nonzero()[:, 0].tolist()
