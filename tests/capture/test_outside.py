"""Whatever a camera file calls its photos, masks and other files: nothing outside of its folder is read."""

import json
import re
import sys

import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.photo_finder import PhotoFinder
from solver.capture.picture_names import parts_of
from solver.capture.read import read_capture
from tests.capture.every_format import MAKERS
from tests.capture.programs import COUNT, save_photos

NAMING = list(MAKERS)[: list(MAKERS).index("COLMAP, binary")]
"""formats whose files are text and name other files"""
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
            return json.dumps(text)[1:-1] if file.suffix in (".json", ".opf", ".sfm", ".geojson") else text

        # A name stands between quotation marks, tags, commas or blanks, perhaps behind its folders.
        text, count = re.subn(rf"""(?<![^\s"'>,])(?:[^\s"'<>,]*/)?({named})(?![^\s"'<,])""", outside,
                              file.read_text())  # fmt: skip
        file.write_text(text)
        changed += count
    return changed


@pytest.mark.parametrize("way", WAYS_OUT)
@pytest.mark.parametrize("program", NAMING)
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
