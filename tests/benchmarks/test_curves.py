"""Quality over time: a run that is cut off goes on, earlier releases stand beside, no scene's origin is lost."""

import json
import sys

import pytest

from benchmarks import curves as benchmark
from benchmarks.curves import comparison, main, page, read_curves
from tests.cli.command import DUCK


def rows(*marks):
    return [
        {"step": 10 * i, "cpu": cpu, "wall": cpu, "psnr": psnr, "normal_mae": angle}
        for i, (cpu, psnr, angle) in enumerate(marks, 1)
    ]


def run(monkeypatch, out, *options, measured=None):
    """Run the benchmark on scenes a and b; where `measured` is given, each only says so."""

    def one(scene, *_):
        measured.append(scene.name)
        if measured == ["a", "b"]:
            raise KeyboardInterrupt
        return rows((1.0, 20.0, 9.0))

    if measured is not None:
        monkeypatch.setattr(benchmark, "curve", one)
    monkeypatch.setattr(benchmark, "commit", lambda: "abc")
    monkeypatch.setattr(benchmark, "describe_machine", lambda: "abacus, commit abc")
    scenes = () if "--scenes" in options else ("--scenes", "a", "b")
    monkeypatch.setattr(sys, "argv", ["curves", *scenes, "--out", str(out), *options])
    main()


def test_a_run_that_was_cut_off_keeps_what_was_measured_and_goes_on(tmp_path, monkeypatch):
    measured, out = [], tmp_path / "curves"
    with pytest.raises(KeyboardInterrupt):
        run(monkeypatch, out, measured=measured)
    assert list(read_curves(tmp_path / "curves.json")[0]) == ["a"]
    assert "| a | 10 | 1.0 | 1.0 | 20.00 | 9.00 |" in (tmp_path / "curves.md").read_text()
    run(monkeypatch, out, measured=measured)
    assert measured == ["a", "b", "b"]
    assert list(read_curves(tmp_path / "curves.json")[0]) == ["a", "b"]
    run(monkeypatch, out, "--set", "fit.rays=512", measured=measured)
    assert measured[3:] == ["a", "b"]
    assert "`draft` `--set fit.rays=512`, the first" in (tmp_path / "curves.md").read_text()


def test_each_scene_says_how_it_was_measured():
    there = {"about": "On an abacus.", "rows": rows((1, 20, 9))}
    text = page({"a": there, "b": there}, {}, "x.png")
    assert text.count("On an abacus.") == 1 and "a, b" not in text and "Before" not in text
    elsewhere = {"about": "On a slide rule.", "rows": rows((1, 20, 9))}
    text = page({"a": there, "b": elsewhere, "c": there}, {}, "x.png")
    assert "a, c: On an abacus." in text and "b: On a slide rule." in text


def test_what_it_takes_now_to_get_as_far_as_before():
    before = {"a": {"about": "", "rows": rows((10, 25, 9), (20, 30, 8), (40, 29.9, 7))}}
    now = {"a": {"about": "", "rows": rows((4, 29, 7), (5, 30, 6), (9, 33, 5))}}
    assert comparison(now, before)[2:] == ["| a | 30.00 | 20.0 | 5.0 | 4.0 | 7.00 | 40.0 | 4.0 | 10.0 |"]
    # What is worse now has no time at which it is as good.
    assert comparison(before, now)[2:] == ["| a | 33.00 | 9.0 | – | – | 5.00 | 9.0 | – | – |"]
    assert comparison(now, {"b": before["a"]})[2:] == []


def test_an_earlier_release_stays_beside_whose_file_had_one_origin_for_all(tmp_path, monkeypatch):
    earlier = {"about": "Release 0.0.", "curves": {"a": rows((5.0, 20.0, 9.0), (9.0, 19.0, 10.0))}}
    (tmp_path / "earlier.json").write_text(json.dumps(earlier))
    measured, out = ["a", "b", "b"], tmp_path / "curves"
    run(monkeypatch, out, "--before", str(tmp_path / "earlier.json"), measured=measured)
    run(monkeypatch, out, measured=measured)
    text = (tmp_path / "curves.md").read_text()
    assert "Before: Release 0.0." in text
    assert "| a | 20.00 | 5.0 | 1.0 | 5.0 | 9.00 | 5.0 | 1.0 | 5.0 |" in text
    assert (tmp_path / "images" / "curves.png").is_file()


def test_a_curve_of_the_sample(tmp_path, monkeypatch):
    small = ["fit.rays=128", "field.sizes=24,32", "field.size_starts=0,0.5", "light.heights=16,32"]
    small += ["field.hull_cells=48", "field.occupancy_cells=32", "fit.steps=80"]
    options = [word for text in small for word in ("--set", text)]
    monkeypatch.setattr(benchmark, "VIEWS", 1)
    monkeypatch.setattr(benchmark, "RAYS", 2)
    out = tmp_path / "curves"
    run(monkeypatch, out, "--scenes", str(DUCK), "--until", "0.6", *options)
    (curve,) = read_curves(tmp_path / "curves.json")[0].values()
    assert [row["step"] for row in curve["rows"]] == [40, 48]
    assert all(row["cpu"] > 0 and row["psnr"] > 15 for row in curve["rows"])
