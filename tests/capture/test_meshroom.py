"""Meshroom's SfM data: AliceVision's projection, the versions of its file, and hostile files.

Files are written here as `sfmDataIO/jsonIO.cpp` of AliceVision writes them; `data/meshroom` has
intrinsics from AliceVision's own tests.
"""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from solver.capture.errors import CaptureError
from solver.capture.formats import meshroom, openmvg, transforms
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    WIDTH,
    check_projection,
    names,
    nested,
    outcome,
    poses,
    put,
    rotation,
    save_photos,
)

FX, FY, OFFSET = 80.0, 90.0, (1.5, -2.25)
RADIAL = (-0.08, 0.03, 0.01)
BROWN = (-0.08, 0.03, 0.01, 0.004, -0.003)
FISHEYE = (0.05, -0.01, 0.002, 0.001)
DATA = Path(__file__).parent / "data" / "meshroom" / "intrinsics.json"


def text(values):
    return [repr(float(value)) for value in values]


def written_pose(pose):
    """`savePose3`: Eigen's matrix(i) runs down the columns of the world-to-camera rotation."""
    world_to_camera = pose[:3, :3].T
    down_columns = [world_to_camera[i % 3, i // 3] for i in range(9)]
    return {"rotation": text(down_columns), "center": text(pose[:3, 3])}


def intrinsic(kind="radial3", k=RADIAL, version=(1, 2, 5), number="300"):
    entry = {
        "intrinsicId": number, "width": str(WIDTH), "height": str(HEIGHT), "sensorWidth": "36",
        "sensorHeight": "24", "serialNumber": "", "type": kind, "initializationMode": "estimated",
        "distortionParams": text(k) or "", "locked": "false",
    }  # fmt: skip
    if version >= (1, 2, 8):
        entry["distortionType"], entry["type"] = kind, "pinhole"
        entry["undistortionType"] = "none"
    if version < (1, 2, 1):
        entry["principalPoint"] = text((OFFSET[0] + WIDTH / 2, OFFSET[1] + HEIGHT / 2))
    else:
        entry["principalPoint"] = text(OFFSET)
    if version < (1, 2, 0):
        entry["pxFocalLength"] = repr(FX)
    elif version < (1, 2, 2):
        entry["pxFocalLength"] = text((FX, FY))
    elif version < (1, 2, 5):
        entry |= {"focalLength": repr(FX * 36 / WIDTH), "pixelRatio": repr(FX / FY)}
    elif version < (1, 2, 9):
        entry |= {"focalLength": repr(FX * 36 / WIDTH), "pixelRatio": repr(FY / FX)}
    else:
        entry |= {"focalLength": repr(FY * 36 / WIDTH), "pixelRatio": repr(FY / FX)}
    return entry


def scene(version=(1, 2, 5), order=range(COUNT), lens=None, folder="/home/other/vase/photos"):
    lens = intrinsic(version=version) if lens is None else lens
    views = [
        {"viewId": str(10 + i), "poseId": str(20 + i), "frameId": str(i), "intrinsicId": "300",
         "path": f"{folder}/{names()[i]}.png", "width": str(WIDTH), "height": str(HEIGHT),
         "metadata": {"Make": "ACME"} if i else ""}
        for i in order
    ]  # fmt: skip
    written = [
        {"poseId": str(20 + i), "pose": {"transform": written_pose(poses()[i]), "locked": "0"}}
        for i in reversed(order)
    ]
    return {
        "version": [str(part) for part in version], "featuresFolders": ["../features"],
        "views": views, "intrinsics": [lens], "poses": written,
        "structure": [{"landmarkId": "1", "descType": "dspsift", "color": ["1", "2", "3"],
                       "X": ["0.5", "-1", "2e0"]}],
    }  # fmt: skip


def write(folder, content, name="cameras.sfm"):
    save_photos(folder / "photos")
    (folder / name).write_text(
        content if isinstance(content, str) else json.dumps(content), encoding="utf-8"
    )
    return folder


def reference(kind, k, to_camera, point, fy=FY):
    """`IntrinsicScaleOffset::cam2ima` after `Distortion*::addDistortion`, number by number; pixels
    count from the centre of the first one there, from its corner here."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    if kind in ("fisheye4", "fisheye"):
        r, t = math.sqrt(r2), math.atan(math.sqrt(r2))
        scale = (t + k[0] * t**3 + k[1] * t**5 + k[2] * t**7 + k[3] * t**9) / r
        x, y = x * scale, y * scale
    elif kind == "fisheye1" and k[0]:
        r = math.sqrt(r2)
        scale = math.atan(2 * r * math.tan(0.5 * k[0])) / k[0] / r
        x, y = x * scale, y * scale
    elif kind == "brown":
        k1, k2, k3, t1, t2 = k
        radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
        tx = t2 * (r2 + 2 * x * x) + 2 * t1 * x * y
        ty = t1 * (r2 + 2 * y * y) + 2 * t2 * x * y
        x, y = x + x * radial + tx, y + y * radial + ty
    elif kind == "radialk3pt":
        scale = (1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3) / (1 + sum(k))
        x, y = x * scale, y * scale
    elif k:
        scale = 1 + sum(value * r2 ** (i + 1) for i, value in enumerate(k))
        x, y = x * scale, y * scale
    return x * FX + WIDTH / 2 + OFFSET[0], y * fy + HEIGHT / 2 + OFFSET[1]


OLD, NEW = (1, 2, 5), (1, 2, 14)


@pytest.mark.parametrize(
    "kind, k, version",
    [
        ("pinhole", (), OLD), ("radial1", RADIAL[:1], OLD), ("radial3", RADIAL, OLD),
        ("brown", BROWN, OLD), ("fisheye4", FISHEYE, OLD), ("none", (), NEW),
        ("radialk1", RADIAL[:1], NEW), ("radialk3", RADIAL, NEW), ("radialk3pt", RADIAL, NEW),
        ("brown", BROWN, NEW), ("fisheye", FISHEYE, NEW), ("fisheye1", (0.9,), OLD),
        ("fisheye1", (0.9,), NEW), ("fisheye1", (0.0,), NEW),
    ],
)  # fmt: skip
def test_points_project_as_alicevision_projects_them(tmp_path, kind, k, version):
    content = scene(version, lens=intrinsic(kind, k, version))
    capture = read_capture(write(tmp_path, content))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(kind, k, to_camera[i], x), poses())
    assert capture.format == meshroom.NAME and not capture.warnings
    np.testing.assert_allclose(capture.points, [[0.5, -1, 2]])


def equidistant(kind, k, to_camera, point, focal, radius):
    """`Equidistant::project`, number by number, of a sensor of 36 × 24 mm; its angles are not small."""
    x, y, z = (to_camera @ [*point, 1.0])[:3]
    view = 24 / focal
    share, around = math.atan2(math.hypot(x, y), z) / (0.5 * view), math.atan2(y, x)
    scale = 1 + sum(value * share ** (2 * i) for i, value in enumerate(k, 1))
    share *= scale / (1 + sum(k)) if kind == "radialk3pt" else scale
    return (
        radius * share * math.cos(around) + WIDTH / 2 + OFFSET[0],
        radius * share * math.sin(around) + HEIGHT / 2 + OFFSET[1],
    )


@pytest.mark.parametrize("radius", [None, 29.5])
@pytest.mark.parametrize(
    "kind, k",
    [("none", ()), ("radialk1", RADIAL[:1]), ("radialk3", RADIAL), ("radialk3pt", RADIAL)],
)
def test_points_project_as_alicevisions_equidistant_camera_has_them(tmp_path, kind, k, radius):
    lens = intrinsic(kind, k, NEW) | {
        "type": "equidistant",
        "focalLength": "16.0",
        "pixelRatio": "1",
    }
    if radius is not None:
        lens["fisheyeCircleRadius"] = repr(radius)
    capture = read_capture(write(tmp_path, scene(NEW, lens=lens)))
    to_camera, circle = np.linalg.inv(poses()), HEIGHT / 2 if radius is None else radius
    check_projection(
        capture, lambda i, x: equidistant(kind, k, to_camera[i], x, 16.0, circle), poses(), spread=1.2
    )


def test_an_equidistant_camera_of_older_files_has_its_distortion_by_its_name(tmp_path):
    lens = intrinsic("equidistant_r3", RADIAL, OLD) | {"focalLength": "16.0", "pixelRatio": "1"}
    capture = read_capture(write(tmp_path, scene(OLD, lens=lens)))
    to_camera, kind = np.linalg.inv(poses()), "radialk3pt"
    check_projection(
        capture, lambda i, x: equidistant(kind, RADIAL, to_camera[i], x, 16.0, HEIGHT / 2), poses(), spread=1.2
    )  # fmt: skip


def test_a_distortion_that_is_not_of_angles_is_refused_of_an_equidistant_camera(tmp_path):
    lens = intrinsic("brown", BROWN, NEW) | {"type": "equidistant"}
    with pytest.raises(CaptureError, match="'brown' is not supported.*equidistant with radialk3"):
        read_capture(write(tmp_path, scene(NEW, lens=lens)))


@pytest.mark.parametrize(
    "version", [(1, 0, 0), (1, 2, 0), (1, 2, 1), (1, 2, 2), (1, 2, 4), (1, 2, 5), (1, 2, 11)]
)
def test_all_versions_state_the_same_lens_in_their_own_way(tmp_path, version):
    kind = "radialk3" if version >= (1, 2, 8) else "radial3"
    content = scene(version, lens=intrinsic(kind, RADIAL, version))
    capture = read_capture(write(tmp_path, content))
    to_camera = np.linalg.inv(poses())
    fy = FX if version < (1, 2, 0) else FY
    check_projection(capture, lambda i, x: reference(kind, RADIAL, to_camera[i], x, fy), poses())


@pytest.mark.parametrize("version", sorted(json.loads(DATA.read_text())))
@pytest.mark.parametrize("which", [0, 1])
def test_alicevisions_own_files_of_all_versions_state_one_camera(tmp_path, version, which):
    lens = json.loads(DATA.read_text())[version][which]
    content = scene(tuple(int(part) for part in version.split(".")), lens={**lens, "intrinsicId": "300"})
    folder = tmp_path
    save_photos(folder / "photos", size=(1023, 512))  # a quarter of 4092 × 2048
    item = read_capture(write(folder, content)).cameras[0]
    quarter = np.array([1000, 2000, 2020, 1040]) / 4
    np.testing.assert_allclose((item.fx, item.fy, item.cx, item.cy), quarter)
    assert item.lens == ("opencv" if which else "pinhole")
    np.testing.assert_allclose(item.distortion or 0, (0.1, 0.05, 0, 0, -0.001) if which else 0)


def test_cameras_of_a_rig_have_the_product_of_both_poses(tmp_path):
    generator = np.random.default_rng(3)
    inner = np.tile(np.eye(4), (2, 1, 1))
    for matrix in inner:
        matrix[:3, :3], matrix[:3, 3] = rotation(generator), generator.normal(size=3)
    content = scene()
    content["rigs"] = [
        {
            "rigId": "7",
            "subPoses": [{"status": "estimated", "pose": written_pose(m)} for m in inner],
        }
    ]
    for index in (1, 2):
        content["views"][index] |= {"rigId": "7", "subPoseId": str(index - 1), "isPoseIndependant": "false"}
    expected = poses()
    for index in (1, 2):
        # Pose3::operator*: camera from rig after rig from world.
        outer, sub = np.linalg.inv(poses()[index]), np.linalg.inv(inner[index - 1])
        expected[index] = np.linalg.inv(sub @ outer)
    capture = read_capture(write(tmp_path, content))
    to_camera = np.linalg.inv(expected)
    check_projection(capture, lambda i, x: reference("radial3", RADIAL, to_camera[i], x), expected)


def test_views_without_a_pose_are_left_out_with_a_warning(tmp_path):
    content = scene()
    content["poses"].pop()
    content["views"][1]["intrinsicId"] = "4294967295"
    capture = read_capture(write(tmp_path, content))
    assert len(capture.cameras) == COUNT - 2 and "no pose" in capture.warnings[0]


def test_numbers_may_be_numbers(tmp_path):
    content = scene()
    content["views"] = [{**view, "viewId": 1, "poseId": int(view["poseId"])} for view in content["views"]]
    for pose in content["poses"]:
        center = pose["pose"]["transform"]["center"]
        pose["pose"]["transform"]["center"] = [float(value) for value in center]
    assert len(read_capture(write(tmp_path, content)).cameras) == COUNT


@pytest.mark.parametrize("folder", ["D:\\Scans\\Vase\\photos", "/photos", "..", "photos"])
def test_photos_are_found_by_paths_of_another_machine(tmp_path, folder):
    cameras = read_capture(write(tmp_path, scene(folder=folder))).cameras
    assert sorted(item.name for item in cameras) == names()


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    for name in ("scene.json", "transforms.json", "sfm_data.json", "x.txt"):
        write(tmp_path / name, scene(), name)
        assert reader_of(tmp_path / name / name) is meshroom
        assert len(read_capture(tmp_path / name).cameras) == COUNT
    for reader in (transforms, openmvg):
        assert not reader.recognises(tmp_path / "scene.json" / "scene.json")


def test_the_file_in_meshrooms_cache_is_found_from_the_projects_folder(tmp_path):
    save_photos(tmp_path / "photos")
    folder = tmp_path / "MeshroomCache" / "StructureFromMotion" / "1a2b3c"
    folder.mkdir(parents=True)
    (folder / "cameras.sfm").write_text(json.dumps(scene()))
    assert len(read_capture(tmp_path).cameras) == COUNT


@pytest.mark.parametrize("given", ["", "MeshroomCache", "MeshroomCache/StructureFromMotion"])
def test_of_what_meshroom_has_tried_the_last_that_was_solved_is_read(tmp_path, given):
    """The cache keeps a folder for every change of a setting; CameraInit's file has no poses."""
    save_photos(tmp_path / "MeshroomCache" / "StructureFromMotion" / "photos")
    cache = tmp_path / "MeshroomCache"
    unsolved = scene() | {"poses": ""}
    tried = [
        ("CameraInit/0f/cameraInit.sfm", unsolved, 50),
        ("StructureFromMotion/1a/cameras.sfm", scene(order=range(3)), 10),
        ("StructureFromMotion/2b/cameras.sfm", scene(), 30),
        ("StructureFromMotion/3c/cameras.sfm", scene(order=range(4)), 20),
        ("StructureFromMotion/4d/cameras.sfm", unsolved, 40),
    ]
    for name, content, written in tried:
        (cache / name).parent.mkdir(parents=True)
        (cache / name).write_text(json.dumps(content))
        os.utime(cache / name, (written, written))
    assert read_capture(tmp_path / given).source == cache / "StructureFromMotion/2b/cameras.sfm"


def test_a_project_that_is_not_solved_says_which_file_to_give(tmp_path):
    save_photos(tmp_path / "photos")
    init = tmp_path / "MeshroomCache" / "CameraInit" / "0f"
    init.mkdir(parents=True)
    (init / "cameraInit.sfm").write_text(json.dumps(scene() | {"poses": ""}))
    with pytest.raises(CaptureError, match="poses: none of its 5 photos.*StructureFromMotion"):
        read_capture(tmp_path)


@pytest.mark.parametrize(
    "at, value, field",
    [
        (("views", 1, "path"), "", "path"),
        (("views",), {"viewId": 1}, "views"),
        (("views", 0), 7, "views[0]"),
        (("poses", 2, "pose", "transform", "rotation"), ["1"] * 8, "rotation"),
        (("poses", 2, "pose", "transform", "rotation"), ["1"] * 9, "views"),
        (("poses", 2, "pose", "transform", "center"), ["1", "nan", "2"], "center"),
        (("poses", 2, "pose"), None, "pose"),
        (("poses",), [], "poses"),
        (("intrinsics", 0, "type"), "3deanamorphic4", "type"),
        (("intrinsics", 0, "undistortionType"), "3declassicld", "type"),
        (("intrinsics", 0, "focalLength"), "-1", "views"),
        (("intrinsics", 0, "focalLength"), None, "focalLength"),
        (("intrinsics", 0, "pixelRatio"), "0", "pixelRatio"),
        (("intrinsics", 0, "width"), "0", "views"),
        (("intrinsics", 0, "principalPoint"), {"x": 1}, "principalPoint"),
        (("structure", 0, "X"), ["1"], "X"),
        (("version",), ["one"], "version"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, at, value, field):
    content = scene()
    put(content, at, value)
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, content))
    assert caught.value.file.name == "cameras.sfm" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_deeply_nested_files_end_in_an_error(tmp_path):
    deep = '{"viewId": ' + "[" * 200_000 + "]" * 200_000 + "}"
    assert outcome(write(tmp_path, deep)) is None
    content = scene()
    content["views"] = {"viewId": nested(500)}
    assert outcome(write(tmp_path, content)) is None


def test_alicevisions_binary_form_is_named(tmp_path):
    (tmp_path / "sfmData.sfm").write_bytes(b"\x14\0\0\0ASFM" + bytes(64))
    with pytest.raises(CaptureError, match="binary form, which is not supported; convert it to JSON by"):
        read_capture(tmp_path)
