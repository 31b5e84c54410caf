"""Pictures of the current state: a photo beside its render and normals, and the environment."""

import dataclasses
from pathlib import Path

import numpy as np
from PIL import Image

from ..asset.files import picture_of, write_png
from ..capture.photos import linear_to_srgb
from ..render.image import RenderedView, render_view
from ..render.scene import StepTables
from .chunk import SURROUNDED
from .schedule import picture_settings
from .trainer import Trainer

PREVIEW_PIXELS = 40_000


def display(view: RenderedView, background: str = "white") -> np.ndarray:
    """sRGB pixels [H, W, 3] in [0, 1] of a view as photos before that background show it.

    Args:
        background: with one of `SURROUNDED`, room and light are in the picture; else it is over black
            for 'black', and over white.
    """
    if background in SURROUNDED:
        return np.clip(linear_to_srgb(view.surrounded), 0, 1)
    return over_plain(view.premultiplied, background)


def over_plain(premultiplied: np.ndarray, background: str = "white") -> np.ndarray:
    """sRGB pixels [H, W, 3] in [0, 1] of linear premultiplied RGBA [H, W, 4] over black, if that is the
    background, else over white."""
    alpha = np.clip(premultiplied[..., 3:], 0, 1)
    straight = premultiplied[..., :3] / np.maximum(alpha, 1e-4)
    behind = 0.0 if background == "black" else 1.0
    return np.clip(linear_to_srgb(straight), 0, 1) * alpha + behind * (1 - alpha)


def tone_mapped(radiance: np.ndarray) -> np.ndarray:
    """An HDR map [H, W, 3] as a displayable picture (Reinhard, then sRGB)."""
    return np.clip(linear_to_srgb(1.4 * radiance / (1 + radiance)), 0, 1)


def write_previews(trainer: Trainer, folder: Path) -> None:
    """Write `render.png` (photo | render | normals) and `environment.png`."""
    scene, bank = trainer.scene, trainer.bank
    camera, photo = bank.preview_camera, bank.preview_photo
    fraction = trainer.fraction
    settings = picture_settings(
        trainer.settings, rays=16, fraction=fraction, emission=trainer.emission(fraction)
    )
    settings = dataclasses.replace(settings, pixel_grid=1)
    tables = StepTables.seen_by(camera, scene)
    view = render_view(scene, tables, settings, camera.no_larger(PREVIEW_PIXELS))
    picture = picture_of(over_plain(photo, trainer.background))
    size = (view.opacity.shape[1], view.opacity.shape[0])
    reference = np.asarray(picture.resize(size, Image.Resampling.BOX)).astype(np.float32) / 255
    normals = view.normal * 0.5 + 0.5
    normals = normals * view.opacity[..., None] + (1 - view.opacity[..., None])
    write_png(
        folder / "render.png",
        np.concatenate([reference, display(view, trainer.background), normals], axis=1),
    )
    write_png(folder / "environment.png", tone_mapped(scene.environment.image()))
