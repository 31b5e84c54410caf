"""CO3D's sequences: their projection, which one is read, masks, and files that are none."""

import gzip
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import co3d
from solver.capture.read import camera_file, read_capture
from tests.capture.hostile import VALUES, reads_or_refuses
from tests.capture.programs import COUNT, HEIGHT, RANDOM_TESTS, WIDTH, check_projection, poses, save_photos

FOCAL, CENTRE = (2.5, 3.0), (0.1, -0.2)
SEQUENCE, OTHER = "110_13051_23361", "540_79043_153212"


def frame(sequence, index, category="apple", isotropic=False):
    """A `FrameAnnotation` of the data set's dataset/data_types.py, as JSON."""
    from_world = np.diag([-1.0, -1, 1, 1]) @ np.linalg.inv(poses()[index])
    folder, stem = f"{category}/{sequence}", f"IMG_{index:04d}"
    return {
        "sequence_name": sequence, "frame_number": index, "frame_timestamp": 0.1 * index,
        "image": {"path": f"{folder}/images/{stem}.jpg", "size": [HEIGHT, WIDTH]},
        "depth": {"path": f"{folder}/depths/{stem}.jpg.geometric.png", "scale_adjustment": 1.0,
                  "mask_path": f"{folder}/depth_masks/{stem}.png"},
        "mask": {"path": f"{folder}/masks/{stem}.png", "mass": 9.0},
        "viewpoint": {
            "R": from_world[:3, :3].T.tolist(), "T": from_world[:3, 3].tolist(), "focal_length": FOCAL,
            "principal_point": CENTRE,
            "intrinsics_format": "ndc_isotropic" if isotropic else "ndc_norm_image_bounds",
        },
        "meta": None,
    }  # fmt: skip


def write(category, frames):
    category.mkdir(parents=True, exist_ok=True)
    (category / co3d.FILE).write_bytes(gzip.compress(json.dumps(frames).encode()))
    sequences = [{"sequence_name": SEQUENCE, "category": "apple", "viewpoint_quality_score": 1.0}]
    (category / "sequence_annotations.jgz").write_bytes(gzip.compress(json.dumps(sequences).encode()))
    return category


def save_sequence(category, sequence):
    stems = [f"IMG_{i:04d}" for i in range(COUNT)]
    save_photos(category / sequence / "images", stems, extension=".jpg")
    for maps, names in (
        ("masks", stems), ("depth_masks", stems), ("depths", [f"{stem}.jpg.geometric" for stem in stems]),
    ):  # fmt: skip
        save_photos(category / sequence / maps, names)
    (category / sequence / "pointcloud.ply").write_text("ply\n")
    return category / sequence


def make(category, isotropic=False, edit=None):
    """A category of two sequences, of which one was downloaded."""
    save_sequence(category, SEQUENCE)
    frames = [frame(name, i, isotropic=isotropic) for name in (OTHER, SEQUENCE) for i in range(COUNT)]
    if edit is not None:
        edit(frames[COUNT + 1])
    return write(category, frames)


def projection(isotropic):
    unit = np.full(2, HEIGHT / 2) if isotropic else np.array([WIDTH, HEIGHT]) / 2

    def project(index, point):
        """As `_get_pytorch3d_camera` of dataset/co3d_dataset.py: from the middle to the left and upwards."""
        view = frame(SEQUENCE, index, isotropic=isotropic)["viewpoint"]
        x, y, z = point @ np.array(view["R"]) + view["T"]
        ndc = np.array(FOCAL) * (x / z, y / z) + CENTRE
        return np.array([WIDTH, HEIGHT]) / 2 - ndc * unit

    return project


@pytest.mark.parametrize("given_as", ["", "apple", f"apple/{co3d.FILE}", f"apple/{SEQUENCE}"])
@pytest.mark.parametrize("isotropic", [False, True])
def test_points_project_as_pytorch3d_has_them_and_masks_are_found(tmp_path, isotropic, given_as):
    folder = make(tmp_path / "apple", isotropic) / SEQUENCE
    capture = read_capture(tmp_path / given_as)
    assert capture.format == co3d.NAME and not capture.warnings and not capture.metric
    check_projection(capture, projection(isotropic), poses())
    for camera in capture.cameras:
        assert camera.image_path.parent == folder / "images"
        assert camera.mask_path == folder / "masks" / f"{camera.image_path.stem}.png"


def test_of_several_sequences_the_one_is_read_whose_folder_is_given(tmp_path):
    category = make(tmp_path / "apple")
    save_sequence(category, OTHER)
    for given_as in (category, tmp_path, category / co3d.FILE):
        with pytest.raises(
            CaptureError, match=rf"several captures \({SEQUENCE}, {OTHER}\); give the folder of"
        ):
            read_capture(given_as)
    for name in (SEQUENCE, OTHER):
        capture = read_capture(category / name)
        assert capture.source == category / co3d.FILE and len(capture.cameras) == COUNT
        assert all(camera.image_path.parent == category / name / "images" for camera in capture.cameras)
        moved = read_capture(category / co3d.FILE, photos=category / name)
        assert [c.image_path for c in moved.cameras] == [c.image_path for c in capture.cameras]


def test_a_camera_file_in_a_sequences_folder_goes_before_the_categorys(tmp_path):
    folder = make(tmp_path / "apple") / SEQUENCE
    (folder / "transforms.json").write_text('{"frames": []}')
    assert camera_file(folder) == folder / "transforms.json"


def test_frames_without_a_viewpoint_are_left_out(tmp_path):
    capture = read_capture(make(tmp_path, edit=lambda annotated: annotated.update(viewpoint=None)))
    assert len(capture.cameras) == COUNT - 1 and "1 of 5 photos has no pose" in capture.warnings[0]


def test_a_sequence_that_is_not_in_the_file_has_no_cameras(tmp_path):
    category = make(tmp_path / "apple")
    (category / SEQUENCE).rename(category / "110")
    with pytest.raises(CaptureError, match="cameras: there are none in it"):
        read_capture(category)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"image": {"path": 3, "size": [4, 4]}}, "image.path"), ({"image": {"path": "a", "size": [4]}}, "image.size"),
        ({"viewpoint": {"R": [[1, 2]], "T": [0, 0, 0], "focal_length": FOCAL, "principal_point": CENTRE}},
         "viewpoint.R"),
        ({"viewpoint": {"focal_length": "x"}}, "viewpoint.focal_length"),
    ],
)  # fmt: skip
def test_a_malformed_frame_gets_an_error_with_file_field_and_remedy(tmp_path, change, field):
    make(tmp_path, edit=lambda annotated: annotated.update(change))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path)
    assert caught.value.file.name == co3d.FILE and caught.value.field == f"{SEQUENCE}[1].{field}"
    assert caught.value.remedy


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_file_that_broke_off_is_told_as_such(tmp_path, share):
    file = make(tmp_path) / co3d.FILE
    packed = file.read_bytes()
    file.write_bytes(packed[: int(share * len(packed))])
    with pytest.raises(CaptureError, match="cannot be read as CO3D .*(ended before the end|unpack)"):
        read_capture(tmp_path)


@RANDOM_TESTS
@given(
    part=st.sampled_from(["", "image", "viewpoint"]), value=VALUES,
    key=st.sampled_from(["R", "T", "focal_length", "principal_point", "intrinsics_format", "path", "size",
                         "image", "viewpoint"]),
)  # fmt: skip
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, part, key, value):
    reads_or_refuses(make(tmp_path, edit=lambda f: (f[part] if part else f).update({key: value})))
