"""What a job is asked to do: `job.json`, and its checks."""

import dataclasses
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SCHEMA_VERSION = 1
MOST_SEED = (1 << 63) - 1
DEVICES = ("auto", "cpu", "cuda", "mps")
"""that a job may ask for"""
DECODER = "fit.decoder"
"""the setting that is a path, of another job; it holds from wherever the job is run later"""
EVEN = 1e-3
"""how far the axes of a similarity may be from square and even, as a share of their length"""


class JobError(ValueError):
    """A job folder that cannot be used; one sentence with the way out."""


@dataclass
class JobRequest:
    """What was asked of the solver (`job.json`).

    Attributes:
        capture: absolute path of the capture's folder or camera file.
        photos, masks: absolute paths of their folders, if they are not below the capture's.
        ignored: absolute path of a folder of pictures that are white where photos are to be ignored, or of
            one for all photos; None: what the camera file names, and what lies beside the photos.
        region: world box {"min": [3], "max": [3]} that holds the object, or None to find it.
        placement: similarity [4][4] from the capture's world to the one that asset.glb is to stand in,
            or None to find out which way is up.
        overrides: settings by `section.field`.
        time_limit: seconds of wall time, asset included, or None.
    """

    capture: str
    preset: str = "draft"
    device: str = "auto"
    seed: int = 0
    time_limit: float | None = None
    photos: str | None = None
    masks: str | None = None
    ignored: str | None = None
    region: dict[str, list[float]] | None = None
    placement: list[list[float]] | None = None
    overrides: dict[str, Any] = field(default_factory=dict)
    code_version: str = ""
    schema_version: int = SCHEMA_VERSION

    @classmethod
    def from_json(cls, content: Any, file: Path) -> "JobRequest":
        """Parse `job.json`'s content.

        Raises:
            JobError: fields missing or of a newer schema.
        """
        if not isinstance(content, dict) or "capture" not in content:
            raise JobError(f"{file}: this is not a job request (no 'capture'); start a new job.")
        version = content.get("schema_version", 1)
        if not isinstance(version, int) or version > SCHEMA_VERSION:
            raise JobError(f"{file}: the job was made by a newer version; update the solver.")
        known = {f.name for f in dataclasses.fields(cls)}
        request = cls(**{key: value for key, value in content.items() if key in known})
        wrong = request._wrong_field()
        if wrong:
            raise JobError(f"{file}: '{wrong}' has a wrong value; start a new job.")
        return request

    def check(self) -> None:
        """Make sure that a new request can be followed.

        Raises:
            JobError: it has a value of a wrong type, or one that cannot be.
        """
        wrong = self._wrong_field()
        if wrong:
            raise JobError(f"{wrong}: {getattr(self, wrong)!r} is a wrong value; change it.")

    def _wrong_field(self) -> str | None:
        """Name of the first field of a wrong type or value; None if all are good."""
        limit = self.time_limit
        good = {
            "capture": isinstance(self.capture, str) and self.capture != "",
            **{name: isinstance(getattr(self, name), str) for name in ("preset", "device", "code_version")},
            "seed": type(self.seed) is int and 0 <= self.seed <= MOST_SEED,
            "time_limit": limit is None or (_is_number(limit) and limit > 0),
            **{
                name: isinstance(getattr(self, name), str | None) for name in ("photos", "masks", "ignored")
            },
            "region": self.region is None or _is_box(self.region),
            "placement": self.placement is None or is_similarity(self.placement),
            "overrides": isinstance(self.overrides, dict),
        }
        return next((name for name, fine in good.items() if not fine), None)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(values: Any, count: int) -> bool:
    return isinstance(values, list) and len(values) == count and all(map(_is_number, values))


def _is_box(region: Any) -> bool:
    """{"min": [3], "max": [3]} with a volume."""
    if not isinstance(region, dict):
        return False
    low, high = region.get("min"), region.get("max")
    if not (_are_numbers(low, 3) and _are_numbers(high, 3)):
        return False
    return all(a < b for a, b in zip(low, high, strict=True))


def is_similarity(matrix: Any) -> bool:
    """True for rows [4][4] of a motion that turns, moves and scales evenly, and does not mirror."""
    if not (isinstance(matrix, list) and len(matrix) == 4 and all(_are_numbers(row, 4) for row in matrix)):
        return False
    x, y, z = (row[:3] for row in matrix[:3])
    size = math.hypot(*x)
    # A rotation's third row is the cross product of the others.
    across = [x[i - 2] * y[i - 1] - x[i - 1] * y[i - 2] for i in range(3)]
    return (
        matrix[3] == [0, 0, 0, 1]
        and size > 0
        and abs(sum(a * b for a, b in zip(x, y, strict=True))) < EVEN * size**2
        and abs(math.hypot(*y) - size) < EVEN * size
        and math.dist(across, [size * value for value in z]) < EVEN * size**2
    )


def overrides_of(texts: Iterable[str]) -> dict[str, str]:
    """What was written after `--set`, as `JobRequest.overrides`.

    Raises:
        JobError: one is no "section.field=value".
    """
    overrides = {}
    for text in texts:
        key, separator, value = text.partition("=")
        if not separator:
            raise JobError(f"--set {text}: write it as section.field=value.")
        overrides[key] = os.path.abspath(value) if key == DECODER and value else value
    return overrides
