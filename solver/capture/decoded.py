"""An image as it lies in its file."""

from dataclasses import dataclass

import numpy as np

from .icc import Profile


@dataclass(frozen=True, eq=False)
class Decoded:
    """An image as it lies in its file.

    Attributes:
        pixels: [H, W, C] unsigned integers of the file's depth, or float32.
        alpha: the channel of coverage, if there is one; the colour is in the channels before it.
        associated: colours are multiplied by alpha already.
        linear: whole numbers stand for linear light, says the file.
        orientation: EXIF's, 1 to 8; 1 is as it lies.
        profile: the ICC profile, if it is one that `icc` reads and not sRGB.
        matrix: [3, 3] from the file's primaries to Rec. 709; None if they are that.
        channels: what the file calls its channels, all of them.
        exposure: times its light, it is as the file has it for looking at.
    """

    pixels: np.ndarray
    alpha: int | None = None
    associated: bool = False
    linear: bool = False
    orientation: int = 1
    profile: Profile | None = None
    matrix: np.ndarray | None = None
    channels: tuple[str, ...] = ()
    exposure: float = 1.0

    @property
    def has_colours(self) -> bool:
        """The channels are colours or grey; those of an OpenEXR file may be anything."""
        return self.pixels.shape[2] > 1 or self.channels[:1] in ((), ("Y",), ("I",)) or not self.is_float

    @property
    def is_float(self) -> bool:
        """Values are not bound to [0, 1]."""
        return self.pixels.dtype.kind == "f"

    @property
    def largest(self) -> float:
        """The code of white."""
        return 1.0 if self.is_float else float(np.iinfo(self.pixels.dtype).max)
