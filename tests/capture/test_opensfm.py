"""OpenSfM's reconstruction.json: its lenses' formulas, rigs, several reconstructions, and hostile files.

Files are written here as `reconstruction_to_json` of OpenSfM's `io.py` writes them, in the folders of OpenSfM
and of OpenDroneMap.
"""

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import meshroom, openmvg, opensfm, transforms
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    WIDTH,
    check_projection,
    names,
    poses,
    put,
    save_photos,
)

PLAIN = dict(focal=0.85, k1=-0.08, k2=0.03)
AFFINE = dict(focal_x=0.85, focal_y=0.8, c_x=0.0144, c_y=-0.0082, k1=-0.08, k2=0.03)
BROWN = dict(AFFINE, k3=0.01, p1=0.004, p2=-0.003)
WIDE = dict(AFFINE, k1=0.05, k2=-0.01, k3=0.002, k4=0.001)
TANGENTIAL = dict(WIDE, k5=0.0, k6=0.0, p1=0.004, p2=-0.003)
SIX = dict(WIDE, k5=-0.002, k6=0.0005, p1=0.0, p2=0.0)
PRISM = dict(TANGENTIAL, s0=0.003, s1=0.0, s2=-0.002, s3=0.0)
NO_PRISM = dict(s0=0.0, s1=0.0, s2=0.0, s3=0.0)
NO_GPS = {"latitude": 0.0, "longitude": 0.0, "altitude": 0.0}
GPS = {"latitude": 52.5191, "longitude": 13.4007, "altitude": 12.0}


def lens(kind="brown", values=BROWN):
    return {"projection_type": kind, "width": WIDTH, "height": HEIGHT, **values}


def pose(to_world):
    """What a file says of a camera-to-world matrix."""
    from_world = np.linalg.inv(to_world)
    turn = Rotation.from_matrix(from_world[:3, :3]).as_rotvec()
    return {"rotation": turn.tolist(), "translation": from_world[:3, 3].tolist()}


def reconstruction(camera=None, order=range(COUNT), reference=GPS, stems=None):
    stems = names() if stems is None else stems
    shots = {
        f"{stems[i]}.png": {
            **pose(poses()[i]), "camera": "v2 maker model 96 64 brown 0.85", "orientation": 1,
            "capture_time": 1467197388.0, "gps_dop": 5.0, "gps_position": [0.8, -4.2, 2.0],
            "vertices": [], "faces": [], "scale": 1.0, "covariance": [], "merge_cc": 0,
        }
        for i in order
    }  # fmt: skip
    points = {"1200": {"color": [36.0, 25.0, 23.0], "coordinates": [0.5, -1.0, 2.0]}}
    bias = {"rotation": [-0.0, -0.0, -0.0], "translation": [0.0, 0.0, 0.0], "scale": 1.0}
    return {
        "cameras": {"v2 maker model 96 64 brown 0.85": camera or lens()},
        "shots": shots,
        "points": points,
        "biases": {"v2 maker model 96 64 brown 0.85": bias},
        "rig_cameras": {"rig": {"rotation": [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0]}},
        "rig_instances": {name: {**pose(poses()[0]), "rig_camera_ids": {name: "rig"}} for name in shots},
        "reference_lla": None if reference is None else dict(reference),
    }


def scene(*arguments, **options):
    return [reconstruction(*arguments, **options)]


def write(folder, content, name="reconstruction.json"):
    save_photos(folder / "images")
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(
        content if isinstance(content, str) else json.dumps(content), encoding="utf-8"
    )
    return folder


def reference(kind, k, to_camera, point):
    """Projection, distortion and scale of OpenSfM's C++, number by number."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    if kind.startswith("fisheye") or (kind == "dual" and k["transition"] == 0):
        r = math.hypot(X, Y)
        x, y = (math.atan2(r, Z) / r * value for value in (X, Y))
    r2 = x * x + y * y
    k1, k2, k3, k4, k5, k6, p1, p2, s0, s1, s2, s3 = (
        k.get(name, 0.0) for name in "k1 k2 k3 k4 k5 k6 p1 p2 s0 s1 s2 s3".split()
    )
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4 + k5 * r2**5 + k6 * r2**6
    a = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s0 * r2 + s1 * r2 * r2
    b = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + s2 * r2 + s3 * r2 * r2
    u = k.get("focal", k.get("focal_x")) * a + k.get("c_x", 0.0)
    v = k.get("focal", k.get("focal_y")) * b + k.get("c_y", 0.0)
    # "denormalized_image_coordinates": pixels from the centre of the first one; here from its corner.
    size = max(WIDTH, HEIGHT)
    return u * size + (WIDTH - 1) / 2 + 0.5, v * size + (HEIGHT - 1) / 2 + 0.5


@pytest.mark.parametrize(
    "kind, k, lens_here",
    [
        ("perspective", dict(focal=0.85, k1=0.0, k2=0.0), "pinhole"),
        ("perspective", PLAIN, "opencv"),
        ("simple_radial", {key: value for key, value in AFFINE.items() if key != "k2"}, "opencv"),
        ("radial", AFFINE, "opencv"),
        ("brown", BROWN, "opencv"),
        ("fisheye", PLAIN, "opencv_fisheye"),
        ("fisheye_opencv", WIDE, "opencv_fisheye"),
        ("fisheye62", dict(TANGENTIAL, p1=0.0, p2=0.0), "opencv_fisheye"),
        ("fisheye62", TANGENTIAL, "brown"),
        ("fisheye62", SIX, "rad_tan_thin_prism_fisheye"),
        ("fisheye624", dict(SIX, **NO_PRISM), "rad_tan_thin_prism_fisheye"),
        ("fisheye624", PRISM, "thin_prism_fisheye"),
        ("dual", dict(PLAIN, transition=1.0), "opencv"),
        ("dual", dict(PLAIN, transition=0.0), "opencv_fisheye"),
    ],
)
def test_points_project_as_opensfm_projects_them(tmp_path, kind, k, lens_here):
    capture = read_capture(write(tmp_path, scene(lens(kind, k))))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(kind, k, to_camera[i], x), poses())
    assert capture.format == opensfm.NAME and not capture.warnings
    assert {item.lens for item in capture.cameras} == {lens_here}
    np.testing.assert_allclose(capture.points, [[0.5, -1, 2]])


def test_photos_that_stand_upright_count_in_their_height(tmp_path):
    save_photos(tmp_path / "images", size=(HEIGHT, WIDTH))
    camera = {**lens("brown", BROWN), "width": HEIGHT, "height": WIDTH}
    for item in read_capture(write(tmp_path, scene(camera))).cameras:
        assert (item.fx, item.fy) == pytest.approx((0.85 * WIDTH, 0.8 * WIDTH))
        assert item.cx == pytest.approx(HEIGHT / 2 + 0.0144 * WIDTH)
        assert item.cy == pytest.approx(WIDTH / 2 - 0.0082 * WIDTH)


@pytest.mark.parametrize(
    "kind, k, said",
    [
        ("dual", dict(PLAIN, transition=0.5), "transition of 0.5"),
        ("dual", PLAIN, "transition of 0.5"),
        ("fisheye62", dict(SIX, p1=0.004), "k5 or k6"),
        ("fisheye624", dict(PRISM, s1=0.001), "s1 or s3"),
        ("cylindrical", {}, "use one of perspective, .*spherical"),
        ("division", PLAIN, "use one of perspective"),
        (["brown"], PLAIN, "use one of perspective"),
    ],
)
def test_a_lens_that_there_is_not_here_is_refused_by_name(tmp_path, kind, k, said):
    with pytest.raises(CaptureError, match=said) as caught:
        read_capture(write(tmp_path, scene(lens(kind, k))))
    assert caught.value.field.endswith("projection_type")


@pytest.mark.parametrize("place, metric", [(GPS, True), (NO_GPS, False), (None, False)])
def test_the_world_stands_upright_and_has_metres_where_photos_had_gps(tmp_path, place, metric):
    capture = read_capture(write(tmp_path, scene(reference=place)))
    assert tuple(capture.up) == (0, 0, 1) and capture.metric is metric


def test_shots_of_a_rig_without_a_pose_have_that_of_their_rig(tmp_path):
    content = reconstruction()
    inner = poses(COUNT, seed=8)  # of each camera, from it to the rig
    content["rig_cameras"] = {f"c{i}": pose(inner[i]) for i in range(COUNT)}
    for i, (name, shot) in enumerate(content["shots"].items()):
        del shot["rotation"], shot["translation"]
        # From the rig to the world, so that the camera comes to lie where it should.
        to_world = poses()[i] @ np.linalg.inv(inner[i])
        content["rig_instances"][name] = {**pose(to_world), "rig_camera_ids": {name: f"c{i}"}}
    capture = read_capture(write(tmp_path, [content]))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference("brown", BROWN, to_camera[i], x), poses())


def test_shots_without_any_pose_are_left_out_with_a_warning(tmp_path):
    content = reconstruction()
    last = f"{names()[-1]}.png"
    del content["shots"][last]["rotation"], content["rig_instances"][last]
    capture = read_capture(write(tmp_path, [content]))
    assert len(capture.cameras) == COUNT - 1 and "no pose" in capture.warnings[0]
    del content["rig_instances"]
    for shot in content["shots"].values():
        shot.pop("rotation", None)
    with pytest.raises(CaptureError, match="none of its 5 photos has a pose"):
        read_capture(write(tmp_path, [content]))


@pytest.mark.parametrize("field, value", [("rig_cameras", {"rig": 1}), ("rig_instances", [1])])
def test_rigs_that_cannot_be_read_matter_only_where_they_are_needed(tmp_path, field, value):
    content = {**reconstruction(), field: value}
    assert len(read_capture(write(tmp_path, [content])).cameras) == COUNT
    del content["shots"][f"{names()[0]}.png"]["rotation"]
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, [content]))
    assert field in caught.value.field


def test_of_several_reconstructions_the_largest_is_read(tmp_path):
    other = reconstruction(order=range(2), stems=["a", "b"])
    capture = read_capture(write(tmp_path, [other, reconstruction(), other]))
    assert len(capture.cameras) == COUNT
    assert "of 3 reconstructions only the largest" in capture.warnings[0]
    assert "4 photos are in others" in capture.warnings[0]


def test_photos_that_are_missing_are_left_out_with_a_warning(tmp_path):
    write(tmp_path, scene())
    (tmp_path / "images" / f"{names()[0]}.png").unlink()
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == COUNT - 1 and names()[0] in capture.warnings[0]
    for name in names()[:3]:
        (tmp_path / "images" / f"{name}.png").unlink(missing_ok=True)
    with pytest.raises(CaptureError, match="photos are missing"):
        read_capture(tmp_path)


def test_a_project_of_opendronemap_is_read_with_the_photos_as_taken(tmp_path):
    write(tmp_path, scene(), "opensfm/reconstruction.json")
    undistorted = tmp_path / "opensfm" / "undistorted"
    write(undistorted, scene(lens("perspective", dict(focal=0.9, k1=0.0, k2=0.0))))
    (tmp_path / "cameras.json").write_text(json.dumps({"v2 maker model": lens()}))
    for given in (tmp_path, tmp_path / "opensfm" / "reconstruction.json"):
        capture = read_capture(given)
        assert {item.image_path.parent for item in capture.cameras} == {tmp_path / "images"}
        assert capture.cameras[0].lens == "opencv"
    capture = read_capture(undistorted)
    assert {item.image_path.parent for item in capture.cameras} == {undistorted / "images"}
    assert capture.cameras[0].lens == "pinhole"


def test_opendronemaps_lenses_are_no_cameras(tmp_path):
    save_photos(tmp_path / "images")
    file = tmp_path / "cameras.json"
    file.write_text(json.dumps({"v2 maker model 96 64 brown 0.85": lens()}, indent=4))
    assert reader_of(file) is None
    for given in (tmp_path, file):
        with pytest.raises(
            CaptureError,
            match=r"lenses, without poses; give the folder with its odm_report/shots\.geojson or opensfm",
        ):
            read_capture(given)


def test_photos_are_found_wherever_they_lie_in_the_project(tmp_path):
    write(tmp_path, scene())
    (tmp_path / "images").rename(tmp_path / "photos of tuesday")
    assert sorted(item.name for item in read_capture(tmp_path).cameras) == names()


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    for name in ("scene.json", "transforms.json", "cameras.sfm", "x.txt"):
        write(tmp_path / name, json.dumps(scene(), indent=4), name)
        assert reader_of(tmp_path / name / name) is opensfm
        assert len(read_capture(tmp_path / name).cameras) == COUNT
    for reader in (transforms, meshroom, openmvg):
        assert not reader.recognises(tmp_path / "scene.json" / "scene.json")


FIRST = (0, "shots", f"{names()[0]}.png")
CAMERA = (0, "cameras", "v2 maker model 96 64 brown 0.85")


@pytest.mark.parametrize(
    "at, value, field",
    [
        ((0, "shots"), [], "[0].shots"),
        ((0, "shots"), {}, "cameras"),
        (FIRST, None, names()[0]),
        ((*FIRST, "rotation"), [1, 2], "rotation"),
        ((*FIRST, "rotation"), [1e300, 1e300, 0], names()[0]),
        ((*FIRST, "translation"), ["a", 1, 2], "translation"),
        ((*FIRST, "translation"), [1e300, 1, 2], names()[0]),
        ((*FIRST, "camera"), "other", "camera"),
        ((*FIRST, "camera"), ["other"], "camera"),
        (CAMERA, [], "cameras"),
        ((*CAMERA, "focal_x"), "long", "focal_x"),
        ((*CAMERA, "focal_y"), -1, names()[0]),
        ((*CAMERA, "k1"), None, "k1"),
        ((*CAMERA, "width"), 0, names()[0]),
        ((0, "points", "1200", "coordinates"), [1], "coordinates"),
        ((0, "points"), [1], "points"),
        ((0, "reference_lla"), 1, "reference_lla"),
        ((0, "reference_lla", "latitude"), "north", "latitude"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, at, value, field):
    content = scene()
    put(content, at, value)
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, content))
    assert caught.value.file.name == "reconstruction.json" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)
