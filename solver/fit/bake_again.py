"""A finished job's asset once more, with another mesh or other textures."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import __version__
from ..asset.export import new_folder
from ..asset.from_scene import asset_of, has_finer_photos
from ..capture.placement import counted_from
from ..job.folder import MANIFEST, JobFolder
from ..job.inputs import capture_of, placement_of
from ..replacing import write_json_atomic
from .checkpoint import read_tensor
from .errors import SettingsError
from .exposure import photo_views
from .load import held_out_photos, load_job, log_gain_of_job
from .same_photos import POSES, check_poses
from .settings import overridden


def bake_again(
    job: JobFolder, out: Path, overrides: dict[str, str], progress: Callable[[float, str], None]
) -> Path:
    """Bake the asset of a job's checkpoint into a new folder `out`; returns it. The job is left as it is.

    The report is not part of it: its pictures are of the field, and its numbers of the job's own mesh.

    Args:
        overrides: settings by `asset.field`; the others are the job's.

    Raises:
        JobError: no complete result or no checkpoint, the capture's cameras are others, or `out` exists and
            is not empty. SettingsError: other settings than the asset's, or ones that cannot be.
            CaptureError: the cameras or photos are gone. EmptySurfaceError: there is no surface. OSError:
            `out` cannot be written.
    """
    manifest = job.manifest()
    scene, settings = load_job(job)
    for key, value in overrides.items():
        if not key.startswith("asset."):
            raise SettingsError(
                f"Setting '{key}': only the asset's can be changed after a fit; start a new job."
            )
        settings = overridden(settings, key, value)
    capture = capture_of(job)
    fitted = (c.no_larger(settings.photos.most_pixels) for c in capture.cameras)
    cameras = [camera.seen_from(scene.origin) for camera in fitted]
    check_poses(read_tensor(job.checkpoint_dir, POSES), cameras)
    placement = manifest.get("placement")
    if placement is None:  # a result from before there was one
        placement = counted_from(placement_of(job.request, capture), scene.origin)
    views = []
    if has_finer_photos(scene, cameras, settings.asset):
        views = photo_views(cameras, held_out_photos(job, capture, settings), log_gain_of_job(job))
    with new_folder(out) as part:
        parts = asset_of(
            scene, settings.render, cameras, part, settings.asset, progress, job.root.name,
            np.asarray(placement, dtype=np.float64), views,
        )  # fmt: skip
        del parts["triangles"]
        manifest.pop("report", None)
        write_json_atomic(part / MANIFEST, {**manifest, **parts, "code_version": __version__})
    progress(1.0, "done")
    return out
