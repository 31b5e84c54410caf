"""MVSNet's cameras: its projection, BlendedMVS' and DTU's photos, lenses for other sizes, hostile files."""

import os
import re
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture import camera_folder
from solver.capture.errors import CaptureError
from solver.capture.formats import mvsnet
from solver.capture.read import CAMERA_FILES, read_capture, reader_of
from tests.capture.layouts import DUCK, check_same_cameras, rewritten, write_mvsnet
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    outcome,
    poses,
    save_photos,
    spoilt,
)

LENS = 80.0, 82.0, 50.5, 30.25
STEMS = [f"{index:08d}" for index in range(COUNT)]


def make(folder, photos="images", lens=LENS, size=(WIDTH, HEIGHT), stems=STEMS, **options):
    save_photos(folder / photos, stems, size)
    return write_mvsnet(folder, poses(), lens, **options)


def project(index, point):
    """K [R | t] of the file, number by number."""
    x, y, z, _ = np.linalg.inv(poses()[index]) @ [*point, 1]
    return LENS[0] * x / z + LENS[2], LENS[1] * y / z + LENS[3]


@pytest.mark.parametrize("cams", ["cams", "cams_1", "Cameras"])
@pytest.mark.parametrize("depths", ["", "425.0 2.5", "425 2.5 192", "425 2.5 192.0 933.8", "0 -1"])
def test_points_project_where_the_file_has_them(tmp_path, cams, depths):
    capture = read_capture(make(tmp_path, cams=cams, depths=depths))
    assert capture.format == "MVSNet" and not capture.warnings
    check_projection(capture, project, poses())


def test_a_capture_in_this_layout_has_the_cameras_of_its_transforms(tmp_path):
    original = read_capture(DUCK)
    capture = read_capture(rewritten(original, tmp_path / "duck", "MVSNet"))
    check_same_cameras(capture, original)
    np.testing.assert_allclose(capture.region, original.region, atol=1e-6)


@pytest.mark.parametrize("given_as", ["", "cams", "cams/00000003_cam.txt", ".."])
def test_the_folder_its_cameras_or_any_one_of_them_stand_for_all(tmp_path, given_as):
    make(tmp_path / "scan9" / "scene")
    capture = read_capture(tmp_path / "scan9" / "scene" / given_as)
    assert [camera.name for camera in capture.cameras] == STEMS


def test_masked_copies_of_photos_are_no_photos_and_no_masks(tmp_path):
    folder = make(tmp_path, "blended_images")
    save_photos(folder / "blended_images", [f"{stem}_masked" for stem in STEMS])
    save_photos(folder / "rendered_depth_maps", STEMS)
    cameras = read_capture(folder).cameras
    assert [camera.image_path.stem for camera in cameras] == STEMS
    assert {camera.image_path.parent.name for camera in cameras} == {"blended_images"}
    assert all(camera.mask_path is None for camera in cameras)


def test_of_a_folder_of_projects_none_is_taken(tmp_path):
    for name in ("5a3ca9cb", "5a8aa0fa"):
        make(tmp_path / name, "blended_images")
    both = ", ".join(os.path.join(name, "cams") for name in ("5a3ca9cb", "5a8aa0fa"))
    with pytest.raises(CaptureError, match=re.escape(f"several captures ({both})")):
        read_capture(tmp_path)
    shutil.rmtree(tmp_path / "5a3ca9cb")
    assert len(read_capture(tmp_path).cameras) == COUNT


def test_photos_may_be_given_by_their_folder(tmp_path):
    make(tmp_path / "scene")
    (tmp_path / "scene" / "images").rename(tmp_path / "photos")
    with pytest.raises(CaptureError, match="5 of 5 photos are missing, the first is 'images/0000"):
        read_capture(tmp_path / "scene")
    assert len(read_capture(tmp_path / "scene", photos=tmp_path / "photos").cameras) == COUNT


def test_dtus_training_cameras_are_for_a_quarter_of_its_photos(tmp_path):
    size, lens = (640, 512), (361.54125, 360.3975, 82.900625, 66.383875)
    stems = [f"rect_{index + 1:03d}_{light}_r5000" for index in range(COUNT) for light in (2, 3)]
    folder = make(tmp_path, "Rectified/scan1_train", lens, size, stems, cams="Cameras/train")
    capture = read_capture(folder / "Cameras" / "train", photos=folder / "Rectified")
    assert "another size for 5 of 5 photos" in capture.warnings[0]
    for index, camera in enumerate(capture.cameras):
        assert camera.image_path.stem == f"rect_{index + 1:03d}_3_r5000"
        assert (camera.width, camera.height) == size
        np.testing.assert_allclose((camera.fx, camera.fy, camera.cx, camera.cy), 4 * np.array(lens))


def test_of_dtus_folders_it_is_said_which_to_give(tmp_path):
    size, lens = (640, 512), (361.54125, 360.3975, 82.900625, 66.383875)
    stems = [f"rect_{index + 1:03d}_3_r5000" for index in range(COUNT)]
    make(tmp_path, "Rectified/scan1_train", lens, size, stems, cams="Cameras/train")
    scan, cameras = tmp_path / "Rectified" / "scan1_train", tmp_path / "Cameras"
    write_mvsnet(tmp_path, poses(), (2892.33, 2883.18, 823.205, 619.071), cams="Cameras")
    with pytest.raises(CaptureError, match="give .*Cameras.train, and this folder as the photos'"):
        read_capture(scan)
    with pytest.raises(CaptureError, match="cameras are for, or .*Cameras.train for those that DTU's"):
        read_capture(cameras, photos=scan)
    assert len(read_capture(cameras / "train", photos=scan).cameras) == COUNT


@pytest.mark.parametrize("scale", [0.5, 2.5, 10.0])
def test_a_lens_for_photos_of_any_other_size_is_refused(tmp_path, scale):
    folder = make(tmp_path, lens=np.array((80, 82, 49, 31.5)) * scale)
    with pytest.raises(CaptureError, match=r"00000000_cam.txt, intrinsic: its centre .* of another"):
        read_capture(folder)


def test_a_centre_that_is_off_in_one_direction_is_a_cut_photos(tmp_path):
    camera = read_capture(make(tmp_path, lens=(80, 80, 48, 10))).cameras[0]
    assert (camera.cx, camera.cy) == (48, 10)


def test_cameras_without_a_pose_are_left_out(tmp_path):
    folder = make(tmp_path)
    file = folder / "cams" / "00000002_cam.txt"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([lines[0], *["nan nan nan nan"] * 4, *lines[5:]]))
    capture = read_capture(folder)
    assert [camera.name for camera in capture.cameras] == STEMS[:2] + STEMS[3:]
    assert "1 of 5 photos has no pose and is left out (the first: images/00000002)" in capture.warnings[0]


@pytest.mark.parametrize(
    "old, new, problem",
    [
        ("intrinsic", "intrinsics", "extrinsic: this is not a 4 × 4 matrix"),
        ("80.0", "eighty", "intrinsic: this is not a 3 × 3 matrix"),
        ("80.0 0.0", "80.0 9.0", r"intrinsic: its pixels are not rectangles \(skew\)"),
        ("0.0 82.0", "5.0 82.0", "intrinsic: this is not a lens's matrix"),
        ("0.0 0.0 1.0\n\n425", "0.0 0.0 0.0\n\n425", "intrinsic: this is not a lens's matrix"),
        ("80.0 ", "-80.0 ", "the lens has a value that no lens can have"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, old, new, problem):
    folder = make(tmp_path)
    file = folder / "cams" / "00000001_cam.txt"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(CaptureError, match=rf"00000001_cam.txt.*{problem}"):
        read_capture(folder)


def test_an_empty_or_huge_camera_is_named(tmp_path):
    folder = make(tmp_path)
    file = folder / "cams" / "00000001_cam.txt"
    file.write_text("")
    with pytest.raises(CaptureError, match="00000001_cam.txt, extrinsic: this is not a 4 × 4 matrix"):
        read_capture(folder)
    file.write_text("extrinsic " + "0 " * (1 << 20))
    with pytest.raises(CaptureError, match="00000001_cam.txt: it has more than 1 MB"):
        read_capture(folder)


def test_hidden_files_do_not_count_and_too_many_are_refused(tmp_path, monkeypatch):
    folder = make(tmp_path)
    (folder / "cams" / "._00000000_cam.txt").write_bytes(b"\0\5\x16\7")
    monkeypatch.setattr(camera_folder, "MOST_FILES", COUNT + 1)
    assert len(read_capture(folder).cameras) == COUNT
    monkeypatch.setattr(camera_folder, "MOST_FILES", COUNT)
    with pytest.raises(CaptureError, match=r"cams: it holds 6 files \.txt; leave only the cameras"):
        read_capture(folder)


def test_pictures_that_are_to_be_made_need_photos_for_their_size(tmp_path):
    folder = make(tmp_path)
    assert len(read_capture(folder, wanted=False).cameras) == COUNT
    shutil.rmtree(folder / "images")
    with pytest.raises(CaptureError, match="which tells the camera's size, is missing; add it, or"):
        read_capture(folder, wanted=False)


def test_only_cameras_are_recognised(tmp_path):
    folder = make(tmp_path)
    assert reader_of(folder / "cams" / "00000000_cam.txt") is mvsnet
    assert reader_of(folder / "cams" / "pair.txt") is None
    assert ".txt" in CAMERA_FILES


@RANDOM_TESTS
@given(data=st.data())
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data):
    folder = make(tmp_path)
    file = folder / "cams" / f"{data.draw(st.sampled_from(STEMS))}_cam.txt"
    spoilt(data, file, " ")
    outcome(folder)


@RANDOM_TESTS
@given(
    content=st.binary(max_size=300),
    begin=st.sampled_from([b"", b"extrinsic ", b"extrinsic intrinsic "]),
)
def test_any_bytes_end_in_an_error(tmp_path, content, begin):
    folder = make(tmp_path)
    (folder / "cams" / "00000000_cam.txt").write_bytes(begin + content)
    assert outcome(folder) is None
