"""Files that camera files lie beside, or are said to be: what is no file at all never ends, nor do some lines."""

import json
import os
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest

from solver.capture.errors import CaptureError
from solver.capture.files import (
    LONGEST_LINE,
    MOST_IN_JSON,
    MOST_IN_XML,
    file_below,
    head_of,
    read_bytes,
    read_json,
    read_lines,
    read_xml,
)
from solver.capture.image_header import (
    focal_35mm,
    image_orientation,
    image_size,
    is_heif,
    is_raw,
    may_have_alpha,
)
from solver.capture.photos import load_photos
from solver.capture.read import read_capture
from tests.capture.programs import names, poses, save_photos


@pytest.fixture(params=["pipe", "device"])
def endless(tmp_path, request):
    if not hasattr(os, "mkfifo"):
        pytest.skip("Windows has no such files")
    file = tmp_path / "trajectories.txt"
    os.mkfifo(tmp_path / "pipe")
    file.symlink_to(tmp_path / "pipe" if request.param == "pipe" else os.devnull)
    return file


def test_pipes_and_devices_are_not_read(endless):
    with pytest.raises(CaptureError, match=r"cannot be read \(this is not a file but a pipe"):
        read_bytes(endless)
    with pytest.raises(CaptureError, match=r"cannot be read \(this is not a file but a pipe"):
        list(read_lines(endless))
    assert head_of(endless) == b""


@pytest.mark.parametrize(
    "read", [image_size, image_orientation, may_have_alpha, is_raw, is_heif, focal_35mm]
)
def test_the_header_of_a_photo_that_is_a_pipe_is_not_waited_for(endless, read):
    photo = endless.with_name("a.png")
    endless.rename(photo)
    with suppress(CaptureError):
        assert read(photo) in (0, 1, True, False)


@pytest.mark.parametrize("masks", [False, True])
def test_a_pipe_among_photos_or_masks_is_named(tmp_path, endless, masks):
    frames = [
        {"file_path": f"{name}.png", "transform_matrix": pose.tolist()}
        for name, pose in zip(names(), poses() @ np.diag([1.0, -1, -1, 1]), strict=True)
    ]
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 80, "frames": frames}))
    save_photos(tmp_path)
    name = f"{names()[1]}.png"
    if masks:
        save_photos(tmp_path / "masks")
    place = tmp_path / "masks" / name if masks else tmp_path / name
    place.unlink()
    endless.rename(place)
    told = "the mask does not exist" if masks else "this is not a file but a pipe or a device"
    with pytest.raises(CaptureError, match=f"{name}.*{told}"):
        load_photos(read_capture(tmp_path))


@pytest.mark.parametrize("filling", [b"", b"7"], ids=["nothing", "digits"])
def test_a_line_of_gigabytes_is_refused_without_being_held(tmp_path, filling):
    file = tmp_path / "points3D.txt"
    with file.open("wb") as out:
        out.write(b"# a list\n" + filling * (LONGEST_LINE + 5))
        out.truncate(1 << 30)  # of what was not written, disks have nothing
    tracemalloc.start()
    with pytest.raises(CaptureError, match=r"points3D.txt, line 2: (this is not text|.*more than 16 MB)"):
        list(read_lines(file))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 8 * LONGEST_LINE


HEADS = {
    "sparse/images.txt": b"1 1 0 0 0 0 0 4 1 a.png\n",
    "sparse/points3D.txt": b"1 0 0 0 9 9 9 0.1\n",
    "bundle.out": b"# Bundle file v0.3\n5 0\n",
    "model.nvm": b"NVM_V3\n\n5\n",
    "sensors/trajectories.txt": b"# kapture format: 1.1\n",
    "odometry.csv": b"timestamp, frame, x, y, z, qx, qy, qz, qw\n",
}


@pytest.mark.parametrize("name", HEADS)
def test_no_reader_holds_a_line_of_gigabytes(tmp_path, name):
    save_photos(tmp_path)
    photos = [f"{stem}.png" for stem in names()]
    beside = {
        "sparse/cameras.txt": "1 PINHOLE 96 64 70 60 48 32\n",
        "sparse/images.txt": "".join(f"{i + 1} 1 0 0 0 {i} 0 4 1 {p}\n\n" for i, p in enumerate(photos)),
        "sparse/points3D.txt": "",
        "list.txt": "\n".join(photos),
        "sensors/sensors.txt": "# kapture format: 1.1\ncam, , camera, PINHOLE, 96, 64, 70, 60, 48, 32\n",
        "sensors/records_camera.txt": "".join(f"{i}, cam, {p}\n" for i, p in enumerate(photos)),
        "camera_matrix.csv": "70,0,48\n0,70,32\n0,0,1\n",
    }
    for other, text in beside.items():
        if other.split("/")[:-1] == name.split("/")[:-1]:
            (tmp_path / other).parent.mkdir(exist_ok=True)
            (tmp_path / other).write_text(text)
    with (tmp_path / name).open("wb") as out:
        out.write(HEADS[name])
        out.truncate(1 << 30)
    tracemalloc.start()
    try:
        said = " ".join(read_capture(tmp_path).warnings)
    except CaptureError as error:
        said = str(error)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert name.split("/")[-1] in said and most < 8 * LONGEST_LINE


@pytest.mark.parametrize(
    "read, most, start, piece, end",
    [
        (read_json, MOST_IN_JSON, b'{"frames": [', b"[],", b"[]]}"),
        (read_json, MOST_IN_JSON, b'{"frames": [', b"{},", b"{}]}"),
        (read_xml, MOST_IN_XML, b"<document>", b"<a/>", b"</document>"),
        (read_xml, MOST_IN_XML, b"<document>", b"<a></a>", b"</document>"),
    ],
)
def test_millions_of_values_without_anything_in_them_are_refused_before_they_are_made(
    tmp_path, read, most, start, piece, end
):
    file = tmp_path / "cameras"
    file.write_bytes(start + piece * most + end)
    tracemalloc.start()
    with pytest.raises(CaptureError, match="more than (8|16) million"):
        read(file)
    held = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert held < 3 * file.stat().st_size


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_xml_that_defines_entities_is_refused_in_any_encoding(tmp_path, encoding):
    file = tmp_path / "cameras.xml"
    file.write_bytes('<!DOCTYPE d [<!ENTITY a "b">]><document>&a;</document>'.encode(encoding))
    with pytest.raises(CaptureError, match="DOCTYPE: no camera file has one"):
        read_xml(file)
    file.write_bytes("<document><chunk>ä</chunk></document>".encode(encoding))
    assert read_xml(file).findtext("chunk") == "ä"


@pytest.mark.parametrize(
    "name",
    ["../secret.bin", "//server/share/secret.bin", "/secret.bin", "a\0b", "x" * 5000, "missing"],
)
def test_files_that_lie_elsewhere_are_not_even_asked_for(tmp_path, monkeypatch, name):
    folder, asked, real = tmp_path / "project", [], os.path.realpath
    (folder / "points").mkdir(parents=True)
    (folder / "points" / "inside.bin").write_bytes(b"1")
    (tmp_path / "secret.bin").write_bytes(b"1")
    monkeypatch.setattr(
        os.path, "realpath", lambda path, **how: asked.append(str(path)) or real(path, **how)
    )
    assert file_below(folder, folder / "points", "inside.bin") == folder / "points" / "inside.bin"
    assert file_below(folder, folder, "points/../points/inside.bin").name == "inside.bin"
    for place in (folder, folder / "points"):
        assert file_below(folder, place, name) is None
        assert file_below(folder, place, f"../{name}") is None
    assert asked and all(path.startswith(str(folder)) for path in asked)


def test_links_that_lead_out_are_no_files_below(tmp_path):
    (tmp_path / "project").mkdir()
    (tmp_path / "secret.bin").write_bytes(b"1")
    (tmp_path / "project" / "link.bin").symlink_to(tmp_path / "secret.bin")
    assert file_below(tmp_path / "project", tmp_path / "project", "link.bin") is None
