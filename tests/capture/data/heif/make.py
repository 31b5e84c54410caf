"""Makes the HEIC files beside it: `pip install pillow-heif==1.8.1 pillow numpy; python make.py`.

They are kept because the encoder (x265) is no dependency of the tests; AVIF and WebP are made by them.
"""

import io
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parent


def ramp() -> np.ndarray:
    """[48, 80, 3]: red grows to the right, green downward, blue is one corner. Tests know it."""
    pixels = np.zeros((48, 80, 3), np.uint8)
    pixels[..., 0] = np.linspace(0, 255, 80)[None]
    pixels[..., 1] = np.linspace(0, 255, 48)[:, None]
    pixels[:12, :20, 2] = 255
    return pixels


def save(name: str, mode: str, pixels: np.ndarray, **options) -> None:
    """Write one file, lossless but for the change to YCbCr."""
    import pillow_heif  # no package of the tests

    info = options.pop("info", {})
    file = pillow_heif.from_bytes(mode, pixels.shape[1::-1], np.ascontiguousarray(pixels).tobytes())
    file.info.update(info)
    out = io.BytesIO()
    file.save(out, quality=-1, chroma=444, **options)
    (HERE / name).write_bytes(out.getvalue())


def main() -> None:
    """Write them all."""
    colour = ramp()
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    save("plain.heic", "RGB", colour, exif=exif.tobytes())
    exif[0x0112] = 6
    save("turned.heic", "RGB", colour, info={"exif": exif.tobytes()})
    save("alpha.heic", "RGBA", np.dstack([colour, np.full((48, 80), 128, np.uint8)]))
    save("grey.heic", "L", colour[..., 0])
    save("ten_bits.heic", "RGB;16", colour.astype(np.uint16) * 257)
    save("p3.heic", "RGB", colour, color_primaries=12)
    save(
        "pq.heic",
        "RGB;16",
        colour.astype(np.uint16) * 257,
        color_primaries=9,
        transfer_characteristics=16,
    )


if __name__ == "__main__":
    main()
