"""Pix4D's calibrated cameras: its projection, a file it wrote, worlds, undistorted photos, hostile files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import pix4d
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    numbers,
    outcome,
    poses,
    save_photos,
    spoilt,
)

TITLES = """fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X

"""
FX, FY, CX, CY = 80.0, 82.0, 50.5, 30.25
RADIAL, TANGENTIAL = (-0.11, 0.04, -0.003), (0.004, -0.007)
FILE = "1_initial/params/duck_calibrated_camera_parameters.txt"
PIX4D_WROTE = """DJI_0172.JPG 5472 3648
4470.89710276625464757672 0 2806.80399985351095892838
0 4470.89710276625464757672 1694.57401670066087717714
0 0 1
0.02006588392682263564 0.01562937180085547523 -0.02095437643714216994
-0.00288771142181162843 0.00196521828681344877
15.94074806386806208991 -29.02692220459498173568 15.15422636680995438496
0.99231434331971635210 0.12374166789348504947 -0.00049362829998193054
0.12374265000928082181 -0.99230722461113951560 0.00375879677799056998
-0.00002471114576337372 -0.00379099083038331869 -0.99999281386312122155
DJI_0173.JPG 5472 3648
4470.89710276625464757672 0 2806.80399985351095892838
0 4470.89710276625464757672 1694.57401670066087717714
0 0 1
0.02006588392682263564 0.01562937180085547523 -0.02095437643714216994
-0.00288771142181162843 0.00196521828681344877
15.51233103266257096209 -26.25582252695903306972 15.26135430290158190303
0.99085561608200850049 0.13490884455663543218 -0.00217984842220095808
0.13491163653021748248 -0.99085692115634493859 0.00118832878749453984
-0.00199960183253528176 -0.00147154917086782808 -0.99999691806302537511
DJI_0174.JPG 5472 3648
4470.89710276625464757672 0 2806.80399985351095892838
0 4470.89710276625464757672 1694.57401670066087717714
0 0 1
0.02006588392682263564 0.01562937180085547523 -0.02095437643714216994
-0.00288771142181162843 0.00196521828681344877
15.12695280806216224789 -24.34217955841750580248 15.21074870252876820587
0.99014075075387042446 0.14003874478232777867 -0.00323166464100315461
0.14003973834634547702 -0.99014588063583164335 0.00008212052337152316
-0.00318831937687193145 -0.00053387234741259892 -0.99999477478628251426
"""
"""of the project that EasyIDP (University of Tokyo, MIT licence) is tested with"""
ITS_PMATRICES = {
    "DJI_0172": [4436.465963, 542.595696, -2808.990791, -12402.620840, 553.198781, -4442.927610, -1677.756646,
                 -112357.812493, -0.000025, -0.003791, -0.999993, 15.044471],
    "DJI_0173": [4424.401013, 599.033212, -2816.541227, -9920.429844, 599.787572, -4432.512987, -1689.255898,
                 -99903.044922, -0.002000, -0.001472, -0.999997, 15.253689],
    "DJI_0174": [4417.868426, 624.600343, -2821.237774, -8711.614681, 620.700417, -4427.745035, -1694.198010,
                 -91400.250428, -0.003188, -0.000534, -0.999995, 15.245903],
}  # fmt: skip
"""the same project's `…_pmatrix.txt`: world to pixels of undistorted photos"""


def document(stems=None, extension=".png"):
    blocks = []
    for stem, pose in zip(names() if stems is None else stems, poses(), strict=False):
        lines = [
            f"{stem}{extension} {WIDTH} {HEIGHT}",
            numbers([FX, 0, CX]),
            numbers([0, FY, CY]),
            "0 0 1",
        ]
        lines += [numbers(RADIAL), numbers(TANGENTIAL), numbers(pose[:3, 3])]
        blocks += lines + [numbers(row) for row in pose[:3, :3].T]
    return TITLES + "\n".join(blocks) + "\n"


def write(folder, text=None, photos="photos", prj=None):
    file = folder / FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(document() if text is None else text)
    (file.parent / "duck_pmatrix.txt").write_text("a.png 1 0 0 0 0 1 0 0 0 0 1 0\n")
    if prj is not None:
        (file.parent / "duck_wkt.prj").write_text(prj)
    save_photos(folder / photos)
    return folder


def ideal(index, point):
    x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
    return x / z, y / z


def reference(index, point):
    """Pix4D's perspective lens, "How are the internal and external camera parameters defined?"."""
    x, y = ideal(index, point)
    (r1, r2, r3), (t1, t2), r = RADIAL, TANGENTIAL, np.hypot(x, y)
    scale = 1 + r1 * r**2 + r2 * r**4 + r3 * r**6
    u = scale * x + 2 * t1 * x * y + t2 * (r**2 + 2 * x**2)
    v = scale * y + 2 * t2 * x * y + t1 * (r**2 + 2 * y**2)
    return FX * u + CX, FY * v + CY


@pytest.mark.parametrize("given_as", ["", "duck", "duck/1_initial/params", f"duck/{FILE}"])
def test_points_project_as_pix4d_projects_them(tmp_path, given_as):
    write(tmp_path / "duck")
    capture = read_capture(tmp_path / given_as)
    assert capture.format == "Pix4D" and not capture.warnings and not capture.metric
    check_projection(capture, reference, poses())


@pytest.mark.parametrize("equation", ["camera model m = K [R|t] X\n", ""])
def test_another_projection_or_none_is_refused(tmp_path, equation):
    text = document().replace("camera model m = K [R|-Rt] X\n", equation)
    with pytest.raises(CaptureError, match=r"this is not Pix4D's projection, K \[R\|-Rt\] X; the file"):
        read_capture(write(tmp_path, text))


def test_a_file_that_pix4d_wrote_has_the_projections_it_wrote(tmp_path):
    stems = list(ITS_PMATRICES)
    save_photos(tmp_path / "undistorted_images", stems, (5472, 3648), ".tif")
    (tmp_path / "test_calibrated_camera_parameters.txt").write_text(TITLES + PIX4D_WROTE)
    for camera in read_capture(tmp_path).cameras:
        assert camera.lens == "pinhole"
        points = np.array([[x, y, 0.5] for x in (10.0, 15, 20) for y in (-32.0, -28, -24)])
        x, y, w = np.reshape(ITS_PMATRICES[camera.name], (3, 4)) @ np.column_stack([points, np.ones(9)]).T
        # They are written with six digits behind the point.
        np.testing.assert_allclose(camera.project(points)[0], np.stack([x, y], 1) / w[:, None], atol=0.01)


def test_undistorted_photos_have_no_distortion_and_others_are_preferred(tmp_path):
    folder = write(tmp_path, photos="1_initial/images/undistorted_images")
    check_projection(
        read_capture(folder), lambda i, x: (FX * ideal(i, x)[0] + CX, FY * ideal(i, x)[1] + CY), poses()
    )
    save_photos(folder / "photos", extension=".jpg")
    (folder / FILE).write_text(document(extension=".JPG"))
    check_projection(read_capture(folder), reference, poses())


@pytest.mark.parametrize(
    "prj, up",
    [
        ('PROJCS["WGS 84 / UTM zone 54N",GEOGCS["WGS 84"]]', [0, 0, 1]),
        ('LOCAL_CS["Arbitrary Coordinate System (m)"]', None), (None, None),
    ],
)  # fmt: skip
def test_only_a_map_says_what_is_up(tmp_path, prj, up):
    found = read_capture(write(tmp_path, prj=prj)).up
    assert (None if found is None else found.tolist()) == up


def test_line_ends_a_byte_order_mark_and_blanks_in_names(tmp_path):
    stems = [f"my photo {name}" for name in names()]
    save_photos(tmp_path / "photos", stems)
    folder = write(tmp_path, document(stems))
    content = b"\xef\xbb\xbf" + (folder / FILE).read_bytes().replace(b"\n", b"\r\n")
    (folder / FILE).write_bytes(content)
    capture = read_capture(folder)
    assert [camera.image_path.stem for camera in capture.cameras] == stems
    check_projection(capture, reference, poses())


@pytest.mark.parametrize(
    "old, new, problem",
    [
        ("radial distortion [3x1]", "fisheye polynomial [4x1]",
         r"fisheye polynomial \[4x1\]: this is not said of a perspective lens; export the project as OPF"),
        ("80.0 0.0 50.5", "80,0 0,0 50,5", "line 10: '80,0' is not a number"),
        (numbers(RADIAL), "0.1 0.2", "line 13: '0.1 0.2' is not 3 numbers"),
        (f"IMG_0000.png {WIDTH} {HEIGHT}", "IMG_0000.png", "line 9: 'IMG_0000.png' breaks off"),
        (f"IMG_0000.png {WIDTH} {HEIGHT}", f"IMG_0000.png {WIDTH} high", "'high' is not a number"),
        ("0 0 1", "0 0 0", "line 9, IMG_0000.png: this is not a lens's matrix"),
        ("80.0 0.0 50.5", "-80.0 0.0 50.5", "the lens has a value that no lens can have"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_named(tmp_path, old, new, problem):
    assert old in document()
    with pytest.raises(CaptureError, match=problem):
        read_capture(write(tmp_path, document().replace(old, new)))


def test_a_file_cut_off_is_named(tmp_path):
    text = "\n".join(document().splitlines()[:-3])
    with pytest.raises(CaptureError, match="line 49: 'IMG_0004.png 96 64' breaks off; the file seems"):
        read_capture(write(tmp_path, text))
    with pytest.raises(CaptureError, match="there are none in it"):
        read_capture(write(tmp_path, TITLES))


def test_only_calibrated_cameras_are_recognised(tmp_path):
    folder = write(tmp_path)
    assert reader_of(folder / FILE) is pix4d
    assert reader_of(folder / FILE.replace("calibrated_camera_parameters", "pmatrix")) is None


@RANDOM_TESTS
@given(data=st.data())
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data):
    folder = write(tmp_path)
    spoilt(data, folder / FILE, data.draw(st.sampled_from([" ", "\n"])))
    outcome(folder)


@RANDOM_TESTS
@given(data=st.data())
def test_lines_lost_or_twice_end_in_a_capture_or_an_error(tmp_path, data):
    lines = document().splitlines()
    place = data.draw(st.integers(0, len(lines) - 1))
    lines[place : place + 1] = [lines[place]] * data.draw(st.sampled_from([0, 2]))
    capture = outcome(write(tmp_path, "\n".join(lines)))
    assert capture is None or len(capture.cameras) == COUNT
