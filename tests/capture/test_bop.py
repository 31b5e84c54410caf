"""BOP's scenes: cameras of the world or of one object, masks, sensors, and files that are none."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import bop
from solver.capture.read import read_capture
from tests.capture.hostile import VALUES, reads_or_refuses
from tests.capture.programs import COUNT, RANDOM_TESTS, check_projection, poses, save_photos

LENS = np.array([[80.0, 0, 47.5], [0, 90.0, 31.5], [0, 0, 1]])
STEMS = [f"{i:06d}" for i in range(COUNT)]


def pose_of(from_world, to):
    return {f"cam_R_{to}": from_world[:3, :3].ravel().tolist(), f"cam_t_{to}": from_world[:3, 3].tolist()}


def make(folder, of_world=True, of_objects=(1,), sensor="", photos="rgb", edit=None):
    """As `write_frames` of BlenderProc's BopWriterUtility writes it; without `of_world` and with one object as
    sets for onboarding are. Objects beyond the first are elsewhere in the world."""
    save_photos(folder / f"{photos}{sensor}", STEMS)
    save_photos(folder / f"depth{sensor}", STEMS)
    cameras, objects = {}, {}
    for i, (stem, from_world) in enumerate(zip(STEMS, np.linalg.inv(poses()), strict=True)):
        cameras[str(i)] = {"cam_K": LENS.ravel().tolist(), "depth_scale": 1.0}
        cameras[str(i)] |= pose_of(from_world, "w2c") if of_world else {}
        objects[str(i)] = []
        for at, name in enumerate(of_objects):
            model = np.eye(4)
            model[0, 3] = at
            objects[str(i)].append({**pose_of(from_world @ model, "m2c"), "obj_id": name})
            for kind in ("mask", "mask_visib"):
                save_photos(folder / f"{kind}{sensor}", [f"{stem}_{at:06d}"])
    if edit is not None:
        edit(cameras, objects)
    (folder / f"scene_camera{sensor}.json").write_text(json.dumps(cameras))
    if of_objects:
        (folder / f"scene_gt{sensor}.json").write_text(json.dumps(objects))
        (folder / f"scene_gt_info{sensor}.json").write_text(json.dumps({"0": [{"px_count_all": 9}]}))
    return folder


def project(index, point):
    x, y, z = LENS @ (np.linalg.inv(poses()[index]) @ [*point, 1])[:3]
    return x / z + 0.5, y / z + 0.5


def masks(capture):
    return {camera.mask_path for camera in capture.cameras}


@pytest.mark.parametrize(
    "given_as", ["", "train_pbr", "train_pbr/000000", "train_pbr/000000/scene_camera.json"]
)
@pytest.mark.parametrize("of_world", [True, False])
def test_points_project_as_k_of_r_and_t_of_the_world_or_of_an_object_that_is_alone(
    tmp_path, of_world, given_as
):
    (tmp_path / "camera.json").write_text('{"cx": 1, "cy": 2, "fx": 3, "fy": 4, "width": 96, "height": 64}')
    scene = make(tmp_path / "train_pbr" / "000000", of_world)
    capture = read_capture(tmp_path / given_as)
    assert capture.format == bop.NAME and not capture.warnings and not capture.metric
    check_projection(capture, project, poses())
    assert {camera.image_path.parent for camera in capture.cameras} == {scene / "rgb"}
    assert masks(capture) == {scene / "mask_visib" / f"{stem}_000000.png" for stem in STEMS}


@pytest.mark.parametrize("of_objects", [(), (1, 2), (1, 1)])
def test_a_scene_of_several_objects_or_none_has_no_masks(tmp_path, of_objects):
    capture = read_capture(make(tmp_path, of_objects=of_objects))
    check_projection(capture, project, poses())
    assert masks(capture) == {None}


@pytest.mark.parametrize("of_objects", [(), (1, 2)])
def test_several_objects_or_none_have_no_world_of_their_own(tmp_path, of_objects):
    make(tmp_path, of_world=False, of_objects=of_objects)
    with pytest.raises(
        CaptureError, match="0.cam_R_w2c: there is no pose; solve the cameras from the photos"
    ):
        read_capture(tmp_path)


def test_one_object_after_another_is_no_object_that_is_alone(tmp_path):
    make(tmp_path, edit=lambda cameras, objects: objects["2"][0].update(obj_id=7))
    assert masks(read_capture(tmp_path)) == {None}


def test_each_sensor_has_its_photos_and_masks(tmp_path):
    for sensor, photos in (("_aria", "rgb"), ("_quest", "gray")):
        make(tmp_path, sensor=sensor, photos=photos)
    for sensor, photos in (("_aria", "rgb"), ("_quest", "gray")):
        capture = read_capture(tmp_path / f"scene_camera{sensor}.json")
        assert {camera.image_path.parent.name for camera in capture.cameras} == {f"{photos}{sensor}"}
        assert {mask.parent.name for mask in masks(capture)} == {f"mask_visib{sensor}"}


def test_of_a_data_set_of_scenes_none_is_taken(tmp_path):
    for scene in ("000001", "000002"):
        make(tmp_path / "test" / scene)
    for given_as in (tmp_path, tmp_path / "test"):
        with pytest.raises(CaptureError, match="it holds several captures"):
            read_capture(given_as)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"cam_K": [1.0, 2.0]}, "2.cam_K"), ({"cam_K": [0.0] * 9}, "2.cam_K"), ({"cam_t_w2c": None}, "2.cam_t_w2c"),
        ({"cam_R_w2c": [0.0] * 9}, "2.cam_R_w2c"), ({"cam_R_w2c": "x"}, "2.cam_R_w2c"),
    ],
)  # fmt: skip
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, change, field):
    make(tmp_path, edit=lambda cameras, objects: cameras["2"].update(change))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path)
    assert caught.value.file.name == "scene_camera.json" and caught.value.field == field
    assert caught.value.remedy


@RANDOM_TESTS
@given(
    key=st.sampled_from(["cam_K", "cam_R_w2c", "cam_t_w2c", "cam_R_m2c", "obj_id"]), value=VALUES,
    of_world=st.booleans(),
)  # fmt: skip
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, key, value, of_world):
    def edit(cameras, objects):
        cameras["1"].update({key: value} if "m2c" not in key else {})
        objects["1"][0].update({key: value})

    reads_or_refuses(make(tmp_path, of_world, edit=edit))
