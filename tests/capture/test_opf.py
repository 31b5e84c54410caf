"""OPF projects as its specification has them: Pix4D's projection, identities, photos, worlds, hostile files."""

import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import opf
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    outcome,
    places,
    poses,
    put,
    save_photos,
)

FOCAL, CENTRE = 80.0, (50.5, 30.25)
RADIAL, TANGENTIAL = (-0.11, 0.04, -0.003), (0.004, -0.007)
FIRST_ID = (1 << 64) - 1000
SENSOR = 18493134
UTM = 'PROJCRS["WGS 84 / UTM zone 16N",BASEGEOGCRS["WGS 84"]]'
SITE = 'ENGCRS["Arbitrary Coordinate System (m)",EDATUM["Unknown"],CS[Cartesian,3]]'
CALIBRATED = "calibration/calibrated_cameras.json"


def lens(**changes):
    return {
        "type": "perspective", "principal_point_px": list(CENTRE), "focal_length_px": FOCAL,
        "radial_distortion": list(RADIAL), "tangential_distortion": list(TANGENTIAL), **changes,
    }  # fmt: skip


def project(uris=None, crs=UTM):
    """The project's files by their paths."""
    uris = [f"images/{name}.png" for name in names()] if uris is None else uris
    ids = [FIRST_ID + index for index in range(len(uris))]
    flip = np.diag([1.0, -1, -1])
    cameras = [
        {
            "id": identity, "sensor_id": SENSOR, "position": pose[:3, 3].tolist(),
            "orientation_deg": Rotation.from_matrix(pose[:3, :3] @ flip).as_euler("XYZ", True).tolist(),
        }
        for identity, pose in zip(ids, poses(), strict=False)
    ]  # fmt: skip
    contents = {
        "camera_list": ("camera-list.json", {
            "cameras": [{"id": i, "uri": uri} for i, uri in zip(ids, uris, strict=True)]}),
        "input_cameras": ("input-cameras.json", {
            "sensors": [{"id": SENSOR, "name": "phone", "image_size_px": [WIDTH, HEIGHT],
                         "internals": lens(focal_length_px=77.0)}],
            "captures": [{"id": i, "reference_camera_id": i, "cameras": [{"id": i, "sensor_id": SENSOR}]}
                         for i in ids]}),
        "scene_reference_frame": ("scene_reference_frame.json", {
            "crs": {"definition": crs},
            "base_to_canonical": {"shift": [-7e5, -3e6, 0], "scale": [1, 1, 1], "swap_xy": False}}),
        "calibration": (CALIBRATED, {
            "sensors": [{"id": SENSOR, "internals": lens()}], "cameras": cameras}),
    }  # fmt: skip
    kinds = {
        kind: "opf-calibrated-cameras+json" if kind == "calibration" else f"opf-{kind.replace('_', '-')}+json"
        for kind in contents
    }  # fmt: skip
    files = {
        file: {"format": f"application/{kinds[kind]}", "version": "1.0", **content}
        for kind, (file, content) in contents.items()
    }
    items = [
        {"id": kind, "type": kind, "sources": [],
         "resources": [{"uri": file, "format": f"application/{kinds[kind]}"},
                       {"uri": "calibration/tracks.gltf", "format": "model/gltf+json"}]}
        for kind, (file, _) in contents.items()
    ]  # fmt: skip
    files["project.opf"] = {
        "format": "application/opf-project+json", "version": "1.0", "id": "caa7754e", "name": "duck",
        "generator": {"name": "PIX4Dmatic", "version": "1.41.0"}, "items": items,
    }  # fmt: skip
    return files


def write(folder, files=None, photos=True):
    for name, content in (project() if files is None else files).items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content if isinstance(content, str) else json.dumps(content, indent=1))
    if photos:
        save_photos(folder / "images")
    return folder


def reference(index, point):
    """`project_point` of Pix4D's example compute_reprojection_error.py, number by number."""
    x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
    x, y = x / z, y / z
    (k1, k2, k3), (t1, t2), r = RADIAL, TANGENTIAL, x * x + y * y
    scale = 1 + r * k1 + r**2 * k2 + r**3 * k3
    u = scale * x + 2 * t1 * x * y + t2 * (r + 2 * x * x)
    v = scale * y + 2 * t2 * x * y + t1 * (r + 2 * y * y)
    return FOCAL * u + CENTRE[0], FOCAL * v + CENTRE[1]


def fisheye(polynomial, affine=(60.0, 0.5, -0.3, 58.0)):
    return {
        "type": "fisheye", "principal_point_px": list(CENTRE), "is_symmetric_affine": False,
        "affine": list(affine), "polynomial": list(polynomial), "is_p0_zero": True,
    }  # fmt: skip


@pytest.mark.parametrize("polynomial", [(0, 1), (0, 1, 0.01, -0.15), (0, 1, 0.1, -0.2, 0.03, 0)])
def test_points_project_as_pix4ds_paper_has_it_of_a_fisheye(tmp_path, polynomial):
    files = project()
    put(files[CALIBRATED], ("sensors", 0, "internals"), fisheye(polynomial))

    def pixel(index, point):
        x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
        across = np.hypot(x, y)
        angle = 2 / np.pi * np.arctan2(across, z)
        radius = sum(value * angle**power for power, value in enumerate(polynomial))
        xh, yh = radius * x / across, radius * y / across
        return 60 * xh + 0.5 * yh + CENTRE[0], -0.3 * xh + 58 * yh + CENTRE[1]

    check_projection(read_capture(write(tmp_path, files)), pixel, poses(), spread=1.5)


@pytest.mark.parametrize("given_as", ["project", "project/project.opf", ""])
def test_points_project_as_pix4d_projects_them(tmp_path, given_as):
    write(tmp_path / "project")
    capture = read_capture(tmp_path / given_as)
    assert capture.format == "OPF" and not capture.warnings and not capture.metric
    assert capture.up.tolist() == [0, 0, 1]
    check_projection(capture, reference, poses())


def test_a_sites_own_world_has_no_up(tmp_path):
    assert read_capture(write(tmp_path / "site", project(crs=SITE))).up is None
    files = project()
    del files["project.opf"]["items"][2]
    assert read_capture(write(tmp_path / "unknown", files)).up is None


@pytest.mark.parametrize(
    "form",
    ["images/{}.png", "./images/{}.png", "file:///C:/a%20b/images/{}.png", "{}.jpg", "C:\\images\\{}.png",
     "file:///data/images/{}.png#page=0"],
)  # fmt: skip
def test_photos_are_found_wherever_they_were(tmp_path, form):
    folder = write(tmp_path, project([form.format(name) for name in names()]))
    check_projection(read_capture(folder), reference, poses())


def test_photos_that_pyopf_undistorted_have_no_distortion(tmp_path):
    folder = write(tmp_path)
    save_photos(folder / "images" / "undistort")
    check_projection(read_capture(folder), reference, poses())
    capture = read_capture(folder, photos=folder / "images" / "undistort")
    for camera in capture.cameras:
        assert (camera.lens, camera.fx, camera.cx, camera.cy) == ("pinhole", FOCAL, *CENTRE)


def test_a_blank_in_a_name_may_be_written_as_it_is_or_as_20(tmp_path):
    stems = [f"a 50%25 {name}" for name in names()]
    save_photos(tmp_path / "images", stems)
    uris = [f"images/{stem}.png" for stem in stems]
    for written in (uris, [uri.replace("%", "%25").replace(" ", "%20") for uri in uris]):
        capture = read_capture(write(tmp_path, project(written), photos=False))
        assert [camera.image_path.stem for camera in capture.cameras] == stems


def test_later_pages_of_a_file_are_refused(tmp_path):
    folder = write(tmp_path, project([f"images/{name}.png#page=2" for name in names()]))
    with pytest.raises(CaptureError, match="page=2: photos on later pages of a file are not read"):
        read_capture(folder)


def test_cameras_that_are_not_calibrated_are_left_out(tmp_path):
    files = project()
    del files[CALIBRATED]["cameras"][1]
    capture = read_capture(write(tmp_path, files))
    assert len(capture.cameras) == COUNT - 1
    assert (
        "1 of 5 photos has no pose and is left out (the first: images/IMG_0001.png)"
        in (capture.warnings[0])
    )


def test_a_rolling_shutter_is_told(tmp_path):
    files = project()
    for camera in files[CALIBRATED]["cameras"][:2]:
        camera["rolling_shutter"] = [0.01, 0, 0]
    files[CALIBRATED]["cameras"][2]["rolling_shutter"] = [0, 0, 0]
    assert "2 cameras moved while" in read_capture(write(tmp_path, files)).warnings[0]


@pytest.mark.parametrize(
    "file, at, value, problem",
    [
        (CALIBRATED, ("sensors", 0, "internals", "type"), "spherical",
         r"sensors\[0\].internals.type: lenses called 'spherical' are not supported; calibrate the cameras with"),
        (CALIBRATED, ("sensors", 0, "internals"), fisheye([0.01, 1, 0.2]), "begin with 0, 1 and"),
        (CALIBRATED, ("sensors", 0, "internals"), fisheye([0, 0.1, 0.2]), "begin with 0, 1 and"),
        (CALIBRATED, ("sensors", 0, "internals"), fisheye([0, 1, 0, 0, 0, 1]), "begin with 0, 1 and"),
        (CALIBRATED, ("sensors", 0, "internals"), fisheye([0, 1], affine=[60, 0, 0, 0]), "begin with 0, 1"),
        (CALIBRATED, ("sensors", 0, "internals"), fisheye([0, 1], affine=[60]), "is not 4 numbers"),
        (CALIBRATED, ("sensors", 0, "internals", "radial_distortion"), [1, 2], "is not 3 numbers"),
        (CALIBRATED, ("sensors", 0, "internals", "focal_length_px"), None, "is not a number"),
        (CALIBRATED, ("sensors", 0, "id"), 7, r"cameras\[0\].sensor_id: there is no such sensor"),
        (CALIBRATED, ("cameras", 2, "id"), 7, r"cameras\[2\].id: no camera list has this camera"),
        (CALIBRATED, ("cameras", 2, "id"), "7", r"cameras\[2\].id: '7' is not an identity"),
        (CALIBRATED, ("cameras", 2, "position"), [1, 2], r"cameras\[2\].position: '\[1, 2\]' is not 3"),
        (CALIBRATED, ("version",), "1.0-draft2", "'1.0-draft2' is not known, only 1.0"),
        (CALIBRATED, ("cameras",), [], "none of its 5 photos has a pose; calibrate its cameras"),
        ("input-cameras.json", ("sensors", 0, "image_size_px"), [96], "is not 2 numbers"),
        ("camera-list.json", ("cameras", 0, "uri"), 5, r"cameras\[0\].uri: the camera names no photo"),
        ("project.opf", ("items", 3, "resources"), [], "there are no calibrations in it"),
        ("project.opf", ("items", 3, "resources", 0, "uri"), "../../etc/passwd", "is not in its folder"),
        ("project.opf", ("items", 3, "resources", 0, "uri"), "gone.json", "is not in its folder"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_named(tmp_path, file, at, value, problem):
    files = project()
    put(files[file], at, value)
    with pytest.raises(CaptureError, match=problem):
        read_capture(write(tmp_path, files))


@pytest.mark.parametrize("uri", ["x" * 5000, "loop", "\ud800.json"])
def test_names_that_no_file_can_have_are_not_in_the_folder(tmp_path, uri):
    files = project()
    put(files["project.opf"], ("items", 3, "resources", 0, "uri"), uri)
    with suppress(OSError):  # there are no links everywhere
        (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(CaptureError, match=r"items\[3\].resources: .* is not in its folder; copy"):
        read_capture(write(tmp_path, files))


def test_of_several_calibrations_none_is_taken(tmp_path):
    files = project()
    files["project.opf"]["items"].append(files["project.opf"]["items"][3])
    with pytest.raises(CaptureError, match="there are 2 calibrations in it; export a project with one"):
        read_capture(write(tmp_path, files))


def test_only_projects_are_recognised(tmp_path):
    folder = write(tmp_path)
    assert reader_of(folder / "project.opf") is opf
    assert reader_of(folder / CALIBRATED) is None
    book = '<?xml version="1.0"?><package xmlns="http://www.idpf.org/2007/opf"/>'
    (folder / "book.opf").write_text(book)
    assert reader_of(folder / "book.opf") is None


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data):
    files = project()
    name = data.draw(st.sampled_from(sorted(files)))
    put(files[name], data.draw(st.sampled_from(places(files[name]))), data.draw(HOSTILE))
    outcome(write(tmp_path, files))


@RANDOM_TESTS
@given(data=st.data())
def test_files_cut_off_end_in_an_error(tmp_path, data):
    files = {name: json.dumps(content) for name, content in project().items()}
    name = data.draw(st.sampled_from(sorted(files)))
    files[name] = files[name][: data.draw(st.integers(0, len(files[name]) - 1))]
    assert outcome(write(tmp_path, files)) is None
