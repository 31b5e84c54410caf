"""BlocksExchange XML: poses, worlds, photos and masks, points, and hostile files."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.capture.errors import CaptureError
from solver.capture.formats import blocks_exchange, metashape
from solver.capture.read import read_capture, reader_of
from tests.capture.blocks import (
    BROWN,
    document,
    group,
    photo,
    reference,
    simple,
    tags,
    write,
)
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

UTM = ("WGS 84 / UTM zone 36N (EPSG:32636)", "EPSG:32636")
ENU = ("Local East-North-Up (ENU); origin: 39.975230N 83.006780W", "ENU:39.97523,-83.00678")
ECEF = ("ECEF", "EPSG:4978")
DEGREES = ("WGS 84 + EGM96 geoid height", "EPSG:4326+5773")
LOCAL = ("Local", 'LOCAL_CS["Local Coordinates (m)",UNIT["metre",1]]')


def test_rotations_may_be_angles(tmp_path):
    cameras = []
    for i, pose in enumerate(poses()):
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("XYZ", degrees=True).tolist()
        turn = tags(dict(zip(("Omega", "Phi", "Kappa"), angles, strict=True)))
        cameras.append(photo(i, pose, turn=turn))
    capture = read_capture(write(tmp_path, document([group(cameras)])))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(BROWN, to_camera[i], x), poses())


def test_angles_whose_order_is_not_known_are_refused(tmp_path):
    turn = tags(dict(Yaw=-98.4, Pitch=-45.0, Roll=1.5))
    text = document([group([photo(i, pose, turn=turn) for i, pose in enumerate(poses())])])
    with pytest.raises(CaptureError, match="Pitch, Roll, Yaw are not read; export .* as matrices"):
        read_capture(write(tmp_path, text))


FAR = np.array([431000.0, 4520000.0, 300.0])


@pytest.mark.parametrize(
    "system, place, up, metric",
    [
        (None, (0, 0, 0), None, False),
        (LOCAL, (0, 0, 0), None, False),
        (ENU, (0, 0, 0), (0, 0, 1), True),
        (UTM, FAR, (0, 0, 1), False),
        (ECEF, (-2499366.4, -4256836.5, 4029217.9), "outward", True),
        (
            ("ECEF", "GEODCRS[WGS 84, CS[Cartesian, 3]]"),
            (-2499366.4, 4256836.5, 4029217.9),
            "outward",
            True,
        ),
        (("UTM", "PROJCRS[x, BASEGEODCRS[WGS 84], CS[Cartesian, 2]]"), FAR, (0, 0, 1), False),
    ],
)
def test_the_worlds_up_and_metres_are_those_of_its_system(tmp_path, system, place, up, metric):
    places = poses()
    places[:, :3, 3] += place
    capture = read_capture(write(tmp_path, simple(places, system=system)))
    middle = places[:, :3, 3].mean(0)
    if up is None:
        assert capture.up is None
    else:
        expected = middle / np.linalg.norm(middle) if up == "outward" else up
        np.testing.assert_allclose(capture.up, expected, atol=1e-12)
    assert capture.metric is metric
    for item in capture.cameras:
        np.testing.assert_allclose(item.position, places[int(item.name[-4:]), :3, 3])


def test_degrees_are_no_world(tmp_path):
    with pytest.raises(CaptureError, match=r"in degrees .*; export it in a local system \(ENU\)"):
        read_capture(write(tmp_path, simple(system=DEGREES)))


def test_photogroups_may_name_their_system_but_only_one(tmp_path):
    groups = [group([photo(i, pose)], inside="<SRSId>2</SRSId>") for i, pose in enumerate(poses())]
    text = document(groups, ENU).replace("</Name><SRSId>2</SRSId>", "</Name>", 1)
    assert read_capture(write(tmp_path, text)).metric
    text = text.replace("<SRSId>2</SRSId>", "<SRSId>0</SRSId>", 1)
    with pytest.raises(CaptureError, match="2 systems of coordinates"):
        read_capture(write(tmp_path, text))


def test_photos_without_a_whole_pose_are_left_out_with_a_warning(tmp_path):
    save_photos(tmp_path / "photos", names(8))
    whole = photo(5, np.eye(4))
    place = whole.split("<Rotation>")[0] + whole.split("</Rotation>")[1]
    turn = whole.split("<Center>")[0] + whole.split("</Center>", 1)[1]
    cameras = [photo(i, pose) for i, pose in enumerate(poses())]
    text = document([group([*cameras, place, turn, photo(7)])])
    capture = read_capture(write(tmp_path, text))
    assert len(capture.cameras) == COUNT
    assert "3 of 8 photos have no pose" in capture.warnings[0]


def test_a_file_of_photos_alone_is_told_to_be_aligned_first(tmp_path):
    listed = "".join(photo(i) for i in range(COUNT))
    for text in (
        document([group([listed])]),
        document([], more=f"<Block><BulkPhotos>{listed}</BulkPhotos></Block>"),
    ):
        with pytest.raises(CaptureError, match="none of its 5 photos has a pose; .* aligned"):
            read_capture(write(tmp_path, text))


def test_photos_of_other_components_are_left_out_with_a_warning(tmp_path):
    parts = ["<Component>1</Component>", "", "<Component>1</Component>", "<Component>2</Component>",
             "<Component>0</Component>"]  # fmt: skip
    cameras = [photo(i, pose, inside=parts[i]) for i, pose in enumerate(poses())]
    capture = read_capture(write(tmp_path, document([group(cameras)])))
    assert [item.name for item in capture.cameras] == names()[:3]
    assert "2 photos are in other components" in capture.warnings[0]
    cameras = [photo(i, pose, inside=parts[4]) for i, pose in enumerate(poses())]
    capture = read_capture(write(tmp_path, document([group(cameras)])))
    assert len(capture.cameras) == COUNT and not capture.warnings


def test_of_several_blocks_the_largest_is_read(tmp_path):
    few = document([group([photo(0, poses()[0])])])
    few = few[few.index("<Block>") : few.index("</Block>") + len("</Block>")]
    capture = read_capture(write(tmp_path, simple(more=few)))
    assert len(capture.cameras) == COUNT and "of 2 blocks only the largest" in capture.warnings[0]


def test_photos_have_the_lens_of_their_group(tmp_path):
    other = dict(BROWN, K1=0.02)
    lens = f"<Distortion>{tags(other)}</Distortion>"
    groups = [
        group([photo(i, pose) for i, pose in enumerate(poses()) if i % 2 == odd], lens=own)
        for odd, own in ((0, None), (1, lens))
    ]
    capture = read_capture(write(tmp_path, document(groups)))
    to_camera = np.linalg.inv(poses())
    check_projection(capture, lambda i, x: reference(other if i % 2 else BROWN, to_camera[i], x), poses())


@pytest.mark.parametrize(
    "base, name",
    [
        ("", "D:/CC_Workspace/Vase/photos/{}.png"),
        ("", "D:\\CC_Workspace\\Vase\\photos\\{}.png"),
        ("<BaseImagePath>D:\\data\\Vase\\photos</BaseImagePath>", "{}.png"),
        ("<BaseImagePath>D:\\data</BaseImagePath>", "/mnt/vase/photos/{}.png"),
        ("", "photos/{}.png"),
        ("", "3e4742f9-87fc-4bfa-8ee3-6103555f325f/{}.png"),
    ],
)
def test_photos_are_found_by_paths_of_another_machine(tmp_path, base, name):
    cameras = [photo(i, pose, name.format(names()[i])) for i, pose in enumerate(poses())]
    capture = read_capture(write(tmp_path, document([group(cameras)], base=base)))
    assert sorted(item.name for item in capture.cameras) == names()


def test_of_photos_of_one_name_the_one_behind_the_common_path_is_meant(tmp_path):
    save_photos(tmp_path / "other")
    capture = read_capture(write(tmp_path, simple(base="<BaseImagePath>D:\\data\\photos</BaseImagePath>")))
    assert {item.image_path.parent for item in capture.cameras} == {tmp_path / "photos"}


def test_photos_that_are_missing_are_left_out_with_a_warning(tmp_path):
    write(tmp_path, simple())
    (tmp_path / "photos" / f"{names()[0]}.png").unlink()
    capture = read_capture(tmp_path)
    assert len(capture.cameras) == COUNT - 1 and names()[0] in capture.warnings[0]


@pytest.mark.parametrize("stated", ["D:\\Vase\\hidden\\{}_msk.png", "hidden/{}_msk.png"])
def test_masks_that_the_file_names_are_taken(tmp_path, stated):
    (tmp_path / "hidden").mkdir()
    cameras = []
    for i, pose in enumerate(poses()):
        Image.new("L", (WIDTH, HEIGHT), 255).save(tmp_path / "hidden" / f"{names()[i]}_msk.png")
        inside = f"<MaskPath>{stated.format(names()[i])}</MaskPath>"
        cameras.append(photo(i, pose, f"photos/{names()[i]}.png", inside=inside))
    for item in read_capture(write(tmp_path, document([group(cameras)]))).cameras:
        assert item.mask_path == tmp_path / "hidden" / f"{item.name}_msk.png"


def test_a_mask_that_is_called_as_its_photo_is_not_the_photo(tmp_path):
    cameras = [
        photo(i, pose, inside=f"<MaskPath>D:\\msk\\{names()[i]}.png</MaskPath>")
        for i, pose in enumerate(poses())
    ]
    save_photos(tmp_path)
    (tmp_path / "block.xml").write_text(document([group(cameras)]))
    capture = read_capture(tmp_path)
    assert all(item.mask_path != item.image_path for item in capture.cameras)


def test_tie_points_are_sparse_points(tmp_path):
    place = "<Position><x>0.5</x><y>-1.0</y><z>2.0</z></Position>"
    seen = "<Measurement><PhotoId>0</PhotoId><x>3.5</x><y>9.25</y></Measurement>"
    points = (
        f"<TiePoint>{place}<Color><Red>0.59</Red></Color>{seen}</TiePoint><TiePoint>{seen}</TiePoint>"
        f"<TiePoint><SRSId>0</SRSId>{place}</TiePoint>"
    )
    capture = read_capture(write(tmp_path, simple(points=points, system=ENU)))
    np.testing.assert_allclose(capture.points, [[0.5, -1, 2]])


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    write(tmp_path, simple(), name="export of tuesday.txt")
    file = tmp_path / "export of tuesday.txt"
    assert reader_of(file) is blocks_exchange and not metashape.recognises(file)
    assert len(read_capture(tmp_path).cameras) == COUNT


@pytest.mark.parametrize(
    "text, field",
    [
        (simple().replace("Block>", "Blocks>"), "Block"),
        (simple(kind="Spherical"), "CameraModelType"),
        (simple(axes="XRightYRight"), "CameraOrientation"),
        (simple(axes="down"), "CameraOrientation"),
        (simple(focal=""), "FocalLength"),
        (simple(focal="<FocalLength>30</FocalLength>"), "SensorSize"),
        (simple(focal="<FocalLength>30</FocalLength><PixelSize>-1</PixelSize>"), "SensorSize"),
        (simple(focal="<FocalLengthPixels>eighty</FocalLengthPixels>"), "FocalLengthPixels"),
        (simple(focal="<FocalLengthPixels>-80</FocalLengthPixels>"), "photo 0"),
        (simple(point="<x>a</x><y>1</y>"), "PrincipalPoint/x"),
        (simple(point="<xmm>1</xmm><ymm>1</ymm>"), "SensorSize"),
        (simple(lens="<Distortion><K1>0.1</K1><K4>0.2</K4></Distortion>"), "Distortion/K4"),
        (simple(lens="<Distortion><K1>x</K1></Distortion>"), "Distortion/K1"),
        (simple(lens="<Distortion><Direct><K1>1</K1></Direct></Distortion>"), "Distortion/Direct"),
        (simple(kind="Fisheye", lens="<FisheyeFocalMatrix><M_00>9</M_00></FisheyeFocalMatrix>"), "M_11"),
        (simple().replace(f"<Width>{WIDTH}</Width>", ""), "ImageDimensions/Width"),
        (simple().replace(f"<Width>{WIDTH}</Width>", "<Width>0</Width>"), "photo"),
        (simple(poses() * np.nan), "photo"),
        (simple(poses() * 0), "photo"),
        (simple(poses() * 1e200), "photo"),
        (simple(poses() * 1e200, system=ECEF), "photo"),
        (simple().replace("<M_11>", "<N_11>").replace("</M_11>", "</N_11>"), "M_11"),
        (simple().replace("<x>", "<xx>").replace("</x>", "</xx>"), "Center"),
        (simple().replace(f"{names()[0]}.png", ""), "ImagePath"),
        (simple(points="<TiePoint><Position><x>1</x></Position></TiePoint>"), "tie point"),
        (document([]), "cameras"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, text, field):
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, text))
    assert caught.value.file.name == "Block_1 - AT.xml" and field in caught.value.field
    assert caught.value.remedy and "\n" not in str(caught.value)


FUZZ = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
POINTS = "<TiePoint><Position><x>1</x><y>2</y><z>3</z></Position></TiePoint>"
FISHEYE = (
    "<FisheyeFocalMatrix><M_00>60</M_00><M_01>0</M_01><M_10>0</M_10><M_11>60</M_11></FisheyeFocalMatrix>"
    "<FisheyeDistortion><P0>0</P0><P1>1</P1><P3>-0.1</P3></FisheyeDistortion>"
)
WHOLE = (
    simple(system=ENU, points=POINTS, base="<BaseImagePath>photos</BaseImagePath>"),
    simple(kind="Fisheye", lens=FISHEYE, point="<xmm>1</xmm><ymm>1</ymm>",
           focal="<FocalLength>9</FocalLength><SensorSize>30</SensorSize>"),
)  # fmt: skip


@FUZZ
@given(data=st.data(), text=st.sampled_from(WHOLE))
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data, text):
    root = ElementTree.fromstring(text)
    for _ in range(data.draw(st.integers(1, 3))):
        element = data.draw(st.sampled_from(list(root.iter())))
        what = data.draw(st.sampled_from(["text", "tag", "empty", "twice"]))
        if what == "text":
            element.text = data.draw(HOSTILE_TEXT)
        elif what == "tag":
            element.tag = data.draw(st.sampled_from([e.tag for e in root.iter()]))
        elif what == "empty":
            element.clear()
        else:
            element.extend(list(element))
    outcome(write(tmp_path, ElementTree.tostring(root, encoding="unicode")))


@FUZZ
@given(share=st.floats(0, 1))
def test_a_file_cut_anywhere_ends_in_an_error(tmp_path, share):
    text = simple()
    assert outcome(write(tmp_path, text[: int(share * (len(text) - 20))])) is None


@FUZZ
@given(order=st.permutations(range(COUNT)))
def test_the_order_of_photos_does_not_matter(tmp_path, order):
    cameras = [photo(i, poses()[i]) for i in order]
    for item in read_capture(write(tmp_path, document([group(cameras)]))).cameras:
        expected = poses()[int(item.name[-4:])]
        np.testing.assert_allclose(item.position, expected[:3, 3])
        np.testing.assert_allclose(item.view_direction, expected[:3, 2])


def test_deep_and_huge_files_end_quickly(tmp_path):
    deep = "<Block>" + "<a>" * 50_000 + "</a>" * 50_000 + "</Block>"
    assert outcome(write(tmp_path, f"<BlocksExchange>{deep}</BlocksExchange>")) is None
    deep = "<Block>" * 50_000 + "</Block>" * 50_000
    assert outcome(write(tmp_path, f"<BlocksExchange>{deep}</BlocksExchange>")) is None
    many = document([group([photo(0, np.eye(4), "gone.png")] * 3_000)])
    assert outcome(write(tmp_path, many)) is None
    assert outcome(write(tmp_path, simple(points=POINTS * 60_000))) is not None


def test_files_that_define_entities_are_refused(tmp_path):
    bomb = '<!DOCTYPE d [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
    text = simple().replace("<BlocksExchange", bomb + "<BlocksExchange", 1)
    with pytest.raises(CaptureError, match="DOCTYPE"):
        read_capture(write(tmp_path, text))
