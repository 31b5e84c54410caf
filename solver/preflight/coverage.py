"""Where the cameras stand around the object, and where none does."""

from dataclasses import dataclass

import numpy as np

from ..capture.camera import positions_of
from ..capture.capture import Capture
from ..capture.frames import unit
from .findings import Finding, note, warning

REACH = 30.0
"""degrees around a camera's direction in which it sees the surface well"""
FEWEST, GOOD = 20, 50
NARROW, SAME_HEIGHT, WIDE_GAP, HIGH = 25.0, 8.0, 75.0, 30.0
MOST_AWAY = 0.25
"""share of cameras that may see nothing of the region"""
_SAMPLES, _TICKS = 4000, 7


@dataclass(frozen=True)
class Coverage:
    """Directions from the region's centre to the cameras; up is the capture's, or +Z.

    Attributes:
        share: of the sphere that is within `REACH` of a camera.
        upper_share: of its upper half.
        widest: degrees between the two cameras furthest apart.
        heights: lowest and highest elevation, degrees.
        gap: widest range of azimuths without a camera, degrees.
        gap_at: its middle, degrees counter-clockwise from the first camera.
    """

    share: float
    upper_share: float
    widest: float
    heights: tuple[float, float]
    gap: float
    gap_at: float


def coverage_of(capture: Capture) -> Coverage:
    """How the cameras of a capture surround its region's centre."""
    up = np.array([0.0, 0.0, 1.0]) if capture.up is None else np.asarray(capture.up, np.float64)
    directions = unit(positions_of(capture.cameras) - capture.region.mean(0), 1e-12)
    frame = _frame(unit(up), directions[0])
    local = directions @ frame.T
    sphere = _sphere(_SAMPLES)
    near = (sphere @ local.T).max(axis=1) > np.cos(np.radians(REACH))
    elevation = np.degrees(np.arcsin(np.clip(local[:, 2], -1, 1)))
    # From right above, an azimuth says nothing.
    azimuth = np.sort(np.degrees(np.arctan2(local[:, 1], local[:, 0]))[elevation < 75] % 360)
    gap, gap_at = 360.0, 180.0
    if len(azimuth) > 1:
        steps = np.diff(np.append(azimuth, azimuth[0] + 360))
        widest = int(np.argmax(steps))
        gap, gap_at = float(steps[widest]), float((azimuth[widest] + steps[widest] / 2) % 360)
    apart = float(np.degrees(np.arccos(np.clip((local @ local.T).min(), -1, 1))))
    return Coverage(
        float(near.mean()), float(near[sphere[:, 2] >= 0].mean()), apart,
        (float(elevation.min()), float(elevation.max())), gap, gap_at,
    )  # fmt: skip


def coverage(capture: Capture) -> list[Finding]:
    """Findings about the number of photos and their places."""
    count = len(capture.cameras)
    found = []
    if count < FEWEST:
        found.append(warning(f"there are only {count} photos; take {GOOD} or more, all around the object"))
    away = looking_away(capture)
    if len(away) > MOST_AWAY * count:
        do = "does" if len(away) == 1 else "do"
        found.append(
            warning(f"{len(away)} of {count} cameras (the first: {away[0]}) {do} not see the region, but "
                    "only an object that all photos show is reconstructed, not the surroundings; if there "
                    "is one, move the region box to it")
        )  # fmt: skip
        return found
    seen = coverage_of(capture)
    first = capture.cameras[0].name
    if seen.widest < NARROW:
        found.append(
            warning(f"all cameras lie within {seen.widest:.0f}° of one another as seen from the object; "
                    "walk around it, since shape and reflections need views from several sides")
        )  # fmt: skip
        return found
    if seen.gap > WIDE_GAP:
        found.append(
            warning(f"no photo shows the object {side_of(seen.gap_at)} (with {first} as the front): a "
                    f"gap of {seen.gap:.0f}° around it; take photos there")
        )  # fmt: skip
    low, high = seen.heights
    if high - low < SAME_HEIGHT:
        found.append(
            warning(f"all photos are from one height ({(low + high) / 2:.0f}° above the object's middle); "
                    "walk a second round higher or lower")
        )  # fmt: skip
    elif high < HIGH:
        found.append(
            note(f"no photo is from above (the highest is at {high:.0f}°); the object's top will be "
                 "guessed, so add some from higher up")
        )  # fmt: skip
    found.append(
        note(f"{count} cameras see {seen.share:.0%} of all directions, {seen.upper_share:.0%} of those "
             "from above")
    )  # fmt: skip
    return found


def looking_away(capture: Capture) -> list[str]:
    """Names of the cameras that have no part of the region in their frame, or its middle behind them.

    Nothing is behind a panorama.
    """
    low, high = capture.region
    middle = (low + high) / 2
    ticks = low + (high - low) * np.linspace(0, 1, _TICKS)[:, None]
    points = np.stack(np.meshgrid(*ticks.T), axis=-1).reshape(-1, 3)
    return [
        camera.name
        for camera in capture.cameras
        if ((middle - camera.position) @ camera.view_direction < 0 and not camera.is_panoramic)
        or not camera.in_frame(points).any()
    ]


def side_of(degrees: float) -> str:
    """A side of the object in words, for an azimuth counter-clockwise from the camera that looks at it."""
    turned = (degrees + 180) % 360 - 180
    if abs(turned) <= 45:
        return "from the front"
    if abs(turned) >= 135:
        return "from behind"
    return "from the right" if turned > 0 else "from the left"


def _frame(up: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Rows [3, 3]: a level x towards `ahead`, y, and up."""
    level = ahead - (ahead @ up) * up
    if np.linalg.norm(level) < 1e-6:
        level = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    level = unit(level)
    return np.stack([level, np.cross(up, level), up])


def _sphere(count: int) -> np.ndarray:
    """Directions [count, 3] spread evenly over the sphere (Fibonacci)."""
    index = np.arange(count) + 0.5
    height, turn = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    around = np.sqrt(1 - height**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
