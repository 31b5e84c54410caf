"""HEIC and AVIF photos as arrays: what phones write.

OpenImageIO's wheels have no decoder of either. Importing this module teaches Pillow to open HEIC.
"""

from pathlib import Path

import numpy as np
import pi_heif
from PIL import Image

from .colour import rec709_from_primaries
from .decoded import Decoded
from .errors import CaptureError
from .heif_header import read_heif_header
from .icc import profile_unless_srgb
from .orientation import oriented

HDR = {16: "PQ", 18: "HLG"}

pi_heif.register_heif_opener()


def decode_heif(path: Path) -> Decoded:
    """Decode a HEIC or AVIF photo as it is to be shown: turned as the file says, so its orientation is 1.

    HEIC of more than eight bits is scaled to 16.

    Raises:
        CaptureError: its light is coded for HDR screens (PQ, HLG). The decoders' own: it is damaged.
    """
    with path.open("rb") as file:
        header = read_heif_header(file)
    check_transfer(path, header.transfer)
    pixels, mode, profile = _of_avif(path, header.turn) if header.is_avif else _of_heic(path)
    if pixels.shape[1::-1] != (header.width, header.height):
        raise ValueError("its picture has another size than its header says")
    return Decoded(
        pixels, pixels.shape[2] - 1 if mode[-1] in "Aa" else None, associated=mode[-1] == "a",
        profile=profile_unless_srgb(profile) if profile else None,
        matrix=None if profile else rec709_from_primaries(header.primaries),  # a profile goes before
        channels=tuple(mode.upper()),
    )  # fmt: skip


def check_transfer(path: Path, transfer: int | None) -> None:
    """Make sure that a photo has light on a scale of its own.

    Args:
        transfer: the number of its transfer function in ITU-T H.273.

    Raises:
        CaptureError: its light is coded for HDR screens.
    """
    if transfer in HDR:
        raise CaptureError(
            path, "transfer", f"its light is coded for HDR screens ({HDR[transfer]})",
            "convert the photos to JPEG, or to linear OpenEXR",
        )  # fmt: skip


def _of_heic(path: Path) -> tuple[np.ndarray, str, bytes | None]:
    """Pixels [H, W, C], the letters of their channels, ICC profile."""
    picture = pi_heif.open_heif(path, convert_hdr_to_8bit=False, hdr_to_16bit=False)
    # A copy: a view would outlive the memory that it looks into.
    pixels, bits = np.array(picture), picture.info["bit_depth"]
    if bits > 8:
        scaled = pixels.astype(np.uint32) * 65535 + (1 << bits - 1)
        pixels = (scaled // ((1 << bits) - 1)).astype(np.uint16)
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    return pixels, picture.mode.split(";")[0], picture.info.get("icc_profile")


def _of_avif(path: Path, turn: int) -> tuple[np.ndarray, str, bytes | None]:
    """As `_of_heic`; Pillow leaves the turn to its caller, and has eight bits."""
    with Image.open(path) as picture:
        profile = picture.info.get("icc_profile")
        picture.load()
        pixels = np.asarray(picture)
    return oriented(pixels.reshape(*pixels.shape[:2], -1), turn), picture.mode, profile
