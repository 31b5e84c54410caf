"""Data sets of shiny objects in the layouts in which they are published, as far as nothing else tests them."""

import json

import numpy as np
import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.read import read_capture
from tests.capture.programs import COUNT, names, poses, save_photos
from tests.capture.test_capture import pose
from tests.capture.test_radiance_fields import make_neus

VIEWS = ("CA2", "CB5", "NA3", "NE7")


def picture(file, mode="RGB"):
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((8, 8, 4), 128, np.uint8)).convert(mode).save(file)


def transforms(file, names):
    frames = [{"file_path": name, "transform_matrix": pose(i).tolist()} for i, name in enumerate(names)]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))


def parts(folder, cameras, what="image_path"):
    return [getattr(camera, what).relative_to(folder).as_posix() for camera in cameras]


def test_stanford_orb_has_masks_beside_each_splits_photos(tmp_path):
    scene = tmp_path / "blender_LDR" / "teapot_scene001"
    stems = [f"{i:04d}" for i in range(4)]
    for split in ("train", "test"):
        for stem in stems:
            picture(scene / split / f"{stem}.png")
            picture(scene / f"{split}_mask" / f"{stem}.png", "L")
        transforms(scene / f"transforms_{split}.json", [f"./{split}/{stem}" for stem in stems])
    transforms(scene / "transforms_novel.json", [f"./novel/{stem}" for stem in stems])
    for split in ("train", "test"):
        cameras = read_capture(scene, split).cameras
        assert parts(scene, cameras) == [f"{split}/{stem}.png" for stem in stems]
        assert parts(scene, cameras, "mask_path") == [f"{split}_mask/{stem}.png" for stem in stems]


def test_shiny_blender_has_normals_and_masks_beside_its_photos(tmp_path):
    for i in range(4):
        for kind in ("", "_alpha", "_disp", "_normal"):
            picture(tmp_path / "train" / f"r_{i}{kind}.png", "RGBA" if not kind else "RGB")
    transforms(tmp_path / "transforms_train.json", [f"./train/r_{i}" for i in range(4)])
    cameras = read_capture(tmp_path).cameras
    assert parts(tmp_path, cameras) == [f"train/r_{i}.png" for i in range(4)]
    assert not any(camera.mask_path for camera in cameras)


def test_openilluminations_training_cameras_serve_the_photos_of_one_light(tmp_path):
    for light in ("001", "013"):
        for view in VIEWS:
            picture(tmp_path / "Lights" / light / "raw_undistorted" / f"{view}.JPG")
    for kind in ("com_masks", "obj_masks"):
        for view in VIEWS:
            picture(tmp_path / "output" / kind / f"{view}.png", "L")
    transforms(tmp_path / "output" / "transforms_alignz_test.json", ["./images/NE7"] * 3)
    names = [f"./images/{view}" for view in VIEWS[:3]]
    transforms(tmp_path / "output" / "transforms_alignz_train.json", names)
    with pytest.raises(CaptureError, match="or give the folder of the photos"):
        read_capture(tmp_path)
    photos, masks = (
        tmp_path / "Lights" / "013" / "raw_undistorted",
        tmp_path / "output" / "obj_masks",
    )
    cameras = read_capture(tmp_path, photos=photos, masks=masks).cameras
    assert parts(photos, cameras) == [f"{view}.JPG" for view in VIEWS[:3]]
    assert parts(masks, cameras, "mask_path") == [f"{view}.png" for view in VIEWS[:3]]


def test_tensoirs_views_lie_in_folders_of_their_own(tmp_path):
    for i in range(4):
        for kind in ("rgba", "rgba_sunset", "albedo", "normal"):
            picture(tmp_path / f"train_{i:03d}" / f"{kind}.png", "RGBA")
    transforms(tmp_path / "transforms_train.json", [f"./train_{i:03d}/rgba" for i in range(4)])
    cameras = read_capture(tmp_path).cameras
    assert parts(tmp_path, cameras) == [f"train_{i:03d}/rgba.png" for i in range(4)]
    assert len({camera.name for camera in cameras}) == 4


def test_mobilebricks_processed_cameras_are_neuss_with_masks(tmp_path):
    make_neus(tmp_path, name="cameras.npz")
    for folder in ("mask", "arkit_depth", "gt_depth"):
        save_photos(tmp_path / folder)
    for stem, matrix in zip(names(), poses(), strict=True):
        for folder, values in (("intrinsic", np.eye(3)), ("pose", matrix)):
            (tmp_path / folder).mkdir(exist_ok=True)
            np.savetxt(tmp_path / folder / f"{stem}.txt", values)
    capture = read_capture(tmp_path)
    assert capture.format == "NeuS" and len(capture.cameras) == COUNT
    for kind, what in (("image", "image_path"), ("mask", "mask_path")):
        assert {getattr(camera, what).parent.name for camera in capture.cameras} == {kind}


def test_monosdfs_depths_and_normals_are_not_taken_for_photos(tmp_path):
    make_neus(tmp_path, name="cameras.npz", photos="images")
    for folder in ("depths", "normals"):
        save_photos(tmp_path / folder)
    cameras = read_capture(tmp_path).cameras
    assert len(cameras) == COUNT and {camera.image_path.parent.name for camera in cameras} == {"images"}


def test_dvrs_shapenet_whose_world_mat_is_a_pose_is_refused(tmp_path):
    make_neus(tmp_path, np.linalg.inv(poses()), name="cameras.npz")
    with pytest.raises(CaptureError, match="world_mat_0: it does not lead to pixels"):
        read_capture(tmp_path)
