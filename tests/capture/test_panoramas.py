"""Panoramas: their lens all over the sphere, and every program's own projection of them.

Pixels at the left and at the right edge are one, so columns are compared around the picture.
"""

import json
import math

import numpy as np
import pycolmap
import pytest

from solver.capture.camera import Camera
from solver.capture.errors import CaptureError
from solver.capture.formats.transforms import write_transforms
from solver.capture.lenses import distort, is_usable, undistort
from solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere, shows_whole_sphere
from solver.capture.read import read_capture
from tests.capture import test_meshroom, test_metashape, test_openmvg, test_opensfm
from tests.capture.programs import COUNT, HEIGHT, WIDTH, poses
from tests.capture.test_transforms import capture_with, make_capture

POLES = np.array([[0, 1, 0], [0, -1, 0], [0, 5e-9, 1e-30], [1e-12, -1, 1e-12]], float)
SEAM = np.array([[0, 0, -1], [-0.0, 0, -1], [1e-18, 0.3, -1], [-1e-18, 0.3, -1]], float)


def panorama(pose=None, width=WIDTH, height=HEIGHT):
    pose = np.eye(4) if pose is None else pose
    return Camera("p", None, pose, width, height, *of_whole_sphere(width, height), EQUIRECTANGULAR)


def all_around(count=400, seed=0):
    """Directions [N, 3] of many lengths, all around, with the poles and the seam."""
    generator = np.random.default_rng(seed)
    anywhere = generator.normal(size=(count, 3)) * generator.uniform(0.01, 100, (count, 1))
    return np.concatenate([anywhere, POLES, SEAM])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def assert_same_pixels(found, wanted, width=WIDTH, tolerance=1e-6):
    around = (found[:, 0] - wanted[:, 0] + width / 2) % width - width / 2
    # A pole is a whole row.
    at_poles = np.minimum(found[:, 1], HEIGHT - found[:, 1]) < 1e-6
    np.testing.assert_allclose(np.where(at_poles, 0, around), 0, atol=tolerance)
    np.testing.assert_allclose(found[:, 1], wanted[:, 1], atol=tolerance)


def test_directions_come_back_from_their_pixels_also_at_the_poles_and_the_seam():
    directions = all_around()
    x, y = distort(EQUIRECTANGULAR, (), directions)
    assert (x >= -np.pi).all() and (x < np.pi).all() and (np.abs(y) <= np.pi / 2).all()
    back, met = undistort(EQUIRECTANGULAR, (), x, y)
    assert met.all()
    np.testing.assert_allclose(back, unit(directions), atol=1e-12)


def test_pixels_come_back_from_their_directions():
    x, y = np.meshgrid(np.linspace(-np.pi, np.pi, 41)[:-1], np.linspace(-1.57, 1.57, 21))
    directions, met = undistort(EQUIRECTANGULAR, (), x.ravel(), y.ravel())
    assert met.all()
    np.testing.assert_allclose(distort(EQUIRECTANGULAR, (), directions), [x.ravel(), y.ravel()], atol=1e-12)


def test_beyond_the_sphere_there_is_the_nearest_of_its_directions():
    x, y = np.array([4.0, -9.0, 0.0, 0.5]), np.array([0.0, 3.0, -1.6, 1e300])
    directions, met = undistort(EQUIRECTANGULAR, (), x, y)
    assert not met.any()
    np.testing.assert_allclose(directions[:3], [[0, 0, -1], [0, 1, 0], [0, -1, 0]], atol=1e-12)
    assert np.isfinite(directions).all()
    assert np.isnan(distort(EQUIRECTANGULAR, (), np.zeros((1, 3)))).all()
    assert not is_usable(EQUIRECTANGULAR, (0.1,)) and is_usable(EQUIRECTANGULAR, ())


def test_a_panorama_sees_every_point_at_its_distance():
    pose = poses()[2]
    camera = panorama(pose)
    points = pose[:3, 3] + all_around()
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(depth, np.linalg.norm(all_around(), axis=1))
    # Straight up and down is an edge of the picture.
    assert camera.in_frame(points[:-8]).all() and camera.in_frame(points[-4:]).all()
    origins, directions = camera.rays(*pixels.T)
    np.testing.assert_allclose(directions, unit(all_around()), atol=1e-12)
    assert not camera.in_frame(camera.position[None]).any()


def test_colmap_projects_and_looks_through_pixels_the_same():
    theirs = pycolmap.Camera(model="EQUIRECTANGULAR", width=WIDTH, height=HEIGHT, params=[WIDTH, HEIGHT])
    local = all_around()
    camera = panorama(np.diag([1.0, -1, -1, 1]))
    found, _ = camera.project(local)
    assert_same_pixels(found, np.array([theirs.img_from_cam(point) for point in local]))
    pixels = np.random.default_rng(1).uniform(0, (WIDTH, HEIGHT), (200, 2))
    rays = np.array([np.ravel(theirs.cam_ray_from_img(pixel)) for pixel in pixels])
    np.testing.assert_allclose(camera.rays(*pixels.T)[1], rays, atol=1e-12)


def in_turns(to_camera, point):
    """OpenSfM's `SphericalProjection` and OpenMVG's `Intrinsic_Spherical`; both count in the longer side,
    from the middle."""
    x, y, z = (to_camera @ [*point, 1.0])[:3]
    lon, lat = math.atan2(x, z), math.atan2(-y, math.hypot(x, z))
    size = max(WIDTH, HEIGHT)
    return lon / (2 * math.pi) * size + WIDTH / 2, -lat / (2 * math.pi) * size + HEIGHT / 2


def of_alicevision(to_camera, point):
    """`Equirectangular::project` with the intrinsics of test_meshroom."""
    x, y, z = (to_camera @ [*point, 1.0])[:3]
    azimuth, elevation = math.atan2(x, z), math.asin(y / math.hypot(x, y, z))
    radian = WIDTH / (2 * math.pi)
    return azimuth * radian + WIDTH / 2, elevation * radian + HEIGHT / 2


def of_whole_picture(to_camera, point):
    """A panorama of all directions, whatever the picture's shape: Metashape's."""
    x, y, z = (to_camera @ [*point, 1.0])[:3]
    azimuth, elevation = math.atan2(x, z), math.atan2(y, math.hypot(x, z))
    return (azimuth / (2 * math.pi) + 0.5) * WIDTH, (elevation / math.pi + 0.5) * HEIGHT


def opensfm(folder, kind="spherical"):
    test_opensfm.write(folder, test_opensfm.scene(test_opensfm.lens(kind, {})))


def openmvg(folder):
    lens = test_openmvg.intrinsic("spherical", ())
    data = lens["value"]["ptr_wrapper"]["data"]
    del data["focal_length"], data["principal_point"]
    lens["value"]["ptr_wrapper"]["data"] = {"value0": data}
    test_openmvg.write(folder, test_openmvg.scene([lens]))


def meshroom(folder, distortion="none"):
    lens = test_meshroom.intrinsic(version=(1, 2, 12)) | {
        "type": "equirectangular", "distortionType": distortion, "pixelRatio": "1",
        "focalLength": repr(36 / (2 * math.pi)), "principalPoint": ["0", "0"],
        "distortionParams": ["0.1"] if distortion != "none" else "",
    }  # fmt: skip
    test_meshroom.write(folder, test_meshroom.scene((1, 2, 12), lens=lens))


def metashape(folder, inside=""):
    cameras = [test_metashape.camera(i, matrix) for i, matrix in enumerate(poses())]
    sensor = test_metashape.sensor(0, inside, "spherical")
    test_metashape.write(folder, test_metashape.document(sensor, cameras))


@pytest.mark.parametrize(
    "write, project",
    [
        (opensfm, in_turns),
        (lambda folder: opensfm(folder, "equirectangular"), in_turns),
        (openmvg, in_turns),
        (meshroom, of_alicevision),
        (metashape, of_whole_picture),
        (
            lambda folder: metashape(folder, test_metashape.calibration({"f": 15.3})),
            of_whole_picture,
        ),
    ],
)
def test_points_all_around_project_as_the_program_projects_them(tmp_path, write, project):
    write(tmp_path)
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == COUNT and not capture.warnings
    for camera in capture.cameras:
        to_camera = np.linalg.inv(poses()[int(camera.image_path.stem[-4:])])
        points = camera.position + all_around(60)[:60]
        wanted = np.array([project(to_camera, point) for point in points])
        assert_same_pixels(camera.project(points)[0], wanted)


def test_meshrooms_panoramas_have_no_distortion(tmp_path):
    meshroom(tmp_path, "radialk1")
    with pytest.raises(CaptureError, match="the lens model 'radialk1' is not supported"):
        read_capture(tmp_path)


def of_nerfstudio(values, width, height):
    """World directions of `_generate_rays_from_coords` in nerfstudio's cameras.py through pixel centres."""
    row, column = np.mgrid[0:height, 0:width] + 0.5
    across = (column.ravel() - width / 2) / values.get("fl_x", width / 2)
    down = -(row.ravel() - height / 2) / values.get("fl_y", height)
    theta, phi = -np.pi * across, np.pi * (0.5 - down)
    return np.stack([-np.sin(theta) * np.sin(phi), np.cos(phi), -np.cos(theta) * np.sin(phi)], axis=-1)


@pytest.mark.parametrize(
    "values",
    [
        {}, {"fl_x": 4.0, "fl_y": 8.0}, {"fl_x": 8.0, "fl_y": 8.0},
        {"latlong": True, "camera_model": None, "fl_x": 77.0},
    ],
)  # fmt: skip
def test_rays_are_those_of_nerfstudio_and_instant_ngp(tmp_path, values):
    given = {"camera_angle_x": None, "camera_model": "EQUIRECTANGULAR", "w": 8, "h": 8} | values
    camera = capture_with(tmp_path, **given).cameras[0]
    row, column = np.mgrid[0:8, 0:8] + 0.5
    _, directions = camera.rays(column.ravel(), row.ravel())
    local = of_nerfstudio({} if "latlong" in values else values, 8, 8)
    np.testing.assert_allclose(directions @ camera.camera_to_world[:3, :3], local, atol=1e-12)
    assert camera.lens == EQUIRECTANGULAR


@pytest.mark.parametrize("key", ["fl_x", "fl_y"])
def test_a_picture_of_more_than_all_directions_is_refused(tmp_path, key):
    values = {"fl_x": 4.0, "fl_y": 8.0, "w": 8, "h": 8, "camera_model": "EQUIRECTANGULAR"}
    with pytest.raises(CaptureError, match=rf"frames\[0\].{key}: .*more than all directions; give"):
        capture_with(tmp_path, **{**values, key: 3.0})


def test_panoramas_come_back_from_a_jobs_file_to_the_last_digit(tmp_path):
    given = {"camera_angle_x": None, "camera_model": "EQUIRECTANGULAR", "w": 8, "h": 8}
    folder = make_capture(tmp_path / "given", edit=lambda content: content.update(given))
    before = list(read_capture(folder).cameras)
    write_transforms(tmp_path / "job" / "transforms.json", before)
    after = read_capture(tmp_path / "job", trusted=True).cameras
    assert [camera.lens_key for camera in after] == [camera.lens_key for camera in before]
    stated = json.loads((tmp_path / "job" / "transforms.json").read_text())["frames"][0]
    assert stated["fl_x"] == pytest.approx(4) and stated["fl_y"] == pytest.approx(8)


def test_a_smaller_photo_shows_all_directions_as_well():
    camera = panorama(width=6000, height=3000).no_larger(10_000)
    key = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    assert shows_whole_sphere(*key) and not shows_whole_sphere(*key[:2], 20.0, *key[3:])
