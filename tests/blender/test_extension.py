"""Registration, operators, jobs and headless runs, with a solver that needs no torch."""

import io
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import addon_utils
import bpy
import pytest

from tests.cli.command import MANUAL, check_help, commands_of

ROOT = Path(__file__).resolve().parents[2]


def names_of(kind):
    return {name for name in dir(kind) if name.startswith(("NMF_", "nmf"))}


def test_unregistering_leaves_nothing_and_registering_works_again(extension):
    registration = extension("registration")
    registration.unregister()
    assert not names_of(bpy.types)
    assert not hasattr(bpy.types.Scene, "nmf")
    entries = getattr(bpy.types.TOPBAR_MT_file_import.draw, "_draw_funcs", [])
    assert not [f for f in entries if "neural_microfacet" in f.__module__ or "nmf" in f.__name__]
    assert not [m for m in ("_tick",) if bpy.app.timers.is_registered(extension("jobs.monitor")._tick)]
    registration.register()
    assert hasattr(bpy.types, "NMF_OT_reconstruct") and hasattr(bpy.types.Scene, "nmf")


def test_every_operator_and_property_explains_itself(extension):
    for cls in extension("registration")._classes:
        if issubclass(cls, bpy.types.Operator):
            assert cls.bl_idname.startswith("nmf.")
            text = cls.__doc__
            assert text and not text.endswith("."), cls
    for prop in bpy.types.Scene.bl_rna.properties["nmf"].fixed_type.properties:
        if prop.identifier not in ("rna_type", "name"):
            assert prop.name and prop.description and not prop.description.endswith("."), prop.identifier


def shown_properties(extension):
    """All that panels and dialogs may show; without an add-on there are no preferences."""
    classes = extension("registration")._classes
    groups = [bpy.types.Scene.bl_rna.properties["nmf"].fixed_type]
    for cls in classes:
        if issubclass(cls, bpy.types.Operator):
            groups.append(getattr(bpy.ops.nmf, cls.bl_idname.removeprefix("nmf.")).get_rna_type())
    for group in groups:
        for item in group.properties:
            if item.is_runtime and not item.is_hidden and item.identifier != "name":
                yield item


def test_names_are_in_title_case_and_descriptions_are_no_sentences_with_a_full_stop(extension):
    """As Blender's own are."""
    classes = extension("registration")._classes
    names = {getattr(cls, "bl_label", "") for cls in classes} - {""}
    for item in shown_properties(extension):
        assert item.description and not item.description.endswith("."), item.identifier
        names.add(item.name)
        if item.type == "ENUM":
            names |= {choice.name for choice in item.enum_items}
            assert not any(choice.description.endswith(".") for choice in item.enum_items)
    assert {"Solve Cameras", "Even Out with Color", "Masks"} <= names
    small = {"a", "and", "for", "of", "to", "with"}
    for name in names:
        first, *others = name.split()
        assert first[0] == first[0].upper() or first == "pip", name
        for word in others:
            assert word in small or word[0] == word[0].upper(), name
            assert word.lower() not in small or word.islower() or word == others[-1], name


def test_the_import_operator_does_what_its_function_does(duck):
    assert bpy.ops.nmf.import_capture(filepath=str(duck / "transforms_train.json")) == {"FINISHED"}
    collection = bpy.context.scene.nmf.capture
    assert sum(item.type == "CAMERA" for item in collection.all_objects) == 60
    assert bpy.ops.nmf.add_region_box() == {"FINISHED"}


def test_an_archive_is_imported_from_the_folder_that_it_is_unpacked_to(duck, tmp_path):
    shutil.make_archive(str(tmp_path / "Duck scan"), "zip", duck)
    assert bpy.ops.nmf.import_capture(filepath=str(tmp_path / "Duck scan.zip")) == {"FINISHED"}
    collection = bpy.context.scene.nmf.capture
    assert Path(collection["nmf_source"]).parent == tmp_path / "Duck scan"
    assert sum(item.type == "CAMERA" for item in collection.all_objects) == 60
    (tmp_path / "bad.zip").write_bytes(b"PK no archive")
    with pytest.raises(RuntimeError, match="bad.zip: the archive is damaged"):
        bpy.ops.nmf.import_capture(filepath=str(tmp_path / "bad.zip"))
    assert not (tmp_path / "bad").exists()


def test_an_archive_of_photos_is_imported_with_the_cameras_beside_it(duck, tmp_path):
    shutil.make_archive(str(tmp_path / "photos"), "zip", duck)
    shutil.copy(duck / "transforms_train.json", tmp_path)
    result = bpy.ops.nmf.import_capture(
        filepath=str(tmp_path / "transforms_train.json"), photos=str(tmp_path / "photos.zip")
    )
    assert result == {"FINISHED"}
    cameras = [c for c in bpy.context.scene.nmf.capture.all_objects if c.type == "CAMERA"]
    images = {c.data.background_images[0].image for c in cameras}
    assert len(images) == 60
    assert all(Path(i.filepath).is_relative_to(tmp_path / "photos") for i in images)


def test_an_archive_of_photos_is_headless_taken_as_its_folder(extension, duck, tmp_path, fake_solver):
    shutil.make_archive(str(tmp_path / "photos"), "zip", duck)
    shutil.copy(duck / "transforms_train.json", tmp_path)
    command = ["reconstruct", str(tmp_path / "transforms_train.json"), str(tmp_path / "x.blend")]
    photos = ["--photos", str(tmp_path / "photos.zip")]
    assert extension("headless").main([*command, *photos]) == 0
    assert (tmp_path / "photos").is_dir()


def test_nothing_is_imported_into_a_scene_of_another_file(duck, tmp_path):
    """A fixed bug: a traceback, and the collection was left behind."""
    file = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True)
    with bpy.data.libraries.load(str(file), link=True) as (there, here):
        here.scenes = there.scenes[:1]
    linked = next(scene for scene in bpy.data.scenes if scene.library)
    bpy.context.window.scene = linked
    before = len(bpy.data.collections), len(bpy.data.images)
    with pytest.raises(RuntimeError, match="the scene is in another file"):
        bpy.ops.nmf.import_capture(filepath=str(duck))
    assert (len(bpy.data.collections), len(bpy.data.images)) == before


def test_the_import_operator_reports_what_is_wrong(tmp_path):
    with pytest.raises(RuntimeError, match="no such file or folder"):
        bpy.ops.nmf.import_capture(filepath=str(tmp_path / "none.json"))


def run_monitor(extension, seconds=30):
    monitor = extension("jobs.monitor").monitor
    until = time.monotonic() + seconds
    while monitor.tick() is not None:
        assert time.monotonic() < until
        time.sleep(0.02)
    return monitor


def start(extension, duck, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.nmf.import_capture(filepath=str(duck / "transforms_train.json"))
    assert bpy.ops.nmf.reconstruct() == {"FINISHED"}
    return extension("jobs.monitor").monitor


@pytest.mark.parametrize("mode", ["normal", "garbage"])
def test_reconstruct_runs_to_an_installed_asset(extension, duck, tmp_path, fake_solver, mode):
    fake_solver(mode)
    monitor = start(extension, duck, tmp_path)
    job = Path(bpy.path.abspath(bpy.context.scene.nmf.job))
    assert job.parent == tmp_path / "nmf_jobs"
    run_monitor(extension)
    assert monitor.model.state == "done" and monitor.model.overall == 1
    assert monitor.model.preview_version == 1
    extension("scene.install").install_result(bpy.context, job)
    assert any(item.get("nmf_job") for item in bpy.data.objects)


def test_a_solver_that_fails_says_why(extension, duck, tmp_path, fake_solver):
    fake_solver("fail")
    start(extension, duck, tmp_path)
    model = run_monitor(extension).model
    assert model.state == "failed" and "upside down" in model.error


def test_a_solver_that_dies_shows_the_end_of_its_log(extension, duck, tmp_path, fake_solver):
    fake_solver("die")
    start(extension, duck, tmp_path)
    model = run_monitor(extension).model
    assert model.state == "failed" and "Segmentation fault" in model.error


def test_cancel_stops_a_job_that_listens(extension, duck, tmp_path, fake_solver):
    fake_solver("slow")
    monitor = start(extension, duck, tmp_path)
    time.sleep(0.5)
    bpy.ops.nmf.cancel()
    assert run_monitor(extension).model.state == "cancelled"
    assert not monitor.running


def test_cancel_ends_a_job_that_hangs(extension, duck, tmp_path, fake_solver, monkeypatch):
    process = extension("jobs.process")
    monkeypatch.setattr(process, "TERMINATE_AFTER", 0.5)
    monkeypatch.setattr(process, "KILL_AFTER", 1.0)
    fake_solver("hang")
    start(extension, duck, tmp_path)
    time.sleep(0.5)
    bpy.ops.nmf.cancel()
    assert run_monitor(extension).model.state in ("cancelled", "failed")


def test_one_job_at_a_time(extension, duck, tmp_path, fake_solver):
    fake_solver("slow")
    start(extension, duck, tmp_path)
    assert not bpy.ops.nmf.reconstruct.poll()
    bpy.ops.nmf.cancel()
    run_monitor(extension)


def test_disabling_the_extension_hangs_up_on_the_solver(extension, duck, tmp_path, fake_solver):
    fake_solver("slow")
    monitor = start(extension, duck, tmp_path)
    child = monitor.process.popen
    extension("registration").unregister()
    assert child.wait(5) == 3
    extension("registration").register()


def test_without_a_solver_the_person_is_told_what_to_do(extension, duck, tmp_path, monkeypatch):
    monkeypatch.setenv("NMF_SOLVER_PYTHON", str(tmp_path / "none"))
    bpy.ops.nmf.import_capture(filepath=str(duck / "transforms_train.json"))
    with pytest.raises(RuntimeError, match="does not exist"):
        bpy.ops.nmf.reconstruct()


def test_headless_writes_a_blend_with_everything_in_it(extension, duck, tmp_path, fake_solver):
    out = tmp_path / "out ü.blend"
    assert extension("headless").main(["reconstruct", str(duck), str(out)]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(out))
    scene = bpy.context.scene
    item = next(i for i in bpy.data.objects if i.get("nmf_job"))
    assert item.active_material.node_tree.get_output_node("CYCLES") is not None
    textures = [n.image for n in item.active_material.node_tree.nodes if n.type == "TEX_IMAGE"]
    assert len(textures) == 6 and all(image.packed_file for image in textures)
    light = next(n.image for n in scene.world.node_tree.nodes if n.type == "TEX_ENVIRONMENT")
    assert light.packed_file
    cameras = [i for i in bpy.data.objects if i.type == "CAMERA"]
    assert len(cameras) == 60 and all(c.data.background_images[0].image for c in cameras)
    assert scene.view_settings.view_transform == "Standard" and scene.cycles.blur_glossy == 0
    assert (scene.render.resolution_x, scene.render.resolution_y) == (200, 200)


def test_all_options_of_the_headless_command_say_what_they_are_for_and_are_in_the_manual(extension):
    (command,) = commands_of(extension("headless")._parser()).values()
    check_help(command)
    known = {option for action in command._actions for option in action.option_strings}
    listed = re.search(r"\nOptions: (.*?)\. OUT", MANUAL, re.DOTALL)[1]
    assert set(re.findall(r"--[\w-]+", listed)) == known - {"-h", "--help"}


def test_headless_refuses_to_overwrite(extension, duck, tmp_path, fake_solver, capsys):
    out = tmp_path / "mine.blend"
    out.write_text("precious")
    assert extension("headless").main(["reconstruct", str(duck), str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err and out.read_text() == "precious"


@pytest.mark.parametrize("mode, code", [("fail", 2), ("die", 139)])
def test_headless_passes_on_the_solvers_exit_code(extension, duck, tmp_path, fake_solver, mode, code):
    fake_solver(mode)
    assert extension("headless").main(["reconstruct", str(duck), str(tmp_path / "x.blend")]) == code


@pytest.mark.parametrize("number, code", [(0xC0000005, 1), (139, 139), (-9, -9)])
def test_headless_ends_in_a_code_that_a_process_can_have(extension, monkeypatch, number, code):
    headless = extension("headless")

    def crash(options):
        raise headless.SolverFailed(number, "The solver crashed")

    monkeypatch.setattr(headless, "reconstruct_to_file", crash)
    assert headless.main(["reconstruct", "photos", "x.blend"]) == code


def test_headless_ends_well_also_where_the_console_lacks_the_results_letters(extension, monkeypatch):
    """As in a pipe on Windows."""
    headless, console = extension("headless"), io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    monkeypatch.setattr(headless, "reconstruct_to_file", lambda options: None)
    monkeypatch.setattr(sys, "stdout", console)
    assert headless.main(["reconstruct", "photos", "写真 ü.blend"]) == 0
    console.flush()
    assert console.buffer.getvalue().decode("cp1252").strip() == "\\u5199\\u771f ü.blend"


def test_headless_leaves_nothing_of_a_job_that_could_not_begin(
    extension, duck, tmp_path, fake_solver, capsys
):
    out = tmp_path / "x.blend"
    command = ["reconstruct", str(duck), str(out)]
    assert extension("headless").main([*command, "--time-limit", "-3"]) == 2
    assert "time_limit: -3.0" in capsys.readouterr().err
    fake_solver("fail")
    assert extension("headless").main(command) == 2
    assert list(tmp_path.glob("x_job*")) == []
    mine = tmp_path / "mine"
    mine.mkdir()
    assert extension("headless").main([*command, "--job", str(mine)]) == 2
    assert list(mine.iterdir()) == []
    deeper = [str(tmp_path / "nothing"), str(tmp_path / "new" / "deeper" / "x.blend")]
    assert extension("headless").main(["reconstruct", *deeper]) == 2
    assert not (tmp_path / "new").exists()
    fake_solver("normal")
    assert extension("headless").main([*command, "--resume"]) == 0


def test_headless_resumes_only_what_was_asked(extension, duck, tmp_path, fake_solver, capsys):
    out, job = tmp_path / "x.blend", tmp_path / "job"
    command = ["reconstruct", str(duck), str(out), "--job", str(job), "--overwrite"]
    assert extension("headless").main(command) == 0
    again = [*command, "--resume"]
    assert extension("headless").main([*again, "--preset", "standard"]) == 2
    assert "preset 'draft', not 'standard'" in capsys.readouterr().err
    other = tmp_path / "other"
    other.mkdir()
    content = json.loads((duck / "transforms_train.json").read_text())
    content["frames"] = content["frames"][:5]
    for frame in content["frames"]:
        name = f"my_{Path(frame['file_path']).name}.png"
        shutil.copy(duck / f"{frame['file_path']}.png", other / name)
        frame["file_path"] = name
    (other / "transforms_train.json").write_text(json.dumps(content))
    before = out.read_bytes()
    assert extension("headless").main([again[0], str(other), *again[2:]]) == 2
    assert "this job was made from other photos" in capsys.readouterr().err and out.read_bytes() == before
    assert extension("headless").main([*again, "--time-limit", "77"]) == 0
    assert json.loads((job / "job.json").read_text())["time_limit"] == 77


def test_headless_says_that_a_blend_was_cut_off_and_keeps_the_older_one(
    extension, duck, tmp_path, fake_solver, capsys
):
    resource = pytest.importorskip("resource", reason="limits of files are POSIX")
    out = tmp_path / "x.blend"
    out.write_text("precious")
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, most))
    try:
        code = extension("headless").main(["reconstruct", str(duck), str(out), "--overwrite"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))
    message = capsys.readouterr().err.splitlines()[-1]
    assert code == 1 and "x.blend: Blender could not save it" in message and "--resume" in message
    assert out.read_text() == "precious"


def test_headless_does_not_start_without_cycles(extension, duck, tmp_path, fake_solver, capsys):
    addon_utils.disable("cycles")
    try:
        assert extension("headless").main(["reconstruct", str(duck), str(tmp_path / "x.blend")]) == 1
    finally:
        addon_utils.enable("cycles")
    assert "Cycles is switched off" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that nobody can write to")
def test_headless_does_not_start_where_it_cannot_save(extension, duck, tmp_path, fake_solver, capsys):
    job = tmp_path / "job"
    command = ["reconstruct", str(duck), "/proc/x.blend", "--job", str(job)]
    assert extension("headless").main(command) == 2
    assert "/proc: it cannot be written to" in capsys.readouterr().err
    assert not job.exists()


def test_the_script_runs_in_plain_python(duck, tmp_path, fake_solver):
    result = subprocess.run(
        [sys.executable, str(ROOT / "samples" / "reconstruct.py"), "--", str(duck), str(tmp_path / "o.blend")],
        capture_output=True, text=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr[-2000:]
    assert (tmp_path / "o.blend").is_file()
