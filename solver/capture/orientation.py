"""Which way up a photo lies: what its EXIF orientation says, and whether its camera followed it."""

import numpy as np

UPWARD = {3: (0, -1), 4: (0, -1), 5: (-1, 0), 6: (-1, 0), 7: (1, 0), 8: (1, 0)}
"""where up is, right and up in the pixels as they lie, by EXIF orientation, where that is not up"""


def oriented(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels [H, W, …] turned upright, a view: what an EXIF orientation from 1 to 8 asks for."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels


def turn_for(size: tuple[int, int], orientation: int, width: int, height: int) -> int | None:
    """The orientation by which pixels of `size` (width, height) become a camera's; None if none does.

    1, as they lie, wherever that is the camera's size; else what the tag says, if that turns them to it.
    The one place that decides on EXIF orientation. Programs that solve cameras differ: most ignore
    the tag, some turn the photo first. The size they write down tells them apart, and where it does
    not (squares, half turns) the tag is ignored, as it is for Blender's background images.
    """
    if size == (width, height):
        return 1
    return orientation if orientation >= 5 and size == (height, width) else None


def lies_on_its_side(size: tuple[int, int], width: int, height: int) -> bool:
    """Whether pixels of `size` (width, height) would have to be turned by a quarter to be a camera's, which
    may be of another size; squares do not tell, and are as they lie (see `turn_for`)."""
    return size[0] != size[1] and (size[0] > size[1]) != (width > height)


def same_shape(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether a picture of `size` may be one of the size `other` made smaller or larger, with sides rounded
    to whole pixels."""
    rounding = 1 / other[0] + 1 / other[1]
    return abs(size[0] / other[0] - size[1] / other[1]) <= rounding


def as_camera_saw(pixels: np.ndarray, orientation: int, width: int, height: int) -> np.ndarray | None:
    """Pixels [H, W, …] of a camera's size, as they lie in the file or else upright; None if neither."""
    turn = turn_for(pixels.shape[1::-1], orientation, width, height)
    return None if turn is None else oriented(pixels, turn)
