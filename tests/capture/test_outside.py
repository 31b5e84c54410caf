"""Whatever a camera file calls its photos, masks and other files: nothing outside of its folder is read."""

import json
import re
import sys

import numpy as np
import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.photo_finder import PhotoFinder
from solver.capture.picture_names import parts_of
from solver.capture.read import read_capture
from tests.capture import (
    blocks,
    colmap_models,
    test_bundler,
    test_kapture,
    test_meshroom,
    test_metashape,
    test_nerfies,
    test_opendronemap,
    test_openmvg,
    test_opensfm,
    test_opf,
    test_radiance_fields,
    test_realitycapture,
    test_sdfstudio,
    test_visualsfm,
)
from tests.capture.programs import COUNT, HEIGHT, WIDTH, names, poses, save_photos

POINTS = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
WAYS_OUT = {
    "whole path": "{place}/{name}",
    "two slashes": "/{place}/{name}",
    "upwards": "../secret/{name}",
    "upwards from within": "photos/../../secret/{name}",
    "of Windows": "..\\secret\\{name}",
    "a server's": "\\{place}\\{name}",
    "address": "file://{place}/{name}",
    "coded address": "%2e%2e/secret/{name}",
}
_TEXTS = (".json", ".opf", ".sfm", ".xml", ".txt", ".csv", ".out", ".nvm", ".geojson")


def make_transforms(folder):
    save_photos(folder)
    save_photos(folder, [f"{name}_seen" for name in names()])
    (folder / "points.ply").write_text(f"{POINTS}end_header\n0 0 0\n")
    frames = [
        {"file_path": f"{name}.png", "mask_path": f"{name}_seen.png", "transform_matrix": pose.tolist()}
        for name, pose in zip(names(), poses() @ np.diag([1.0, -1, -1, 1]), strict=True)
    ]  # fmt: skip
    content = {"fl_x": 80, "w": WIDTH, "h": HEIGHT, "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))


def make_blocks(folder):
    photos = [
        blocks.photo(i, pose, inside=f"<MaskPath>{name}_seen.png</MaskPath>")
        for i, (name, pose) in enumerate(zip(names(), poses(), strict=True))
    ]
    blocks.write(folder, blocks.document([blocks.group(photos)]))
    save_photos(folder / "photos", [f"{name}_seen" for name in names()])


def make_nerfies(folder):
    ids = test_nerfies.IDS
    test_nerfies.make(folder)
    (folder / "dataset.json").write_text(
        json.dumps({"ids": ids, "train_ids": ids, "val_ids": [], "count": COUNT})
    )


MAKERS = {
    "transforms.json": lambda folder, solved: make_transforms(folder),
    "COLMAP": lambda folder, solved: colmap_models.write(
        solved(folder, names=[f"{name}.png" for name in names()]), folder, "txt"
    ),
    "Bundler": lambda folder, solved: test_bundler.export(
        solved(folder, "SIMPLE_PINHOLE", (70, 32, 24)), folder / "bundle.out", "list.txt"
    ),
    "VisualSFM": lambda folder, solved: test_visualsfm.export(
        solved(folder, "SIMPLE_PINHOLE", (70, 32, 24)), folder / "model.nvm"
    ),
    "Meshroom": lambda folder, solved: test_meshroom.write(folder, test_meshroom.scene(folder=".")),
    "OpenMVG": lambda folder, solved: test_openmvg.write(folder, test_openmvg.scene(root=".")),
    "OpenSfM": lambda folder, solved: test_opensfm.write(folder, test_opensfm.scene()),
    "OpenDroneMap": lambda folder, solved: test_opendronemap.write(
        folder, test_opendronemap.shots()
    ),
    "Metashape": lambda folder, solved: test_metashape.write(folder, test_metashape.simple()),
    "RealityCapture": lambda folder, solved: test_realitycapture.write_table(
        folder, test_realitycapture.table()
    ),
    "BlocksExchange": lambda folder, solved: make_blocks(folder),
    "Kapture": lambda folder, solved: test_kapture.make(folder),
    "OPF": lambda folder, solved: test_opf.write(folder),
    "SDFStudio": lambda folder, solved: test_sdfstudio.write(folder, test_sdfstudio.scene()),
    "splat": lambda folder, solved: test_radiance_fields.make_splat(folder),
    "Nerfies": lambda folder, solved: make_nerfies(folder),
}
"""formats whose files name other files"""


@pytest.fixture(scope="module")
def opened():
    """Paths of files and folders that are opened while a test runs."""
    paths, watching = [], [True]

    def see(event, arguments):
        if watching[0] and event in ("open", "os.listdir", "os.scandir"):
            paths.append(str(arguments[0]))

    sys.addaudithook(see)  # there is no taking it off
    yield paths
    watching[0] = False


def lead_out(folder, form):
    """Let all names in the text files of a capture lead to the copies in the folder `secret` beside it;
    returns how many were changed."""
    place, changed = folder.parent / "secret", 0
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    spelt = {spelling for file in files for spelling in (file.name, file.stem)}
    named = "|".join(re.escape(name) for name in sorted(spelt, key=len, reverse=True))
    for file in files:
        if file.suffix not in _TEXTS:
            continue

        def outside(found, file=file):
            text = form.format(place=place, name=found[1])
            return (
                json.dumps(text)[1:-1]
                if file.suffix in (".json", ".opf", ".sfm", ".geojson")
                else text
            )

        # A name stands between quotation marks, tags, commas or blanks, perhaps behind its folders.
        text, count = re.subn(rf"""(?<![^\s"'>,])(?:[^\s"'<>,]*/)?({named})(?![^\s"'<,])""", outside,
                              file.read_text())  # fmt: skip
        file.write_text(text)
        changed += count
    return changed


@pytest.mark.parametrize("way", WAYS_OUT)
@pytest.mark.parametrize("program", MAKERS)
def test_no_name_in_a_camera_file_leads_out_of_its_folder(tmp_path, solved, opened, program, way):
    for folder in (tmp_path / "capture", tmp_path / "secret"):
        folder.mkdir()
        MAKERS[program](folder, solved)
    for file in (tmp_path / "secret").rglob("*.png"):
        file.replace(tmp_path / "secret" / file.name)
    assert lead_out(tmp_path / "capture", WAYS_OUT[way]) >= COUNT
    opened.clear()
    try:
        cameras = read_capture(tmp_path / "capture").cameras
    except CaptureError:
        cameras = ()
    assert opened and not [path for path in opened if path.startswith(str(tmp_path / "secret"))]
    used = [path for camera in cameras for path in (camera.image_path, camera.mask_path) if path]
    assert not [path for path in used if not path.resolve().is_relative_to(tmp_path / "capture")]


@pytest.mark.parametrize("form", WAYS_OUT.values())
def test_a_mask_that_is_not_there_is_looked_for_in_the_captures_folder_alone(tmp_path, form):
    for folder in ("capture", "secret"):
        save_photos(tmp_path / folder, ["a"])
    Image.new("L", (8, 8)).save(tmp_path / "secret" / "b.png")
    folder, photo = tmp_path / "capture", tmp_path / "capture" / "a.png"
    stated = form.format(place=tmp_path / "secret", name="b.png")
    mask = PhotoFinder(folder).mask_of(photo, stated, beside=folder / "transforms.json")
    assert mask.is_relative_to(folder) and not mask.exists()


def test_parts_of_a_path_begin_below_its_root_server_or_drive():
    for stated in ("/a/b.png", "//a/b.png", "\\\\a\\b.png", "C:\\a\\b.png", "c:/a//./../b.png"):
        assert parts_of(stated) == ["a", "b.png"]
