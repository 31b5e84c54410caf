"""Camera raw photos for tests: DNGs as a camera would write them of known colours."""

import numpy as np
import tifffile

WHITE, BLACK = 4095, 64
NEUTRAL = (0.5, 1.0, 0.7)
"""what the made-up sensor, whose primaries are Rec. 709's, says of white in the light of the photo"""
_REC709_FROM_XYZ = (3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570)
_MAKE, _MODEL, _ORIENTATION = 271, 272, 274
_PATTERN_SIZE, _PATTERN, _VERSION, _BLACK, _WHITE = 33421, 33422, 50706, 50714, 50717
_CROP_FROM, _CROP_SIZE, _MATRIX, _AS_SHOT, _BRIGHTER, _LIGHT, _ACTIVE = (
    50719, 50720, 50721, 50728, 50730, 50778, 50829,
)  # fmt: skip
_MOSAIC, _COLOURS = 32803, 34892


def patches(colours, side=32, across=4):
    """[H, W, 3] of even squares of linear colours, `across` in a row."""
    rows = np.asarray(colours, dtype=np.float64).reshape(-1, across, 3)
    return rows.repeat(side, axis=0).repeat(side, axis=1)


def sensor_codes(linear, neutral=NEUTRAL):
    """What the sensor measures of linear Rec. 709 [H, W, 3], each pixel all colours; saturated at WHITE."""
    codes = BLACK + linear * np.asarray(neutral) * (WHITE - BLACK)
    return np.clip(np.round(codes), 0, WHITE).astype(np.uint16)


def mosaic(codes):
    """One colour of each pixel: red and green in even rows, green and blue in odd ones."""
    raw = codes[..., 1].copy()
    raw[::2, ::2], raw[1::2, 1::2] = codes[::2, ::2, 0], codes[1::2, 1::2, 2]
    return raw


def write_dng(
    path, linear, *, neutral=NEUTRAL, orientation=1, crop=None, active=None, brighter=None,
    demosaiced=False, floating=False,
):  # fmt: skip
    """Write a DNG of linear Rec. 709 [H, W, 3].

    Args:
        crop: left, top, width and height of the picture. active: top, left, bottom, right within the border.
        brighter: BaselineExposure, stops.
        demosaiced: it holds colours, as phones write them, not a mosaic.
        floating: its codes are floating-point numbers, as merges have them.
    """

    def rationals(values):
        return [part for value in values for part in (round(value * 10_000), 10_000)]

    tags = [
        (_VERSION, "B", 4, bytes([1, 4, 0, 0])), (_MAKE, "s", 0, "Test"), (_MODEL, "s", 0, "Camera"),
        (_ORIENTATION, "H", 1, orientation), (_LIGHT, "H", 1, 21),
        (_MATRIX, "2i", 9, rationals(_REC709_FROM_XYZ)),
    ]  # fmt: skip
    if neutral is not None:
        tags.append((_AS_SHOT, "2I", 3, rationals(neutral)))
    if demosaiced:
        tags += [(_WHITE, "H", 3, (WHITE,) * 3), (_BLACK, "H", 3, (BLACK,) * 3)]
    else:
        tags += [(_WHITE, "H", 1, WHITE), (_BLACK, "H", 1, BLACK)]
        tags += [(_PATTERN_SIZE, "H", 2, (2, 2)), (_PATTERN, "B", 4, bytes([0, 1, 1, 2]))]
    if crop is not None:
        tags += [(_CROP_FROM, "I", 2, crop[:2]), (_CROP_SIZE, "I", 2, crop[2:])]
    if active is not None:
        tags.append((_ACTIVE, "I", 4, active))
    if brighter is not None:
        tags.append((_BRIGHTER, "2i", 1, rationals([brighter])))
    codes = sensor_codes(linear, neutral or NEUTRAL)
    if floating:
        codes = codes.astype(np.float16)
    tifffile.imwrite(
        path, codes if demosaiced else mosaic(codes), photometric=_COLOURS if demosaiced else _MOSAIC,
        planarconfig=1 if demosaiced else None, extratags=[(*tag, True) for tag in tags], metadata=None,
        software=None,
    )  # fmt: skip
    return path
