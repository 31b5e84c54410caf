"""Folders of poses: NSVF's lens, splits and box, ScanNet's lost cameras, hostile files."""

import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import pose_folder
from solver.capture.read import read_capture, reader_of
from tests.capture.layouts import (
    DUCK,
    check_same_cameras,
    matrix_of,
    rewritten,
    rows,
    write,
    write_poses,
)
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    numbers,
    outcome,
    poses,
    save_photos,
    spoilt,
)

LENS = 80.0, 82.0, 50.5, 30.25
NSVF = [f"0_train_{index:04d}" for index in range(COUNT)]
SCANNET = [str(index) for index in range(COUNT)]
COLOUR_LENS = "intrinsic/intrinsic_color.txt"


def make_nsvf(folder, lens=LENS, lens_text=None, photos="rgb", stems=NSVF, size=(WIDTH, HEIGHT)):
    save_photos(folder / photos, stems, size)
    return write_poses(folder, stems, poses(len(stems)), lens, lens_text=lens_text)


def make_scannet(folder, stems=SCANNET):
    save_photos(folder / "color", stems, extension=".jpg")
    save_photos(folder / "depth", stems, (48, 32))
    write(folder / "intrinsic" / "intrinsic_depth.txt", rows(np.eye(4)))
    write(folder / "intrinsic" / "extrinsic_color.txt", rows(np.eye(4)))
    return write_poses(folder, stems, poses(len(stems)), LENS, COLOUR_LENS)


def make_nerf_plus_plus(folder, lenses, sides=4):
    """Returns the folder of the scene; photos are held out in `test`, and of a camera path there are none."""
    for split, count in (("train", COUNT), ("test", 3)):
        stems = [f"{index:03d}" for index in range(count)]
        save_photos(folder / split / "rgb", stems)
        for stem, pose, (fx, fy, cx, cy) in zip(stems, poses(count), lenses, strict=False):
            lens = np.eye(sides)
            lens[:2, :3] = [[fx, 0, cx], [0, fy, cy]]
            for kind, matrix in (("intrinsics", lens), ("pose", pose)):
                line = " ".join(map(repr, matrix.ravel().tolist())) + "\n"
                write(folder / split / kind / f"{stem}.txt", line)
    write(folder / "camera_path" / "pose" / "000.txt", rows(np.eye(4)))
    return folder


def make_reference_views(folder, by_bundle_sdf=False):
    """As FoundationPose's `run_one_ob` reads them, or with what BundleSDF writes."""
    stems = [f"{index:07d}" for index in range(COUNT)]
    for place in ("color_segmented" if by_bundle_sdf else "rgb", "mask", "depth_enhanced"):
        save_photos(folder / place, stems)
    for stem, pose in zip(stems, poses(), strict=True):
        kind = ("ob_in_cam", np.linalg.inv(pose)) if by_bundle_sdf else ("cam_in_ob", pose)
        write(folder / kind[0] / f"{stem}.txt", rows(kind[1]))
    write(folder / ("cam_K.txt" if by_bundle_sdf else "K.txt"), rows(matrix_of(*LENS)))
    write(folder / "select_frames.yml", "[]")
    return folder


def pinhole(fx, fy, cx, cy):
    def project(index, point):
        x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
        return fx * x / z + cx, fy * y / z + cy

    return project


def test_nsvfs_points_project_where_its_matrices_have_them(tmp_path):
    capture = read_capture(make_nsvf(tmp_path))
    assert capture.format == "NSVF" and not capture.warnings and not capture.metric
    check_projection(capture, pinhole(*LENS), poses())


def test_scannets_points_project_where_its_matrices_have_them(tmp_path):
    capture = read_capture(make_scannet(tmp_path))
    assert capture.format == "ScanNet" and not capture.warnings and capture.metric
    assert {camera.image_path.parent.name for camera in capture.cameras} == {"color"}
    check_projection(capture, pinhole(*LENS), poses())


@pytest.mark.parametrize("by_bundle_sdf", [False, True])
@pytest.mark.parametrize("given_as", ["", "{poses}", "{poses}/0000003.txt", "{lens}", ".."])
def test_reference_views_of_an_object_are_read_with_their_masks(tmp_path, by_bundle_sdf, given_as):
    folder = make_reference_views(tmp_path / "ref_views" / "ob_0000001", by_bundle_sdf)
    named = (
        dict(poses="ob_in_cam", lens="cam_K.txt")
        if by_bundle_sdf
        else dict(poses="cam_in_ob", lens="K.txt")
    )
    capture = read_capture(folder / given_as.format(**named))
    assert capture.format == "FoundationPose" and not capture.warnings and capture.metric
    check_projection(capture, pinhole(*LENS[:2], LENS[2] + 0.5, LENS[3] + 0.5), poses())
    for camera in capture.cameras:
        assert camera.image_path.parent.name == ("color_segmented" if by_bundle_sdf else "rgb")
        assert camera.mask_path.parent.name == "mask"
        assert camera.mask_path.name == camera.image_path.name


@pytest.mark.parametrize("given", ["scene", "train", "pose", "lens"])
@pytest.mark.parametrize("sides", [3, 4])
def test_nerf_plus_pluss_photos_have_a_lens_each(tmp_path, given, sides):
    lenses = [(80.0 + index, 82.0 - index, 50.5, 30.25 + index) for index in range(COUNT)]
    scene = make_nerf_plus_plus(tmp_path, lenses, sides)
    train = scene / "train"
    places = {
        "scene": scene, "train": train, "pose": train / "pose" / "002.txt",
        "lens": train / "intrinsics" / "002.txt",
    }  # fmt: skip
    capture = read_capture(places[given])
    assert capture.format == "NeRF++" and not capture.warnings and len(capture.cameras) == COUNT
    assert {camera.image_path.parent for camera in capture.cameras} == {train / "rgb"}
    check_projection(capture, lambda index, point: pinhole(*lenses[index])(index, point), poses())


def test_a_photos_lens_that_is_missing_is_named(tmp_path):
    scene = make_nerf_plus_plus(tmp_path, [LENS] * COUNT)
    (scene / "train" / "intrinsics" / "003.txt").unlink()
    with pytest.raises(CaptureError, match=r"intrinsics.003\.txt"):
        read_capture(scene)


@pytest.mark.parametrize("layout", ["NSVF", "ScanNet"])
def test_a_capture_in_this_layout_has_the_cameras_of_its_transforms(tmp_path, layout):
    original = read_capture(DUCK)
    capture = read_capture(rewritten(original, tmp_path / "duck", layout))
    check_same_cameras(capture, original)
    np.testing.assert_allclose(capture.region, original.region, atol=1e-6)


@pytest.mark.parametrize(
    "text, fy",
    [
        (rows(matrix_of(*LENS)), LENS[1]),
        (rows(matrix_of(*LENS, 4)) + "\n\n", LENS[1]),
        (rows(matrix_of(*LENS, 4)[:3]), LENS[1]),
        ("80. 50.5 30.25 0.\n0. 0. 0.\n1.\n64 96\n", LENS[0]),
        ("8.0e+01 50.5 30.25\n0 0 0\n0\n1\n64 96", LENS[0]),
        ("\ufeff80 50.5 30.25 0.", LENS[0]),
    ],
)
def test_the_lens_is_a_matrix_or_begins_with_its_focal_length_and_centre(tmp_path, text, fy):
    capture = read_capture(make_nsvf(tmp_path, lens_text=text))
    check_projection(capture, pinhole(LENS[0], fy, *LENS[2:]), poses())


@pytest.mark.parametrize("given_as", ["", "pose", "pose/0_train_0003.txt", "intrinsics.txt", ".."])
def test_the_folder_its_poses_or_any_one_of_its_files_stand_for_all(tmp_path, given_as):
    make_nsvf(tmp_path / "sets" / "Bike")
    write(tmp_path / "sets" / "Bike" / "near_and_far.txt", "0.05 6.0")
    capture = read_capture(tmp_path / "sets" / "Bike" / given_as)
    assert [camera.name for camera in capture.cameras] == NSVF


@pytest.mark.parametrize("given_as", ["", "extrinsic", "extrinsic/0_train_0003.txt", "intrinsics.txt"])
def test_nsvfs_matrices_may_be_from_the_world_to_the_camera(tmp_path, given_as):
    folder = make_nsvf(tmp_path)
    shutil.rmtree(folder / "pose")
    for stem, pose in zip(NSVF, poses(), strict=True):
        write(folder / "extrinsic" / f"{stem}.txt", rows(np.linalg.inv(pose)))
    check_projection(read_capture(folder / given_as), pinhole(*LENS), poses())
    write(folder / "extrinsic" / f"{NSVF[1]}.txt", rows(np.diag([1.0, 1, 0, 1])))
    with pytest.raises(CaptureError, match=r"0_train_0001\.txt: the pose's rotation is singular"):
        read_capture(folder / given_as)


@pytest.mark.parametrize("given_as", ["", "pose", "pose/3.txt", "intrinsic", COLOUR_LENS, ".."])
def test_so_it_is_with_scannets(tmp_path, given_as):
    make_scannet(tmp_path / "scans" / "scene0000_00")
    capture = read_capture(tmp_path / "scans" / "scene0000_00" / given_as)
    assert [camera.name for camera in capture.cameras] == SCANNET


def test_of_a_folder_of_scenes_none_is_taken(tmp_path):
    for name in ("Bike", "Robot"):
        make_nsvf(tmp_path / name)
    with pytest.raises(CaptureError, match=r"several captures \(Bike, Robot\); give the folder of"):
        read_capture(tmp_path)


def test_numbers_in_names_are_counted(tmp_path):
    stems = ["0", "10", "100", "20", "3"]
    cameras = read_capture(make_scannet(tmp_path, stems)).cameras
    assert [camera.name for camera in cameras] == ["0", "3", "10", "20", "100"]


def test_photos_for_validation_and_tests_are_left_out(tmp_path):
    stems = [*NSVF, "1_val_0000", "2_test_0000", "2_test_0001"]
    capture = read_capture(make_nsvf(tmp_path, stems=stems))
    assert [camera.name for camera in capture.cameras] == NSVF
    assert "3 photos for validation and tests (1_…, 2_…) are left out" in capture.warnings[0]


@pytest.mark.parametrize("stems", [["0_a", "1_a", "3_a"], ["1_a", "2_a", "2_b"], ["0", "1", "2"]])
def test_other_numbers_in_names_say_nothing_of_tests(tmp_path, stems):
    capture = read_capture(make_nsvf(tmp_path, stems=stems))
    assert [camera.name for camera in capture.cameras] == stems and not capture.warnings


def test_the_box_is_the_region(tmp_path):
    folder = make_nsvf(tmp_path)
    middle = read_capture(folder).region.mean(0)
    box = np.stack([middle - (1, 2, 3), middle + (3, 2, 1)])
    write(folder / "bbox.txt", numbers(box) + " 0.4\n")
    np.testing.assert_array_equal(read_capture(folder).region, box)


@pytest.mark.parametrize(
    "text", ["", "1 2 3", "1 1 1 0 0 0 0.4", "nan 0 0 1 1 1 0.4", "-1 -1 -1 1 1 inf", "a b c d e f",
             "900 900 900 901 901 901 0.4", "-1e300 -1 -1 1e300 1 1"],
)  # fmt: skip
def test_a_box_that_makes_no_sense_is_not_used(tmp_path, text):
    folder = make_nsvf(tmp_path)
    region = read_capture(folder).region
    write(folder / "bbox.txt", text)
    capture = read_capture(folder)
    assert "bbox.txt: this is not a box that the cameras look at" in capture.warnings[0]
    np.testing.assert_array_equal(capture.region, region)


@pytest.mark.parametrize("word", ["-inf", "nan", "0"])
def test_lost_cameras_are_left_out(tmp_path, word):
    folder = make_scannet(tmp_path)
    write(folder / "pose" / "1.txt", "\n".join([" ".join([word] * 4)] * 4))
    capture = read_capture(folder)
    assert [camera.name for camera in capture.cameras] == ["0", "2", "3", "4"]
    assert "1 of 5 photos has no pose and is left out (the first: color/1)" in capture.warnings[0]


def test_where_all_are_lost_that_is_said(tmp_path):
    folder = make_scannet(tmp_path)
    for stem in SCANNET:
        write(folder / "pose" / f"{stem}.txt", "-inf " * 16)
    with pytest.raises(CaptureError, match="poses: none of its 5 photos has a pose; solve or"):
        read_capture(folder)


def test_the_lens_follows_photos_that_were_made_smaller(tmp_path):
    lens = 1170.187988, 1170.187988, 647.75, 483.75
    folder = make_nsvf(tmp_path, lens, photos="images", size=(648, 484))
    capture = read_capture(folder)
    assert "another size for 5 of 5 photos" in capture.warnings[0]
    camera = capture.cameras[0]
    assert (camera.width, camera.height) == (648, 484)
    np.testing.assert_allclose((camera.fx, camera.cx, camera.cy), np.array((lens[0], *lens[2:])) / 2, 1e-3)


@pytest.mark.parametrize("columns", [12, 16])
def test_poses_may_have_three_rows_or_stand_in_one_line(tmp_path, columns):
    folder = make_nsvf(tmp_path)
    for stem, pose in zip(NSVF, poses(), strict=True):
        write(folder / "pose" / f"{stem}.txt", numbers(pose.ravel()[:columns]))
    check_projection(read_capture(folder), pinhole(*LENS), poses())


def test_masks_lie_beside_the_photos_folder(tmp_path):
    folder = make_nsvf(tmp_path)
    save_photos(folder / "mask", NSVF)
    assert all(camera.mask_path.parent.name == "mask" for camera in read_capture(folder).cameras)


@pytest.mark.parametrize(
    "file, text, problem",
    [
        ("intrinsics.txt", "1 2", "this is neither a lens's matrix nor a line f cx cy"),
        ("intrinsics.txt", "9 x 9 0.", "this is not a 3 × 3 matrix"),
        ("intrinsics.txt", "0 48 32 0.", "the lens has a value that no lens can have"),
        ("intrinsics.txt", "nan 48 32 0.", "this is not a lens's matrix"),
        ("pose/0_train_0002.txt", "1 0 0 0", "this is not a 4 × 4 matrix"),
        ("pose/0_train_0002.txt", "", "this is not a 4 × 4 matrix"),
        ("pose/0_train_0002.txt", "1 0 0 0 0 -1 0 0 0 0 1 0", "the pose mirrors the world"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, file, text, problem):
    folder = make_nsvf(tmp_path)
    write(folder / file, text)
    with pytest.raises(CaptureError, match=rf"{file.split('/')[-1]}.*{problem}"):
        read_capture(folder)


def test_a_lens_or_poses_alone_are_no_capture(tmp_path):
    folder = make_nsvf(tmp_path)
    shutil.move(folder / "pose", tmp_path / "elsewhere")
    assert reader_of(folder / "intrinsics.txt") is None
    assert reader_of(tmp_path / "elsewhere" / f"{NSVF[0]}.txt") is None
    shutil.move(tmp_path / "elsewhere", folder / "pose")
    assert reader_of(folder / "intrinsics.txt") is pose_folder
    write(folder / "notes.txt", "1 2 3")
    assert reader_of(folder / "notes.txt") is None


@RANDOM_TESTS
@given(data=st.data(), make=st.sampled_from([make_nsvf, make_scannet, make_reference_views]))
def test_cut_and_shuffled_files_end_in_a_capture_or_an_error(tmp_path, data, make):
    folder = make(tmp_path / make.__name__)
    write(folder / "bbox.txt", "-9 -9 -9 9 9 9 0.4")
    file = data.draw(st.sampled_from(sorted(folder.rglob("*.txt"))))
    spoilt(data, file, data.draw(st.sampled_from([" ", "\n"])))
    outcome(folder)


@RANDOM_TESTS
@given(content=st.binary(max_size=300), name=st.sampled_from(["intrinsics.txt", f"pose/{NSVF[2]}.txt"]))
def test_any_bytes_end_in_an_error(tmp_path, content, name):
    folder = make_nsvf(tmp_path)
    (folder / name).write_bytes(content)
    assert outcome(folder) is None
