"""What a job keeps of cutting photos out before a support: standing.npz, by which other photos are, and
masks/NAME.png of its own."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..asset.files import write_png
from ..capture.camera import Camera
from ..job.request import JobError
from ..replacing import written_beside
from .colour_counts import ColourCounts
from .ground import Ground, GroundColours
from .places import Places
from .standing import Odds, Outline, Standing
from .support import Support

DAMAGED = zipfile.BadZipFile, zlib.error
DARK, LIGHT = 0.25, 0.75
"""of a mask where a photo is not sure to show the object, or that it does not"""


def write_standing(path: Path, standing: Standing) -> None:
    ground, colours, places, surface = (
        standing.ground, standing.ground_colours, standing.places, standing.surface
    )  # fmt: skip
    with written_beside(path) as part:
        np.savez_compressed(
            part, normal=ground.support.normal, height=ground.support.height, origin=ground.origin,
            axes=[ground.first, ground.second], edge=ground.edge, cells=ground.cells,
            colour=colours.colour.astype(np.float16), spread=colours.spread.astype(np.float16),
            places=places.centres, places_edge=places.edge, likely=standing.likely.astype(np.float16),
            surface=surface.centres, surface_edge=surface.edge,
            **{name: counts.share.astype(np.float32) for name, counts in standing.odds._asdict().items()},
        )  # fmt: skip


def read_standing(path: Path) -> Standing | None:
    """What `write_standing` wrote; None if there is no such file.

    Raises:
        JobError: it cannot be read.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            read = {name: file[name] for name in file.files}
        support = Support(read["normal"], float(read["height"]))
        ground = Ground(support, read["origin"], *read["axes"], float(read["edge"]), int(read["cells"]))
        colours = (read[name].astype(np.float32) for name in ("colour", "spread"))
        counts = (ColourCounts(read[name].astype(np.float64)) for name in Odds._fields)
        return Standing(
            ground, GroundColours(*colours), Odds(*counts),
            Places(read["places"], float(read["places_edge"])), read["likely"].astype(np.float32),
            Places(read["surface"], float(read["surface_edge"])),
        )  # fmt: skip
    except (OSError, EOFError, ValueError, KeyError, TypeError, *DAMAGED) as error:
        raise JobError(f"{path}: it cannot be read ({error}); start a new job.") from error


def write_masks(folder: Path, cameras: Sequence[Camera], outlines: Sequence[Outline]) -> None:
    """Write masks under their photos' names, dark or light grey where they are not sure: a person can look
    at them, mend one, and give the folder to another job."""
    for camera, outline in zip(cameras, outlines, strict=True):
        grey = np.where(outline.shown, LIGHT, DARK)
        sure = outline.shown.astype(np.float32)
        write_png(folder / f"{camera.name}.png", np.where(outline.unsure, grey, sure)[..., None])


def read_masks(
    folder: Path, cameras: Sequence[Camera], shapes: Sequence[tuple[int, int]]
) -> list[Outline] | None:
    """What `write_masks` wrote; None unless all are there in their photos' shapes."""
    outlines = []
    for camera, shape in zip(cameras, shapes, strict=True):
        try:
            with Image.open(folder / f"{camera.name}.png") as picture:
                values = np.asarray(picture.convert("L"))
        except OSError:
            return None
        if values.shape != shape:
            return None
        outlines.append(Outline(values > 127, (values > 0) & (values < 255)))
    return outlines
