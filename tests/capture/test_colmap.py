"""COLMAP models: COLMAP's own projections for every camera model, and where programs put the files."""

import shutil
import struct

import numpy as np
import pycolmap
import pytest

from solver.capture.errors import CaptureError
from solver.capture.formats import colmap
from solver.capture.formats.colmap_model import MODELS
from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture
from tests.capture.colmap_models import PARAMETERS, WRITERS, write


def test_every_model_that_colmap_knows_has_its_id_and_number_of_parameters_here():
    for name, value in pycolmap.CameraModelId.__members__.items():
        if int(value) >= 0:
            camera = pycolmap.Camera.create_from_model_id(1, value, 100, 64, 48)
            assert MODELS[name][:2] == (int(value), len(camera.params))
    assert PARAMETERS.keys() == MODELS.keys()


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


def test_a_model_elsewhere_takes_the_photos_it_is_given_whatever_model_lies_beside_them(tmp_path, solved):
    model = solved(tmp_path / "project" / "images")
    write(model, tmp_path / "project" / "sparse" / "0")
    file = write(model, tmp_path / "project" / "models" / "0") / "images.bin"
    assert len(read_capture(file).cameras) > 2
    other = write(model, tmp_path / "elsewhere") / "images.bin"
    capture = read_capture(other, photos=tmp_path / "project" / "images")
    assert capture.cameras[0].image_path.parent == tmp_path / "project" / "images"


def test_a_project_of_colmap_is_read_whatever_lies_in_folders_below(tmp_path, solved):
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "0")
    for name in ("nmf_jobs/scan", "nerf/out"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "transforms.json").write_text('{"camera_angle_x": 0.7, "frames": []}')
    assert read_capture(tmp_path).format == "COLMAP"


def test_chunks_that_were_exported_side_by_side_are_told_apart(tmp_path, solved):
    """As Metashape's script for Gaussian splatting writes them; folders of one capture are no several."""
    for name in ("Chunk 1", "Chunk 2"):
        write(solved(tmp_path / name / "images"), tmp_path / name / "sparse" / "0")
    with pytest.raises(CaptureError, match=r"several captures \(Chunk 1, Chunk 2\); give the folder"):
        read_capture(tmp_path)
    assert len(read_capture(tmp_path / "Chunk 2").cameras) == 5
    shutil.rmtree(tmp_path / "Chunk 2" / "images")
    assert read_capture(tmp_path).source.is_relative_to(tmp_path / "Chunk 1")


def test_a_model_with_distortion_does_not_take_photos_without(tmp_path, solved):
    model = solved(tmp_path / "dense" / "images")
    write(model, tmp_path / "sparse" / "0")
    write(model, tmp_path / "dense" / "sparse")
    for given in (tmp_path, tmp_path / "sparse" / "0" / "images.bin"):
        with pytest.raises(CaptureError, match="belong to another model, in .*images; give .*dense"):
            read_capture(given)
    capture = read_capture(tmp_path / "dense")
    assert capture.cameras[0].image_path.parent == tmp_path / "dense" / "images"


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


@pytest.mark.parametrize("extension", ["bin", "txt"])
def test_of_a_projects_models_the_largest_is_read_unless_another_is_named(tmp_path, solved, extension):
    small = solved(tmp_path / "images", names=["a.png", "b.png", "c.png"])
    write(small, tmp_path / "sparse" / "0", extension)
    write(solved(tmp_path / "images"), tmp_path / "sparse" / "1", extension)
    whole = read_capture(tmp_path)
    assert len(whole.cameras) == 5 and not whole.warnings
    named = read_capture(tmp_path / "sparse" / "0")
    assert len(named.cameras) == 3
    assert any("1 beside 0" in text for text in named.warnings)


def test_a_text_model_without_the_lines_of_observations_is_read(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images")
    file = write(reconstruction, tmp_path / "sparse", "txt") / "images.txt"
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    file.write_text("\n".join(lines))
    agrees(read_capture(tmp_path), reconstruction, tmp_path / "images")


def test_observations_are_passed_over(tmp_path, solved, agrees):
    reconstruction = solved(tmp_path / "images")
    for image in reconstruction.images.values():
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([i, 2.5 * i])) for i in range(40)])
    for index, number in enumerate(list(reconstruction.points3D)[:40]):
        for image in (1, 2, 3):
            element = pycolmap.TrackElement(image, index)
            reconstruction.add_observation(number, element)
    for extension in WRITERS:
        folder = write(reconstruction, tmp_path / extension, extension)
        capture = read_capture(folder / f"images.{extension}", photos=tmp_path / "images")
        agrees(capture, reconstruction, tmp_path / "images")
        assert len(capture.points) == 150
