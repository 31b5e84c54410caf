"""Settings of how photos are read; apart from `photos`, so that Blender can import them."""

from dataclasses import dataclass

COLOUR_SPACES = ("auto", "srgb", "linear")


@dataclass(frozen=True)
class PhotoSettings:
    """How photos are read."""

    colour_space: str = "auto"
    """of the photos: 'srgb', 'linear' (Rec. 709), or 'auto': what a file states, else sRGB for whole
    numbers (PNG, JPEG, TIFF) and linear for floating point (OpenEXR, HDR, TIFF)"""

    most_pixels: int = 640_000
    """of a photo in a fit; larger ones are made smaller, for they take memory and no grid holds so much
    detail (0: they stay as they are)"""
