"""Archives: what apps give reads as its folder does, and a hostile one writes nothing outside."""

import errno
import io
import os
import shutil
import stat
import subprocess
import sys
import zipfile
from pathlib import PurePath

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver.cameras.folder import photos_below
from solver.capture import archive_members, archives
from solver.capture.archives import MARK, unpacked
from solver.capture.errors import CaptureError
from solver.capture.read import read_capture
from tests.capture.test_capture import make_capture
from tests.capture.test_polycam import make_polycam
from tests.capture.test_record3d import make_record3d
from tests.cli.command import ROOT

LONG_AGO = 5_000_000_000
"""nanoseconds; whole seconds are kept by every disk"""


def packed(folder, archive, above=""):
    """All of a folder in an archive, below the folder `above` there."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            file.write(path, os.path.join(above, path.relative_to(folder)))
    return archive


def with_member(archive, name, content=b"x", **changes):
    """An archive of one photo and a member more, with this and that changed."""
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("photo.png", b"x" * 100)
        info = zipfile.ZipInfo(name)
        for key, value in changes.items():
            setattr(info, key, value)
        file.writestr(info, content)
    return archive


def of_names(archive, *names, content=b"x"):
    """An archive of files of these names."""
    with zipfile.ZipFile(archive, "w") as file:
        for name in names:
            file.writestr(zipfile.ZipInfo(name), content)
    return archive


def files_below(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.mark.parametrize(
    "make, name", [(make_polycam, "scan.zip"), (make_record3d, "walk.r3d"), (make_capture, "lego.ZIP")]
)
@pytest.mark.parametrize("above", ["", "lego", "anything", "home/me/all scans/lego"])
def test_an_archive_reads_as_its_folder_does(tmp_path, make, name, above):
    folder = make(tmp_path / "original")
    (tmp_path / "downloads").mkdir()
    archive = packed(folder, tmp_path / "downloads" / name, above)
    ours, theirs = read_capture(unpacked(archive)), read_capture(folder)
    assert ours.format == theirs.format
    assert [c.name for c in ours.cameras] == [c.name for c in theirs.cameras]
    assert all(
        (a.camera_to_world == b.camera_to_world).all()
        for a, b in zip(ours.cameras, theirs.cameras, strict=True)
    )
    assert sorted(os.listdir(archive.parent)) == sorted([name, archive.stem])
    assert files_below(unpacked(archive)) == files_below(folder)


@pytest.mark.parametrize(
    "content",
    [
        b"<document><chunk><camera/></chunk></document>", b"<BlocksExchange/>",
        b"<x xmlns:xcr='http://www.capturingreality.com/ns/xcr/1.1#'/>",
    ],
)  # fmt: skip
def test_an_archive_is_no_camera_file_though_one_lies_in_it_uncompressed(tmp_path, content):
    """Python's zipfile and others pack so unless they are told otherwise."""
    of_names(tmp_path / "cameras.zip", "cameras.xml", content=content)
    with pytest.raises(CaptureError, match="no camera file in this folder; give cameras.zip itself"):
        read_capture(tmp_path)


def test_a_folder_of_the_archives_own_name_is_not_put_into_another(tmp_path):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip", "lego")
    assert unpacked(archive) == tmp_path / "lego"
    assert (tmp_path / "lego" / "transforms_train.json").is_file()


@pytest.mark.parametrize("place", ["lego", "lego/lego"])
def test_what_a_person_has_unpacked_is_taken_as_it_is(tmp_path, place):
    folder = make_capture(tmp_path / place)
    (folder / "notes.txt").write_text("mine")
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip", "lego")
    before = files_below(tmp_path / "lego")
    assert unpacked(archive) == folder
    assert files_below(tmp_path / "lego") == before


def test_another_folder_of_that_name_is_left_alone(tmp_path):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")
    (tmp_path / "lego").mkdir()
    (tmp_path / "lego" / "r_0.png").write_bytes(b"another")
    with pytest.raises(CaptureError, match="lego, where something else is; give that folder"):
        unpacked(archive)
    assert files_below(tmp_path / "lego") == {"r_0.png": b"another"}


def test_one_that_was_stopped_goes_on_and_one_that_was_replaced_begins_anew(tmp_path):
    folder = make_capture(tmp_path / "o", count=6)
    archive = packed(folder, tmp_path / "lego.zip")

    class Killed(BaseException):
        pass

    def kill(fraction):
        if fraction > 0.2:
            raise Killed

    with pytest.raises(Killed):
        unpacked(archive, kill)
    half = files_below(tmp_path / "lego")
    assert MARK in half and 1 < len(half) < 7
    with pytest.raises(CaptureError):
        read_capture(tmp_path / "lego")
    told = []
    assert files_below(unpacked(archive, told.append)) == files_below(folder)
    assert told == sorted(told) and told[-1] == 1.0

    shutil.rmtree(tmp_path / "lego")
    with pytest.raises(Killed):
        unpacked(archive, kill)
    for name in ("r_0.png", "r_1.png"):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[:-1] + b"?")  # as long as before
    packed(folder, archive)
    os.utime(archive, ns=(1, 1))
    assert files_below(unpacked(archive)) == files_below(folder)


def test_what_an_archive_has_once_unpacked_is_not_unpacked_again(tmp_path):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")
    folder = unpacked(archive)
    os.utime(folder / "r_0.png", ns=(LONG_AGO, LONG_AGO))
    assert unpacked(archive) == folder
    assert (folder / "r_0.png").stat().st_mtime_ns == LONG_AGO


@pytest.mark.parametrize("name", [
    "../evil.png", "a/../../evil.png", "/evil.png", "C:/evil.png", "C:\\evil.png", "..\\evil.png",
    "\\\\server\\evil.png", "a/c:/evil.png",
])  # fmt: skip
def test_no_path_leads_out_of_the_archives_folder(tmp_path, name):
    archive = with_member(tmp_path / "bad.zip", name)
    with pytest.raises(CaptureError, match="it would be outside the archive's folder; pack it again"):
        unpacked(archive)
    assert os.listdir(tmp_path) == ["bad.zip"]


@pytest.mark.parametrize("name, written", [
    ("a/c:evil.png", "a/c_evil.png"), ("c:evil.png", "c_evil.png"), ("a/12:30?.png", "a/12_30_.png"),
    ("aux/con.png", "_aux/_con.png"), ("Lpt1 .x/b\n.png", "_Lpt1 .x/b_.png"), ("a. /b.png .", "a/b.png"),
    ("console/com.png", "console/com.png"),
])  # fmt: skip
def test_what_windows_forbids_in_names_is_written_there_in_others(tmp_path, monkeypatch, name, written):
    monkeypatch.setattr(archive_members, "_WINDOWS", True)
    unpacked(with_member(tmp_path / "scan.zip", name))
    written = str(PurePath(written))
    assert files_below(tmp_path / "scan") == {"photo.png": b"x" * 100, written: b"x"}
    assert sorted(os.listdir(tmp_path)) == ["scan", "scan.zip"]


@pytest.mark.parametrize("windows", [True, os.name == "nt"])
def test_cameras_find_their_photos_whatever_windows_forbids_in_their_names(tmp_path, monkeypatch, windows):
    monkeypatch.setattr(archive_members, "_WINDOWS", windows)
    with zipfile.ZipFile(packed(make_capture(tmp_path / "o"), tmp_path / "own.zip")) as own:
        with zipfile.ZipFile(tmp_path / "scan.zip", "w") as file:
            for name in own.namelist():
                content = own.read(name).replace(b"./r_0", b"./12:30:00").replace(b"./r_1", b"./aux/con")
                name = name.replace("r_0", "12:30:00").replace("r_1", "aux/con")
                file.writestr(name, content)
    names = [camera.name for camera in read_capture(unpacked(tmp_path / "scan.zip")).cameras]
    assert names[:2] == ["12_30_00", "_con"], "outputs are named so"


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFBLK])
def test_links_and_devices_are_refused(tmp_path, kind):
    archive = with_member(tmp_path / "bad.zip", "a.png", b"/etc/passwd", external_attr=(kind | 0o777) << 16)
    with pytest.raises(CaptureError, match="this is not a file"):
        unpacked(archive)
    assert os.listdir(tmp_path) == ["bad.zip"]


def test_what_macos_adds_is_left_out_and_its_names_are_read_as_it_means_them(tmp_path):
    archive = tmp_path / "scan.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for name in ("Txxr/a.png", "__MACOSX/Txxr/._a.png", "Txxr/._b.png"):
            file.writestr(name, b"x")
    # UTF-8, without the flag that says so.
    archive.write_bytes(archive.read_bytes().replace(b"Txxr", "Tür".encode()))
    assert files_below(unpacked(archive)) == {"a.png": b"x"}
    assert unpacked(archive) == tmp_path / "scan" / "Tür"


def test_what_systems_write_into_folders_is_left_out_and_may_change_there(tmp_path):
    names = ".DS_Store", "Thumbs.db", "shots/desktop.ini"
    archive = of_names(tmp_path / "scan.zip", "shots/a.png", *names)
    folder = unpacked(archive)
    assert folder == tmp_path / "scan" / "shots" and files_below(tmp_path / "scan") == {
        os.path.join("shots", "a.png"): b"x"
    }
    (folder / ".DS_Store").write_bytes(b"the Finder's, of another size")
    assert unpacked(archive) == folder


def test_an_archive_larger_than_any_of_photos_is_refused(tmp_path):
    archive = tmp_path / "bomb.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("photo.png", bytes(1 << 26))
    with pytest.raises(CaptureError, match="which no archive of photos does"):
        unpacked(archive)
    assert os.listdir(tmp_path) == ["bomb.zip"]


def test_an_archive_that_a_disk_has_no_room_for_is_refused(tmp_path, monkeypatch):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")
    free = shutil.disk_usage(tmp_path)._replace(free=archives._SPARE)
    monkeypatch.setattr(archives.shutil, "disk_usage", lambda path: free)
    with pytest.raises(CaptureError, match="it takes .* GB of disk space, and 0.3 GB are free; free space"):
        unpacked(archive)
    assert not (tmp_path / "lego").exists()


def test_locked_archives_and_those_of_other_kinds_are_to_be_unpacked_by_hand(tmp_path):
    locked = bytearray(with_member(tmp_path / "l.zip", "b.png").read_bytes())
    locked[locked.index(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "l.zip").write_bytes(locked)
    with pytest.raises(CaptureError, match="locked with a password; unpack it yourself"):
        unpacked(tmp_path / "l.zip")
    with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_LZMA) as file:
        file.writestr("photo.png", b"x")
    with pytest.raises(CaptureError, match="a way that is not supported; unpack it yourself"):
        unpacked(tmp_path / "x.zip")


def test_archives_without_photos_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "project.zip", "w") as file:
        file.writestr("doc.xml", b"<document/>")
    with pytest.raises(CaptureError, match="there are no photos in it"):
        unpacked(tmp_path / "project.zip")


def test_a_damaged_archive_leaves_nothing(tmp_path):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")
    content = archive.read_bytes()
    for damaged in (content[:-40], content[:50], b"", content[:80] + b"????" + content[84:]):
        archive.write_bytes(damaged)
        with pytest.raises(CaptureError, match="damaged"):
            unpacked(archive)
        assert sorted(os.listdir(tmp_path)) == ["lego.zip", "o"]


def test_a_process_that_another_has_overtaken_leaves_what_that_one_unpacked(tmp_path):
    folder = make_capture(tmp_path / "o", count=6)
    archive = packed(folder, tmp_path / "lego.zip")
    code = "import sys, pathlib; from solver.capture.archives import unpacked; "
    code += "unpacked(pathlib.Path(sys.argv[1]))"
    whole = []

    def overtaken(fraction):
        if not whole:
            subprocess.run([sys.executable, "-c", code, str(archive)], check=True, cwd=ROOT)
            os.utime(tmp_path / "lego" / "r_5.png", ns=(LONG_AGO, LONG_AGO))
        whole.append(MARK not in files_below(tmp_path / "lego"))

    assert unpacked(archive, overtaken) == tmp_path / "lego"
    assert all(whole) and files_below(tmp_path / "lego") == files_below(folder)
    assert (tmp_path / "lego" / "r_5.png").stat().st_mtime_ns == LONG_AGO, "it is being read"


@pytest.mark.parametrize("moment", ["_unpack", "_is_made"])
def test_processes_that_begin_at_once_do_not_refuse_what_the_other_makes(tmp_path, monkeypatch, moment):
    folder = make_capture(tmp_path / "o")
    archive = packed(folder, tmp_path / "lego.zip")
    own = getattr(archives, moment)

    def overtaken(*arguments):
        monkeypatch.setattr(archives, moment, own)
        unpacked(archive)
        return own(*arguments)

    monkeypatch.setattr(archives, moment, overtaken)
    assert unpacked(archive) == tmp_path / "lego"
    assert sorted(os.listdir(tmp_path)) == ["lego", "lego.zip", "o"]
    assert files_below(tmp_path / "lego") == files_below(folder)


def test_who_is_overtaken_and_then_has_no_room_leaves_what_the_other_has_begun(tmp_path, monkeypatch):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")

    def overtaken(folder, mark):
        folder.mkdir()
        (folder / MARK).write_text(mark)
        (folder / "r_0.png").write_bytes(b"begun")
        free = shutil.disk_usage(tmp_path)._replace(free=archives._SPARE)
        monkeypatch.setattr(archives.shutil, "disk_usage", lambda path: free)
        return False

    monkeypatch.setattr(archives, "_is_made", overtaken)
    with pytest.raises(CaptureError, match="free space"):
        unpacked(archive)
    assert set(files_below(tmp_path / "lego")) == {MARK, "r_0.png"}


def test_half_of_another_archive_is_not_mixed_with_this_one(tmp_path):
    archive = of_names(tmp_path / "scan.zip", "b.png")
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / MARK).write_text("scan.zip 1 1")
    (tmp_path / "scan" / "a.png").write_bytes(b"other")
    (tmp_path / "scan" / "7.part").write_bytes(b"oth")
    with pytest.raises(CaptureError, match="where another archive is half unpacked; move or delete that"):
        unpacked(archive)
    (tmp_path / "scan" / "a.png").unlink()
    assert (unpacked(archive) / "b.png").read_bytes() == b"x"


def test_what_is_not_unpacked_completely_is_read_by_nobody(tmp_path):
    folder = make_capture(tmp_path / "lego" / "inside")
    (tmp_path / "lego" / MARK).write_text("lego.zip 1 1")
    for place in (folder, tmp_path / "lego"):
        with pytest.raises(
            CaptureError, match="not completely unpacked; give its archive again to continue"
        ):
            read_capture(place)
        with pytest.raises(
            CaptureError, match="not completely unpacked; give its archive again to continue"
        ):
            photos_below(place)
    with pytest.raises(CaptureError, match="not completely unpacked; give its archive again to continue"):
        read_capture(folder / "transforms_train.json")


def test_an_archive_of_what_was_not_unpacked_completely_is_unpacked_once(tmp_path):
    archive = of_names(tmp_path / "scan.zip", "scan/a.png", f"scan/{MARK}")
    assert unpacked(archive) == unpacked(archive) == tmp_path / "scan"
    assert files_below(tmp_path / "scan") == {"a.png": b"x"}


def test_of_two_files_of_one_name_the_last_counts(tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "scan.zip", "w") as file:
        file.writestr("a.png", b"first")
        with pytest.warns(UserWarning, match="Duplicate"):
            file.writestr("a.png", b"second one")
        file.writestr("A.png", b"third")
    if not archive_members._ONE_CASE:
        assert unpacked(tmp_path / "scan.zip") == unpacked(tmp_path / "scan.zip")
        assert files_below(tmp_path / "scan") == {"a.png": b"second one", "A.png": b"third"}
        shutil.rmtree(tmp_path / "scan")
    monkeypatch.setattr(archive_members, "_ONE_CASE", True)  # as on Windows and macOS
    assert unpacked(tmp_path / "scan.zip") == unpacked(tmp_path / "scan.zip")
    assert files_below(tmp_path / "scan") == {"A.png": b"third"}


def test_folders_that_end_in_a_backslash_are_folders(tmp_path):
    archive = of_names(tmp_path / "scan.zip", "shots\\", "shots\\a.png", "shots\\more\\b.png")
    assert unpacked(archive) == tmp_path / "scan" / "shots"
    assert set(files_below(tmp_path / "scan" / "shots")) == {"a.png", os.path.join("more", "b.png")}


@pytest.mark.parametrize("name", [".. /evil.png", "a/. ./.. ./evil.png", "a/.../evil.png"])
def test_no_name_that_windows_makes_another_of_leads_out(tmp_path, name):
    with pytest.raises(CaptureError, match="it would be outside the archive's folder"):
        unpacked(with_member(tmp_path / "bad.zip", name))
    assert os.listdir(tmp_path) == ["bad.zip"]


@pytest.mark.parametrize("name, folder", [
    ("scan .zip", "scan"), ("scan...zip", "scan"), ("..zip", "unpacked"), ("...zip", "unpacked"),
    ("my scan (1).v2.zip", "my scan (1).v2"),
])  # fmt: skip
def test_a_folder_has_a_name_that_all_systems_take(tmp_path, name, folder):
    (tmp_path / "d").mkdir()
    archive = of_names(tmp_path / "d" / name, "shots/a.png")
    assert unpacked(archive) == unpacked(archive) == tmp_path / "d" / folder / "shots"
    assert sorted(os.listdir(tmp_path / "d")) == sorted([name, folder])


def test_names_as_long_as_they_can_be_are_unpacked(tmp_path):
    name = "照" * 83 + ".png"
    assert len(os.fsencode(name)) > 250
    assert (unpacked(of_names(tmp_path / "scan.zip", name)) / name).read_bytes() == b"x"


def test_a_name_that_a_disk_does_not_take_is_told(tmp_path):
    with pytest.raises(CaptureError, match="xx…: it cannot be unpacked.* with a shorter path"):
        unpacked(of_names(tmp_path / "scan.zip", "a.png", "x" * 300 + ".png"))
    assert os.listdir(tmp_path) == ["scan.zip"]


@pytest.mark.parametrize("number, remedy", [
    (errno.EACCES, "make that folder writable, or move the archive"), (errno.ENOSPC, "free space"),
    (errno.EINVAL, "unpack it yourself elsewhere and give the folder"),
])  # fmt: skip
def test_what_cannot_be_written_is_named_with_the_way_out(tmp_path, monkeypatch, number, remedy):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(archives, "_pieces_into", refuse)
    with pytest.raises(CaptureError, match=rf"scan.zip, what.*png: it cannot.*\); {remedy}"):
        unpacked(of_names(tmp_path / "scan.zip", "what?.png"))
    assert os.listdir(tmp_path) == ["scan.zip"]


def test_what_a_virus_scanner_holds_for_a_moment_is_waited_for(tmp_path, monkeypatch):
    archive = packed(make_capture(tmp_path / "o"), tmp_path / "lego.zip")
    own, held = os.replace, []

    def replace(source, target):
        if target not in held:
            held.append(target)
            raise PermissionError(errno.EACCES, "held")
        own(source, target)

    monkeypatch.setattr(os, "replace", replace)
    assert files_below(unpacked(archive)) == files_below(tmp_path / "o")
    assert len(held) == 1 + len(files_below(tmp_path / "o"))


def test_of_an_archive_around_archives_it_is_said_what_to_do(tmp_path):
    with pytest.raises(CaptureError, match="other archives in it; unpack it and give one of those"):
        unpacked(of_names(tmp_path / "scans.zip", "one.r3d", "two.r3d", "notes.txt"))


def test_an_archive_around_a_video_is_unpacked(tmp_path):
    folder = unpacked(of_names(tmp_path / "walk.zip", "walk/IMG_1.MOV"))
    with pytest.raises(CaptureError, match="give the video itself, IMG_1.MOV"):
        photos_below(folder)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_archive_crashes_or_writes_elsewhere(tmp_path_factory, data):
    place = tmp_path_factory.mktemp("archives")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name in ("a/r_0.png", "a/r_1.png", "a/transforms.json"):
            file.writestr(name, b"x" * 300)
    content = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    archive = place / "in" / "scan.zip"
    archive.parent.mkdir()
    archive.write_bytes(content[: data.draw(st.integers(0, len(content)))] or content)
    try:
        unpacked(archive)
    except CaptureError as error:
        assert "\n" not in str(error) and error.problem and error.remedy
    assert os.listdir(place) == ["in"] and set(os.listdir(archive.parent)) <= {
        "scan.zip",
        "scan",
        "a",
    }


def test_any_other_path_stays_as_it_is(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere.zip", make_capture(tmp_path / "o") / "r_0.png"):
        assert unpacked(path) == path


def test_a_path_that_no_disk_has_is_no_archive(tmp_path):
    assert not archives.is_archive(tmp_path / ("x" * 300 + ".zip"))
