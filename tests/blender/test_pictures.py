"""Two results in one file: unpacked and exported, each keeps its own pictures."""

import os
from pathlib import Path

import bpy
import fake_result
import pytest

RED, GREEN = (255, 0, 0), (0, 255, 0)


@pytest.fixture
def two_jobs(tmp_path):
    """Installed results of two folders of the same name, a red and a green one; the .blend is saved."""
    jobs = []
    for folder, colour in (("a", RED), ("b", GREEN)):
        jobs.append(tmp_path / folder / "job")
        fake_result.write_result(jobs[-1])
        for name in ("albedo.png", "base_colour.png"):
            fake_result.write_png(jobs[-1] / "result" / name, colour)
        assert bpy.ops.nmf.install_result(directory=str(jobs[-1])) == {"FINISHED"}
    (tmp_path / "blend").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "blend" / "x.blend"))
    return jobs


def albedos():
    """First pixels of the albedos, by file name."""
    images = [image for image in bpy.data.images if image.filepath.endswith("albedo.png")]
    return {Path(bpy.path.abspath(i.filepath)).name: tuple(i.pixels[:2]) for i in images}


def test_pictures_that_are_unpacked_stay_those_of_their_object(two_jobs, tmp_path):
    bpy.ops.file.pack_all()
    bpy.ops.file.unpack_all(method="USE_LOCAL")
    for image in bpy.data.images:
        image.reload()
    assert sorted(albedos().values()) == [(0, 1), (1, 0)]
    assert len(list((tmp_path / "blend" / "textures").iterdir())) == 14


def exported_colours(folder):
    return {path.read_bytes() for path in folder.rglob("*base_colour.png")}


def test_exported_pictures_stay_those_of_their_object(two_jobs, tmp_path):
    expected = {(job / "result" / "base_colour.png").read_bytes() for job in two_jobs}
    for name in ("usd", "obj"):
        (tmp_path / name).mkdir()
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "usd" / "x.usda"))
    bpy.ops.wm.obj_export(filepath=str(tmp_path / "obj" / "x.obj"), path_mode="COPY")
    assert exported_colours(tmp_path / "usd") == expected
    assert exported_colours(tmp_path / "obj") == expected


def test_pictures_have_names_of_their_own_and_are_no_part_of_the_result(two_jobs):
    for number, job in enumerate(two_jobs):
        names = {path.name for path in (job / "textures").iterdir()}
        stem = ("job", "job_2")[number]
        files = (
            "albedo.png", "f0.png", "roughness.png", "normal.png", "base_colour.png", "metallic.png",
            "environment.exr",
        )  # fmt: skip
        assert names == {f"{stem}_{file}" for file in files}
        same = job / "textures" / f"{stem}_albedo.png", job / "result" / "albedo.png"
        assert not os.path.samefile(*same) and len({path.read_bytes() for path in same}) == 1


def test_a_job_installed_again_keeps_the_names_of_its_pictures(two_jobs):
    for job in two_jobs:
        bpy.ops.nmf.install_result(directory=str(job / ".." / "job"))
    assert set(albedos()) == {"job_albedo.png", "job_2_albedo.png"}
    assert all(len(list((job / "textures").iterdir())) == 7 for job in two_jobs)


def test_a_result_is_installed_where_no_copy_can_be_made(result_job, part, monkeypatch):
    def refuse(*_):
        raise PermissionError("read only")

    monkeypatch.setattr(part("scene.pictures").shutil, "copyfile", refuse)
    assert bpy.ops.nmf.install_result(directory=str(result_job)) == {"FINISHED"}
    assert list(albedos()) == ["albedo.png"]


@pytest.mark.parametrize("most, packed", [(200_000_000, True), (0, False)])
def test_photos_are_packed_unless_they_make_the_file_huge_and_all_else_is_always(
    capture, two_jobs, extension, monkeypatch, capsys, most, packed
):
    headless = extension("headless")
    photos = extension("scene.capture_collection").photo_paths(capture)
    monkeypatch.setattr(headless, "MOST_PACKED", most)
    gone = min(photos)
    gone.unlink()  # while the solver was at work
    headless.pack_pictures(photos)
    for image in bpy.data.images:
        path = Path(bpy.path.abspath(image.filepath)).resolve()
        wanted = path != gone and (packed or path not in photos)
        assert (image.packed_file is not None) == wanted, image.name
    assert len(photos) == 3 and ("not packed" in capsys.readouterr().err) != packed
