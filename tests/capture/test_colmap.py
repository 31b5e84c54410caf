"""COLMAP models: COLMAP's own projections for every camera model, and every way a file can be broken."""

import shutil
import struct
import time
import tracemalloc

import numpy as np
import pycolmap
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image as Photo

from solver.capture.errors import CaptureError
from solver.capture.formats import colmap
from solver.capture.formats.colmap_model import MODELS
from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture

PARAMETERS = {
    "SIMPLE_PINHOLE": (70, 30, 25),
    "PINHOLE": (70, 60, 30, 25),
    "SIMPLE_RADIAL": (70, 30, 25, -0.12),
    "RADIAL": (70, 30, 25, -0.12, 0.03),
    "OPENCV": (70, 60, 30, 25, 0.1, -0.05, 0.004, -0.003),
    "OPENCV_FISHEYE": (70, 60, 30, 25, 0.05, -0.01, 0.002, 0.001),
    "FULL_OPENCV": (70, 60, 30, 25, 0.3, -0.05, 0.002, -0.001, 0.01, 0.2, 0.03, 0.001),
    "FOV": (70, 60, 30, 25, 0.8),
    "SIMPLE_RADIAL_FISHEYE": (70, 30, 25, 0.06),
    "RADIAL_FISHEYE": (70, 30, 25, 0.06, -0.02),
    "THIN_PRISM_FISHEYE": (70, 60, 30, 25, 0.05, -0.01, 0.003, -0.002, 0.002, 1e-3, 0.004, -0.003),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *(70, 60, 30, 25, 0.05, -0.01, 0.002, -0.001, 5e-4, 1e-4),
        *(0.003, -0.002, 0.004, -0.003, 0.002, 0.001),
    ),
    "SIMPLE_DIVISION": (70, 30, 25, -0.2),
    "DIVISION": (70, 60, 30, 25, 0.15),
    "SIMPLE_FISHEYE": (70, 30, 25),
    "FISHEYE": (70, 60, 30, 25),
    "EUCM": (70, 60, 30, 25, 0.6, 1.1),
}
WRITERS = {"bin": "write_binary", "txt": "write_text"}


def write(reconstruction, folder, extension="bin"):
    folder.mkdir(parents=True, exist_ok=True)
    getattr(reconstruction, WRITERS[extension])(folder)
    return folder


def test_every_model_that_colmap_knows_has_its_id_and_number_of_parameters_here():
    for name, value in pycolmap.CameraModelId.__members__.items():
        if int(value) >= 0:
            camera = pycolmap.Camera.create_from_model_id(1, value, 100, 64, 48)
            assert MODELS[name][:2] == (int(value), len(camera.params))
    assert PARAMETERS.keys() == {name for name, row in MODELS.items() if row[3]}


@pytest.mark.parametrize("extension", WRITERS)
@pytest.mark.parametrize("model", PARAMETERS)
def test_points_project_where_colmap_projects_them(tmp_path, solved, agrees, model, extension):
    photos = tmp_path / "images"
    reconstruction = solved(photos, model, PARAMETERS[model])
    write(reconstruction, tmp_path / "sparse" / "0", extension)
    capture = read_capture(tmp_path)
    assert capture.format == "COLMAP" and len(capture.cameras) == 5 and not capture.warnings
    assert agrees(capture, reconstruction, photos) > 500
    expected = np.array([point.xyz for point in reconstruction.points3D.values()])
    np.testing.assert_allclose(np.sort(capture.points, 0), np.sort(expected, 0), atol=1e-12)


@pytest.mark.parametrize("model", PARAMETERS)
def test_every_lens_survives_the_way_from_blender_to_the_solver(tmp_path, solved, agrees, model):
    photos = tmp_path / "images"
    reconstruction = solved(photos, model, PARAMETERS[model])
    write(reconstruction, tmp_path / "sparse")
    write_transforms(tmp_path / "job" / "transforms.json", list(read_capture(tmp_path).cameras))
    agrees(read_capture(tmp_path / "job", trusted=True), reconstruction, photos)


@pytest.mark.parametrize("model", PARAMETERS)
def test_rays_are_finite_and_unit_far_beyond_the_photo(tmp_path, solved, model):
    write(solved(tmp_path / "images", model, PARAMETERS[model]), tmp_path / "sparse")
    camera = read_capture(tmp_path).cameras[0]
    pixels = np.random.default_rng(1).uniform(-3000, 3000, (400, 2))
    _, directions = camera.rays(*pixels.T)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    reached = camera.lens_reaches(*pixels.T)
    seen, _ = camera.project(camera.position + directions[reached])
    fine = np.isfinite(seen).all(axis=1)
    np.testing.assert_allclose(seen[fine], pixels[reached][fine], rtol=1e-5, atol=1e-3)


def test_a_panorama_is_refused_with_a_way_out(tmp_path, solved):
    for extension in WRITERS:
        folder = tmp_path / extension
        reconstruction = solved(folder / "images", "EQUIRECTANGULAR", (64, 48))
        write(reconstruction, folder / "sparse", extension)
        with pytest.raises(CaptureError, match="panorama.*perspective photos"):
            read_capture(folder)


@pytest.mark.parametrize("extension", WRITERS)
@pytest.mark.parametrize("kind", ["cameras", "images", "points3D", "rigs", "frames"])
def test_any_file_of_a_model_stands_for_it(tmp_path, solved, kind, extension):
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "0", extension)
    file = tmp_path / "sparse" / "0" / f"{kind}.{extension}"
    assert colmap.recognises(file)
    assert len(read_capture(file).cameras) == 5


@pytest.mark.parametrize("given_folder", ["", "sparse", "sparse/0"])
def test_the_folders_of_the_model_stand_for_the_capture(tmp_path, solved, given_folder):
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "0")
    assert len(read_capture(tmp_path / given_folder).cameras) == 5


@pytest.mark.parametrize("place", ["dense/0/sparse", "colmap/sparse/0", "distorted/sparse/0"])
def test_models_are_found_where_programs_put_them(tmp_path, solved, place):
    file = write(solved(tmp_path / "images"), tmp_path / place) / "images.bin"
    assert len(read_capture(tmp_path).cameras) == 5
    assert len(read_capture(file).cameras) == 5


def test_a_model_with_distortion_means_the_photos_as_taken(tmp_path, solved):
    file = write(solved(tmp_path / "input"), tmp_path / "distorted" / "sparse" / "0") / "images.bin"
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "0")
    assert read_capture(file).cameras[0].image_path.parent == tmp_path / "input"
    assert read_capture(tmp_path).cameras[0].image_path.parent == tmp_path / "images"


@pytest.mark.parametrize("with_comments", [True, False])
def test_renamed_text_files_are_recognised_by_what_is_in_them(tmp_path, solved, with_comments):
    folder = write(solved(tmp_path / "images"), tmp_path, "txt")
    for old, new in (("cameras", "lenses"), ("images", "poses")):
        text = (folder / f"{old}.txt").read_text()
        if not with_comments:
            text = "".join(line for line in text.splitlines(True) if not line.startswith("#"))
        (folder / f"{new}.txt").write_text(text)
        (folder / f"{old}.txt").unlink()
    assert len(read_capture(folder / "poses.txt").cameras) == 5


def test_other_text_and_binary_files_are_not_taken_for_models(tmp_path):
    contents = {
        "notes.txt": "photos from Tuesday\n1 2 3 4 5 6 7 8 9 10 11 12\n",
        "images.txt": "a.png\nb.png\n",
        "images.bin": b"\x01" * 40,
        "cameras.bin": struct.pack("<Q", 2**63) + b"\0" * 80,
        "cameras.txt": "extrinsic\n1 0 0 0\n",
        "weights.bin": struct.pack("<Q", 0),
        "huge.txt": "1 1e300 1e300 1e300 1e300 0 0 0 1 a.png\n",
    }
    for name, content in contents.items():
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        assert not colmap.recognises(file), name
    assert not colmap.recognises(tmp_path / "nowhere.bin")


def test_names_with_blanks_and_folders_find_their_photos(tmp_path, solved, agrees):
    names = ["left/a.png", "right/a.png", "left/b c.png", "right/b c.png", "ö ä/d 1 2.png"]
    for extension in WRITERS:
        folder = tmp_path / extension
        reconstruction = solved(folder / "images", names=names)
        write(reconstruction, folder / "sparse" / "0", extension)
        capture = read_capture(folder)
        assert len({camera.name for camera in capture.cameras}) == 5
        agrees(capture, reconstruction, folder / "images")


def test_a_missing_photo_is_not_replaced_by_one_of_its_name_in_another_folder(tmp_path, solved):
    names = ["left/a.png", "right/a.png", "left/b.png", "right/b.png", "left/c.png", "right/c.png"]
    write(solved(tmp_path / "images", names=names), tmp_path / "sparse" / "0")
    (tmp_path / "images" / "left" / "a.png").unlink()
    capture = read_capture(tmp_path)
    assert len({camera.image_path for camera in capture.cameras}) == len(capture.cameras) == 5
    assert "left/a.png" in capture.warnings[0]


def test_copies_of_the_photos_in_other_sizes_are_not_meant(tmp_path, solved):
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "0")
    for copy in ("images_2", "images_4"):
        shutil.copytree(tmp_path / "images", tmp_path / copy)
    for camera in read_capture(tmp_path).cameras:
        assert camera.image_path.parent == tmp_path / "images"
    file = tmp_path / "sparse" / "0" / "images.bin"
    assert read_capture(file).cameras[0].image_path.parent == tmp_path / "images"
    elsewhere = read_capture(file, photos=tmp_path / "images_4")
    assert elsewhere.cameras[0].image_path.parent == tmp_path / "images_4"


def test_photos_beside_the_model_or_in_a_folder_of_another_name_are_found(tmp_path, solved):
    for place in ("", "photos"):
        folder = tmp_path / (place or "beside")
        write(solved(folder / place), folder)
        assert len(read_capture(folder).cameras) == 5


def test_a_larger_model_beside_is_mentioned(tmp_path, solved):
    write(solved(tmp_path / "images", names=["a.png", "b.png", "c.png"]), tmp_path / "sparse" / "0")
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "1")
    assert any("1 beside 0" in text for text in read_capture(tmp_path).warnings)


def turned(*quaternion):
    """A rotation from x y z w of any length."""
    return pycolmap.Rotation3d(np.array(quaternion) / np.linalg.norm(quaternion))


def rig_of_two(photos, save):
    """Two cameras side by side, three times; the second turned and moved against the first."""
    reconstruction = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    for number in (1, 2):
        reconstruction.add_camera(
            pycolmap.Camera(
                camera_id=number, model="PINHOLE", width=64, height=48, params=[70, 60, 30, 25]
            )
        )
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number)
        if number == 1:
            rig.add_ref_sensor(sensor)
        else:
            turn = turned(0.05, 0.1, -0.02, 0.99)
            rig.add_sensor(sensor, pycolmap.Rigid3d(turn, np.array([0.3, 0.1, 0.2])))
    reconstruction.add_rig(rig)
    for index in range(3):
        frame = pycolmap.Frame(frame_id=index + 1, rig_id=1)
        for number in (1, 2):
            sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number)
            frame.add_data_id(pycolmap.data_t(sensor, 10 * index + number))
        turn = turned(0.0, 0.3 * index, 0.0, 1.0)
        frame.rig_from_world = pycolmap.Rigid3d(turn, np.array([0.1 * index, 0.2, 4.0]))
        reconstruction.add_frame(frame)
        for number in (1, 2):
            image = pycolmap.Image(
                name=f"c{number}/{index}.png", camera_id=number, image_id=10 * index + number
            )
            image.frame_id = index + 1
            reconstruction.add_image(image)
            save(photos / f"c{number}" / f"{index}.png")
        reconstruction.register_frame(index + 1)
    for xyz in np.random.default_rng(0).uniform(-0.9, 0.9, (120, 3)):
        reconstruction.add_point3D(xyz, pycolmap.Track(), np.array([9, 9, 9], np.uint8))
    return reconstruction


@pytest.mark.parametrize("extension", WRITERS)
@pytest.mark.parametrize("own_poses", [True, False])
def test_photos_of_a_rig_stand_where_colmap_has_them(
    tmp_path, solved, agrees, extension, own_poses
):
    solved(tmp_path / "spare", names=["x.png"])
    photo = tmp_path / "spare" / "x.png"

    def save(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(photo, file)

    reconstruction = rig_of_two(tmp_path / "images", save)
    folder = write(reconstruction, tmp_path / "sparse" / "0", extension)
    shutil.rmtree(tmp_path / "spare")
    if not own_poses:
        without_poses(folder / f"images.{extension}")
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == 6
    assert agrees(capture, reconstruction, tmp_path / "images") > 300


@pytest.mark.parametrize("extension", WRITERS)
def test_points_project_onto_their_observations_in_a_solve_of_two_rigs(tmp_path, extension):
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 2, 2, 3
    options.num_points3D = 120
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280, 512, 384, 0.05]
    reconstruction = pycolmap.synthesize_dataset(options)
    write(reconstruction, tmp_path / "sparse" / "0", extension)
    images = {image.name: image for image in reconstruction.images.values()}
    for image in images.values():
        camera = reconstruction.cameras[image.camera_id]
        file = tmp_path / "images" / image.name
        file.parent.mkdir(parents=True, exist_ok=True)
        Photo.new("L", (camera.width, camera.height)).save(file)
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == 12 and len(capture.points) == 120
    for camera in capture.cameras:
        image = images[camera.image_path.relative_to(tmp_path / "images").as_posix()]
        observed = [point for point in image.points2D if point.has_point3D()]
        points = [reconstruction.points3D[point.point3D_id].xyz for point in observed]
        pixels, _ = camera.project(np.array(points))
        np.testing.assert_allclose(pixels, [point.xy for point in observed], rtol=0, atol=1e-6)


def without_poses(file):
    if file.suffix == ".txt":
        lines = file.read_text().splitlines()
        for index, line in enumerate(lines):
            words = line.split(" ")
            if not line.startswith("#") and len(words) > 8:
                lines[index] = " ".join([words[0], *["nan"] * 7, *words[8:]])
        file.write_text("\n".join(lines) + "\n")
        return
    data = bytearray(file.read_bytes())
    at = 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        data[at + 4 : at + 60] = bytes(56)
        at = data.index(b"\0", at + 64) + 1
        at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
    file.write_bytes(data)


def test_a_text_model_without_the_lines_of_observations_is_read(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images")
    file = write(reconstruction, tmp_path / "sparse", "txt") / "images.txt"
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    file.write_text("\n".join(lines))
    agrees(read_capture(tmp_path), reconstruction, tmp_path / "images")


def test_observations_are_passed_over(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images")
    for image in reconstruction.images.values():
        image.points2D = pycolmap.Point2DList(
            [pycolmap.Point2D(np.array([i, 2.5 * i])) for i in range(40)]
        )
    for index, number in enumerate(list(reconstruction.points3D)[:40]):
        for image in (1, 2, 3):
            element = pycolmap.TrackElement(image, index)
            reconstruction.add_observation(number, element)
    for extension in WRITERS:
        folder = write(reconstruction, tmp_path / extension, extension)
        capture = read_capture(folder / f"images.{extension}", photos=tmp_path / "images")
        agrees(capture, reconstruction, tmp_path / "images")
        assert len(capture.points) == 150


@pytest.mark.parametrize("missing", [1, 8, 50, 51, 60])
def test_damaged_points_are_left_out_with_a_warning(tmp_path, solved, missing):
    file = write(solved(tmp_path / "images"), tmp_path / "sparse") / "points3D.bin"
    file.write_bytes(file.read_bytes()[:-missing])
    capture = read_capture(tmp_path)
    assert capture.points is None and "points3D.bin" in capture.warnings[0]


def test_a_missing_cameras_file_is_named(tmp_path, solved):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    (folder / "cameras.bin").unlink()
    with pytest.raises(CaptureError, match="no cameras.bin beside it"):
        read_capture(tmp_path)


def test_a_photo_whose_camera_is_missing_is_named(tmp_path, solved):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse", "txt")
    text = (folder / "cameras.txt").read_text()
    (folder / "cameras.txt").write_text(text.replace("1 PINHOLE", "7 PINHOLE"))
    with pytest.raises(CaptureError, match="there is no camera 1"):
        read_capture(tmp_path)


@pytest.mark.parametrize(
    "change, told",
    [
        (("1 PINHOLE", "1 BANANA"), "'BANANA' is not known"),
        (("70 60", "70"), "4 parameters, not 3"),
        (("70 60", "70 inf"), "not a number"),
        (("70 60", "0 60"), "no lens can have"),
        (("64 48", "-64 48"), "no number of its kind"),
        (("64 48", "0 48"), "no size"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(tmp_path, solved, change, told):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse", "txt")
    text = (folder / "cameras.txt").read_text()
    assert change[0] in text
    (folder / "cameras.txt").write_text(text.replace(*change))
    with pytest.raises(CaptureError, match=told):
        read_capture(tmp_path)


def test_names_outside_the_capture_find_nothing(tmp_path, solved):
    folder = tmp_path / "capture"
    reconstruction = solved(tmp_path / "elsewhere")
    for image in reconstruction.images.values():
        image.name = f"../elsewhere/{image.name}"
    for extension in WRITERS:
        write(reconstruction, folder / "sparse" / "0", extension)
        with pytest.raises(CaptureError, match="5 of 5 photos are missing"):
            read_capture(folder / "sparse" / "0" / f"images.{extension}")


def outcome(file):
    """A capture or None, checked to come soon and with an error of one line."""
    begin = time.monotonic()
    try:
        capture = read_capture(file)
        assert len(capture.cameras) >= 3
        for camera in capture.cameras:
            assert np.isfinite(camera.camera_to_world).all()
    except CaptureError as error:
        assert "\n" not in str(error) and "Traceback" not in str(error) and error.remedy
        str(error).encode()
        capture = None
    assert time.monotonic() - begin < 5
    return capture


@pytest.fixture(scope="module", params=WRITERS)
def model(request, tmp_path_factory, solved):
    """A folder with a model and the bytes of its files."""
    folder = tmp_path_factory.mktemp("broken")
    reconstruction = solved(folder / "images", "OPENCV", PARAMETERS["OPENCV"], points=6)
    write(reconstruction, folder / "sparse", request.param)
    return {file: file.read_bytes() for file in sorted((folder / "sparse").iterdir())}


QUICK = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def restore(files):
    for file, content in files.items():
        file.write_bytes(content)


@QUICK
@given(data=st.data())
def test_a_model_cut_anywhere_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    file.write_bytes(model[file][: data.draw(st.integers(0, len(model[file])))])
    outcome(data.draw(st.sampled_from(sorted(model))))


@QUICK
@given(data=st.data())
def test_a_model_with_other_bytes_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    content = bytearray(model[file])
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    outcome(data.draw(st.sampled_from(sorted(model))))


@QUICK
@given(data=st.data())
def test_a_model_with_shuffled_or_foreign_lines_is_a_capture_or_an_error(model, data):
    restore(model)
    file = data.draw(st.sampled_from(sorted(model)))
    lines = model[file].splitlines(True)
    lines = data.draw(st.permutations(lines[:40]))
    foreign = st.sampled_from([b"1 2 3\n", b"\n", b"\xff\xfe\n", b"1 " * 5000 + b"\n", b"nan\n"])
    lines.insert(data.draw(st.integers(0, len(lines))), data.draw(foreign))
    file.write_bytes(b"".join(lines))
    outcome(data.draw(st.sampled_from(sorted(model))))


@pytest.mark.parametrize("count", [2**63, 2**64 - 1, 2**32, 10**9])
@pytest.mark.parametrize("kind", ["cameras", "images", "points3D", "rigs", "frames"])
def test_hostile_counts_allocate_nothing(tmp_path, solved, kind, count):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    file = folder / f"{kind}.bin"
    file.write_bytes(struct.pack("<Q", count) + file.read_bytes()[8:])
    if kind in ("rigs", "frames"):
        without_poses(folder / "images.bin")
    tracemalloc.start()
    capture = outcome(folder / "images.bin")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20
    assert (capture is not None) == (kind == "points3D")


@pytest.mark.parametrize("count", [2**63, 2**64 - 1, 2**40])
def test_hostile_lengths_within_a_record_allocate_nothing(tmp_path, solved, count):
    folder = write(solved(tmp_path / "images"), tmp_path / "sparse")
    data = (folder / "images.bin").read_bytes()
    at = data.index(b".png\0") + 5
    (folder / "images.bin").write_bytes(data[:at] + struct.pack("<Q", count) + data[at + 8 :])
    points = (folder / "points3D.bin").read_bytes()
    (folder / "points3D.bin").write_bytes(points[:51] + struct.pack("<Q", count) + points[59:])
    tracemalloc.start()
    assert outcome(folder / "images.bin") is None
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()


def test_a_million_points_are_read_in_seconds(tmp_path):
    record = struct.Struct("<Q3d3BdQ4I")
    block = b"".join(
        record.pack(i, i, 2.0 * i, 3.0, 1, 2, 3, 0.5, 2, 1, 2, 3, 4) for i in range(10_000)
    )
    file = tmp_path / "points3D.bin"
    file.write_bytes(struct.pack("<Q", 1_200_000) + block * 120)
    begin = time.monotonic()
    points = colmap.colmap_binary.read_points(file)
    assert time.monotonic() - begin < 10
    file.unlink()
    assert 500_000 <= len(points) <= 1_000_000 and points[:, 2].tolist() == [3.0] * len(points)
