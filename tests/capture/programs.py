"""What the tests of camera files share: cameras, photos, points, and hostile values."""

import time

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.read import read_capture

WIDTH, HEIGHT, COUNT = 96, 64, 5


def names(count=COUNT):
    return [f"IMG_{i:04d}" for i in range(count)]


def numbers(values):
    """As text files have them, with all digits."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


def save_photos(folder, stems=None, size=(WIDTH, HEIGHT), extension=".png"):
    folder.mkdir(parents=True, exist_ok=True)
    for stem in names() if stems is None else stems:
        file = folder / f"{stem}{extension}"
        if not file.exists():
            Image.new("RGB", size, "gray").save(file)
    return folder


def rotation(generator):
    q, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def poses(count=COUNT, seed=0):
    """Camera to world [count, 4, 4] with OpenCV's axes: any rotations, places around the origin."""
    generator = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for matrix in matrices:
        matrix[:3, :3] = rotation(generator)
        matrix[:3, 3] = generator.normal(size=3) * 3
    return matrices


def seen_points(pose, count=40, seed=1, spread=0.45):
    """World points [count, 3] before a camera [4, 4] with OpenCV's axes."""
    generator = np.random.default_rng(seed)
    local = np.ones((count, 3))
    local[:, :2] = generator.uniform(-spread, spread, (count, 2))
    local *= generator.uniform(0.5, 4, (count, 1))
    return local @ pose[:3, :3].T + pose[:3, 3]


def check_projection(capture, reference, expected_poses, spread=0.45):
    """`Camera.project` is the program's own projection, `reference(index, point) -> (u, v)`.

    Cameras are found by their photos, IMG_0000 …, in whatever order they come.
    """
    assert len(capture.cameras) == len(expected_poses)
    for camera in capture.cameras:
        index = int(camera.image_path.stem[-4:])
        points = seen_points(expected_poses[index], seed=index, spread=spread)
        pixels, depth = camera.project(points)
        assert (depth > 0).all()
        wanted = np.array([reference(index, point) for point in points])
        np.testing.assert_allclose(pixels, wanted, atol=1e-6, rtol=0)
        origins, directions = camera.rays(wanted[:, 0], wanted[:, 1])
        along = points - origins
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        np.testing.assert_allclose(directions, along, atol=1e-7)


def outcome(path, **options):
    """The capture, or None after an error in one short sentence; anything else fails the test."""
    start = time.monotonic()
    try:
        capture = read_capture(path, **options)
        assert len(capture.cameras) >= 3
        for camera in capture.cameras:
            assert np.isfinite(camera.camera_to_world).all() and camera.fx > 0
            assert camera.image_path.is_relative_to(path if path.is_dir() else path.parent)
    except CaptureError as error:
        capture = None
        assert str(error) and len(str(error).splitlines()) == 1 and len(str(error)) < 1000
        assert error.remedy
    assert time.monotonic() - start < 10
    return capture


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


HOSTILE = st.one_of(
    st.sampled_from(
        [None, "", "nan", "-inf", "1e400", 1e308, -1, 0, 10**400, True, [], {}, [1, 2], "x" * 5000,
         "../../etc/passwd", "/etc/passwd", "C:\\Windows\\win.ini", "a\0b", "\n\n", "🜁", nested(300),
         float("nan"), float("inf"), "1 2 3", {"a": {"b": []}}, "4294967295", -(1 << 63)]
    ),
    st.floats(), st.integers(), st.text(max_size=8),
    st.lists(st.floats() | st.text(max_size=3), max_size=16),
)  # fmt: skip
"""values to put in the place of others"""
HOSTILE_TEXT = st.sampled_from(
    ["", "nan", "-inf", "1e400", "1e308", "-1", "0", "true", "x" * 5000, "../../etc/passwd",
     "/etc/passwd", "C:\\Windows\\win.ini", "🜁", "1 2 3", "1 2 3 4 5 6 7 8 9", "0 " * 16, "9" * 400]
) | st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), max_size=8)  # fmt: skip


RANDOM_TESTS = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def spoilt(data, file, between):
    """Shuffle the words of a text file or make one hostile, and cut it off somewhere."""
    words = file.read_text().split()
    if data.draw(st.booleans()):
        words = data.draw(st.permutations(words))
    elif words:
        words[data.draw(st.integers(0, len(words) - 1))] = data.draw(HOSTILE_TEXT)
    text = between.join(words)
    file.write_text(text[: data.draw(st.integers(0, len(text)) | st.just(len(text)))], "utf-8")


def places(value, at=()):
    """Paths to all values inside parsed JSON, itself excluded."""
    found = []
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in inner:
        found.append((*at, key))
        if isinstance(item, (dict, list)):
            found += places(item, (*at, key))
    return found


def put(value, at, new):
    for key in at[:-1]:
        value = value[key]
    value[at[-1]] = new
