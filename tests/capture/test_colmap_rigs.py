"""COLMAP's rigs and frames: photos stand where pycolmap has them."""

import shutil

import numpy as np
import pycolmap
import pytest
from PIL import Image as Photo

from solver.capture.read import read_capture
from tests.capture.colmap_models import WRITERS, without_poses, write


def turned(*quaternion):
    """A rotation from x y z w of any length."""
    return pycolmap.Rotation3d(np.array(quaternion) / np.linalg.norm(quaternion))


def rig_of_two(photos, save):
    """Two cameras side by side, three times; the second turned and moved against the first."""
    reconstruction = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    for number in (1, 2):
        reconstruction.add_camera(
            pycolmap.Camera(camera_id=number, model="PINHOLE", width=64, height=48, params=[70, 60, 30, 25])
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
def test_photos_of_a_rig_stand_where_colmap_has_them(tmp_path, solved, agrees, extension, own_poses):
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
