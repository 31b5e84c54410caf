"""Pictures of the fit on its way: render, weights along a scan line, light (paper's snapshots figure)."""

from pathlib import Path

import numpy as np
from PIL import Image

from ..asset.files import write_png
from ..render.image import render_view
from ..render.scan_line import scan_line_weights
from ..render.scene import StepTables
from .preview import display, tone_mapped
from .schedule import picture_settings
from .trainer import Trainer

PARTS = ("render", "weights", "environment")
FIGURE = "snapshots.png"
GAP = 4  # pixels between the pictures of the figure


def write_snapshot(trainer: Trainer, folder: Path, fraction: float) -> None:
    """Write `render_000123.png`, `weights_…` and `environment_…` of step 123.

    The render is of the first photo's camera, the weights are those along its middle row (dotted in
    the render).
    """
    scene, camera = trainer.scene, trainer.bank.preview_camera
    settings = picture_settings(trainer.settings, 32, fraction, emission=trainer.emission(fraction))
    view = render_view(scene, StepTables.seen_by(camera, scene), settings, camera)
    picture = display(view, trainer.background)
    row = camera.height // 2
    picture[row, ::4] = (1.0, 0.3, 0.0)
    step = f"{trainer.step:06d}.png"
    write_png(folder / f"render_{step}", picture)
    weights = scan_line_weights(scene, settings, camera, row, camera.height)
    write_png(folder / f"weights_{step}", np.repeat(1 - weights[..., None] ** 0.5, 3, axis=-1))
    write_png(folder / f"environment_{step}", tone_mapped(scene.environment.image()))


def write_figure(folder: Path) -> Path | None:
    """Lay all snapshots of a folder side by side in `snapshots.png`; None if there are none."""
    steps = sorted(path.stem.split("_")[1] for path in folder.glob("render_*.png"))
    if not steps:
        return None
    columns = []
    for step in steps:
        pictures = [Image.open(folder / f"{part}_{step}.png").convert("RGB") for part in PARTS]
        width = pictures[0].width
        scaled = [p.resize((width, max(1, round(p.height * width / p.width)))) for p in pictures]
        gap = np.full((GAP, width, 3), 255, np.uint8)
        columns.append(np.concatenate([x for p in scaled for x in (np.asarray(p), gap)], axis=0))
    gap = np.full((columns[0].shape[0], GAP, 3), 255, np.uint8)
    figure = np.concatenate([x for column in columns for x in (column, gap)], axis=1)
    write_png(folder / FIGURE, figure.astype(np.float32) / 255)
    return folder / FIGURE
