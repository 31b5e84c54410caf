"""Photos and masks by what camera files call them."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photos import load_photo
from solver.capture.read import read_capture
from solver.capture.reduced import load_reduced, load_reduced_mask
from solver.preflight.looks import look_at
from tests.capture.test_capture import make_capture, pose


def save(file, value=128, size=8):
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((size, size, 3), value, np.uint8)).save(file)
    return file


def write_cameras(folder, names, **extra):
    frames = [
        {"file_path": name, "transform_matrix": pose(i).tolist(), **extra} for i, name in enumerate(names)
    ]
    file = folder / "transforms.json"
    file.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    return file


def test_photos_of_one_name_have_the_masks_of_their_own_folders(tmp_path):
    for side in ("left", "right"):
        for i in range(3):
            save(tmp_path / "images" / side / f"{i}.png")
            save(tmp_path / "masks" / side / f"{i}.png.png", 255)
    finder = PhotoFinder(tmp_path)
    for side in ("left", "right"):
        mask = finder.mask_of(tmp_path / "images" / side / "1.png")
        assert mask == tmp_path / "masks" / side / "1.png.png"


@pytest.mark.parametrize("masks", ["masks", "images_masks"])
def test_smaller_copies_of_masks_are_no_photos_and_no_masks(masks, tmp_path):
    photo = save(tmp_path / "images" / "a.png")
    for folder in (masks, f"{masks}_2", f"{masks}_4"):
        save(tmp_path / folder / "a.png", 255)
    finder = PhotoFinder(tmp_path)
    assert finder.find("a.png") == photo
    assert finder.mask_of(photo) == tmp_path / masks / "a.png"


def test_a_folder_that_is_called_like_a_second_one_of_a_mask_may_hold_photos(tmp_path):
    for name in ("mask_2", "_1"):
        photo = save(tmp_path / name / f"{name}.png")
        assert PhotoFinder(tmp_path).find(f"{name}.png") == photo


def test_masks_that_could_both_be_meant_are_refused(tmp_path):
    photo = save(tmp_path / "images" / "a.png")
    save(tmp_path / "masks" / "one" / "a.png")
    save(tmp_path / "masks" / "two" / "a.png")
    with pytest.raises(CaptureError, match="could both be meant; .*folder of the masks"):
        PhotoFinder(tmp_path).mask_of(photo)
    assert PhotoFinder(tmp_path, tmp_path / "masks" / "two").mask_of(photo).parent.name == "two"


@pytest.mark.parametrize(
    "mask",
    [
        "masks/a.png", "masks/a.jpg.png", "Masks/a_mask.png", "images/masks/a.png",
        "images_mask/a.png", "images_masks/a.tif", "mask/mask_a.png", "masks/a-mask.png",
        "masks/images/a.png", "masks/a.jpg.mask.png", "images/.mask/a.jpg.mask.png",
    ],
)  # fmt: skip
def test_masks_are_found_by_the_names_programs_give_them(mask, tmp_path):
    photo = save(tmp_path / "project" / "images" / "a.jpg")
    file = save(tmp_path / "project" / mask, 255)
    finder = PhotoFinder(tmp_path)
    assert finder.mask_of(photo) == file
    assert finder.pictures() == [photo]


@pytest.mark.parametrize(
    "mask", ["{}.jpg.mask.png", "{}_mask.png", "{}.mask.tif", "{}-mask.png", "mask_{}.png"]
)
def test_masks_that_lie_beside_their_photos_are_masks_and_no_photos(mask, tmp_path):
    photos = [save(tmp_path / "images" / f"{i}.jpg") for i in range(3)]
    masks = [save(tmp_path / "images" / mask.format(i), 255) for i in range(3)]
    file = write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(3)])
    assert [camera.mask_path for camera in read_capture(file).cameras] == masks
    assert PhotoFinder(tmp_path).pictures() == photos


def test_a_picture_called_like_a_mask_of_no_other_is_a_photo(tmp_path):
    photos = [save(tmp_path / f"venetian_mask_{i}.jpg") for i in range(3)]
    photos.append(save(tmp_path / "the_mask.jpg"))
    save(tmp_path / "other" / "the.jpg")
    assert set(photos) < set(PhotoFinder(tmp_path).pictures())


def test_where_photos_are_gone_the_larger_of_their_smaller_copies_count(tmp_path):
    for i in range(3):
        for factor in (2, 4, 8):
            save(tmp_path / f"images_{factor}" / f"{i}.jpg", size=99 // factor)
    capture = read_capture(write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(3)]))
    assert {camera.image_path.parent.name for camera in capture.cameras} == {"images_2"}


@pytest.mark.parametrize("copies", ["images_2", "thumbnails", "images/Preview"])
def test_of_a_photo_and_its_smaller_copies_the_photo_counts(copies, tmp_path):
    whole = [save(tmp_path / "images" / f"{i}.png", size=16) for i in range(3)]
    for i in range(3):
        save(tmp_path / copies / f"{i}.png", size=8)
    names = [f"D:/elsewhere/{i}.png" for i in range(3)]
    capture = read_capture(write_cameras(tmp_path, names))
    assert [camera.image_path for camera in capture.cameras] == whole


@pytest.mark.parametrize(
    ("name", "page"),
    [("Küche", "cp1252"), ("Łazienka", "cp1250"), ("写真", "cp932"), ("Küche", "mac_roman")],
)
def test_names_in_the_encodings_of_windows_are_found(name, page, tmp_path):
    for folder in (name, "other"):
        save(tmp_path / folder / "1.png")
    photos = [save(tmp_path / name / f"{i} {name}.png") for i in range(3)]
    finder = PhotoFinder(tmp_path)
    told = [f"{name}/{path.name}".encode(page).decode("utf-8", "surrogateescape") for path in photos]
    assert [finder.find(stated) for stated in told] == photos
    stated = f"{name}/1.png".encode(page).decode("utf-8", "surrogateescape")
    assert finder.find(stated) == tmp_path / name / "1.png"
    assert finder.find("\ud83d.png") is None, "half a letter, as broken JSON has it"


def test_other_photos_of_the_same_names_are_no_copies(tmp_path):
    for folder in ("left", "right"):
        for i in range(3):
            save(tmp_path / folder / f"{i}.png")
    with pytest.raises(CaptureError, match="could both be meant"):
        read_capture(write_cameras(tmp_path, [f"D:/elsewhere/{i}.png" for i in range(3)]))


def test_photos_in_a_folder_that_is_a_link_are_found_and_links_in_circles_end(tmp_path):
    for i in range(3):
        save(tmp_path / "disk" / f"{i}.png")
    project = tmp_path / "project"
    project.mkdir()
    try:
        (project / "photos").symlink_to(tmp_path / "disk", target_is_directory=True)
        (tmp_path / "disk" / "round").symlink_to(project, target_is_directory=True)
    except OSError:
        pytest.skip("no links here")
    capture = read_capture(write_cameras(project, [f"C:/photos/{i}.jpg" for i in range(3)]))
    assert [c.image_path for c in capture.cameras] == [project / "photos" / f"{i}.png" for i in range(3)]
    assert len(PhotoFinder(project).pictures()) == 3


@pytest.mark.parametrize("name", ["1", "model", "text"])
def test_a_camera_file_beside_its_photos_means_those_whatever_its_folder_is_called(name, tmp_path):
    for folder in (name, "2"):
        for i in range(3):
            save(tmp_path / folder / "photos" / f"{i}.png")
    names = [f"D:/elsewhere/{i}.png" for i in range(3)]
    capture = read_capture(write_cameras(tmp_path / name, names))
    assert {c.image_path.parent for c in capture.cameras} == {tmp_path / name / "photos"}


def test_pictures_beside_a_model_do_not_keep_it_from_its_photos(tmp_path):
    photos = [save(tmp_path / "images" / f"{i}.png", size=16) for i in range(3)]
    for i in range(3):
        save(tmp_path / "colmap" / "masks" / f"{i}.png", 255, size=16)
        save(tmp_path / "colmap" / "textures" / f"t{i}.png")
    capture = read_capture(write_cameras(tmp_path / "colmap", [f"D:/elsewhere/{i}.png" for i in range(3)]))
    assert [camera.image_path for camera in capture.cameras] == photos


def test_photos_of_one_name_in_numbered_folders_are_no_copies(tmp_path):
    for i in range(3):
        for number in (2, 4):
            save(tmp_path / f"walk_{number}" / f"{i}.jpg")
    with pytest.raises(CaptureError, match="could both be meant"):
        read_capture(write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(3)]))


def test_a_folder_called_like_a_mask_holds_photos_if_it_stands_alone(tmp_path):
    photo = save(tmp_path / "venetian_mask" / "a.jpg")
    assert PhotoFinder(tmp_path).pictures() == [photo]


def test_a_photo_missing_from_its_folder_is_not_another_folders(tmp_path):
    for i in range(5):
        save(tmp_path / "train" / f"r_{i}.png")
        save(tmp_path / "test" / f"r_{i}.png")
    (tmp_path / "train" / "r_3.png").unlink()
    names = [f"./train/r_{i}" for i in range(5)]
    capture = read_capture(write_cameras(tmp_path, names))
    assert [camera.name for camera in capture.cameras] == ["r_0", "r_1", "r_2", "r_4"]
    assert "1 of 5 listed photos does not exist and is left out" in capture.warnings[0]


def test_a_photo_missing_beside_smaller_copies_is_left_out(tmp_path):
    for i in range(5):
        for folder in ("images", "images_2", "images_4"):
            save(tmp_path / folder / f"{i}.jpg")
    (tmp_path / "images" / "2.jpg").unlink()
    capture = read_capture(write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(5)]))
    assert {camera.image_path.parent.name for camera in capture.cameras} == {"images"}
    assert len(capture.cameras) == 4


def test_photos_that_moved_to_a_folder_of_another_name_are_still_found(tmp_path):
    for i in range(3):
        save(tmp_path / "small" / f"{i}.jpg")
    names = [rf"D:\shoot\images\{i}.jpg" for i in range(3)]
    assert len(read_capture(write_cameras(tmp_path, names)).cameras) == 3


@pytest.mark.parametrize("form", ["./{}/0.jpg", "{}/0", "{}\\0.jpg", "/elsewhere/{}/0.jpg"])
def test_of_two_cameras_that_find_one_photo_the_one_that_names_its_folder_keeps_it(form, tmp_path):
    for name in "012":
        save(tmp_path / "right" / f"{name}.jpg")
    names = [form.format("left"), form.format("right"), "right/1.jpg", "right/2.jpg"]
    capture = read_capture(write_cameras(tmp_path, names))
    assert len(capture.cameras) == 3 and "1 of 4 listed photos" in capture.warnings[0]
    kept = [camera for camera in capture.cameras if camera.image_path.stem == "0"]
    assert len(kept) == 1
    np.testing.assert_allclose(kept[0].camera_to_world, pose(1), atol=1e-12)


def test_a_folder_of_other_pictures_by_the_stated_name_does_not_hide_the_photos(tmp_path):
    save(tmp_path / "images" / "preview.jpg")
    for i in range(3):
        save(tmp_path / "photos" / f"{i}.jpg")
    for start in ("images/", "/home/somebody/images/"):
        capture = read_capture(write_cameras(tmp_path, [f"{start}{i}.jpg" for i in range(3)]))
        assert {camera.image_path.parent.name for camera in capture.cameras} == {"photos"}


def test_a_mask_by_a_path_of_another_machine_is_found_by_its_photos_name(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"{i}.jpg")
        save(tmp_path / "masks" / f"{i}.png", 255)
    names = [f"images/{i}.jpg" for i in range(3)]
    capture = read_capture(write_cameras(tmp_path, names, mask_path="/home/bob/masks/0.png"))
    assert [camera.mask_path.name for camera in capture.cameras] == ["0.png", "1.png", "2.png"]


def test_photos_of_one_folder_may_have_been_converted(tmp_path):
    file = save(tmp_path / "rgb" / "7.png")
    assert PhotoFinder(tmp_path).find_in(tmp_path / "rgb", "7.jpg") == file
    assert PhotoFinder(tmp_path).find_in(tmp_path / "rgb", "8.jpg") is None


def test_a_folder_of_masks_that_is_given_must_hold_some(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"{i}.jpg")
    (tmp_path / "none").mkdir()
    with pytest.raises(CaptureError, match="no mask there has a photo's name"):
        read_capture(
            write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(3)]), masks=tmp_path / "none"
        )


def test_letters_with_marks_are_found_however_they_are_written(tmp_path):
    for i in range(3):
        save(tmp_path / "Fotos" / f"Ka\u0308fer {i}.jpg")
    names = [f"Fotos/K\u00e4fer {i}.jpg" for i in range(3)]
    assert len(read_capture(write_cameras(tmp_path, names)).cameras) == 3


@pytest.mark.parametrize("kind", ["X3F", "gif"])
def test_photos_of_a_kind_that_cannot_be_read_are_named_and_found_once_converted(tmp_path, kind):
    (tmp_path / "images").mkdir()
    names = [f"images/IMG_{i}.{kind}" for i in range(3)]
    for name in names:
        (tmp_path / name).write_bytes(b"MM\0*")
    file = write_cameras(tmp_path, names)
    with pytest.raises(CaptureError, match=rf"IMG_0.{kind}.*cannot be read; convert all to JPEG"):
        read_capture(file)
    for i in range(3):
        save(tmp_path / "images" / f"IMG_{i}.jpg")
    assert len(read_capture(file).cameras) == 3


@pytest.mark.parametrize("stated", ["{}.jfif", "{}.JPG", "{}"])
def test_jpegs_may_be_called_jfif_as_on_windows(tmp_path, stated):
    for i in range(3):
        save(tmp_path / "images" / f"{i}.jpg").rename(tmp_path / "images" / f"{i}.jfif")
        save(tmp_path / "masks" / f"{i}.jfif.png", 255)
    names = [f"images/{stated.format(i)}" for i in range(3)]
    cameras = read_capture(write_cameras(tmp_path, names)).cameras
    assert [(camera.name, camera.image_path.name) for camera in cameras] == [
        (str(i), f"{i}.jfif") for i in range(3)
    ]
    assert all(camera.mask_path is not None for camera in cameras)
    assert load_photo(cameras[0]).pixels.shape == (8, 8, 4)
    assert load_reduced(cameras[0].image_path, 4, (8, 8))[0].shape[:2] == (4, 4)


def test_photos_of_which_a_file_holds_more_than_one_are_the_first(tmp_path):
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    for i in range(3):
        (tmp_path / "images").mkdir(exist_ok=True)
        frames[0].save(tmp_path / f"images/{i}.MPO", save_all=True, append_images=frames[1:])
    cameras = read_capture(write_cameras(tmp_path, [f"images/{i}" for i in range(3)])).cameras
    path = cameras[2].image_path
    assert path.resolve().name == "2.MPO"
    np.testing.assert_allclose(load_photo(cameras[2]).pixels[4, 4], (1, 0, 0, 1), atol=0.01)
    np.testing.assert_allclose(load_reduced(path, 4, (8, 8))[0][2, 2], (255, 0, 0), atol=2)
    frames[0].save(tmp_path / "images/2.JPG")  # as cameras with two lenses do beside it
    cameras = read_capture(write_cameras(tmp_path, [f"images/{i}" for i in range(3)])).cameras
    assert [camera.image_path.resolve().name for camera in cameras] == ["0.MPO", "1.MPO", "2.JPG"]


def test_masks_of_which_none_has_a_photos_name_are_told(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"{i}.jpg")
        save(tmp_path / "masks" / f"cut out {i}.png")
    file = write_cameras(tmp_path, [f"images/{i}.jpg" for i in range(3)])
    assert "not used; name them like the photos" in " ".join(read_capture(file).warnings)
    with pytest.raises(CaptureError, match="no mask there has a photo's name.*name masks like the photos"):
        read_capture(file, masks=tmp_path / "masks")


def test_a_check_refuses_a_lost_mask_as_a_fit_does_and_names_where_it_was(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"{i}.jpg")
    names = [f"images/{i}.jpg" for i in range(3)]
    capture = read_capture(write_cameras(tmp_path, names, mask_path="masks/all.png"))
    with pytest.raises(CaptureError, match=r"masks.all\.png.*does not exist"):
        look_at(capture.cameras[0], capture.region)


def test_a_photo_turned_without_a_tag_is_refused_when_it_is_read(tmp_path):
    def upright(content):
        content.update(w=20, h=40, fl_x=30.0)

    folder = make_capture(tmp_path, edit=upright)
    for file in folder.glob("r_*.png"):
        Image.new("RGB", (10, 5)).save(file)
    with pytest.raises(CaptureError, match="10 × 5 pixels, but .* says 20 × 40"):
        read_capture(folder)


@pytest.mark.parametrize("kind", ["0 and 1", "alpha", "grey"])
def test_a_check_reads_masks_as_a_fit_does(kind, tmp_path):
    shown = np.zeros((40, 40), np.uint8)
    shown[10:30, 10:30] = 255
    file = tmp_path / "mask.png"
    if kind == "0 and 1":
        Image.fromarray(shown // 255).save(file)
    elif kind == "grey":
        Image.fromarray(shown).save(file)
    else:
        Image.fromarray(np.dstack([np.full((40, 40, 3), 255, np.uint8), shown])).save(file)
    small = load_reduced_mask(file, (20, 20), (40, 40))
    assert small.shape == (20, 20)
    assert (small > 127).sum() == 100 and small[10, 10] == 255 and small[2, 2] == 0


def test_a_camera_file_without_access_is_told_as_such(tmp_path, monkeypatch):
    file = write_cameras(tmp_path, ["a.png"])
    real = type(file).open

    def denied(self, *arguments, **options):
        if self == file:
            raise PermissionError(13, "Permission denied")
        return real(self, *arguments, **options)

    monkeypatch.setattr(type(file), "open", denied)
    with pytest.raises(CaptureError, match="cannot be read .Permission denied.*permissions"):
        read_capture(file)


@pytest.mark.parametrize("name", ["capture.zip", "capture.r3d"])
def test_an_archive_in_a_folder_is_to_be_given_itself(tmp_path, name):
    with zipfile.ZipFile(tmp_path / name, "w") as archive:
        archive.writestr("transforms.json", "{}")
    with pytest.raises(CaptureError, match="this is an archive; unpack it"):
        read_capture(tmp_path / name)
    (tmp_path / "a film.r3d").write_bytes(b"RED2")
    with pytest.raises(CaptureError, match=f"no camera file.*give {name} itself"):
        read_capture(tmp_path)


def test_cameras_of_pictures_to_be_made_need_no_photo_to_be_the_only_one_of_its_name(tmp_path):
    for i in range(3):
        for split in ("train", "test"):
            save(tmp_path / split / f"r_{i}.png")
    file = write_cameras(tmp_path, [f"path/r_{i}" for i in range(3)], w=40, h=30)
    with pytest.raises(CaptureError, match="could both be meant"):
        read_capture(file)
    cameras = read_capture(file, wanted=False).cameras
    assert [(c.name, c.width, c.height, c.image_path) for c in cameras] == [
        (f"r_{i}", 40, 30, None) for i in range(3)
    ]


def test_names_that_are_written_as_addresses_are_found(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"IMG {i}.png")
    write_cameras(tmp_path, [f"file:///C:/my%20scan/images/IMG%20{i}.png" for i in range(3)])
    assert len(read_capture(tmp_path).cameras) == 3


def test_a_name_that_has_a_percent_sign_itself_goes_before_what_it_would_mean(tmp_path):
    for i in range(3):
        save(tmp_path / "images" / f"IMG%20{i}.png")
        save(tmp_path / "images" / f"IMG {i}.png")
    write_cameras(tmp_path, [f"D:/images/IMG%20{i}.png" for i in range(3)])
    assert {c.image_path.name for c in read_capture(tmp_path).cameras} == {
        f"IMG%20{i}.png" for i in range(3)
    }


def test_photos_and_links_to_them_are_the_same_photos(tmp_path):
    for i in range(3):
        photo = save(tmp_path / "originals" / f"{i}.png")
        (tmp_path / "a chosen few").mkdir(exist_ok=True)
        try:
            (tmp_path / "a chosen few" / f"{i}.png").symlink_to(photo)
        except OSError:
            pytest.skip("no links here")
    write_cameras(tmp_path, [f"D:/elsewhere/{i}.png" for i in range(3)])
    cameras = read_capture(tmp_path).cameras
    assert {camera.image_path.parent.name for camera in cameras} == {"originals"}


@pytest.mark.parametrize(
    "told, there",
    [
        ("train", "test"), ("test", "train"), ("./val", "train"), ("test_imgs", "train_imgs"),
        ("train/rgb", "test/rgb"), ("validation/images", "training/images"),
    ],
)  # fmt: skip
def test_a_photo_of_another_split_is_none_though_it_is_the_only_one_of_its_name(tmp_path, told, there):
    """As of BlenderNeRF, which lists test cameras whose photos it does not render."""
    for i in range(3):
        save(tmp_path / there / f"r_{i}.png")
    assert PhotoFinder(tmp_path).find(f"{told}/r_1") is None
    write_cameras(tmp_path, [f"{told}/r_{i}" for i in range(3)])
    with pytest.raises(CaptureError, match="3 of 3 photos are missing"):
        read_capture(tmp_path)


@pytest.mark.parametrize(
    "told, there",
    [
        ("pictures", "train"), ("training_photos", "train"), ("", "train"), ("D:/test", "train engine"),
        ("D:/scans/mug", "normal"), ("D:/scans/mug", "exposure_normal"), ("images", "great_depths"),
    ],
)  # fmt: skip
def test_a_photo_in_a_folder_of_any_name_is_found_where_a_file_tells_no_other_use(tmp_path, told, there):
    photo = save(tmp_path / there / "r_1.png")
    assert PhotoFinder(tmp_path).find(f"{told}/r_1.png".lstrip("/")) == photo


@pytest.mark.parametrize(
    "folder", ["depth", "depths_2", "depth_maps", "normals", "mono_normal", "confidence"]
)
def test_maps_of_the_photos_names_are_not_taken_for_photos_that_are_missing(tmp_path, folder):
    picture = save(tmp_path / folder / "frame_1.png")
    assert PhotoFinder(tmp_path).find("images/frame_1.png") is None
    assert PhotoFinder(tmp_path).find("frame_1.png") == picture  # a file that tells no folder means this
    assert PhotoFinder(tmp_path).find(f"{folder}/frame_1.png") == picture


def test_photos_named_without_extension_are_not_looked_for_one_extension_after_another(
    tmp_path, monkeypatch
):
    names = [f"images/r_{i}" for i in range(40)]
    for name in names:
        save(tmp_path / f"{name}.webp")
    file, asked = write_cameras(tmp_path, names, w=8, h=8), []
    is_file = Path.is_file

    def counted(path):
        asked.append(path.name)
        return is_file(path)

    monkeypatch.setattr(Path, "is_file", counted)
    assert len(read_capture(file).cameras) == len(names)
    assert len([name for name in asked if name.startswith("r_")]) == len(names)


def test_a_photo_in_a_folder_that_may_be_entered_but_not_listed_is_found_by_its_path(tmp_path, monkeypatch):
    photo = save(tmp_path / "images" / "r_1.png")

    def refuse(folder):
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(os, "listdir", refuse)
    monkeypatch.setattr(os, "scandir", refuse)
    assert PhotoFinder(tmp_path).find("images/r_1.png") == photo
    assert PhotoFinder(tmp_path).find("images/r_1") == photo


@pytest.mark.parametrize("stated", ["images/r_1", "images/R_1.jpeg", "images/R_1.JPEG"])
def test_a_photo_has_the_letters_that_its_file_has_also_where_disks_take_either(
    tmp_path, monkeypatch, stated
):
    photo = save(tmp_path / "images" / "r_1.JPEG")
    is_file = Path.is_file

    def of_either_case(path):
        return is_file(photo if path.name.lower() == "r_1.jpeg" else path)

    monkeypatch.setattr(Path, "is_file", of_either_case)
    assert str(PhotoFinder(tmp_path).find(stated)) == str(photo)


@pytest.mark.skipif(os.name == "nt", reason="its disks take letters of either case for the same")
def test_of_photos_whose_names_differ_in_letters_alone_each_is_found(tmp_path):
    photos = [save(tmp_path / "images" / name) for name in ("r_1.png", "R_1.png", "r_1.PNG")]
    if len(os.listdir(tmp_path / "images")) < 3:
        pytest.skip("this disk takes letters of either case for the same")
    assert [PhotoFinder(tmp_path).find(f"images/{photo.name}") for photo in photos] == photos
