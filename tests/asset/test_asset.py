"""Surface, unwrap, bake and files on analytic fields."""

import json
import struct

import numpy as np
import pytest
import skimage.measure
import trimesh

from solver.asset.bake import fill_texture, gather
from solver.asset.build import build_asset
from solver.asset.errors import EmptySurfaceError
from solver.asset.files import write_exr, write_fine_png
from solver.asset.settings import AssetSettings
from solver.asset.surface import (
    cut_unseen,
    decimate,
    drop_floaters,
    extract_surface,
    marching_cubes,
    smooth,
)
from solver.asset.tangent import encode_normals, texel_frames
from solver.asset.unwrap import UnwrappedMesh, rasterise, unwrap
from solver.capture.decoding import decode
from solver.capture.photos import read_exr, srgb_to_linear

LEVEL = 30.0
SETTINGS = AssetSettings(cells=64, triangles=4000, texture_size=256)


def decode_normals(colours: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """World normals [T, 3] of tangent-space colours [T, 3]: what a renderer does."""
    world = np.einsum("ti,tij->tj", colours * 2 - 1, frames)
    return world / np.maximum(np.linalg.norm(world, axis=1, keepdims=True), 1e-12)


class Balls:
    """Balls with a soft shell: extinction falls by e^-1 per 0.02 outside, saturates inside."""

    def __init__(self, *balls):
        self.balls = balls
        self.edge, self.voxel = 2.0, 2 / 64
        self.surrounded = False

    def _distance(self, points):
        return np.min([np.linalg.norm(points - c, axis=1) - r for c, r in self.balls], axis=0)

    def density(self, points):
        return np.minimum(LEVEL * np.exp(-self._distance(points) / 0.02), 500).astype(np.float32)

    def raw_density(self, count):
        ticks = np.linspace(-1, 1, count)
        points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
        with np.errstate(divide="ignore"):
            return np.log(self.density(points)).reshape(count, count, count)

    def from_box(self, box_points):
        return 2 * box_points - 1

    def raw_level(self, extinction):
        return float(np.log(extinction))

    def normals(self, points):
        centre = np.array(self.balls[0][0])
        offset = points - centre
        return offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-9)

    def seen(self, points, normals):
        return np.ones(len(points), dtype=bool)

    def known(self, points, normals):
        return np.ones(len(points), dtype=bool)

    def materials(self, points):
        albedo = 0.5 + 0.4 * np.sin(3 * points)
        alpha = 0.2 + 0.1 * points[:, 0]
        f0 = np.repeat(0.04 + 0.03 * points[:, 1:2], 3, axis=1)
        return albedo.astype(np.float32), alpha.astype(np.float32), f0.astype(np.float32)


ONE = Balls(((0.05, -0.1, 0.0), 0.6))


def test_marching_cubes_finds_a_ball_of_the_right_radius_facing_outward():
    mesh = marching_cubes(ONE, 64, LEVEL)
    radius = np.linalg.norm(mesh.vertices - (0.05, -0.1, 0.0), axis=1)
    # A tenth of a cell: interpolating the logarithm places the surface exactly.
    assert np.abs(radius - 0.6).max() < 0.1 * 2 / 64
    assert mesh.is_watertight
    outward = (mesh.face_normals * (mesh.triangles_center - (0.05, -0.1, 0.0))).sum(1)
    assert (outward > 0).all()


def test_a_surface_cut_by_the_region_is_closed():
    assert marching_cubes(Balls(((1.0, 0, 0), 0.5)), 32, LEVEL).is_watertight


def test_an_empty_field_is_an_error_with_a_way_out():
    with pytest.raises(EmptySurfaceError, match="masks"):
        marching_cubes(Balls(((9, 9, 9), 0.1)), 16, LEVEL)


def test_small_parts_stay_unless_they_may_be_shreds_of_a_room():
    field = Balls(((0, 0, 0), 0.5), ((0.8, 0.8, 0.8), 0.08))
    for surrounded, parts in ((False, 2), (True, 1)):
        field.surrounded = surrounded
        mesh = extract_surface(field, LEVEL, SETTINGS)
        assert len(mesh.split(only_watertight=False)) == parts


def test_floaters_go_and_separate_bodies_stay():
    field = Balls(((-0.5, 0, 0), 0.35), ((0.5, 0, 0), 0.3), ((0, 0.9, 0), 0.02))
    mesh = marching_cubes(field, 96, LEVEL)
    assert len(mesh.split()) == 3
    assert len(drop_floaters(mesh, 0.01).split()) == 2


def test_a_small_part_that_photos_show_stays_but_no_dust():
    """A fixed bug: what thin things leave behind, a wire or a piece of a handle, was dropped."""
    field = Balls(((-0.3, 0, 0), 0.5), ((0.6, 0.3, 0), 0.04), ((0.6, -0.3, 0), 0.04), ((0, 0.9, 0), 0.014))
    mesh = marching_cubes(field, 128, LEVEL)
    assert len(mesh.split()) == 4
    kept = drop_floaters(mesh, 0.01, lambda points, normals: points[:, 1] > 0)
    centres = sorted(tuple(part.centroid.round(1)) for part in kept.split())
    assert centres == [(-0.3, 0.0, 0.0), (0.6, 0.3, 0.0)]


def test_inner_walls_go():
    outer, inner = trimesh.creation.icosphere(radius=1), trimesh.creation.icosphere(radius=0.5)
    inner.invert()
    kept = drop_floaters(trimesh.util.concatenate([outer, inner]), 0.01)
    assert len(kept.split()) == 1 and np.isclose(kept.volume, outer.volume)


def test_a_side_that_no_photo_shows_is_cut_off_and_small_holes_in_what_they_show_are_closed():
    class Wall(Balls):
        """Photos show what is before x = 0.2, except for a small patch around -y."""

        surrounded = True

        def seen(self, points, normals):
            return (points[:, 0] < 0.2) & (normals[:, 1] > -0.97)

    field = Wall(((0.0, 0, 0), 0.6))
    whole = marching_cubes(field, 64, LEVEL)
    cut = cut_unseen(whole.copy(), field, 0.02)
    # A sphere's zones have areas as their heights.
    assert np.isclose(cut.area / whole.area, 0.8 / 1.2, rtol=0.05)
    assert cut.vertices[:, 0].max() < 0.25
    assert cut.vertices[:, 1].min() < -0.59
    boundary = trimesh.grouping.group_rows(cut.edges_sorted, require_count=1)
    assert (cut.vertices[cut.edges[boundary].ravel(), 0] > 0.15).all()


def test_with_masks_the_side_that_no_photo_shows_closes_the_mesh():
    field = Balls(((0.0, 0, 0), 0.6))
    field.seen = lambda points, normals: points[:, 0] < 0.2
    for surrounded, closed in ((False, True), (True, False)):
        field.surrounded = surrounded
        assert extract_surface(field, LEVEL, SETTINGS).is_watertight == closed


def off_radius(mesh):
    """Mean angle, °, between a ball's faces and its radius."""
    outward = mesh.triangles_center / np.linalg.norm(mesh.triangles_center, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip((mesh.face_normals * outward).sum(1), -1, 1))).mean()


def rough_ball(waves):
    """Of radius 1, with random heights of a tenth of an edge or, where `waves`, with broad poles."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    height = 0.1 * ball.vertices[:, 2] ** 2
    if not waves:
        height = 0.1 * ball.edges_unique_length.mean() * np.random.default_rng(0).normal(size=len(height))
    return trimesh.Trimesh(ball.vertices * (1 + height)[:, None], ball.faces, process=False)


def test_smoothing_takes_ripples_away_and_nothing_of_size_or_shape():
    ball = rough_ball(waves=False)
    volume, before = ball.volume, off_radius(ball)
    assert off_radius(smooth(ball, 5)) < 0.4 * before
    assert ball.volume == pytest.approx(volume, rel=3e-3)
    shape = smooth(rough_ball(waves=True), 5).vertices
    radius = np.linalg.norm(shape, axis=1)
    np.testing.assert_allclose(radius, 1 + 0.1 * (shape[:, 2] / radius) ** 2, atol=1e-3)


def test_smoothing_depends_neither_on_the_place_nor_on_how_faces_are_wound():
    """Fixed bugs: an edge of four faces went towards the world's origin, and a border along itself."""
    boxes = [trimesh.creation.box() for _ in range(2)]
    boxes[1].apply_translation((1, 1, 0))
    touching = trimesh.util.concatenate(boxes)
    touching.merge_vertices()
    assert len(touching.vertices) == 14, "else they share no edge"
    away = touching.copy()
    away.apply_translation((100, 0, 0))
    away.vertices = [*away.vertices, (100, 0, 0)]  # of no face, as marching cubes leave some
    moved = smooth(away, 5).vertices[:-1] - (100, 0, 0)
    np.testing.assert_allclose(moved, smooth(touching, 5).vertices, atol=1e-9)

    cut = rough_ball(waves=False)
    cut.update_faces(cut.triangles_center[:, 2] > 0)
    cut.remove_unreferenced_vertices()
    other = cut.copy()
    other.invert()
    np.testing.assert_allclose(smooth(other, 5).vertices, smooth(cut, 5).vertices, atol=1e-9)


def test_a_thin_rod_is_as_thick_after_smoothing():
    rod = trimesh.creation.cylinder(radius=0.02, height=1, sections=8)
    rod = rod.subdivide_to_size(0.02)
    assert smooth(rod.copy(), 5).volume == pytest.approx(rod.volume, rel=0.1)


def test_the_extracted_surface_is_smoothed_unless_a_setting_says_no():
    field = Balls(((0.0, 0, 0), 0.6))
    field.raw_density = lambda count: (
        Balls.raw_density(field, count) + 0.2 * np.random.default_rng(0).normal(size=(count,) * 3)
    )
    rough, even = (
        extract_surface(field, LEVEL, AssetSettings(cells=64, smoothing=rounds)) for rounds in (0, 5)
    )
    assert off_radius(even) < 0.6 * off_radius(rough)


def test_decimation_reaches_its_target_and_keeps_the_shape():
    mesh = extract_surface(ONE, LEVEL, AssetSettings(cells=64, triangles=2000))
    assert 1500 <= len(mesh.faces) <= 2000
    assert np.isclose(mesh.volume, 4 / 3 * np.pi * 0.6**3, rtol=0.02)


def test_decimation_leaves_no_triangles_on_the_same_corners():
    """A fixed bug: Blender took meshes of results for damaged."""
    ticks = np.linspace(-1, 1, 32)
    x, y, z = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    bumps = np.sin(13 * x) * np.sin(17 * y) * np.sin(19 * z)
    values = 0.6 - np.sqrt(x**2 + y**2 + z**2) + 0.3 * bumps
    vertices, faces, _, _ = skimage.measure.marching_cubes(values, 0)
    rough = trimesh.Trimesh(vertices, faces)
    mesh = decimate(rough, 300)
    assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces) > 250
    assert mesh.volume == pytest.approx(rough.volume, rel=0.1)


@pytest.fixture(scope="module")
def unwrapped():
    mesh = extract_surface(ONE, LEVEL, SETTINGS)
    samples = gather(ONE, np.float32(mesh.vertices), np.float32(mesh.vertex_normals), SETTINGS)
    return unwrap(mesh, samples.normals, SETTINGS.texture_size)


def test_texels_lie_on_the_surface_and_cover_every_chart(unwrapped):
    texels = rasterise(unwrapped, 256)
    points = texels.interpolate(unwrapped, unwrapped.positions)
    assert np.abs(np.linalg.norm(points - (0.05, -0.1, 0), axis=1) - 0.6).max() < 0.01
    uv = texels.interpolate(unwrapped, unwrapped.uvs)
    expected = np.stack([(texels.column + 0.5) / 256, 1 - (texels.row + 0.5) / 256], 1)
    np.testing.assert_allclose(uv, expected, atol=1e-4)
    corners = unwrapped.uvs[unwrapped.faces].astype(float)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 * 256**2
    assert np.isclose(len(texels.row), area, rtol=0.05)


@pytest.mark.parametrize("size", [1e-4, 0.02, 50.0])
def test_an_object_of_any_size_has_all_its_surface_on_the_texture(size):
    """A fixed bug: a cup in metres had a sixth of its texels, and what is smaller no UVs at all."""
    mesh = trimesh.creation.icosphere(5)
    mesh.apply_transform(trimesh.transformations.scale_matrix(size / 2))
    mesh.apply_translation((3 * size, 0, 0))
    found = unwrap(mesh, mesh.vertex_normals, 256)
    assert np.isfinite(found.uvs).all()
    corners = found.uvs[found.faces].astype(float)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert (area > 0).all() and area.sum() > 0.35
    np.testing.assert_allclose(np.ptp(found.positions, axis=0), size, rtol=0.01)


def test_normal_map_decodes_to_the_normals_that_were_baked(unwrapped):
    texels = rasterise(unwrapped, 256)
    frames = texel_frames(unwrapped, texels)
    points = texels.interpolate(unwrapped, unwrapped.positions)
    normals = ONE.normals(points + (0.02, 0, 0))
    codes = np.round(encode_normals(normals, frames) * 255) / 255
    cosine = (decode_normals(codes, frames) * normals).sum(1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 1.0


@pytest.mark.parametrize("mirrored", [False, True])
def test_frames_follow_the_uv_map_also_where_it_is_mirrored(mirrored):
    """Tangent along u, bitangent along v, as renderers have it; of a square in the plane of x and y."""
    corners = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    uvs = corners[:, :2] * 0.8 + 0.1
    if mirrored:
        uvs[:, 0] = 1 - uvs[:, 0]
    square = UnwrappedMesh(
        corners,
        np.tile(np.float32([0, 0, 1]), (4, 1)),
        uvs,
        np.int32([[0, 1, 2], [0, 2, 3]]),
        np.arange(4),
    )
    frames = texel_frames(square, rasterise(square, 32))
    along_u = -1.0 if mirrored else 1.0
    expected = np.float64([[along_u, 0, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_allclose(frames, np.broadcast_to(expected, frames.shape), atol=1e-6)
    tilted = np.tile([0.6, 0.0, 0.8], (len(frames), 1))
    np.testing.assert_allclose(
        encode_normals(tilted, frames)[0], [0.5 + 0.3 * along_u, 0.5, 0.9], atol=1e-6
    )


def test_a_thin_body_has_the_colour_of_its_field_though_it_lets_most_light_through():
    class Mist(Balls):
        def density(self, points):
            return np.full(len(points), 0.5, np.float32)

        def materials(self, points):
            grey = np.full((len(points), 3), 0.4, np.float32)
            return grey, np.full(len(points), 0.3, np.float32), 0.1 * grey

    points = np.float32([[0.6, 0, 0], [0, 0.6, 0]])
    found = gather(Mist(((0.0, 0.0, 0.0), 0.6)), points, points / np.float32(0.6), SETTINGS)
    np.testing.assert_allclose(found.albedo, 0.4, rtol=1e-5)
    np.testing.assert_allclose(found.alpha, 0.3, rtol=1e-5)
    np.testing.assert_allclose(found.f0, 0.04, rtol=1e-5)


def test_dilation_copies_the_nearest_covered_texel():
    row, column = np.array([2, 2]), np.array([2, 6])
    texture = fill_texture(8, row, column, np.array([[1.0], [5.0]]))
    assert texture[2, 0] == 1 and texture[7, 7] == 5 and texture[2, 2] == 1


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("asset é x") / "result"
    light = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32) * 5
    silent = lambda fraction, text: None  # noqa: E731
    parts = build_asset(ONE, light, LEVEL, folder, SETTINGS, silent, "tea pot", np.eye(4))
    return folder, parts, light


def lookup(path, uv):
    from PIL import Image

    pixels = np.asarray(Image.open(path)).astype(np.float64) / 255
    column, row = (uv[:, 0] * 256).astype(int), ((1 - uv[:, 1]) * 256).astype(int)
    return pixels[row.clip(0, 255), column.clip(0, 255)]


def test_baked_textures_hold_the_materials_of_the_field(built, unwrapped):
    folder, parts, _ = built
    albedo, alpha, f0 = ONE.materials(unwrapped.positions.astype(np.float64))
    baked = srgb_to_linear(lookup(folder / "albedo.png", unwrapped.uvs))
    assert np.abs(baked - albedo).mean() < 0.02
    roughness = lookup(folder / "roughness.png", unwrapped.uvs)
    assert np.abs(roughness - np.sqrt(alpha)).mean() < 0.01
    scale = parts["textures"]["f0"]["scale"]
    baked_f0 = scale * srgb_to_linear(lookup(folder / "f0.png", unwrapped.uvs))
    assert np.abs(baked_f0 - f0).mean() < 0.005


def test_baked_normals_are_fine_enough_for_a_mirror(built, unwrapped):
    """In 8 bits they would be a quarter of a degree off: steps that a mirror shows."""
    texels = rasterise(unwrapped, 256)
    coded = decode(built[0] / "normal.png").pixels[texels.row, texels.column].astype(float) / 65535
    frames = texel_frames(unwrapped, texels)
    points = texels.interpolate(unwrapped, unwrapped.positions)
    cosine = (decode_normals(coded, frames) * ONE.normals(points)).sum(1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.05


def test_a_texture_that_cannot_be_written_is_an_error_that_names_it(tmp_path):
    with pytest.raises(OSError, match="normal.png"):
        write_fine_png(tmp_path / "missing" / "normal.png", np.zeros((4, 4, 3)))


def test_environment_exr_round_trips(built):
    folder, _, light = built
    rgb, alpha = read_exr(folder / "environment.exr")
    np.testing.assert_array_equal(rgb, light)
    assert alpha is None


def test_mesh_ply_can_be_read_by_others(built):
    folder, parts, _ = built
    mesh = trimesh.load(folder / "mesh.ply", process=False)
    assert len(mesh.faces) == parts["triangles"]
    assert np.isclose(mesh.volume, 4 / 3 * np.pi * 0.6**3, rtol=0.02)


def read_glb(path):
    """The JSON and the binary part of a .glb."""
    data = path.read_bytes()
    size = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def attributes_of(path):
    """Arrays of a .glb's only primitive by their names, and `indices` [F, 3]."""
    document, binary = read_glb(path)
    primitive = document["meshes"][0]["primitives"][0]
    arrays = {}
    for name, number in (*primitive["attributes"].items(), ("indices", primitive["indices"])):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        arrays[name] = np.frombuffer(part, kind).reshape(accessor["count"], -1)
    return arrays | {"indices": arrays["indices"].reshape(-1, 3)}


def test_two_assets_in_one_scene_have_names_of_their_own(built):
    document, _ = read_glb(built[0] / "asset.glb")
    named = [document[kind][0]["name"] for kind in ("nodes", "meshes", "materials")]
    assert named == ["tea pot"] * 3
    images = [image["name"] for image in document["images"]]
    assert images == [f"tea pot_{kind}" for kind in ("base_colour", "metallic_roughness", "normal", "f0")]


def test_glb_has_the_tangents_its_normal_map_was_made_for(built):
    """Along +u, and by the sign's cross product towards the picture's top, which is −v in glTF."""
    arrays = attributes_of(built[0] / "asset.glb")
    normals, tangents = arrays["NORMAL"].astype(float), arrays["TANGENT"].astype(float)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-5)
    assert set(np.unique(tangents[:, 3])) <= {-1.0, 1.0}
    p, uv = (arrays[name][arrays["indices"]].astype(float) for name in ("POSITION", "TEXCOORD_0"))
    edges = np.stack([p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]], 1)
    steps = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], 1)
    fine = np.abs(np.linalg.det(steps)) > 1e-9
    along = np.linalg.solve(steps[fine], edges[fine])  # rows ∂p/∂u, ∂p/∂v
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    corner = arrays["indices"][fine, 0]
    right = tangents[corner, :3]
    up = np.cross(normals[corner], right) * tangents[corner, 3:]
    assert (right * along[:, 0]).sum(1).min() > 0.5 and (up * along[:, 1]).sum(1).max() < -0.5


def test_both_sides_are_drawn_where_a_mesh_is_open_and_no_texture_repeats(built, tmp_path):
    class Bowl(Balls):
        def seen(self, points, normals):
            return points[:, 0] < 0.2

    bowl = Bowl(*ONE.balls)
    bowl.surrounded = True
    few = AssetSettings(cells=32, triangles=500, texture_size=64)
    silent = lambda fraction, text: None  # noqa: E731
    build_asset(bowl, built[2], LEVEL, tmp_path, few, silent, "bowl", np.eye(4))
    for path, double_sided in ((tmp_path, True), (built[0], False)):
        document, _ = read_glb(path / "asset.glb")
        assert document["materials"][0]["doubleSided"] is double_sided
        assert document["samplers"] == [{"wrapS": 33071, "wrapT": 33071}]


def test_glb_is_valid_and_keeps_f0(built):
    folder, parts, _ = built
    data = (folder / "asset.glb").read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    document, binary = read_glb(folder / "asset.glb")
    specular = document["materials"][0]["extensions"]["KHR_materials_specular"]
    factor = parts["textures"]["f0"]["scale"] / 0.04
    assert specular["specularColorFactor"] == pytest.approx([factor] * 3)
    assert document["buffers"][0]["byteLength"] == len(binary)
    scene = trimesh.load(folder / "asset.glb")
    low, high = scene.bounds  # Y up
    np.testing.assert_allclose(low, (-0.55, -0.6, -0.5), atol=0.02)
    np.testing.assert_allclose(high, (0.65, 0.6, 0.7), atol=0.02)


def test_exr_names_its_channels(tmp_path):
    write_exr(tmp_path / "x.exr", {"alpha": np.ones((2, 3)), "roughness": np.zeros((2, 3))})
    import OpenEXR

    names = set(OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True).channels())
    assert names == {"alpha", "roughness"}
