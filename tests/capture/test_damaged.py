"""Files of every format that are cut off, shuffled or hostile: a capture, or an error in one sentence."""

import copy
import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.formats.transforms import write_transforms
from solver.capture.image_header import EXTENSIONS
from solver.capture.read import FORMATS, read_capture, reader_of
from tests.capture.every_format import MAKERS
from tests.capture.programs import HOSTILE, HOSTILE_TEXT, RANDOM_TESTS, outcome, places, put

_WORD = re.compile(rb"[^\s,;<>\"=]+")


@pytest.fixture(scope="module", params=MAKERS)
def capture(request, tmp_path_factory, solved):
    """A capture's folder, and what is in its files that are no pictures."""
    folder = tmp_path_factory.mktemp("capture")
    MAKERS[request.param](folder, solved)
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return folder, {f: f.read_bytes() for f in files if f.suffix.lower() not in EXTENSIONS}


def test_every_format_is_tried_here(tmp_path, solved):
    tried = set()
    for number, make in enumerate(MAKERS.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        make(folder, solved)
        tried.add(reader_of(read_capture(folder).source))
    assert tried == set(FORMATS)


def test_cameras_of_every_format_are_written_and_read_again(capture, tmp_path):
    folder, _ = capture
    cameras = read_capture(folder).cameras
    write_transforms(tmp_path / "transforms.json", list(cameras))
    again = read_capture(tmp_path / "transforms.json", trusted=True).cameras
    assert [(c.width, c.height, c.lens) for c in again] == [(c.width, c.height, c.lens) for c in cameras]


def shuffled(data, content):
    """Lines, words or, in JSON, two values in each other's place."""
    parsed = json_of(content)
    if parsed is not None:
        one, other = (at_random(data, parsed) for _ in range(2))
        first, second = (copy.deepcopy(value_at(parsed, at)) for at in (one, other))
        put(parsed, one, second)
        try:
            put(parsed, other, first)
        except (KeyError, IndexError, TypeError):  # it lay within the first
            pass
        return json.dumps(parsed).encode()
    if data.draw(st.booleans()):
        lines = content.splitlines(True)
        return b"".join(data.draw(st.permutations(lines[:40])) + lines[40:])
    words = list(_WORD.finditer(content)) or [re.match(b"", content)]
    one, other = sorted(data.draw(st.tuples(*[st.integers(0, len(words) - 1)] * 2)))
    (a, b), (c, d) = words[one].span(), words[other].span()
    if one == other:
        return content
    return content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def hostile(data, content):
    """A value as no program writes it, or other bytes."""
    parsed = json_of(content)
    if parsed is not None:
        put(parsed, at_random(data, parsed), data.draw(HOSTILE))
        return json.dumps(parsed).encode("utf-8", "surrogatepass")
    words = list(_WORD.finditer(content))
    if words and data.draw(st.booleans()):
        start, end = words[data.draw(st.integers(0, len(words) - 1))].span()
        return content[:start] + data.draw(HOSTILE_TEXT).encode() + content[end:]
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6)) if content else 0):
        changed[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    return bytes(changed)


def cut(data, content):
    return content[: data.draw(st.integers(0, len(content)))]


def json_of(content):
    """What JSON with anything in it says; None for all else."""
    try:
        parsed = json.loads(content)
    except ValueError:
        return None
    return parsed if isinstance(parsed, (dict, list)) and parsed else None


def at_random(data, parsed):
    return data.draw(st.sampled_from(places(parsed)))


def value_at(parsed, at):
    for key in at:
        parsed = parsed[key]
    return parsed


@pytest.mark.parametrize("damage", [cut, shuffled, hostile])
@RANDOM_TESTS
@given(data=st.data())
def test_a_damaged_file_ends_in_a_capture_or_an_error_of_one_sentence(capture, damage, data):
    folder, files = capture
    file = data.draw(st.sampled_from(sorted(files)))
    file.write_bytes(damage(data, files[file]))
    try:
        outcome(folder)
    finally:
        file.write_bytes(files[file])
