"""Projects of programs hold no cameras that others can read: one is told what to export."""

import pytest

from solver.capture.errors import CaptureError
from solver.capture.read import CAMERA_FILES, read_capture
from tests.capture.programs import save_photos

PROJECTS = {
    "cup.psx": (b'<?xml version="1.0"?>\n<document version="1.2.0" path="{projectname}.files/project.zip"/>\n',
                "project of Metashape; choose File > Export > Export Cameras"),
    "cup.psz": (b"PK\x05\x06" + bytes(18), "project of Metashape; choose File > Export"),
    "cup.rcproj": (b'<RealityCaptureProject id="{1}"><scene id="{2}"/></RealityCaptureProject>',
                   "project of RealityCapture; export 'Internal/External camera parameters'"),
    "cup.rsproj": (b'<RealityCaptureProject id="{1}"><scene id="{2}"/></RealityCaptureProject>',
                   "project of RealityScan; export 'Internal/External camera parameters'"),
    "cup.p4d": (b"<?xml version='1.0'?>\n<pix4uav><images><image path='a.jpg'/></images></pix4uav>",
                "project of Pix4D; export it as OPF, or give its folder 1_initial/params"),
    "cup.mg": (b'{"header": {"nodesVersions": {"CameraInit": "9.0"}}, "graph": {"CameraInit_1": {}}}',
               "project of Meshroom; give its MeshroomCache, or the cameras.sfm in it"),
}  # fmt: skip


@pytest.mark.parametrize("name", PROJECTS)
def test_one_is_told_what_to_export_from_a_project_and_from_a_folder_that_has_one(tmp_path, name):
    content, told = PROJECTS[name]
    file = save_photos(tmp_path / "photos").parent / name
    file.write_bytes(content)
    with pytest.raises(CaptureError, match=f"{name}: this is a {told}"):
        read_capture(file)
    with pytest.raises(CaptureError, match=f"no camera file in this folder, since {name} is a {told}"):
        read_capture(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("sfm.abc", b"Ogawa\xff\x00\x01", "an Alembic file; give Meshroom's cameras.sfm, or convert it"),
        ("sfm_data.bin", b"\x01\x03\x00\x00\x000.3" * 9,
         "OpenMVG's binary form; convert it to JSON by openMVG_main_ConvertSfM_DataFormat"),
    ],
)  # fmt: skip
def test_one_is_told_how_to_convert_what_meshroom_and_openmvg_write_first(tmp_path, name, content, told):
    file = save_photos(tmp_path / "photos").parent / name
    file.write_bytes(content)
    for path, before in ((file, f"{name}: this is {told}"), (tmp_path, f"since {name} is {told}")):
        with pytest.raises(CaptureError, match=before):
            read_capture(path)


def test_a_table_of_points_beside_photos_is_no_table_of_their_places(tmp_path):
    file = save_photos(tmp_path / "photos").parent / "gcp.txt"
    file.write_text("Name,X,Y,Z\nA,1,2,3\n")
    (tmp_path / "folder.psx").mkdir()
    with pytest.raises(CaptureError, match="in this folder; give the camera file itself, or solve"):
        read_capture(tmp_path)


def test_file_dialogs_and_drops_take_projects_for_one_to_be_told():
    assert {f".{name.partition('.')[2]}" for name in PROJECTS} <= set(CAMERA_FILES)
