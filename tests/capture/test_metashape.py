"""Metashape's cameras.xml: its manual's projection, sensors, chunks, and hostile files.

The files are written here as Metashape 1.5 … 2.1 writes them, after exports found in public
repositories; an export of ours would need a licence of the program.
"""

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import metashape
from solver.capture.placement import suggest_placement
from solver.capture.read import read_capture, reader_of
from solver.capture.upright import estimate_up
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE_TEXT,
    WIDTH,
    check_projection,
    names,
    numbers,
    outcome,
    poses,
    rotation,
    save_photos,
)

FRAME = dict(f=80.0, cx=1.5, cy=-2.25, k1=-0.08, k2=0.03, k3=0.01, p1=0.004, p2=-0.003)
FULL = dict(FRAME, b1=0.8, b2=-0.4, k4=-0.02)


def calibration(values, kind="frame", kind_of="adjusted"):
    numbers = "".join(f"<{name}>{value!r}</{name}>" for name, value in values.items())
    return (
        f'<calibration type="{kind}" class="{kind_of}"><resolution width="{WIDTH}" '
        f'height="{HEIGHT}"/>{numbers}</calibration>'
    )


def sensor(number, inside, kind="frame"):
    return (
        f'<sensor id="{number}" label="unknown" type="{kind}"><resolution width="{WIDTH}" '
        f'height="{HEIGHT}"/><property name="layer_index" value="0"/>{inside}'
        "<covariance><params>f cx cy</params><coeffs>1 0 0 0 1 0 0 0 1</coeffs></covariance></sensor>"
    )


def camera(number, matrix, label=None, sensor_id=0, extra=""):
    label = names()[number] if label is None else label
    inside = "" if matrix is None else f"<transform>{numbers(matrix)}</transform>"
    return (
        f'<camera id="{number}" sensor_id="{sensor_id}" component_id="0" label="{label}" {extra}>'
        f"{inside}<orientation>1</orientation></camera>"
    )


def chunk_transform(turn, scale, place):
    return (
        f'<transform><rotation locked="true">{numbers(turn)}</rotation><translation locked="true">'
        f'{numbers(place)}</translation><scale locked="true">{scale!r}</scale></transform>'
    )


def document(sensors, cameras, component="", chunk="", wrap=("", "")):
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n'
        f'  <chunk label="Chunk 1" enabled="true">\n    <sensors next_id="2">{sensors}</sensors>\n'
        f'    <components next_id="1" active_id="0"><component id="0" label="Component 1">{component}'
        f'</component></components>\n    <cameras next_id="9" next_group_id="0">{wrap[0]}'
        + "\n".join(cameras)
        + f"{wrap[1]}</cameras>\n    {chunk}<settings/>\n  </chunk>\n</document>\n"
    )


def write(folder, text, name="cameras.xml"):
    save_photos(folder / "photos")
    (folder / name).write_text(text, encoding="utf-8")
    return folder


def simple(values=FRAME, kind="frame", matrices=None, **parts):
    matrices = poses() if matrices is None else matrices
    cameras = [camera(i, matrix) for i, matrix in enumerate(matrices)]
    return document(sensor(0, calibration(values, kind), kind), cameras, **parts)


def reference(values, kind, to_camera, point):
    """Metashape's manual, appendix "Camera models", number by number."""
    k = [values.get(f"k{i}", 0.0) for i in (1, 2, 3, 4)]
    p1, p2 = values.get("p1", 0.0), values.get("p2", 0.0)
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    if kind == "fisheye":
        r0 = math.sqrt(x * x + y * y)
        x, y = x * math.atan(r0) / r0, y * math.atan(r0) / r0
    if kind == "equisolid_fisheye":
        across = math.sqrt(X * X + Y * Y)
        r0 = 2 * math.sin(math.atan2(across, Z) / 2)
        x, y = X / across * r0, Y / across * r0
    r = math.sqrt(x * x + y * y)
    radial = 1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6 + k[3] * r**8
    grows = 1 + values.get("p3", 0.0) * r**2 + values.get("p4", 0.0) * r**4
    xd = x * radial + (p1 * (r**2 + 2 * x**2) + 2 * p2 * x * y) * grows
    yd = y * radial + (p2 * (r**2 + 2 * y**2) + 2 * p1 * x * y) * grows
    f, b1, b2 = values["f"], values.get("b1", 0.0), values.get("b2", 0.0)
    u = WIDTH * 0.5 + values["cx"] + xd * f + xd * b1 + yd * b2
    v = HEIGHT * 0.5 + values["cy"] + yd * f
    return u, v


PLAIN_FISHEYE = dict(f=40.0, cx=0.5, cy=0.25, k1=-0.02, k2=0.004, k3=0.001, k4=-0.0005)


@pytest.mark.parametrize(
    "values, kind, lens",
    [
        (dict(f=80.0, cx=0.0, cy=0.0), "frame", "pinhole"),
        (dict(f=80.0, cx=0.0, cy=0.0, b1=3.0), "frame", "pinhole"),
        (FRAME, "frame", "opencv"),
        (FULL, "frame", "brown"),
        (PLAIN_FISHEYE, "fisheye", "opencv_fisheye"),
        (dict(PLAIN_FISHEYE, p1=0.003, p2=-0.002, b1=0.5, b2=0.2), "fisheye", "brown"),
        (dict(FULL, p3=0.7, p4=-0.3), "frame", "brown"),
        (dict(f=80.0, cx=0.0, cy=0.0, p1=0.004, p4=0.9), "frame", "brown"),
        (dict(PLAIN_FISHEYE, p1=0.003, p2=-0.002, p3=-0.4), "fisheye", "brown"),
        (dict(f=40.0, cx=0.5, cy=0.25), "equisolid_fisheye", "brown"),
        (dict(PLAIN_FISHEYE, p1=0.003, p2=-0.002, b1=0.5, b2=0.2), "equisolid_fisheye", "brown"),
        (dict(FRAME, p1=0.0, p2=0.0, p3=0.7, p4=-0.3), "frame", "opencv"),
    ],
)
def test_points_project_as_the_manual_says(tmp_path, values, kind, lens):
    capture = read_capture(write(tmp_path, simple(values, kind)))
    assert capture.format == metashape.NAME and not capture.warnings and not capture.metric
    assert {item.lens for item in capture.cameras} == {lens}
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(values, kind, to_camera[i], x), poses())


@pytest.mark.parametrize("where", ["component", "chunk"])
def test_the_chunk_places_its_cameras_in_the_world(tmp_path, where):
    turn, scale, place = rotation(np.random.default_rng(5)), 2.5, np.array([10.0, -4.0, 3.0])
    text = simple(**{where: chunk_transform(turn, scale, place)})
    capture = read_capture(write(tmp_path, text))
    expected = poses()
    expected[:, :3, :3] = turn @ expected[:, :3, :3]
    expected[:, :3, 3] = scale * expected[:, :3, 3] @ turn.T + place
    to_camera = np.linalg.inv(expected)
    check_projection(capture, lambda i, x: reference(FRAME, "frame", to_camera[i], x), expected)
    np.testing.assert_allclose(capture.up, (0, 0, 1))


@pytest.mark.parametrize("turn", ["", "<rotation>1 0 0 0 1 0 0 0 1</rotation>"])
def test_of_a_chunk_that_scale_bars_alone_place_the_scale_is_kept_and_up_is_found(tmp_path, turn):
    chunk = f"<transform>{turn}<scale>0.25</scale></transform>"
    capture = read_capture(write(tmp_path, simple(component=chunk)))
    assert capture.up is None and capture.metric
    expected = poses()
    expected[:, :3, 3] *= 0.25
    np.testing.assert_allclose([c.camera_to_world[:3, 3] for c in capture.cameras], expected[:, :3, 3])
    matrix = suggest_placement(capture)
    np.testing.assert_allclose(matrix[:3, :3] @ estimate_up(list(capture.cameras)), (0, 0, 1), atol=1e-9)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)


@pytest.mark.parametrize("place", [(-2499366.4, -4256836.5, 4029217.9), (431000.0, 5200000.0, 300.0)])
def test_chunks_far_from_the_origin_stay_in_their_own_coordinates(tmp_path, place):
    turn = rotation(np.random.default_rng(5))
    capture = read_capture(write(tmp_path, simple(component=chunk_transform(turn, 12.354, place))))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(FRAME, "frame", to_camera[i], x), poses())
    # The first is on the Earth's surface, counted from its centre; the second on no sphere.
    up = np.array(place) / np.linalg.norm(place) if place[0] < 0 else (0, 0, 1)
    np.testing.assert_allclose(turn @ capture.up, up, atol=1e-12)


def test_cameras_use_their_own_sensor_and_its_adjusted_calibration(tmp_path):
    other = dict(FRAME, f=70.0, k1=0.02)
    sensors = sensor(0, calibration({"f": 1.0}, kind_of="initial") + calibration(FRAME))
    sensors += sensor(7, calibration(other, kind_of="initial"))
    cameras = [camera(i, m, sensor_id=7 if i % 2 else 0) for i, m in enumerate(poses())]
    wrap = ('<group id="0" label="Group 1" type="folder">', "</group>")
    capture = read_capture(write(tmp_path, document(sensors, cameras, wrap=wrap)))
    to_camera = np.linalg.inv(poses())
    check_projection(
        capture,
        lambda i, x: reference(other if i % 2 else FRAME, "frame", to_camera[i], x),
        poses(),
    )


def test_photoscans_old_calibration_counts_from_the_corner(tmp_path):
    old = dict(fx=82.0, fy=80.0, cx=50.0, cy=30.0, skew=0.5, k1=-0.05, k2=0.01, k3=0.0, p1=1e-3, p2=2e-3)
    new = dict(f=80.0, b1=2.0, b2=0.5, cx=50.0 - WIDTH / 2, cy=30.0 - HEIGHT / 2, k1=-0.05, k2=0.01,
               p1=2e-3, p2=1e-3)  # fmt: skip
    capture = read_capture(write(tmp_path, simple(old)))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(new, "frame", to_camera[i], x), poses())


def test_unaligned_and_disabled_cameras_are_left_out_with_a_warning(tmp_path):
    matrices = poses(7)
    cameras = [camera(i, matrices[i]) for i in range(COUNT)]
    cameras.append(camera(5, None, label="IMG_0005"))
    cameras.append(camera(6, matrices[6], label="IMG_0006", extra='enabled="false"'))
    save_photos(tmp_path / "photos", names(7))
    text = document(sensor(0, calibration(FRAME)), cameras)
    capture = read_capture(write(tmp_path, text))
    assert len(capture.cameras) == COUNT
    assert any("not aligned" in text and "IMG_0005" in text for text in capture.warnings)
    assert any("disabled" in text and "IMG_0006" in text for text in capture.warnings)


def test_members_of_rigs_and_panoramas_with_a_lens_are_left_out_with_a_warning(tmp_path):
    matrices = poses(8)
    cameras = [camera(i, matrices[i]) for i in range(COUNT)]
    cameras.append(camera(5, None, label="IMG_0005", extra='master_id="0"'))
    cameras.append(camera(6, matrices[6], sensor_id=1, label="IMG_0006"))
    cameras.append(camera(7, None, sensor_id=1, label="IMG_0007"))
    save_photos(tmp_path / "photos", names(8))
    round_about = sensor(1, calibration(FRAME, "spherical"), "spherical")
    text = document(sensor(0, calibration(FRAME)) + round_about, cameras)
    capture = read_capture(write(tmp_path, text))
    assert len(capture.cameras) == COUNT and len(capture.warnings) == 2
    assert any("1 camera is part of a rig" in w and "IMG_0005" in w for w in capture.warnings)
    assert any("2 cameras are panoramic" in w and "IMG_0006" in w for w in capture.warnings)


def rig(offset, photos=3, **changes):
    """A document of `photos` places with two cameras each, the second at `offset` [4, 4] from the first."""
    parts = dict(
        rotation=f"<rotation>{numbers(offset[:3, :3])}</rotation>",
        location=f"<location>{numbers(offset[:3, 3])}</location>",
    )
    parts.update(changes)
    second = sensor(1, calibration(dict(FRAME, f=70.0)) + parts["rotation"] + parts["location"])
    sensors = sensor(0, calibration(FRAME)) + second.replace("<sensor", '<sensor master_id="0"')
    cameras = []
    for place, matrix in enumerate(poses(photos)):
        first, follows = 2 * place, f'master_id="{2 * place}"'
        cameras.append(camera(first, matrix, label=f"IMG_{first:04d}"))
        second = camera(first + 1, None, f"IMG_{first + 1:04d}", 1, follows)
        cameras.append(second.replace(' component_id="0"', ""))
    return document(sensors, cameras, component=chunk_transform(np.eye(3), 2.5, np.ones(3)))


def offset():
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(np.random.default_rng(9)), (0.3, -0.1, 0.2)
    return matrix


def test_members_of_rigs_stand_where_their_sensor_is_beside_the_first_camera(tmp_path):
    save_photos(tmp_path / "photos", names(6))
    capture = read_capture(write(tmp_path, rig(offset())))
    assert not capture.warnings
    expected = np.repeat(poses(3), 2, axis=0)
    expected[1::2] = expected[1::2] @ offset()
    expected[:, :3, 3] = 2.5 * expected[:, :3, 3] + 1
    to_camera, lenses = np.linalg.inv(expected), (FRAME, dict(FRAME, f=70.0))
    check_projection(capture, lambda i, x: reference(lenses[i % 2], "frame", to_camera[i], x), expected)


@pytest.mark.parametrize("left", ["rotation", "location"])
def test_members_of_rigs_whose_place_is_not_stated_are_left_out(tmp_path, left):
    save_photos(tmp_path / "photos", names(6))
    capture = read_capture(write(tmp_path, rig(offset(), **{left: ""})))
    assert len(capture.cameras) == 3
    assert "3 cameras are part of a rig" in capture.warnings[0]


def test_members_of_a_rig_that_was_not_aligned_are_not_aligned(tmp_path):
    save_photos(tmp_path / "photos", names(8))
    text = rig(offset(), photos=4).replace(f"<transform>{numbers(poses(4)[3])}</transform>", "")
    capture = read_capture(write(tmp_path, text))
    assert len(capture.cameras) == 6 and "2 cameras are not aligned" in capture.warnings[0]


ROLLS = '<property name="layer_index" value="0"/><property name="rolling_shutter" value="{}"/>'


@pytest.mark.parametrize("value, said", [("true", True), ("1", True), ("false", False), ("", False)])
def test_of_a_rolling_shutter_it_is_said_that_it_is_left_aside(tmp_path, value, said):
    plain = '<property name="layer_index" value="0"/>'
    capture = read_capture(write(tmp_path, simple().replace(plain, ROLLS.format(value))))
    assert bool(capture.warnings) is said
    if said:
        assert "5 cameras were aligned with a rolling shutter" in capture.warnings[0]
        assert "(the first: IMG_0000)" in capture.warnings[0]


def test_the_movement_of_a_single_camera_is_left_aside_with_a_word(tmp_path):
    moved = (
        '<camera id="2" sensor_id="0"',
        "<rolling_shutter><translation>1 0 0</translation></rolling_shutter>",
    )
    parts = simple().split(moved[0])
    text = moved[0].join([parts[0], parts[1].replace("<transform>", moved[1] + "<transform>", 1)])
    capture = read_capture(write(tmp_path, text))
    assert "1 camera was aligned with a rolling shutter" in capture.warnings[0]
    still = read_capture(write(tmp_path / "still", simple()))
    for a, b in zip(capture.cameras, still.cameras, strict=True):
        np.testing.assert_array_equal(a.camera_to_world, b.camera_to_world)


def corrected(coefficients):
    extent = "<extent><min>0 0</min><max>96 64</max></extent>"
    inside = f'<corrections type="fourier"><coeffs>{coefficients}</coeffs>{extent}</corrections>'
    return simple().replace("</calibration>", inside + "</calibration>")


def test_additional_corrections_are_refused_unless_they_are_nothing(tmp_path):
    assert not read_capture(write(tmp_path, corrected("0 " * 96))).warnings
    with pytest.raises(CaptureError, match="Fit additional corrections") as caught:
        read_capture(write(tmp_path, corrected("0 " * 95 + "0.25")))
    assert caught.value.field == "sensor unknown, corrections"


def test_of_an_unknown_coefficient_only_zero_is_read(tmp_path):
    assert read_capture(write(tmp_path, simple(dict(FRAME, k5=0.0))))
    with pytest.raises(CaptureError, match="k5: this coefficient is not known"):
        read_capture(write(tmp_path, simple(dict(FRAME, k5=0.1))))


def test_only_the_largest_of_unplaced_components_is_read(tmp_path):
    cameras = [camera(i, m) for i, m in enumerate(poses())]
    cameras[4] = cameras[4].replace('component_id="0"', 'component_id="1"')
    capture = read_capture(write(tmp_path, document(sensor(0, calibration(FRAME)), cameras)))
    assert len(capture.cameras) == 4 and "other components" in capture.warnings[0]


def test_cameras_of_a_component_without_a_place_are_left_out_beside_placed_ones(tmp_path):
    text = simple(component=chunk_transform(np.eye(3), 2.0, np.ones(3)))
    text = text.replace('id="4" sensor_id="0" component_id="0"', 'id="4" sensor_id="0" component_id="1"')
    text = text.replace('id="3" sensor_id="0" component_id="0"', 'id="3" sensor_id="0"')
    cameras = {item.name: item for item in read_capture(write(tmp_path, text)).cameras}
    assert sorted(cameras) == names()[:4]
    np.testing.assert_allclose(cameras["IMG_0003"].position, 2 * poses()[3, :3, 3] + 1)


def test_a_projects_own_chunk_is_read_as_its_export_is(tmp_path):
    """`doc.xml` in a `.psx` project's `chunk.zip` is what a document has around it, alone."""
    whole = simple(chunk=chunk_transform(rotation(np.random.default_rng(1)), 2.5, np.ones(3)))
    chunk = whole[whole.index("<chunk") : whole.index("</chunk>")].replace(
        "<chunk ", '<chunk version="1.2.0" '
    )
    frames = '<frames next_id="1"><frame id="0" path="0/frame.zip"/></frames></chunk>'
    exported = read_capture(write(tmp_path / "exported", whole))
    inside = tmp_path / "project" / "duck.files" / "0"
    inside.mkdir(parents=True)
    save_photos(tmp_path / "project" / "photos")
    (inside / "doc.xml").write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{chunk}{frames}')
    for given_as in (tmp_path / "project", inside / "doc.xml"):
        capture = read_capture(given_as, photos=tmp_path / "project" / "photos")
        assert capture.format == "Metashape cameras.xml" and len(capture.cameras) == COUNT
        for one, other in zip(capture.cameras, exported.cameras, strict=True):
            assert one.name == other.name and one.distortion == other.distortion
            np.testing.assert_allclose(one.camera_to_world, other.camera_to_world)


def test_of_several_chunks_the_one_with_the_most_cameras_is_read(tmp_path):
    save_photos(tmp_path)
    whole = simple()
    start, end = whole.index("<chunk"), whole.index("</chunk>") + len("</chunk>")
    chunk = whole[start:end]
    few = ElementTree.fromstring(chunk)
    cameras = few.find("cameras")
    for camera in list(cameras)[3:]:
        cameras.remove(camera)
    text = whole[:start] + ElementTree.tostring(few, "unicode") + chunk + whole[end:]
    capture = read_capture(write(tmp_path, text))
    assert len(capture.cameras) == COUNT
    assert any("of 2 chunks only the largest" in text for text in capture.warnings)


def test_photos_are_found_by_windows_paths_of_another_machine(tmp_path):
    cameras = [
        camera(i, m, label=f"D:\\Scans\\Vase\\photos\\{names()[i]}.JPG") for i, m in enumerate(poses())
    ]
    capture = read_capture(write(tmp_path, document(sensor(0, calibration(FRAME)), cameras)))
    assert sorted(item.name for item in capture.cameras) == names()


CARDS = ("100", "101")


def of_two_cards(folder, groups=CARDS, label="{}"):
    """Photos of the same names in two folders; cameras in groups, 0 … 2 of the first, 3 … 5 of the other."""
    for card in CARDS:
        save_photos(folder / "photos" / card, names(3))
    cameras = [camera(i, matrix, label=label.format(names(3)[i % 3])) for i, matrix in enumerate(poses(6))]
    if groups is not None:
        for i, group in enumerate(groups):
            cameras[3 * i] = f'<group id="{i}" label="{group}" type="folder">{cameras[3 * i]}'
            cameras[3 * i + 2] += "</group>"
    text = document(sensor(0, calibration(FRAME)), cameras)
    (folder / "cameras.xml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("groups", [CARDS, CARDS[::-1], ("DCIM/100", "DCIM/101")])
@pytest.mark.parametrize("label", ["{}", "{}.JPG"])
def test_of_photos_of_one_name_the_one_in_the_folder_of_the_groups_name_is_meant(tmp_path, groups, label):
    capture = read_capture(of_two_cards(tmp_path, groups, label))
    assert len(capture.cameras) == 6 and not capture.warnings
    for item, pose in zip(capture.cameras, poses(6), strict=True):
        np.testing.assert_allclose(item.position, pose[:3, 3])
    cards = [item.image_path.parent.name for item in capture.cameras]
    assert cards == [group[-3:] for group in groups for _ in range(3)]


def test_a_photo_that_is_missing_from_its_groups_folder_is_not_the_other_folders(tmp_path):
    folder = of_two_cards(tmp_path)
    (folder / "photos" / "101" / f"{names()[1]}.png").unlink()
    capture = read_capture(folder)
    assert len({item.image_path for item in capture.cameras}) == len(capture.cameras) == 5
    assert f"101/{names()[1]}" in capture.warnings[0]


@pytest.mark.parametrize("groups", [None, ("Group 1", "Group 2"), ("", "")])
def test_photos_of_one_name_that_no_group_tells_apart_are_to_be_renamed(tmp_path, groups):
    with pytest.raises(CaptureError, match="could both be meant; rename the photos so that no two"):
        read_capture(of_two_cards(tmp_path, groups))


def test_a_group_that_is_called_as_a_folder_is_need_not_hold_its_photos(tmp_path):
    wrap = ('<group id="0" label="details" type="folder">', "</group>")
    folder = write(tmp_path, simple(wrap=wrap))
    (folder / "details").mkdir()
    (folder / "photos" / f"{names()[0]}.png").rename(folder / "details" / f"{names()[0]}.png")
    assert len(read_capture(folder).cameras) == COUNT


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    write(tmp_path, simple(), name="export of tuesday.txt")
    assert reader_of(tmp_path / "export of tuesday.txt") is metashape
    assert len(read_capture(tmp_path).cameras) == COUNT


@pytest.mark.parametrize(
    "text, field",
    [
        (simple(kind="spherical"), "type"),
        (simple(kind="cylindrical"), "type"),
        (simple().replace("<f>80.0</f>", ""), "f"),
        (simple().replace("<f>80.0</f>", "<f>eighty</f>"), "f"),
        (simple().replace("<f>80.0</f>", "<f>-80.0</f>"), "IMG"),
        (simple(matrices=poses() * np.nan), "transform"),
        (simple(matrices=poses() * 0), "IMG"),
        (simple(matrices=[np.eye(3)] * COUNT), "transform"),
        (simple(matrices=[None] * COUNT), "transform"),
        (simple().replace('sensor_id="0"', 'sensor_id="5"'), "IMG"),
        (simple(chunk=chunk_transform(np.zeros((3, 3)), 1.0, np.zeros(3))), "chunk"),
        (document(sensor(0, calibration(FRAME)), []), "chunk"),
        (simple().replace("<calibration", "<guess").replace("</calibration", "</guess"), "sensor"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, text, field):
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, text))
    assert caught.value.file.name == "cameras.xml" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


FUZZ = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FUZZ
@given(data=st.data())
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data):
    save_photos(tmp_path / "photos", names(6))
    text = simple(component=chunk_transform(np.eye(3), 1.0, np.ones(3)))
    root = ElementTree.fromstring(data.draw(st.sampled_from([text, rig(offset()), corrected("0 1")])))
    element = data.draw(st.sampled_from(list(root.iter())))
    value = data.draw(HOSTILE_TEXT)
    if element.attrib and data.draw(st.booleans()):
        element.set(data.draw(st.sampled_from(sorted(element.attrib))), value)
    else:
        element.text = value
    outcome(write(tmp_path, ElementTree.tostring(root, encoding="unicode")))


@FUZZ
@given(share=st.floats(0, 1))
def test_a_file_cut_anywhere_ends_in_an_error(tmp_path, share):
    text = simple()
    assert outcome(write(tmp_path, text[: int(share * (len(text) - 20))])) is None


@FUZZ
@given(order=st.permutations(range(COUNT)))
def test_the_order_of_cameras_does_not_matter(tmp_path, order):
    cameras = [camera(i, poses()[i]) for i in order]
    capture = read_capture(write(tmp_path, document(sensor(0, calibration(FRAME)), cameras)))
    for item in capture.cameras:
        expected = poses()[int(item.name[-4:])]
        np.testing.assert_allclose(item.position, expected[:3, 3])
        np.testing.assert_allclose(item.view_direction, expected[:3, 2])


def test_deep_and_huge_files_end_quickly(tmp_path):
    deep = "<chunk><camera>" + "<a>" * 50_000 + "</a>" * 50_000 + "</camera></chunk>"
    assert outcome(write(tmp_path, f"<document>{deep}</document>")) is None
    many = document(sensor(0, calibration(FRAME)), [camera(0, np.eye(4), label="gone")] * 3_000)
    assert outcome(write(tmp_path, many)) is None


def test_files_that_define_entities_are_refused(tmp_path):
    bomb = '<!DOCTYPE d [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
    text = simple().replace("<document", bomb + "<document", 1)
    with pytest.raises(CaptureError, match="DOCTYPE"):
        read_capture(write(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1"])
def test_files_are_read_in_the_encoding_that_they_state(tmp_path, encoding):
    stems = [f"Öl & Söhne {i}" for i in range(COUNT)]
    save_photos(tmp_path / "Fotos (neu)", stems, extension=".JPG")
    cameras = [camera(i, matrix, label=stems[i].replace("&", "&amp;")) for i, matrix in enumerate(poses())]
    text = document(sensor(0, calibration(FRAME)), cameras)
    text = text.replace("UTF-8", encoding.removesuffix("-sig"))
    (tmp_path / "cameras.xml").write_bytes(text.encode(encoding))
    assert sorted(item.image_path.stem for item in read_capture(tmp_path).cameras) == stems


def test_decimal_commas_are_named(tmp_path):
    text = simple().replace(f"<transform>{numbers(poses()[0])}", "<transform>" + "0,5 " * 16)
    with pytest.raises(CaptureError, match="camera IMG_0000, transform.*has decimal commas"):
        read_capture(write(tmp_path, text))


def test_of_a_single_camera_that_is_not_aligned_nothing_is_said_in_the_plural(tmp_path):
    write(tmp_path, simple(matrices=[None]))
    with pytest.raises(CaptureError, match="transform: its camera is not aligned; align"):
        read_capture(tmp_path)
