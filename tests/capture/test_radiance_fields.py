"""Cameras of programs for radiance fields: NeuS' projections, LLFF's table, Gaussian splats' list."""

import json
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from solver.cameras.output import write_points
from solver.capture.errors import CaptureError
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.read import read_capture
from tests.capture import programs
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    outcome,
)

FX, FY, CX, CY = 80.0, 82.0, 50.5, 30.25


def projections(cx=CX, cy=CY, skew=0.0):
    """World to pixels [COUNT, 4, 4], whole numbers pixels' centres; each of a scale and sign of its own."""
    k = np.array([[FX, skew, cx - 0.5], [0, FY, cy - 0.5], [0, 0, 1]])
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    for index, pose in enumerate(programs.poses()):
        matrices[index, :3] = k @ np.linalg.inv(pose)[:3] * (1, -1, 3e-3, -400, 1)[index]
    return matrices


def make_neus(folder, matrices=None, sphere=None, name="cameras_sphere.npz", photos="image"):
    arrays = {}
    sphere = np.diag([2.5, 2.5, 2.5, 1.0]) if sphere is None else sphere
    for index, matrix in enumerate(projections() if matrices is None else matrices):
        arrays |= {f"world_mat_{index}": matrix, f"scale_mat_{index}": sphere}
        arrays |= {f"world_mat_inv_{index}": np.eye(4), f"camera_mat_{index}": np.eye(4)}
    programs.save_photos(folder / photos)
    np.savez(folder / name, **arrays)
    return folder


def make_llff(folder, photos="images", size=(WIDTH, HEIGHT)):
    rows = []
    for pose in programs.poses():
        right, down, forwards, place = pose[:3].T
        table = np.column_stack([down, right, -forwards, place, (HEIGHT, WIDTH, FX)])
        rows.append([*table.ravel(), 0.5, 9.0])
    programs.save_photos(folder / photos, size=size)
    np.save(folder / "poses_bounds.npy", rows)
    return folder


def splat_cameras():
    return [
        {"id": index, "img_name": name, "width": WIDTH, "height": HEIGHT, "fx": FX, "fy": FY,
         "position": pose[:3, 3].tolist(), "rotation": pose[:3, :3].tolist()}
        for index, (name, pose) in enumerate(zip(names(), programs.poses(), strict=True))
    ]  # fmt: skip


def make_splat(folder, cameras=None):
    programs.save_photos(folder / "photos")
    (folder / "cameras.json").write_text(json.dumps(splat_cameras() if cameras is None else cameras))
    return folder


def pinhole(cx, cy, fy=FX):
    def project(index, point):
        x, y, z = programs.poses()[index, :3, :3].T @ (point - programs.poses()[index, :3, 3])
        return FX * x / z + cx, fy * y / z + cy

    return project


def test_neus_projections_of_any_scale_and_sign_are_taken_apart(tmp_path):
    capture = read_capture(make_neus(tmp_path))
    assert capture.format == "NeuS"
    check_projection(capture, pinhole(CX, CY, FY), programs.poses())
    # The file's own matrices say the same, half a pixel from their count of pixels.
    for camera, matrix in zip(capture.cameras, projections(), strict=True):
        point = programs.seen_points(camera.camera_to_world * [1, -1, -1, 1])[0]
        u, v, w = matrix[:3] @ [*point, 1]
        np.testing.assert_allclose(camera.project(point[None])[0][0], (u / w + 0.5, v / w + 0.5))


def test_neus_sphere_is_the_region(tmp_path):
    sphere = np.diag([0.5, 0.5, 0.5, 1.0])
    sphere[:3, 3] = 1, 2, 3
    region = read_capture(make_neus(tmp_path, sphere=sphere)).region
    np.testing.assert_allclose(region, [(0.5, 1.5, 2.5), (1.5, 2.5, 3.5)])


def test_neus_masks_and_other_names_of_its_folders_are_found(tmp_path):
    folder = make_neus(tmp_path / "a", name="cameras.npz", photos="rgb")
    for name in names():
        (folder / "mask").mkdir(exist_ok=True)
        Image.new("L", (WIDTH, HEIGHT), 255).save(folder / "mask" / f"{name}.png")
    for path in (folder, folder.parent, folder / "cameras.npz"):
        cameras = read_capture(path).cameras
        assert [camera.mask_path.stem for camera in cameras] == names()


def test_its_folders_may_be_called_in_other_letters(tmp_path):
    folder = make_neus(tmp_path, photos="Image")
    (folder / "MASK").mkdir()
    for name in names():
        Image.new("L", (WIDTH, HEIGHT), 255).save(folder / "MASK" / f"{name}.png")
    cameras = read_capture(folder).cameras
    assert {camera.image_path.parent.name for camera in cameras} == {"Image"}
    assert {camera.mask_path.parent.name for camera in cameras} == {"MASK"}


def test_a_folder_of_several_scans_is_no_capture(tmp_path):
    for scan in ("dtu_scan24", "dtu_scan37"):
        make_neus(tmp_path / scan)
    with pytest.raises(CaptureError, match="holds several captures .dtu_scan24, dtu_scan37"):
        read_capture(tmp_path)


def test_idrs_masks_have_the_photos_numbers_with_other_digits(tmp_path):
    folder = make_neus(tmp_path)
    (folder / "mask").mkdir()
    for index, photo in enumerate(sorted((folder / "image").iterdir())):
        photo.rename(photo.with_name(f"{index:06d}.png"))
        Image.new("L", (WIDTH, HEIGHT), 255).save(folder / "mask" / f"{index:03d}.png")
    capture = read_capture(folder)
    stems = [(c.image_path.stem, c.mask_path.stem) for c in capture.cameras]
    assert stems == [(f"{i:06d}", f"{i:03d}") for i in range(len(capture.cameras))]
    assert not capture.warnings


def test_of_idrs_files_the_one_of_the_sphere_is_read(tmp_path):
    make_neus(tmp_path, projections(cx=10), name="cameras_large.npz")
    assert read_capture(make_neus(tmp_path)).cameras[0].cx == pytest.approx(CX)


def test_skewed_pixels_are_refused(tmp_path):
    with pytest.raises(CaptureError, match=r"world_mat_0: its pixels are not rectangles \(skew\)"):
        read_capture(make_neus(tmp_path, projections(skew=5.0)))


@pytest.mark.parametrize("matrix", [np.zeros((4, 4)), np.diag([1.0, 1.0, 0.0, 1.0])])
def test_a_matrix_that_is_no_projection_is_named(tmp_path, matrix):
    with pytest.raises(CaptureError, match="world_mat_0: this is not a projection"):
        read_capture(make_neus(tmp_path, [matrix] * COUNT))


def test_llffs_axes_are_down_right_backwards(tmp_path):
    capture = read_capture(make_llff(tmp_path))
    assert capture.format == "LLFF" and "no lens distortion" in capture.warnings[0]
    check_projection(capture, pinhole(WIDTH / 2, HEIGHT / 2), programs.poses())


def test_llffs_focal_length_follows_smaller_photos(tmp_path):
    camera = read_capture(make_llff(tmp_path, "images_2", (WIDTH // 2, HEIGHT // 2))).cameras[0]
    assert (camera.width, camera.fx) == (WIDTH // 2, FX / 2)


def test_cameras_with_all_of_their_lens_go_before_what_was_made_of_them(tmp_path):
    make_llff(tmp_path)
    make_splat(tmp_path)
    (tmp_path / "transforms.json").write_text(
        json.dumps(
            {"camera_angle_x": 1.0, "frames": [
                {"file_path": f"images/{name}", "transform_matrix": pose.tolist()}
                for name, pose in zip(names(), programs.poses(), strict=True)
            ]}
        )
    )  # fmt: skip
    assert read_capture(tmp_path).format == "transforms.json"


def test_a_splats_cameras_find_their_photos_and_points(tmp_path):
    folder = make_splat(tmp_path / "output")
    write_points(folder / "input.ply", np.eye(3) * 2, np.zeros((3, 3), np.uint8))
    capture = read_capture(folder)
    assert capture.format == "Gaussian splatting"
    check_projection(capture, pinhole(WIDTH / 2, HEIGHT / 2, FY), programs.poses())
    np.testing.assert_allclose(capture.points, np.eye(3) * 2)
    expected = pose_opengl_from_opencv(programs.poses()[0])
    np.testing.assert_allclose(capture.cameras[0].camera_to_world, expected, atol=1e-12)


def test_a_splats_photos_may_lie_elsewhere_and_its_points_be_broken(tmp_path):
    folder = make_splat(tmp_path / "output")
    (folder / "photos").rename(tmp_path / "photos")
    (folder / "input.ply").write_bytes(b"ply\n")
    with pytest.raises(CaptureError, match="5 of 5 photos are missing"):
        read_capture(folder)
    capture = read_capture(folder, photos=tmp_path / "photos")
    assert [camera.name for camera in capture.cameras] == names() and capture.points is None


@pytest.mark.parametrize("make, folder", [(make_neus, "image"), (make_llff, "images")])
def test_more_photos_than_cameras_belong_to_none(tmp_path, make, folder):
    make(tmp_path)
    programs.save_photos(tmp_path / folder, ["another"])
    with pytest.raises(CaptureError, match=f"5 cameras, but .*{folder} has 6 photos"):
        read_capture(tmp_path)
    for file in (tmp_path / folder).iterdir():
        file.unlink()
    with pytest.raises(CaptureError, match=f"photos: there are none in the folder {folder} next to"):
        read_capture(tmp_path)


@pytest.mark.parametrize("make, folder", [(make_neus, "image"), (make_llff, "images")])
def test_photos_may_be_given_by_their_folder(tmp_path, make, folder):
    make(tmp_path / "cameras")
    (tmp_path / "cameras" / folder).rename(tmp_path / "photos")
    capture = read_capture(tmp_path / "cameras", photos=tmp_path / "photos")
    assert [camera.name for camera in capture.cameras] == names()


@pytest.mark.parametrize("make", [make_neus, make_llff])
def test_arrays_of_objects_are_never_unpickled(tmp_path, make):
    folder = make(tmp_path)
    if make is make_neus:
        objects = np.array([[{}, 0, 0, 0]] * 4, dtype=object)
        np.savez(folder / "cameras_sphere.npz", world_mat_0=objects)
    else:
        np.save(folder / "poses_bounds.npy", np.array([[{}] * 17] * 5, dtype=object))
    with pytest.raises(CaptureError, match="this is not an array of numbers"):
        read_capture(folder)


@pytest.mark.parametrize("shape", [(10**12, 17), (-1, 17), (10**30, 17), (2**63, 17)])
def test_an_arrays_stated_size_sets_no_memory_aside(tmp_path, shape):
    folder = make_llff(tmp_path)
    content = (folder / "poses_bounds.npy").read_bytes()
    stated = content.replace(b"(5, 17)", f"({shape[0]}, 17)".encode(), 1)
    if len(stated) > len(content):  # the header is filled up with blanks
        stated = stated.replace(b" " * (len(stated) - len(content)) + b"\n", b"\n", 1)
    (folder / "poses_bounds.npy").write_bytes(stated)
    with pytest.raises(CaptureError, match="this is not an array of numbers"):
        read_capture(folder / "poses_bounds.npy")


@pytest.mark.parametrize("bracket", [b"(", b"[", b"{", b"'"])
def test_a_header_that_cannot_be_taken_apart_is_named(tmp_path, bracket):
    file = make_llff(tmp_path) / "poses_bounds.npy"
    file.write_bytes(file.read_bytes().replace(b"(5, 17), } ", bracket + b"(5, 17), }", 1))
    with pytest.raises(CaptureError, match="this is not an array of numbers"):
        read_capture(file)


def test_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path):
    folder = make_neus(tmp_path)
    with zipfile.ZipFile(folder / "cameras_sphere.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for index in range(3):
            archive.writestr(f"world_mat_{index}.npy", bytes(1 << 25))
    with pytest.raises(CaptureError, match="too large for cameras when unpacked"):
        read_capture(folder)


@RANDOM_TESTS
@given(data=st.data())
@pytest.mark.parametrize("make", [make_neus, make_llff])
def test_cut_and_changed_arrays_end_in_a_capture_or_an_error(make, tmp_path, data):
    file = next(file for file in make(tmp_path).iterdir() if file.is_file())
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    outcome(file)
    file.unlink()


@RANDOM_TESTS
@given(value=HOSTILE, key=st.sampled_from([None, *splat_cameras()[0]]), data=st.data())
def test_hostile_splat_cameras_end_in_a_capture_or_an_error(tmp_path, value, key, data):
    cameras = splat_cameras()
    if key is None:
        cameras[0] = value
    else:
        cameras[0][key] = value
    text = json.dumps(cameras)
    file = make_splat(tmp_path, cameras) / "cameras.json"
    file.write_text(text[: data.draw(st.integers(0, len(text)) | st.just(len(text)))])
    outcome(file)


@pytest.mark.parametrize("times", [0.5, 2])
def test_neus_photos_that_were_resized_have_a_lens_of_their_size(tmp_path, times):
    folder = make_neus(tmp_path, projections(cx=49.5))
    for photo in (folder / "image").iterdir():
        Image.new("RGB", (int(times * WIDTH), int(times * HEIGHT)), "gray").save(photo)
    for camera in read_capture(folder).cameras:
        lens = camera.fx, camera.fy, camera.cx, camera.cy
        assert lens == pytest.approx([times * value for value in (FX, FY, 49.5, CY)])


def test_what_is_no_matrix_is_told_with_the_size_of_one(tmp_path):
    cameras = splat_cameras()
    cameras[2]["rotation"] = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    with pytest.raises(CaptureError, match=r"\[2\].rotation: this is not a 3 × 3 matrix"):
        read_capture(make_splat(tmp_path, cameras))
