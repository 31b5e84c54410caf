"""OpenMVG's sfm_data.json: its lenses' formulas, cereal's pointers, and hostile files.

Files are written here as OpenMVG 1.x and 2.x write them through cereal (`sfm_data_io_cereal.cpp` and
`cameras/*_io.hpp`).
"""

import json
import math

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
    poses,
    put,
    save_photos,
)

F, CX, CY = 80.0, 49.5, 30.25
K1, K3, T2 = (-0.08,), (-0.08, 0.03, 0.01), (-0.08, 0.03, 0.01, 0.004, -0.003)
FISHEYE = (0.05, -0.01, 0.002, 0.001)
KEYS = {"pinhole_radial_k1": "disto_k1", "pinhole_radial_k3": "disto_k3",
        "pinhole_brown_t2": "disto_t2", "fisheye": "fisheye"}  # fmt: skip
FIRST = 1 << 31


def intrinsic(name="pinhole_radial_k3", k=K3, key=0, identity=FIRST + 1, nested=False):
    """`nested`: members of the base class in `value0`, as versions with `base_class` write them."""
    base = {"width": WIDTH, "height": HEIGHT, "focal_length": F, "principal_point": [CX, CY]}
    data = {"value0": base} if nested else dict(base)
    if name in KEYS:
        data[KEYS[name]] = list(k)
    value = {"polymorphic_id": identity}
    if identity >= FIRST:
        value["polymorphic_name"] = name
    return {"key": key, "value": {**value, "ptr_wrapper": {"id": FIRST + 60 + key, "data": data}}}


def scene(intrinsics=None, lens_of=lambda i: 0, order=range(COUNT), root="/home/other/vase/photos"):
    views, extrinsics = [], []
    for i in order:
        data = {"local_path": "", "filename": f"{names()[i]}.png", "width": WIDTH, "height": HEIGHT,
                "id_view": i, "id_intrinsic": lens_of(i), "id_pose": 30 + i}  # fmt: skip
        wrapper = {"id": FIRST + 1 + i, "data": data}
        views.append({"key": i, "value": {"polymorphic_id": 1 << 30, "ptr_wrapper": wrapper}})
        pose = {"rotation": poses()[i, :3, :3].T.tolist(), "center": poses()[i, :3, 3].tolist()}
        extrinsics.insert(0, {"key": 30 + i, "value": pose})
    observations = [{"key": 0, "value": {"id_feat": 3, "x": [1.0, 2.0]}}]
    structure = [{"key": 0, "value": {"X": [0.5, -1.0, 2.0], "observations": observations}}]
    return {
        "sfm_data_version": "0.3", "root_path": root, "views": views,
        "intrinsics": [intrinsic()] if intrinsics is None else intrinsics,
        "extrinsics": extrinsics, "structure": structure, "control_points": [],
    }  # fmt: skip


def write(folder, content, name="sfm_data.json"):
    save_photos(folder / "photos")
    (folder / name).write_text(
        content if isinstance(content, str) else json.dumps(content), encoding="utf-8"
    )
    return folder


def reference(name, k, to_camera, point):
    """`cam2ima(add_disto(p))`, number by number; pixels count from the centre of the first one there,
    from its corner here."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    if name == "fisheye":
        r = math.sqrt(r2)
        t = math.atan(r)
        scale = (t + k[0] * t**3 + k[1] * t**5 + k[2] * t**7 + k[3] * t**9) / r
        x, y = x * scale, y * scale
    elif name == "pinhole_brown_t2":
        k1, k2, k3, t1, t2 = k
        radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
        tx = t2 * (r2 + 2 * x * x) + 2 * t1 * x * y
        ty = t1 * (r2 + 2 * y * y) + 2 * t2 * x * y
        x, y = x + x * radial + tx, y + y * radial + ty
    else:
        scale = 1 + sum(value * r2 ** (i + 1) for i, value in enumerate(k))
        x, y = x * scale, y * scale
    return F * x + CX, F * y + CY


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize(
    "name, k",
    [
        ("pinhole", ()), ("pinhole_radial_k1", K1), ("pinhole_radial_k3", K3),
        ("pinhole_brown_t2", T2), ("fisheye", FISHEYE),
    ],
)  # fmt: skip
def test_points_project_as_openmvg_projects_them(tmp_path, name, k, nested):
    capture = read_capture(write(tmp_path, scene([intrinsic(name, k, nested=nested)])))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(name, k, to_camera[i], x), poses())
    assert capture.format == openmvg.NAME and not capture.warnings
    np.testing.assert_allclose(capture.points, [[0.5, -1, 2]])


def test_a_lens_is_named_only_where_its_type_comes_first(tmp_path):
    lenses = [
        intrinsic("pinhole_radial_k3", K3, 0, FIRST + 1),
        intrinsic("pinhole_brown_t2", T2, 1, FIRST + 2),
        intrinsic("pinhole_radial_k3", (0.0, 0.1, 0.0), 2, 1),
        intrinsic("pinhole_brown_t2", T2[::-1], 3, 2),
    ]
    own = [
        ("", K3),
        ("pinhole_brown_t2", T2),
        ("", (0.0, 0.1, 0.0)),
        ("pinhole_brown_t2", T2[::-1]),
    ]
    capture = read_capture(write(tmp_path, scene(lenses, lambda i: i % 4)))
    to_camera = np.linalg.inv(poses())
    for item in capture.cameras:
        index = int(item.name[-4:])
        point = poses()[index, :3, :3] @ (0.1, 0.2, 1.0) + poses()[index, :3, 3]
        wanted = reference(*own[index % 4], to_camera[index], point)
        np.testing.assert_allclose(item.project(point[None])[0][0], wanted, atol=1e-6)


def test_views_without_a_pose_are_left_out_with_a_warning(tmp_path):
    content = scene()
    content["extrinsics"].pop()
    content["views"][1]["value"]["ptr_wrapper"]["data"]["id_intrinsic"] = 4294967295
    capture = read_capture(write(tmp_path, content))
    assert len(capture.cameras) == COUNT - 2 and "no pose" in capture.warnings[0]


@pytest.mark.parametrize("root", ["D:\\Scans\\Vase\\photos", "/photos", "..", "photos", ""])
def test_photos_are_found_by_paths_of_another_machine(tmp_path, root):
    cameras = read_capture(write(tmp_path, scene(root=root))).cameras
    assert sorted(item.name for item in cameras) == names()


def test_of_a_project_the_scene_with_poses_is_read(tmp_path):
    write(tmp_path, scene(), "reconstruction.json")
    for folder, extrinsics in (
        ("matches", []),
        ("reconstruction_sequential", scene()["extrinsics"]),
    ):
        (tmp_path / folder).mkdir()
        content = json.dumps({**scene(), "extrinsics": extrinsics})
        (tmp_path / folder / "sfm_data.json").write_text(content)
    (tmp_path / "reconstruction.json").unlink()
    solved = tmp_path / "reconstruction_sequential"
    for given in (tmp_path, solved, solved / "sfm_data.json"):
        capture = read_capture(given)
        assert len(capture.cameras) == COUNT and capture.source == solved / "sfm_data.json"


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    for name in ("scene.json", "transforms.json", "cameras.sfm", "x.txt"):
        write(tmp_path / name, scene(), name)
        assert reader_of(tmp_path / name / name) is openmvg
        assert len(read_capture(tmp_path / name).cameras) == COUNT
    for reader in (transforms, meshroom):
        assert not reader.recognises(tmp_path / "scene.json" / "scene.json")


LENS = ("intrinsics", 0, "value")


@pytest.mark.parametrize(
    "at, value, field",
    [
        (("views", 1, "value"), None, "views[1]"),
        (("views", 1, "value", "ptr_wrapper", "data", "filename"), 3, "filename"),
        (("views",), {"a": 1}, "views"),
        (("extrinsics", 0, "value", "rotation"), [[1, 0, 0]], "rotation"),
        (("extrinsics", 0, "value", "rotation"), [[1, 1, 1]] * 3, "extrinsics[0]"),
        (("extrinsics", 0, "value", "center"), ["a", 1, 2], "center"),
        (("extrinsics", 0, "key"), "a", "key"),
        (("extrinsics",), [], "extrinsics"),
        ((*LENS, "polymorphic_name"), "cylindrical", "polymorphic_name"),
        ((*LENS, "polymorphic_name"), None, "polymorphic_name"),
        ((*LENS, "ptr_wrapper", "data", "focal_length"), "long", "focal_length"),
        ((*LENS, "ptr_wrapper", "data", "focal_length"), -1, "extrinsics"),
        ((*LENS, "ptr_wrapper", "data", "principal_point"), [1], "principal_point"),
        ((*LENS, "ptr_wrapper", "data", "disto_k3"), [1, 2], "disto_k3"),
        ((*LENS, "ptr_wrapper", "data", "width"), 0, "extrinsics"),
        (("structure", 0, "value", "X"), [1], "X"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, at, value, field):
    content = scene()
    put(content, at, value)
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, content))
    assert caught.value.file.name == "sfm_data.json" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_of_a_single_photo_without_a_pose_nothing_is_said_in_the_plural(tmp_path):
    content = scene(order=[0])
    content["extrinsics"] = []
    with pytest.raises(CaptureError, match="extrinsics: its photo has no pose; give"):
        read_capture(write(tmp_path, content))
