"""RealityCapture's table and sidecars: its camera math, found photos, and hostile files.

The files are written here as RealityCapture 1.x and RealityScan 2.x write them, after exports and
format descriptions in public repositories; an export of ours would need the program.
"""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.formats import realitycapture
from solver.capture.photo_finder import PhotoFinder
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE_TEXT,
    WIDTH,
    check_projection,
    names,
    outcome,
    poses,
    save_photos,
)

HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
LENS = dict(f=30.0, px=0.01, py=-0.02, k1=-0.08, k2=0.03, k3=0.01, k4=0.0, t1=0.004, t2=-0.003)
BROWN4 = dict(LENS, k4=-0.02)


def turned(axis, degrees):
    """Rotation [3, 3] about an axis, by the sine and cosine of Rodrigues' formula."""
    a, angle = np.array(axis, float), math.radians(degrees)
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def angles(index):
    return 40.0 + 70 * index, 85.0 - 13 * index, -20.0 + 11 * index


def table_pose(index):
    """Camera to world [4, 4], OpenCV's axes: from looking down with north on top, the photographer
    rolls about the view, lifts the view by the pitch, and turns by the heading, clockwise."""
    heading, pitch, roll = angles(index)
    down = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]])  # columns: right, down (south), view
    pose = np.eye(4)
    pose[:3, :3] = turned((0, 0, 1), -heading) @ turned((1, 0, 0), pitch) @ turned((0, 1, 0), roll) @ down
    pose[:3, 3] = poses()[index, :3, 3]
    return pose


def row(index, lens, name=None):
    place = table_pose(index)[:3, 3]
    values = (*place, *angles(index), *lens.values())
    return ",".join([name or f"{names()[index]}.png", *(repr(float(v)) for v in values)])


def table(lens=LENS, order=range(COUNT), header=HEADER, count_line=False):
    first = [f"#cameras {COUNT}"] if count_line else []
    return "\r\n".join([*first, header, *(row(index, lens) for index in order), ""])


def write_table(folder, text, size=(WIDTH, HEIGHT), name="cameras.csv"):
    save_photos(folder / "photos", size=size)
    (folder / name).write_text(text, encoding="utf-8", newline="")
    return folder


def sidecar(pose, lens, model="brown3t2", style="elements", extra=""):
    """As RealityScan 2 writes it (`elements`), or as Epic's sample has it (`attributes`)."""
    rotation = " ".join(repr(float(v)) for v in pose[:3, :3].T.ravel())
    place = " ".join(repr(float(v)) for v in pose[:3, 3])
    k = " ".join(repr(float(lens[key])) for key in ("k1", "k2", "k3", "k4", "t1", "t2"))
    inside = attributes = ""
    if style == "elements":
        inside = (
            f"<xcr:Rotation>{rotation}</xcr:Rotation>\n      <xcr:Position>{place}</xcr:Position>\n"
            f"      <xcr:DistortionCoeficients>{k}</xcr:DistortionCoeficients>"
        )
    else:
        attributes = f'xcr:Rotation="{rotation}" xcr:DistortionCoeficients="{k}"'
        inside = f"<xcr:Position>{place}</xcr:Position>"
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        '  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '    <rdf:Description xcr:Version="3" xcr:PosePrior="initial" xcr:Coordinates="absolute"\n'
        f'       xcr:DistortionModel="{model}" xcr:FocalLength35mm="{lens["f"]!r}"\n'
        f'       xcr:Skew="{lens.get("skew", 0)!r}" xcr:AspectRatio="{lens.get("aspect", 1)!r}"\n'
        f'       xcr:PrincipalPointU="{lens["px"]!r}" xcr:PrincipalPointV="{lens["py"]!r}"\n'
        f'       xcr:CalibrationPrior="initial" xcr:CalibrationGroup="-1" {attributes} {extra}\n'
        '       xcr:InTexturing="1" xcr:InMeshing="1"\n'
        '       xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">\n'
        f"      {inside}\n    </rdf:Description>\n  </rdf:RDF>\n</x:xmpmeta>\n"
    )


def write_sidecars(folder, make=None, size=(WIDTH, HEIGHT), **options):
    save_photos(folder, size=size)
    for index, name in enumerate(names()):
        text = sidecar(poses()[index], LENS, **options) if make is None else make(index)
        (folder / f"{name}.xmp").write_text(text, encoding="utf-8")
    return folder


def reference(lens, to_camera, point, size=(WIDTH, HEIGHT)):
    """ "RealityCapture XMP Camera Math", number by number; image coordinates are in −½ … ½."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    radial = 1 + lens["k1"] * r2 + lens["k2"] * r2**2 + lens["k3"] * r2**3 + lens["k4"] * r2**4
    xd = x * radial + lens["t1"] * (r2 + 2 * x * x) + 2 * lens["t2"] * x * y
    yd = y * radial + lens["t2"] * (r2 + 2 * y * y) + 2 * lens["t1"] * x * y
    f = lens["f"] / 36
    u = f * xd + lens.get("skew", 0.0) * yd + lens["px"]
    v = f * lens.get("aspect", 1.0) * yd + lens["py"]
    scale = max(size)
    return u * scale + 0.5 * size[0], v * scale + 0.5 * size[1]


@pytest.mark.parametrize("lens", [LENS, BROWN4])
@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (HEIGHT, WIDTH)])
def test_points_of_a_table_project_as_the_camera_math_says(tmp_path, lens, size):
    capture = read_capture(write_table(tmp_path, table(lens), size))
    expected = np.stack([table_pose(index) for index in range(COUNT)])
    to_camera = np.linalg.inv(expected)
    check_projection(capture, lambda i, x: reference(lens, to_camera[i], x, size), expected)
    np.testing.assert_allclose(capture.up, (0, 0, 1))
    assert not capture.metric and not capture.warnings


OPENCV_HEADER = (
    "#name,tx,ty,tz,R00,R01,R02,R10,R11,R12,R20,R21,R22,f_pix,px_pix,py_pix,k1,k2,t2,t1,k3,k4 "
    "(R = [Rij] provided in row major ordering and t = (tx,ty,tz) are the rotation matrix R and the "
    "translation vector t of the pose (R,t) of the camera)"
)
"""as RealityScan's calibration.xml has it, shortened: its last column has a sentence in its name"""


def opencv_table(lens, size, order=range(COUNT)):
    width, height = size
    focal, longer = lens["f"] / 36 * max(size), max(size)
    centre = width / 2 + lens["px"] * longer, height / 2 + lens["py"] * longer
    coefficients = [lens[key] for key in ("k1", "k2", "t2", "t1", "k3", "k4")]
    lines = [OPENCV_HEADER]
    for index in order:
        from_world = np.linalg.inv(table_pose(index))
        values = (*from_world[:3, 3], *from_world[:3, :3].ravel(), focal, *centre, *coefficients)
        lines.append(",".join([f"{names()[index]}.png", *(repr(float(v)) for v in values)]))
    return "\n".join(lines)


@pytest.mark.parametrize("lens", [LENS, BROWN4, dict.fromkeys(LENS, 0.0) | {"f": 30.0}])
@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (HEIGHT, WIDTH)])
def test_points_of_an_opencv_compliant_table_project_as_the_camera_math_says(tmp_path, lens, size):
    capture = read_capture(write_table(tmp_path, opencv_table(lens, size, (2, 0, 1, 4, 3)), size))
    expected = np.stack([table_pose(index) for index in range(COUNT)])
    to_camera = np.linalg.inv(expected)
    check_projection(capture, lambda i, x: reference(lens, to_camera[i], x, size), expected)
    assert capture.format == realitycapture.NAME and not capture.warnings


def test_a_rotation_that_is_none_in_an_opencv_compliant_table_is_named(tmp_path):
    text = opencv_table(LENS, (WIDTH, HEIGHT)).split("\n")
    cells = text[2].split(",")
    cells[4:7] = cells[7:10]
    text[2] = ",".join(cells)
    with pytest.raises(CaptureError, match="line 3, R00.*singular"):
        read_capture(write_table(tmp_path, "\n".join(text)))


@pytest.mark.parametrize("write", [table, lambda lens: opencv_table(lens, (WIDTH, HEIGHT))])
def test_a_table_whose_lenses_have_k1_alone_is_refused_as_of_the_division_model(tmp_path, write):
    division = dict(LENS, k2=0, k3=0, t1=0, t2=0)
    with pytest.raises(CaptureError, match="k1.*division.*set Brown"):
        read_capture(write_table(tmp_path, write(division)))
    straight = write(dict(division, k1=0)).splitlines()[1:2]
    one_straight = "\n".join(
        [*write(division).splitlines()[:1], *straight, *write(division).splitlines()[2:]]
    )
    with pytest.raises(CaptureError, match="k1.*division.*set Brown"):
        read_capture(write_table(tmp_path, one_straight))
    read_capture(write_table(tmp_path, write(dict(division, k1=0))))
    read_capture(write_table(tmp_path, write(dict(division, k2=1e-4))))


def test_longitudes_and_latitudes_are_refused_and_lengths_far_away_are_not(tmp_path):
    def at(x, y, size, height=1.0):
        lines = [HEADER]
        for index in range(COUNT):
            cells = row(index, LENS).split(",")
            place = table_pose(index)[:3, 3]
            moved = x + size * place[0], y + size * place[1], height * place[2]
            cells[1:4] = (repr(float(value)) for value in moved)
            lines.append(",".join(cells))
        return write_table(tmp_path, "\n".join(lines))

    with pytest.raises(CaptureError, match="longitudes and latitudes.*Euclidean or a projected"):
        read_capture(at(-34.82878, -7.16331, 1e-5))
    for x, y, size in (
        (512345.0, 5412345.0, 1.0), (30.0, -7.0, 1.0), (0.0, 0.0, 1e-5), (150.0, 40.0, 0.02),
    ):  # fmt: skip
        assert len(read_capture(at(x, y, size, size)).cameras) == COUNT


def test_photos_in_realitycaptures_layer_of_geometry_are_found_with_their_masks(tmp_path):
    save_photos(tmp_path / ".geometry")
    for name in names():
        save_mask(tmp_path / ".mask" / f"{name}.png")
    (tmp_path / "cameras.csv").write_text(table(), encoding="utf-8")
    for item in read_capture(tmp_path).cameras:
        assert item.image_path.parent.name == ".geometry"
        assert item.mask_path == tmp_path / ".mask" / item.image_path.name


def test_a_layer_of_geometry_beside_the_photos_themselves_does_not_count(tmp_path):
    write_table(tmp_path, table())
    for layer in (tmp_path / ".geometry", tmp_path / "photos" / ".geometry"):
        save_photos(layer)
    cameras = read_capture(tmp_path).cameras
    assert [item.image_path.parent.name for item in cameras] == ["photos"] * COUNT
    assert len(PhotoFinder(tmp_path).pictures()) == COUNT


def test_rows_without_a_photo_need_no_lens(tmp_path):
    lines = table().splitlines()
    cells = lines[2].split(",")
    cells[0], cells[10:] = "lost.png", [""] * 6
    lines[2] = ",".join(cells)
    capture = read_capture(write_table(tmp_path, "\n".join(lines)))
    assert len(capture.cameras) == COUNT - 1 and "lost.png" in capture.warnings[0]


def test_photos_of_another_size_than_an_opencv_compliant_table_has_are_named(tmp_path):
    text = opencv_table(LENS, (WIDTH, HEIGHT))
    for size in ((WIDTH // 2, HEIGHT // 2), (2 * WIDTH, 2 * HEIGHT)):
        with pytest.raises(CaptureError, match="px_pix.*not the centre.*size in which they were aligned"):
            read_capture(write_table(tmp_path, text, size))


def save_mask(path):
    path.parent.mkdir(exist_ok=True)
    Image.new("L", (WIDTH, HEIGHT), 255).save(path)


def test_angles_of_a_table_are_those_of_a_compass(tmp_path):
    lines = [HEADER] + [
        f"{name}.png,0,0,{i},{heading},90,0,30,0,0,0,0,0,0,0,0"
        for i, (name, heading) in enumerate(zip(names(), (0, 90, 180, 270, 45), strict=True))
    ]
    cameras = read_capture(write_table(tmp_path, "\n".join(lines))).cameras
    north_east = np.array([(0, 1, 0), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0.5**0.5, 0.5**0.5, 0)])
    for item, view in zip(cameras, north_east, strict=True):
        np.testing.assert_allclose(item.view_direction, view, atol=1e-12)
        np.testing.assert_allclose(item.camera_to_world[:3, 1], (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize("style", ["elements", "attributes"])
@pytest.mark.parametrize(
    "lens, model",
    [
        (LENS, "brown3t2"),
        (BROWN4, "brown4t2"),
        (dict(BROWN4, skew=0.004, aspect=1.01), "brown4t2"),
    ],
)
def test_points_of_sidecars_project_as_the_camera_math_says(tmp_path, lens, model, style):
    write_sidecars(tmp_path, lambda i: sidecar(poses()[i], lens, model, style))
    capture = read_capture(tmp_path)
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(lens, to_camera[i], x), poses())
    np.testing.assert_allclose(capture.up, (0, 0, 1))


def test_epics_sample_matrix_is_a_camera_that_looks_along_minus_y_with_z_up(tmp_path):
    # xcr:Rotation="-1 0 0 0 0 -1 0 -1 0": rows are right, down, view.
    text = sidecar(np.eye(4), LENS).replace("1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0", "-1 0 0 0 0 -1 0 -1 0")
    write_sidecars(tmp_path, lambda i: text.replace("0.0 0.0 0.0</xcr:P", f"0.0 0.0 {i}</xcr:P"))
    for item in read_capture(tmp_path).cameras:
        np.testing.assert_allclose(item.view_direction, (0, -1, 0), atol=1e-12)
        np.testing.assert_allclose(item.camera_to_world[:3, 1], (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize("model", ["perspective", "none"])
def test_a_perspective_lens_has_no_distortion(tmp_path, model):
    write_sidecars(tmp_path, model=model)
    assert {item.lens for item in read_capture(tmp_path).cameras} == {"pinhole"}


def test_the_division_model_is_refused_unless_it_does_nothing(tmp_path):
    write_sidecars(tmp_path, model="division")
    with pytest.raises(CaptureError, match="division"):
        read_capture(tmp_path)
    straight = dict(LENS, k1=0, k2=0, k3=0, t1=0, t2=0)
    write_sidecars(tmp_path, lambda i: sidecar(poses()[i], straight, "division"))
    assert {item.lens for item in read_capture(tmp_path).cameras} == {"pinhole"}


@pytest.mark.parametrize(
    "header",
    [
        HEADER.replace("heading", "yaw").replace(",f,px,py", ",f_35mm,px_norm,py_norm"),
        HEADER.lstrip("#"),
        HEADER.upper(),
    ],
)
def test_headers_of_other_versions_are_understood(tmp_path, header):
    capture = read_capture(write_table(tmp_path, table(header=header, count_line=True)))
    first = read_capture(write_table(tmp_path / "b", table())).cameras
    for a, b in zip(capture.cameras, first, strict=True):
        np.testing.assert_allclose(a.camera_to_world, b.camera_to_world)
        assert (a.fx, a.distortion) == (b.fx, b.distortion)


def saved_by_excel(text, separator, decimal):
    """The lines as Excel saves them: the first, shorter one is filled up with empty cells."""
    rows = [line.split(",") for line in text.splitlines()]
    width = max(len(row) for row in rows)
    rows = [row[:1] + [cell.replace(".", decimal) for cell in row[1:]] for row in rows]
    return "".join(separator.join(row + [""] * (width - len(row))) + "\r\n" for row in rows)


@pytest.mark.parametrize("count_line", [False, True])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    "separator, decimal", [(";", ","), (";", "."), ("\t", "."), ("\t", ","), (",", ".")]
)
def test_a_table_that_excel_saved_again_is_read_as_before(
    tmp_path, separator, decimal, encoding, count_line
):
    text = saved_by_excel(table(BROWN4, count_line=count_line), separator, decimal)
    folder = write_table(tmp_path / "a", "")
    (folder / "cameras.csv").write_bytes(text.encode(encoding))
    assert reader_of(folder / "cameras.csv") is realitycapture
    plain = read_capture(write_table(tmp_path / "b", table(BROWN4))).cameras
    for one, other in zip(read_capture(folder).cameras, plain, strict=True):
        np.testing.assert_array_equal(one.camera_to_world, other.camera_to_world)
        assert (one.fx, one.cx, one.distortion) == (other.fx, other.cx, other.distortion)


def test_decimal_commas_between_commas_end_in_an_error(tmp_path):
    text = saved_by_excel(table(), ",", ",")
    with pytest.raises(CaptureError):
        read_capture(write_table(tmp_path, text))


@pytest.mark.parametrize("number", ["1.234,5", "1,234,5", "1 234,5", ","])
def test_a_number_with_more_than_a_decimal_comma_is_named(tmp_path, number):
    text = saved_by_excel(table(), ";", ",").replace(";40,0;", f";{number};", 1)
    with pytest.raises(CaptureError, match="heading.*is not a number"):
        read_capture(write_table(tmp_path, text))


def test_a_table_without_distortion_is_a_pinhole(tmp_path):
    lines = ["#name,x,y,alt,heading,pitch,roll,f"]
    lines += [",".join(row(i, LENS).split(",")[:8]) for i in range(COUNT)]
    cameras = read_capture(write_table(tmp_path, "\n".join(lines))).cameras
    assert {item.lens for item in cameras} == {"pinhole"} and cameras[0].cx == WIDTH / 2


def test_sidecars_of_several_folders_are_one_capture(tmp_path):
    write_sidecars(tmp_path)
    for folder, name in (("a", names()[0]), ("b/c", names()[1])):
        (tmp_path / folder).mkdir(parents=True)
        for extension in (".png", ".xmp"):
            (tmp_path / f"{name}{extension}").rename(tmp_path / folder / f"{name}{extension}")
    assert len(read_capture(tmp_path).cameras) == COUNT


def test_sidecars_may_lie_apart_from_the_photos(tmp_path):
    write_sidecars(tmp_path / "photos")
    (tmp_path / "xmp").mkdir()
    for file in (tmp_path / "photos").glob("*.xmp"):
        file.rename(tmp_path / "xmp" / file.name)
    assert len(read_capture(tmp_path).cameras) == COUNT


def test_sidecars_without_a_pose_and_of_other_programs_are_left_out(tmp_path):
    write_sidecars(tmp_path)
    bare = sidecar(np.eye(4), LENS)
    bare = bare[: bare.index("<xcr:Rotation>")] + bare[bare.index("<xcr:Position>") :]
    (tmp_path / f"{names()[0]}.xmp").write_text(bare)
    (tmp_path / f"{names()[1]}.xmp").write_text('<x:xmpmeta xmlns:x="adobe:ns:meta/"/>')
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == COUNT - 2
    assert any("no pose" in text and names()[0] in text for text in capture.warnings)


def with_coordinates(index, coordinates, extra=""):
    text = sidecar(poses()[index], LENS, extra=extra)
    return text.replace('Coordinates="absolute"', f'Coordinates="{coordinates}"')


@pytest.mark.parametrize("coordinates", ["relative", "rigid"])
@pytest.mark.parametrize("extra", ['xcr:ComponentId="{70F5304C-4695-4299-8F99-2D331BE3EB98}"', ""])
def test_places_in_a_component_are_places(tmp_path, coordinates, extra):
    write_sidecars(tmp_path, lambda i: with_coordinates(i, coordinates, extra))
    capture = read_capture(tmp_path)
    assert not capture.warnings
    np.testing.assert_allclose(
        np.stack([c.camera_to_world for c in capture.cameras]),
        np.stack([c.camera_to_world for c in read_capture(write_sidecars(tmp_path / "b")).cameras]),
    )


def test_of_several_components_the_largest_is_read_and_the_others_are_named(tmp_path):
    write_sidecars(tmp_path, lambda i: with_coordinates(i, "relative", f'xcr:ComponentId="{{{i == 1}}}"'))
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == COUNT - 1
    assert any(f"{names()[1]}.xmp" in warning for warning in capture.warnings)


def test_places_in_a_rig_are_none_in_the_world(tmp_path):
    rig = 'xcr:Rig="{1}" xcr:RigInstance="{2}" xcr:RigPoseIndex="0"'
    write_sidecars(
        tmp_path / "some",
        lambda i: with_coordinates(i, "relative" if i == 0 else "absolute", rig),
    )
    capture = read_capture(tmp_path / "some")
    assert len(capture.cameras) == COUNT - 1 and "rig" in capture.warnings[0]
    write_sidecars(tmp_path / "all", lambda i: with_coordinates(i, "relative", rig))
    with pytest.raises(CaptureError, match="xcr:Coordinates.*in a rig"):
        read_capture(tmp_path / "all")


def test_photos_are_found_by_windows_paths_of_another_machine(tmp_path):
    lines = [HEADER] + [row(i, LENS, f"D:\\Scans\\Vase\\photos\\{names()[i]}.JPG") for i in range(COUNT)]
    capture = read_capture(write_table(tmp_path, "\n".join(lines)))
    assert sorted(item.name for item in capture.cameras) == names()


def test_renamed_files_are_recognised_by_their_content(tmp_path):
    write_table(tmp_path / "a", table(), name="export.txt")
    assert reader_of(tmp_path / "a" / "export.txt") is realitycapture
    assert len(read_capture(tmp_path / "a").cameras) == COUNT
    write_sidecars(tmp_path / "b")
    (tmp_path / "b" / f"{names()[0]}.xmp").rename(tmp_path / "b" / "one.xml")
    assert reader_of(tmp_path / "b" / "one.xml") is realitycapture


def test_other_tables_are_not_recognised(tmp_path):
    for text in (
        "name,x,y,z\na.png,1,2,3\n", "name;x;y;z\na.png;1;2;3\n", HEADER.replace(",pitch", ""),
        HEADER.replace(",", " "), HEADER.replace(",", ";", 4), HEADER.replace(",", "|"), "\n" * 5 + HEADER,
    ):  # fmt: skip
        for encoding in ("utf-8", "utf-16"):
            (tmp_path / "t.csv").write_bytes(text.encode(encoding))
            assert reader_of(tmp_path / "t.csv") is None


@pytest.mark.parametrize(
    "header",
    [
        "#name,x,y,alt,heading,pitch,roll", "Name;X;Y;Z", HEADER[:-9],
        "#name,X/Lon,Y/Lat,Z/Alt,yaw,pitch,roll",
    ],
)  # fmt: skip
def test_tables_without_lenses_say_which_one_to_export(tmp_path, header):
    file = save_photos(tmp_path / "photos").parent / "cameras.csv"
    file.write_text("#cameras 5\n" + header.replace(",f,", ",") + "\na.png,1,2,3\n")
    for path in (tmp_path, file):
        with pytest.raises(CaptureError, match="places without lenses; export 'Internal/External"):
            read_capture(path)


@pytest.mark.parametrize(
    "text, field",
    [
        (table().replace(",30.0,", ",wide,", 1), "f"),
        (table().replace(",30.0,", ",-30.0,"), "line"),
        (table().replace(",40.0,", ",,", 1), "heading"),
        (table()[:-200].rsplit(",", 10)[0] + ",1\n", "line"),
        (HEADER + "\n", "cameras"),
        (table().replace("\n" + names()[0], "\n" + '"' + names()[0]), ""),
    ],
)
def test_a_malformed_table_gets_an_error_with_file_field_and_remedy(tmp_path, text, field):
    with pytest.raises(CaptureError) as caught:
        read_capture(write_table(tmp_path, text))
    assert field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "change, field",
    [
        (lambda text: text.replace('xcr:FocalLength35mm="30.0"', ""), "FocalLength35mm"),
        (
            lambda text: text.replace('xcr:FocalLength35mm="30.0"', 'xcr:FocalLength35mm="x"'),
            "Focal",
        ),
        (lambda text: text.replace("<xcr:Rotation>", "<xcr:Rotation>9 "), "Rotation"),
        (lambda text: text.replace("<xcr:Position>", "<xcr:Position>nan "), "Position"),
        (lambda text: text[:-40], "line"),
        (lambda text: text.replace("brown3t2", "rationalP2D1"), "DistortionModel"),
    ],
)
def test_a_malformed_sidecar_is_named_with_field_and_remedy(tmp_path, change, field):
    write_sidecars(tmp_path, lambda i: change(sidecar(poses()[i], LENS)))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path)
    assert caught.value.file.suffix == ".xmp" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


FUZZ = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FUZZ
@given(line=st.integers(0, COUNT), column=st.integers(0, 15), value=HOSTILE_TEXT)
def test_hostile_cells_end_in_a_capture_or_an_error(tmp_path, line, column, value):
    cells = [text.split(",") for text in table().splitlines()]
    cells[line][column] = value
    outcome(write_table(tmp_path, "\n".join(",".join(row) for row in cells)))


@FUZZ
@given(data=st.data())
def test_hostile_sidecars_end_in_a_capture_or_an_error(tmp_path, data):
    value = data.draw(HOSTILE_TEXT).replace("&", "").replace("<", "").replace('"', "")
    key = data.draw(
        st.sampled_from(["Rotation", "Position", "DistortionCoeficients", "FocalLength35mm", "Skew",
                         "AspectRatio", "PrincipalPointU", "DistortionModel", "Coordinates"])
    )  # fmt: skip
    text = sidecar(poses()[0], LENS)
    if f"<xcr:{key}>" in text:
        before, after = text.split(f"<xcr:{key}>")
        text = f"{before}<xcr:{key}>{value}</xcr:{key}>" + after.split(f"</xcr:{key}>")[1]
    else:
        before, after = text.split(f'xcr:{key}="')
        text = f'{before}xcr:{key}="{value}"' + after.split('"', 1)[1]
    write_sidecars(tmp_path)
    (tmp_path / f"{names()[0]}.xmp").write_text(text, encoding="utf-8")
    outcome(tmp_path)


@FUZZ
@given(share=st.floats(0, 1), utf16=st.booleans())
def test_files_cut_anywhere_end_in_a_capture_or_an_error(tmp_path, share, utf16):
    text = table()
    folder = write_table(tmp_path / "a", text[: int(share * len(text))])
    if utf16:
        (folder / "cameras.csv").write_bytes(text.encode("utf-16")[: int(share * 2 * len(text))])
    outcome(folder)
    write_sidecars(tmp_path / "b")
    one = tmp_path / "b" / f"{names()[0]}.xmp"
    one.write_text(one.read_text()[: int(share * 1000)])
    outcome(tmp_path / "b")


@FUZZ
@given(order=st.permutations(range(COUNT)))
def test_the_order_of_lines_does_not_matter(tmp_path, order):
    for item in read_capture(write_table(tmp_path, table(order=order))).cameras:
        expected = table_pose(int(item.name[-4:]))
        np.testing.assert_allclose(item.position, expected[:3, 3])
        np.testing.assert_allclose(item.view_direction, expected[:3, 2], atol=1e-12)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252", "mac_roman"])
def test_names_with_umlauts_are_found_however_a_table_was_saved(tmp_path, encoding):
    stems = [f"Vase Grün {i}" for i in range(COUNT)]
    save_photos(tmp_path / "photos", stems)
    rows = [row(i, LENS, name=f"{stem}.png") for i, stem in enumerate(stems)]
    (tmp_path / "cameras.csv").write_bytes("\r\n".join([HEADER, *rows, ""]).encode(encoding))
    assert sorted(camera.image_path.stem for camera in read_capture(tmp_path).cameras) == stems


def test_sidecars_of_the_same_names_in_two_folders_are_one_capture(tmp_path):
    for side in ("left", "right"):
        write_sidecars(tmp_path / side)
    assert len(read_capture(tmp_path).cameras) == 2 * COUNT
