"""All checks of a capture, in seconds and without changing anything."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..capture.capture import Capture
from ..fit.cut_out_standing import support_below
from ..fit.devices import card_of, choose_device, idle_card
from ..fit.presets import settings_for
from ..fit.settings import Settings
from ..fit.turned_light import circles_of
from . import photos
from .bounds import nothing_in_common, object_box
from .coverage import coverage
from .estimate import Estimate, estimate
from .findings import Finding, note, warning
from .looks import look_at_photos
from .poses import poses
from .reduced_photos import ReducedPhotos
from .turning import turning
from .white_balance import white_balance

LOOKING = 0.7
"""of the time, for the progress: the rest is for comparing photos"""


@dataclass(frozen=True)
class Report:
    """What a check found; warnings first. `box` [2, 3] is where masks show the object, in the capture's
    world; None without them."""

    findings: tuple[Finding, ...]
    estimate: Estimate
    box: np.ndarray | None

    def as_json(self) -> dict:
        """{"findings": [{"level", "photo", "text"}], "estimate": {…}, "box": {"min", "max"} or null}."""
        box = None
        if self.box is not None:
            box = dict(zip(("min", "max"), self.box.tolist(), strict=True))
        return {
            "findings": [vars(finding) for finding in self.findings],
            "estimate": self.estimate.as_json(),
            "box": box,
        }


def check(
    capture: Capture, preset: str = "draft",
    progress: Callable[[float, str], None] = lambda done, text: None,
    region: np.ndarray | None = None, overrides: Mapping[str, object] | None = None,
    device: str = "auto",
) -> Report:  # fmt: skip
    """Check a capture before it is reconstructed.

    Args:
        progress: told the share done, and what is being done; what it raises ends the check.
        region: [2, 3] world box that a person gave; None: the capture's. `Report.box` may lie beside it.
        overrides: settings that a person chose, as `JobRequest.overrides`; what they answer is not advised.
        device: that it is to run on, as `choose_device` takes it.

    Raises:
        CaptureError: a photo cannot be decoded. SettingsError: there is no such preset, setting or device.
    """
    card = card_of(choose_device(device))
    idle = idle_card() if device == "auto" and card is None else None
    settings = settings_for(preset, overrides)
    asked = capture if region is None else replace(capture, region=region)
    reduced = ReducedPhotos()
    looks = look_at_photos(
        asked, lambda n, count: progress(LOOKING * n / count, f"photo {n} of {count}"), reduced
    )
    circles = circles_of(asked)
    asks = settings.light.turntable == "auto"
    still = circles is not None and circles.still is True
    turned = still if asks else settings.light.turntable == "yes"
    stands, masked = _stands(capture, settings, region), all(look.coverage is not None for look in looks)
    needed = estimate(asked, preset, masked, turned=turned, standing=stands, settings=settings, card=card)
    found = [note(text) for text in (*capture.warnings, idle) if text]
    found += (
        photos.blur(looks)
        + photos.exposure(looks, settings.fit.exposure == "fixed")
        + photos.duplicates(looks)
    )
    if settings.fit.exposure != "white_balance":
        found += white_balance(capture)
    found += (
        photos.masks(looks, stands)
        + photos.size(looks, asked, settings.photos.most_pixels)
        + coverage(asked)
        + (turning(circles) if asks else [])
    )
    # Where alpha has taken away what is around the object, only that is left to compare, maybe a mirror.
    if not turned and (not masked or all(camera.mask_path for camera in capture.cameras)):

        def compared(done: float) -> None:
            progress(LOOKING + (1 - LOOKING) * done, "comparing photos")

        found = poses(capture, reduced, settings, compared) + found
    margin = settings.field.box_margin
    box = object_box(asked, looks, margin)
    found += nothing_in_common(looks, box)
    if region is not None:
        box = object_box(capture, looks, margin)
    if needed.memory is not None and needed.bytes > 0.8 * needed.memory:
        found.append(
            warning(f"the fit will need about {needed.bytes / 1e9:.0f} of this machine's "
                    f"{needed.memory / 1e9:.0f} GB of memory; make the photos smaller")
        )  # fmt: skip
    found.sort(key=lambda finding: finding.level != "warning")
    return Report(tuple(found), needed, box)


def _stands(capture: Capture, settings: Settings, region: np.ndarray | None) -> bool:
    """True if a fit looks for something that stands on a support, and there is one."""
    fit = settings.fit
    looks_for = fit.use_masks and fit.cut_out and fit.cut_out_standing
    return looks_for and support_below(capture, region) is not None
