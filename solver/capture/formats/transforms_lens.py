"""Lenses of `transforms.json`: OpenCV's k1 k2 p1 p2 …, and other programs' under keys of this program.

nerfstudio also reads `distortion_params`, a list of OpenCV's numbers in an order of its own; for Project
Aria's cameras, FISHEYE624, that is k0 … k5, p0, p1, s0 … s3. Its fisheyes may have p1 and p2: the whole
polynomial acts on the equidistant picture (`_generate_rays_from_coords` in its cameras.py), where
EQUIRECTANGULAR has focal lengths of half a turn (width / 2, height). instant-ngp's `latlong` is that
panorama of all directions, too; its `equirectangular` is another, of equal areas (`common_device.cuh`).
"""

from typing import Any

import numpy as np

from ..brown_lens import polynomial_lens
from ..camera import Camera
from ..fields import Entry
from ..lens_solve import Lens
from ..panoramic_lens import EQUIRECTANGULAR, of_whole_sphere

_CUT = "cut the panoramas into perspective photos and solve or export their cameras"
_KINDS = {
    "ftheta_p0": ("f-theta lenses", "export the cameras with one of OpenCV's lenses"),
    "equirectangular": ("panoramas of equal areas (instant-ngp's equirectangular)", _CUT),
    "orthographic": ("orthographic lenses", "export the cameras with one of OpenCV's lenses"),
}
"""keys by which instant-ngp knows lenses of its own that are none here, with ways out"""
_WHOLE_SPHERE = "latlong"
"""its key for a panorama of all directions"""
_SAME = 1e-9
"""share of a focal length by which one in a file is that of all directions"""
_TOO_WIDE = 1 + 1e-3
"""times all directions that a panorama may be wide or high: what rounding leaves"""
_LENS_OF_MODEL = {
    "PINHOLE": "pinhole", "SIMPLE_PINHOLE": "pinhole", "OPENCV": "opencv", "RADIAL": "opencv",
    "SIMPLE_RADIAL": "opencv", "FULL_OPENCV": "opencv", "PERSPECTIVE": "opencv",
    "OPENCV_FISHEYE": "opencv_fisheye", "SIMPLE_RADIAL_FISHEYE": "opencv_fisheye",
    "RADIAL_FISHEYE": "opencv_fisheye", "FOV": "fov", "DIVISION": "division", "EUCM": "eucm",
    "VISUALSFM": "visualsfm", "THIN_PRISM_FISHEYE": "thin_prism_fisheye",
    "RAD_TAN_THIN_PRISM_FISHEYE": "rad_tan_thin_prism_fisheye",
    "FISHEYE624": "rad_tan_thin_prism_fisheye", "BROWN": "brown", "FISHEYE_POWER": "fisheye_power",
    "EQUIRECTANGULAR": EQUIRECTANGULAR,
}  # fmt: skip
_RATIONAL_KEYS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_LISTED_KEYS = ("k1", "k2", "k3", "k4", "p1", "p2")
"""what nerfstudio's `distortion_params` holds, in its order"""
_KEYS = {
    "pinhole": (),
    "opencv": _RATIONAL_KEYS[:5],
    "opencv_fisheye": ("k1", "k2", "k3", "k4"),
    "fov": ("omega",),
    "division": ("k",),
    "eucm": ("alpha", "beta"),
    "visualsfm": ("r",),
    "brown": (*_RATIONAL_KEYS[:6], "skew", "equidistant", "p3", "p4"),
    "fisheye_power": ("k2", "k3", "k4", "across", "down"),
    EQUIRECTANGULAR: (),
    "thin_prism_fisheye": ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"),
    "rad_tan_thin_prism_fisheye": ("k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
}


def read_lens(values: Entry) -> Lens:
    """A frame's lens and its numbers, as a `Camera` has them.

    Raises:
        CaptureError: a model that is not known, or what is no number.
    """
    for key, (kind, remedy) in _KINDS.items():
        if _is_set(values, key):
            raise values.error(key, f"{kind} are not read", remedy)
    model = values.get("camera_model") or None
    if _is_set(values, _WHOLE_SPHERE) or str(model).upper() == "EQUIRECTANGULAR":
        return EQUIRECTANGULAR, ()
    if values.get("is_fisheye") is True:
        model = "OPENCV_FISHEYE"
    lens = "opencv" if model is None else _LENS_OF_MODEL.get(str(model).upper())
    if lens is None:
        raise values.error(
            "camera_model", f"the lens model '{model}' is not supported",
            f"use one of {', '.join(_LENS_OF_MODEL)}",
        )  # fmt: skip
    keys = _KEYS[lens]
    listed = values.get("distortion_params")
    order = keys if lens == "rad_tan_thin_prism_fisheye" else _LISTED_KEYS
    if listed not in (None, []) and all(values.get(key) is None for key in order):
        given = values.numbers("distortion_params", len(order)).tolist()
        given = dict(zip(order, given, strict=True))
        values = Entry(values.path, values.where, {**values, **given})
    if str(model).upper() == "FULL_OPENCV":
        keys = _RATIONAL_KEYS  # elsewhere k4 is a power of the radius
    elif lens in ("pinhole", "opencv"):
        _refuse_rational(
            values, "only the lens FULL_OPENCV has this coefficient",
            "call its camera_model so if it is that, or export the cameras again",
        )  # fmt: skip
        # Programs that read these files go by the numbers, whatever the model is called.
        k1, k2, p1, p2, k3, k4 = _numbers(values, _RATIONAL_KEYS[:6])
        return polynomial_lens((k1, k2, k3, k4), (p1, p2))
    elif lens == "opencv_fisheye":
        return _fisheye(values)
    own = _numbers(values, keys)
    if lens == "brown" and not any(own[8:]):
        own = own[:8]
    return ("pinhole", ()) if lens == "opencv" and not any(own) else (lens, own)


def _numbers(values: Entry, keys: tuple[str, ...]) -> tuple[float, ...]:
    """Numbers, 0 where they are not stated."""
    return tuple(values.optional(key) or 0.0 for key in keys)


def _is_set(values: dict, key: str) -> bool:
    return values.get(key) is not None and values[key] is not False


def focal_lengths_of_panorama(values: Entry, width: int, height: int) -> tuple[float, float]:
    """fx and fy, pixels per radian, of a panorama of so many pixels: of all directions, if none are stated.

    Raises:
        CaptureError: its picture would show more than that.
    """
    whole = of_whole_sphere(width, height)[:2]
    if _is_set(values, _WHOLE_SPHERE):
        return whole
    focal_lengths = []
    for key, least in zip(("fl_x", "fl_y"), whole, strict=True):
        stated = values.optional(key)
        focal = least if stated is None else stated / np.pi
        if focal * _TOO_WIDE < least:
            raise values.error(
                key, "a panorama's picture cannot show more than all directions",
                "give half of the width as fl_x and the height as fl_y, or leave both out",
            )  # fmt: skip
        # What this program has written comes back to the last digit.
        focal_lengths.append(least if abs(focal - least) <= _SAME * least else focal)
    return focal_lengths[0], focal_lengths[1]


def _refuse_rational(values: Entry, problem: str, remedy: str) -> None:
    """Make sure that k5 and k6, of which only OpenCV's rational lens is made, are 0 or left out."""
    for key in _RATIONAL_KEYS[6:]:
        if values.optional(key):
            raise values.error(key, problem, remedy)


def _fisheye(values: Entry) -> Lens:
    """An equidistant lens with k1 … k4, and p1 and p2 if they are not 0."""
    _refuse_rational(
        values, "no fisheye has this coefficient, only k1 … k4, p1 and p2",
        "remove it, or export the cameras again",
    )  # fmt: skip
    k1, k2, k3, k4, p1, p2 = _numbers(values, _LISTED_KEYS)
    return polynomial_lens((k1, k2, k3, k4), (p1, p2), equidistant=True)


def lens_entries(camera: Camera) -> dict[str, Any]:
    """What a frame says of its camera's lens, before its focal lengths; read back by `read_lens`."""
    model = {lens: model for model, lens in reversed(_LENS_OF_MODEL.items())}[camera.lens]
    keys = _KEYS[camera.lens]
    if camera.lens == "opencv" and len(camera.distortion) > 5:
        model, keys = "FULL_OPENCV", _RATIONAL_KEYS
    if camera.lens == EQUIRECTANGULAR:
        return {"camera_model": model, "fl_x": np.pi * camera.fx, "fl_y": np.pi * camera.fy}
    return {"camera_model": model, **dict(zip(keys, camera.distortion, strict=False))}
