"""Where photos say nothing of what is there: beyond their lens, and where a picture says so."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from solver.capture.camera import Camera
from solver.capture.errors import CaptureError
from solver.capture.formats.transforms import write_transforms
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photo_matches import picture_of
from solver.capture.photos import Photo, at_sizes_of, load_photo, load_photos, resized
from solver.capture.read import read_capture
from solver.capture.told import filled, told_of, told_of_reduced
from tests.capture.test_capture import make_capture, pose

SIZE = 16
BOX = np.zeros((SIZE, SIZE), np.uint8)
BOX[:, 12:] = 255


def camera(**changes):
    values = dict(
        name="c", image_path=None, camera_to_world=pose(0.4), width=64, height=48, fx=20.0, fy=20.0,
        cx=32.0, cy=24.0,
    )  # fmt: skip
    return Camera(**{**values, **changes})


def ignoring_capture(folder, picture=BOX, edit=lambda content: None):
    """A capture of opaque photos, and beside it a picture of what is to be ignored of all of them."""
    make_capture(folder / "capture", size=SIZE, alpha=False, edit=edit)
    if picture is not None:
        Image.fromarray(picture).save(folder / "ignore.png")
    return folder / "capture"


@pytest.mark.parametrize(
    "lens, distortion, focal",
    [
        ("opencv_fisheye", (0.0,) * 4, 7.0), ("opencv", (-1 / 3, 0.0, 0.0, 0.0, 0.0), 30.0),
        ("eucm", (0.8, 1.0), 15.0), ("division", (0.5,), 15.0),
    ],
)  # fmt: skip
def test_a_photo_says_nothing_where_its_lens_has_no_rays(lens, distortion, focal):
    item = camera(lens=lens, distortion=distortion, fx=focal, fy=focal)
    told = told_of(item)
    row, column = np.mgrid[: item.height, : item.width] + 0.5
    reached = item.lens_reaches(column.ravel(), row.ravel()).reshape(told.shape)
    assert 0 < told.sum() < reached.sum() < told.size and not (told & ~reached).any()
    # All but the rim, whose rays beside the centre of a pixel there is no step for.
    assert told.sum() > 0.75 * reached.sum()
    assert told_of(item) is told, "one answer for all cameras of a lens"


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lens": "opencv", "distortion": (0.1, -0.05, 0, 0)},
        {"lens": "fov", "distortion": (0.9,)},
    ],
)
def test_photos_that_say_something_everywhere_are_not_looked_at_any_closer(changes):
    item = camera(fx=70.0, fy=70.0, **changes)
    assert told_of(item) is None and item.told is None


def test_a_picture_says_what_is_ignored_white_or_black_soft_or_not(tmp_path):
    photo = tmp_path / "a.png"
    Image.fromarray(np.full((SIZE, SIZE, 3), 90, np.uint8)).save(photo)
    soft = BOX.copy()
    soft[:, 11] = 100
    for picture, is_black, first in ((BOX, False, 12), (255 - BOX, True, 12), (soft, False, 11)):
        Image.fromarray(picture).save(tmp_path / "i.png")
        item = camera(
            image_path=photo, width=SIZE, height=SIZE, ignored_path=tmp_path / "i.png",
            ignored_is_black=is_black,
        )  # fmt: skip
        expected = np.arange(SIZE) < first
        np.testing.assert_array_equal(load_photo(item).told, np.tile(expected, (SIZE, 1)))
        assert not load_photo(item).has_alpha
    Image.fromarray(np.zeros((SIZE, SIZE), np.uint8)).save(tmp_path / "i.png")
    assert told_of(camera(image_path=photo, ignored_path=tmp_path / "i.png", height=64)) is None


def test_what_alpha_says_of_what_is_ignored_does_not_count(tmp_path):
    pixels = np.full((SIZE, SIZE, 4), 90, np.uint8)
    pixels[..., 3] = 255 - BOX
    Image.fromarray(pixels).save(tmp_path / "a.png")
    Image.fromarray(BOX).save(tmp_path / "i.png")
    item = camera(image_path=tmp_path / "a.png", width=SIZE, height=SIZE)
    assert load_photo(item).has_alpha
    ignoring = camera(
        image_path=tmp_path / "a.png", width=SIZE, height=SIZE, ignored_path=tmp_path / "i.png"
    )
    assert not load_photo(ignoring).has_alpha


def test_a_smaller_photo_says_something_where_all_that_its_pixels_are_made_of_does():
    told = np.ones((60, 60), bool)
    told[:, 30:] = False
    pixels = np.ones((60, 60, 4), np.float32)
    pixels[:, 30:] = 0
    small = resized(Photo(pixels, False, False, told=told), 20, 20)
    assert small.told[:, :9].all() and not small.told[:, 10:].any()
    np.testing.assert_allclose(small.pixels[small.told], 1, atol=1e-6)
    whole = resized(Photo(pixels, False, False), 20, 20)
    assert whole.told is None and np.array_equal(whole.pixels, small.pixels)


def test_what_a_photo_says_nothing_of_is_out_of_its_cameras_frame(tmp_path):
    folder = ignoring_capture(tmp_path)
    capture = read_capture(folder, ignored=tmp_path / "ignore.png")
    seeing = at_sizes_of(load_photos(capture), capture).cameras[0]
    row, column = np.mgrid[:SIZE, :SIZE].reshape(2, -1) + 0.5
    origins, directions = seeing.rays(column, row)
    points = origins + 3 * directions
    for side in (SIZE, 2 * SIZE, SIZE // 2):  # a mask of any size is looked up
        (rows, columns), inside, depth = seeing.pixels_of(points, (side, side))
        np.testing.assert_array_equal(inside, column < 12)
        assert len(rows) == len(columns) == len(depth) == inside.sum()
    assert capture.cameras[0].in_frame(points).all() and not seeing.in_frame(points).all()
    assert seeing.resized(8, 8).seen_from(np.ones(3)).told is seeing.told


def test_colours_go_on_where_nothing_is_known():
    colour = np.arange(4.0)[None, :, None].repeat(3, 0)
    known = np.tile([False, True, True, False], (3, 1))
    np.testing.assert_array_equal(filled(colour, known)[0, :, 0], [1, 1, 2, 2])
    assert filled(colour, None) is colour and filled(colour, known | True) is colour


def test_no_features_are_sought_where_a_photo_says_nothing():
    told = np.ones((400, 400), bool)
    told[:, 300:] = False
    photo = Photo(np.ones((400, 400, 4), np.float32), False, False, told=told)
    hidden = picture_of(photo).hidden
    share = 300 / 400 * hidden.shape[1]
    assert hidden[:, int(share) :].all() and hidden[:, int(share) - 2].all()
    assert not hidden[:, : int(share) - 20].any()
    assert picture_of(Photo(photo.pixels, False, False)).hidden is None


def test_a_reduced_photo_says_something_where_the_whole_one_does(tmp_path):
    folder = ignoring_capture(tmp_path)
    item = read_capture(folder, ignored=tmp_path / "ignore.png").cameras[0]
    np.testing.assert_array_equal(told_of_reduced(item, (8, 8)), np.tile(np.arange(8) < 6, (8, 1)))


def test_instant_ngps_dynamic_masks_are_of_what_is_ignored_and_neither_masks_nor_photos(tmp_path):
    folder = ignoring_capture(tmp_path, None)
    Image.fromarray(BOX // 85).save(folder / "dynamic_mask_r_1.png")  # not black at all is enough
    capture = read_capture(folder)
    assert [c.ignored_path for c in capture.cameras] == [None, folder / "dynamic_mask_r_1.png", None, None]
    assert not any(c.mask_path for c in capture.cameras) and not capture.warnings
    assert [p.stem for p in PhotoFinder(folder).pictures()] == ["r_0", "r_1", "r_2", "r_3"]
    told = [photo.told for photo in load_photos(capture)]
    assert told[0] is None and not told[1][:, 12:].any() and told[1][:, :12].all()


def test_a_picture_called_like_a_dynamic_mask_of_no_photo_is_a_photo(tmp_path):
    Image.new("L", (8, 8)).save(tmp_path / "dynamic_mask_a.png")
    assert len(PhotoFinder(tmp_path).pictures()) == 1


def test_a_folder_holds_what_is_ignored_by_the_photos_names_and_no_photos(tmp_path):
    folder = ignoring_capture(tmp_path, None)
    (folder / "hands").mkdir()
    for name in ("r_0.png", "r_2.png"):
        Image.fromarray(BOX).save(folder / "hands" / name)
    capture = read_capture(folder, ignored=folder / "hands")
    assert [c.ignored_path is not None for c in capture.cameras] == [True, False, True, False]
    assert [c.image_path.parent for c in capture.cameras] == [folder] * 4
    with pytest.raises(CaptureError, match="other, ignore: no mask there has a photo's name"):
        (tmp_path / "other").mkdir()
        read_capture(folder, ignored=tmp_path / "other")
    with pytest.raises(CaptureError, match="nowhere, ignore: there is no such folder or picture"):
        read_capture(folder, ignored=tmp_path / "nowhere")


def test_one_file_for_all_photos_that_is_no_picture_is_refused_before_any_photo_is_read(tmp_path):
    folder = ignoring_capture(tmp_path, None)
    (tmp_path / "a.png").write_text("white where a hand is")
    with pytest.raises(CaptureError, match=r"a\.png: this is no PNG, JPEG"):
        read_capture(folder, ignored=tmp_path / "a.png")


def test_a_lenss_mask_that_all_frames_name_is_black_where_nothing_is_fitted(tmp_path):
    def name(content):
        for frame in content["frames"]:
            frame["mask_path"] = "../ignore.png"

    folder = ignoring_capture(tmp_path, 255 - BOX, name)
    capture = read_capture(folder, photos=tmp_path)
    assert all(c.mask_path is None and c.ignored_is_black for c in capture.cameras)
    assert "what is black in it is ignored" in capture.warnings[0]
    assert not load_photos(capture)[0].told[:, 12:].any()


def test_a_jobs_camera_file_has_what_is_ignored_back(tmp_path):
    folder = ignoring_capture(tmp_path)
    capture = read_capture(folder, ignored=tmp_path / "ignore.png")
    write_transforms(tmp_path / "job" / "transforms.json", list(capture.cameras))
    again = read_capture(tmp_path / "job" / "transforms.json", trusted=True)
    assert {c.ignored_path for c in again.cameras} == {tmp_path / "ignore.png"}
    assert not any(c.ignored_is_black or c.mask_path for c in again.cameras)
    write_transforms(
        tmp_path / "job" / "transforms.json",
        [Camera(**{**vars(c), "ignored_is_black": True}) for c in again.cameras],
    )
    again = read_capture(tmp_path / "job" / "transforms.json", trusted=True)
    assert all(c.ignored_is_black for c in again.cameras)


def test_what_is_ignored_moves_with_the_photos_and_is_not_read_from_elsewhere(tmp_path):
    def name(content):
        for frame, ignored in zip(
            content["frames"],
            ("hand.png", "../ignore.png", str(tmp_path / "ignore.png"), None),
            strict=True,
        ):
            frame["ignored_path"] = ignored

    folder = ignoring_capture(tmp_path, BOX, name)
    Image.fromarray(BOX).save(folder / "hand.png")
    moved = tmp_path / "cameras"
    moved.mkdir()
    (folder / "transforms_train.json").replace(moved / "transforms.json")
    cameras = read_capture(moved, photos=folder).cameras
    assert cameras[0].ignored_path == folder / "hand.png" and cameras[3].ignored_path is None
    for item in cameras[1:3]:
        assert item.ignored_path.is_relative_to(moved) and not item.ignored_path.exists()


def test_pictures_that_cannot_be_used_are_named_with_what_to_do(tmp_path):
    folder = ignoring_capture(tmp_path, np.zeros((8, 20), np.uint8))

    def load():
        load_photos(read_capture(folder, ignored=tmp_path / "ignore.png"))

    with pytest.raises(CaptureError, match="ignore.png, ignored_path: .*20 × 8.*16 × 16.*the same shape"):
        load()
    (tmp_path / "ignore.png").write_bytes((tmp_path / "ignore.png").read_bytes()[:40])
    with pytest.raises(CaptureError, match="ignore.png.*cannot be decoded"):
        load()
    Image.fromarray(np.full((SIZE, SIZE), 255, np.uint8)).save(tmp_path / "ignore.png")
    with pytest.raises(
        CaptureError, match="ignored_path: all of the photo 'r_0' is to be ignored"
    ) as caught:
        load()
    assert "make only what is to be ignored white" in str(caught.value)
    content = json.loads((folder / "transforms_train.json").read_text())
    content["frames"][0]["ignored_path"] = "none.png"
    (folder / "transforms_train.json").write_text(json.dumps(content))
    with pytest.raises(CaptureError, match="none.png, ignored_path: the mask does not exist"):
        load_photos(read_capture(folder))


def test_a_lens_that_reaches_no_pixel_is_refused():
    item = camera(lens="division", distortion=(1e6,), cx=32.1, cy=-math.pi)
    with pytest.raises(CaptureError, match="c, lens: its lens model has no ray for any"):
        told_of(item)
