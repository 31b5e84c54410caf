"""Photos of every kind on disk, for tests."""

import numpy as np
import OpenEXR
import OpenImageIO

from solver.capture import frames
from solver.capture.camera import Camera
from solver.capture.errors import CaptureError
from solver.capture.image_header import image_orientation, image_size, may_have_alpha
from solver.capture.photo_settings import PhotoSettings
from solver.capture.photos import (
    load_photo,
)

UPRIGHT = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20  # 4 wide, 3 high


def camera_for(path, width, height, mask=None):
    return Camera(
        name="c", image_path=path, camera_to_world=frames.invert_pose(np.eye(4)), width=width,
        height=height, fx=50.0, fy=50.0, cx=width / 2, cy=height / 2, mask_path=mask,
    )  # fmt: skip


def check_photo_or_error(path):
    """A file, whatever was done to it, is a photo, or an error of one line that names it."""
    assert 1 <= image_orientation(path) <= 8 and may_have_alpha(path) in (True, False)
    try:
        width, height = image_size(path)
        if width * height < 1 << 16:
            assert load_photo(camera_for(path, width, height)).pixels.shape == (height, width, 4)
    except CaptureError as error:
        assert path.name in str(error) and "\n" not in str(error)


def write(path, pixels, **attributes):
    """Write [H, W, C] with OpenImageIO in the array's own type."""
    kind = {"float32": "float", "float16": "half"}.get(pixels.dtype.name, pixels.dtype.name)
    spec = OpenImageIO.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    file = OpenImageIO.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(pixels), file.geterror()
    file.close()
    return path


def write_hdr(path, stated="", order="-Y 6 +X 10"):
    """A Radiance file of one colour, with more lines and the order of its pixels as its header states them."""
    head = f"#?RADIANCE\n{stated}FORMAT=32-bit_rle_rgbe\n\n{order}\n"
    path.write_bytes(head.encode() + bytes([200, 100, 50, 129]) * 60)
    return path


def load(path, mask=None, **changes):
    return load_photo(camera_for(path, *image_size(path), mask), PhotoSettings(**changes))


def ramp(dtype, channels=3, size=(6, 10)):
    top = 1 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    values = np.random.default_rng(0).uniform(0, top, (*size, channels))
    return (values if top == 1 else np.round(values)).astype(dtype)


def write_exr(path, pixels, **header):
    OpenEXR.File(header, {"RGBA" if pixels.shape[2] == 4 else "RGB": pixels}).write(str(path))
    return path
