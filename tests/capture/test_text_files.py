"""Text, numbers and XML as people's programs save them: code pages, UTF-16, decimal commas."""

import pytest

from solver.capture.errors import CaptureError
from solver.capture.fields import numbers
from solver.capture.files import read_text, read_xml


def test_text_in_a_code_page_keeps_its_bytes_and_binary_files_are_no_text(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes("Grüße 1.JPG,2\r\n".encode("cp1252"))
    assert read_text(file).encode("utf-8", "surrogateescape") == file.read_bytes()
    for content in (b"\x89PNG\r\n\x1a\n\x07", b"a\0b", b"\xff\xfea", bytes(range(1, 200))):
        file.write_bytes(content)
        with pytest.raises(CaptureError, match="not a text file"):
            read_text(file)


@pytest.mark.parametrize("text", ["0,5 1,5", "-0,5 2 1e-3", "0,5\n1,25"])
def test_decimal_commas_are_named_rather_than_taken_for_blanks(tmp_path, text):
    with pytest.raises(CaptureError, match="has decimal commas; export it with decimal points"):
        numbers(tmp_path / "a.xml", "transform", text)


def test_commas_between_numbers_are_blanks(tmp_path):
    for text in ("1,2", "1, 2", "1 2", "1 ,2"):
        assert numbers(tmp_path / "a.xml", "size", text, 2).tolist() == [1, 2]


def test_xml_in_utf_16_is_read_and_may_define_no_entities_either(tmp_path):
    file = tmp_path / "a.xml"
    start = '<?xml version="1.0" encoding="UTF-16"?>'
    file.write_bytes((start + '<a b="ü"/>').encode("utf-16"))
    assert read_xml(file).get("b") == "ü"
    file.write_bytes((start + '<!DOCTYPE a [<!ENTITY c "d">]><a>&c;</a>').encode("utf-16"))
    with pytest.raises(CaptureError, match="DOCTYPE"):
        read_xml(file)
