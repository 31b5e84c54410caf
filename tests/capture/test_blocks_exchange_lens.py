"""Lenses of BlocksExchange XML: Bentley's projections, units and camera axes."""

import math

import numpy as np
import pytest

from solver.capture.errors import CaptureError
from solver.capture.formats import blocks_exchange
from solver.capture.read import read_capture
from tests.capture.blocks import (
    BROWN,
    document,
    fisheye_reference,
    group,
    matrix,
    photo,
    reference,
    simple,
    tags,
    write,
)
from tests.capture.programs import HEIGHT, WIDTH, check_projection, poses, save_photos

AXES = {
    "XRightYDown": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "XLeftYDown": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "XLeftYUp": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "XRightYUp": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "XDownYRight": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "XDownYLeft": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "XUpYLeft": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    "XUpYRight": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}
"""from the axes so called to OpenCV's"""


@pytest.mark.parametrize(
    "values, inside, options, lens",
    [
        (dict.fromkeys(BROWN, 0.0), "", {}, "pinhole"),
        (BROWN, "<AspectRatio>1</AspectRatio><Skew>0</Skew>", {}, "opencv"),
        (BROWN, "<AspectRatio>0.95</AspectRatio>", dict(aspect=0.95), "opencv"),
        (BROWN, "<Skew>0.5</Skew>", dict(skew=0.5), "brown"),
    ],
)
def test_points_project_as_the_guide_says(tmp_path, values, inside, options, lens):
    text = simple(lens=f"<Distortion>{tags(values)}</Distortion>", inside=inside)
    capture = read_capture(write(tmp_path, text))
    assert capture.format == blocks_exchange.NAME and not capture.warnings
    assert {item.lens for item in capture.cameras} == {lens}
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(values, to_camera[i], x, **options), poses())


@pytest.mark.parametrize(
    "focal, f",
    [
        ("<FocalLength>30.0</FocalLength><SensorSize>36.0</SensorSize>", 80.0),
        ("<FocalLength>30.0</FocalLength><PixelSize>0.375</PixelSize>", 80.0),
        ("<FocalLength>5.0</FocalLength><FocalLengthPixels>75.5</FocalLengthPixels>", 75.5),
    ],
)
def test_focal_lengths_are_in_pixels_or_in_millimetres(tmp_path, focal, f):
    capture = read_capture(write(tmp_path, simple(focal=focal)))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(BROWN, to_camera[i], x, f=f), poses())


def test_the_specifications_own_numbers_agree(tmp_path):
    """Its photo of 9420 × 14430 pixels: lengths in mm and in pixels, angles and matrix."""
    save_photos(tmp_path, ["071_2810", "b", "c"], (942, 1443), ".jpg")
    size = ("<Width>96</Width><Height>64</Height>", "<Width>9420</Width><Height>14430</Height>")
    turn = (
        "<M_00>-0.9999982912233401</M_00><M_01>-0.001636319085375301</M_01><M_02>-0.0008602425863163225</M_02>"
        "<M_10>-0.001631068695467463</M_10><M_11>0.9999802528616577</M_11><M_12>-0.00606906089589293</M_12>"
        "<M_20>0.0008701565192966738</M_20><M_21>-0.006067647409696231</M_21><M_22>-0.9999812130648239</M_22>"
    )
    angles = (
        "<Omega>179.6523471469934</Omega><Phi>0.04985630236313049</Phi><Kappa>179.9065465708369</Kappa>"
    )
    place = np.eye(4)
    place[:3, 3] = 651999.7159189156, 6863073.633923346, 1318.897690166719
    found = []
    for focal, point, written in (
        ("<FocalLengthPixels>13991.05582</FocalLengthPixels>",
         "<x>4683.755692</x><y>7223.0141002</y>", turn),
        ("<FocalLength>100.735601903992</FocalLength><SensorSize>103.896</SensorSize>",
         "<xmm>-0.1853590176</xmm><ymm>0.06130152144</ymm>", angles),
        ("<FocalLength>100.735601903992</FocalLength><PixelSize>0.0072</PixelSize>",
         "<x>4683.755692</x><y>7223.0141002</y>", turn),
    ):  # fmt: skip
        photos = [
            photo(i, place, name, written) for i, name in enumerate(("071_2810.jpg", "b.jpg", "c.jpg"))
        ]
        text = document([group(photos, focal=focal, point=point, lens="")], ("Lambert 93", "EPSG:2154"))
        (tmp_path / "block.xml").write_text(text.replace(*size))
        found.append(read_capture(tmp_path).cameras[0])
    for item in found:
        assert item.fx == pytest.approx(1399.105582, rel=1e-8)
        assert (item.cx, item.cy) == pytest.approx((468.4255692, 722.35141002), abs=1e-5)
        np.testing.assert_allclose(item.camera_to_world, found[0].camera_to_world, atol=1e-9, rtol=1e-12)
        # The photos of an aerial survey look down.
        assert item.view_direction @ (0, 0, -1) > 0.99


@pytest.mark.parametrize("axes", AXES)
def test_cameras_axes_may_be_any(tmp_path, axes):
    to_opencv = np.array(AXES[axes])
    offset = to_opencv.T @ (1.5, -2.25, 0)  # mm, along those axes
    cameras = [photo(i, pose, turn=matrix(to_opencv.T @ pose[:3, :3].T)) for i, pose in enumerate(poses())]
    text = document(
        [
            group(
                cameras, axes=axes, focal="<FocalLength>40</FocalLength><PixelSize>0.5</PixelSize>",
                point=tags(dict(xmm=float(offset[0]), ymm=float(offset[1]))),
            )
        ]
    )  # fmt: skip
    capture = read_capture(write(tmp_path, text))
    centre = (WIDTH - 1) / 2 + 3, (HEIGHT - 1) / 2 - 4.5
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(BROWN, to_camera[i], x, centre=centre), poses())


@pytest.mark.parametrize(
    "p, focal, lens",
    [
        ((0, 1, 0, 0, 0), [[60.0, 0.0], [0.0, 58.0]], "opencv_fisheye"),
        ((0, 1, 0, -0.11, 0), [[60.0, 0.0], [0.0, 60.0]], "opencv_fisheye"),
        ((0, 0.9, 0, -0.11, 0), [[60.0, 0.5], [0.0, 58.0]], "brown"),
        ((0, 1, 0.1, -0.2, 0.03), [[60.0, 0.5], [-0.3, 58.0]], "fisheye_power"),
        ((0, 1.1, 0, -0.2, 0.03), [[60.0, 0.0], [0.0, 60.0]], "fisheye_power"),
        ((0, 1, 0, 0, 0), [[60.0, 0.0], [0.4, 60.0]], "fisheye_power"),
    ],
)
def test_points_project_as_the_guide_says_of_a_fisheye(tmp_path, p, focal, lens):
    values = dict(zip(("M_00", "M_01", "M_10", "M_11"), np.ravel(focal).tolist(), strict=True))
    numbers = tags(dict(zip(("P0", "P1", "P2", "P3", "P4"), p, strict=True)))
    text = simple(
        kind="Fisheye", focal="",
        lens=f"<FisheyeFocalMatrix>{tags(values)}</FisheyeFocalMatrix>"
        f"<FisheyeDistortion>{numbers}</FisheyeDistortion>",
    )  # fmt: skip
    capture = read_capture(write(tmp_path, text))
    assert {item.lens for item in capture.cameras} == {lens}
    to_camera = np.linalg.inv(poses())
    check_projection(
        capture, lambda i, x: fisheye_reference(p, focal, to_camera[i], x), poses(), spread=1.5
    )


def test_a_fisheyes_focal_length_is_that_on_its_axis(tmp_path):
    capture = read_capture(write(tmp_path, simple(kind="Fisheye", lens="")))
    focal = np.eye(2) * 80 * math.pi / 2
    to_camera = np.linalg.inv(poses())
    check_projection(
        capture, lambda i, x: fisheye_reference((0, 1), focal, to_camera[i], x), poses(), spread=1.0
    )


@pytest.mark.parametrize(
    "numbers",
    [
        "<P0>0.01</P0><P1>1</P1>",
        "<P0>0.01</P0><P1>1</P1><P2>0.483949</P2><P3>-0.724297</P3>",
        "<P1>0</P1><P3>1</P3>",
    ],
)
def test_a_fisheye_that_there_is_not_here_is_refused(tmp_path, numbers):
    text = simple(kind="Fisheye", lens=f"<FisheyeDistortion>{numbers}</FisheyeDistortion>")
    with pytest.raises(CaptureError, match="no lens here that is the same .*; export the undistorted"):
        read_capture(write(tmp_path, text))
