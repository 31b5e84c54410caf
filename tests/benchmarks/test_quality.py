"""The benchmark: a row is measured once, the page says what the JSON holds."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.quality import SETTINGS, stage_seconds
from benchmarks.tables import METRICS, PAPER, ablation_table, quality_table, write_page
from tests.cli.command import ROOT, TINY


def row(scene="ball", setting="default", paper_scene=None, **mean):
    return {
        "scene": scene, "setting": setting, "preset": "draft", "seed": 0, "device": "cpu",
        "changes": [], "paper_scene": paper_scene, "machine": "abacus", "cores": 2, "threads": 2, "gpu": None,
        "system": "Linux", "seconds": 120.0, "cpu_seconds": 180.0, "peak_gigabytes": 1.25,
        "commit": "abc1234", "stages": {"fit": 90.0, "asset": 30.0}, "quality": {"mean": mean},
    }  # fmt: skip


def test_the_paper_numbers_are_those_of_its_tables():
    shiny = ["teapot", "toaster", "car", "ball", "coffee", "helmet"]
    mean = lambda key: sum(PAPER["default"][key][scene] for scene in shiny) / 6  # noqa: E731
    # Means of the paper's Table 1 (its MAE columns are swapped, see docs/method.md).
    assert mean("psnr") == pytest.approx(34.56, abs=0.01)
    assert mean("normal_mae") == pytest.approx(6.061, abs=0.01)
    assert set(PAPER) == set(SETTINGS) - {"with neural"}


def test_the_paper_stands_beside_its_own_scenes_only():
    assert "*paper*" not in quality_table([row(psnr=30.0)])
    table = quality_table([row(paper_scene="ball", psnr=30.0, normal_mae=1.0)])
    assert f"| *paper* | {PAPER['default']['psnr']['ball']:.2f} |" in table
    assert "| ball | default | 30.00 | 1.00 |" in table


def test_every_column_of_the_tables_is_defined():
    definitions = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    for title, key, *_ in METRICS:
        assert re.search(rf"^\| {re.escape(title)} \| `{key}`", definitions, re.MULTILINE), title


def test_differences_are_means_over_scenes_that_have_both():
    rows = [
        row("a", psnr=30.0), row("b", psnr=20.0), row("a", "no neural", psnr=29.0),
        row("b", "no neural", psnr=22.0), row("c", "no neural", psnr=50.0),
    ]  # fmt: skip
    line = next(x for x in ablation_table(rows).splitlines() if x.startswith("| no neural"))
    assert line.startswith("| no neural | 2 | +0.50 |")


def test_the_page_names_machine_seed_and_commit(tmp_path):
    write_page([row(psnr=30.0)], tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert "abacus" in text and "seed 0" in text and "abc1234" in text and "1.25" in text


def test_means_are_of_all_scenes_and_of_nothing_else():
    table = quality_table([row("a", psnr=30.0, ssim=0.9), row("b", psnr=20.0)])
    assert "| **mean of 2** | default | 25.00 | – |" in table
    assert "mean" not in quality_table([row("a", psnr=30.0)])


def test_means_of_albedo_are_of_the_scenes_that_are_not_all_metal(tmp_path):
    metal, mixed = row("ball", f0_mae=0.2), row("a", f0_mae=0.1, albedo_mae=0.04)
    table = quality_table([metal, mixed, row("b", f0_mae=0.3, albedo_mae=0.06)])
    assert "| **mean of 3** | default | 0.050 | 0.200 |" in table
    # Nothing is known of the materials of a capture without truth, so its mean would be of others.
    table = quality_table([row("real", roughness_mae=0.1), mixed])
    assert "| **mean of 2** | default | – | – | – |" in table
    write_page([metal, mixed], tmp_path / "page.md")
    assert "of the scenes that have one" in (tmp_path / "page.md").read_text()


def test_the_page_begins_with_what_holds_now_and_ends_with_means_and_ablations_of_what_was(
    tmp_path,
):
    before = {"preset": "draft 0.1, before light"}
    was = [row(psnr=29.0) | before, row("ball", "no neural", psnr=28.0) | before]
    write_page([*was, row(psnr=30.0), row("a", "no neural", psnr=31.0)], tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    glance = text.index("| `draft` | 1 | 30.00 |")
    assert glance < text.index("## Preset `draft`\n") < text.index("# Earlier")
    earlier = text[text.index("# Earlier") :]
    assert "| `draft 0.1, before light` | 1 | 29.00 |" in earlier
    assert "## Preset `draft 0.1, before light`: against its default" in earlier
    assert "| no neural | 1 | -1.00 |" in earlier and "abc1234" not in earlier


def test_stages_of_a_resumed_job_are_added_up(tmp_path):
    events = [
        ("hello", 0, ""), ("stage", 1, "fit"), ("stage", 11, "asset"),
        ("hello", 100, ""), ("stage", 101, "fit"), ("stage", 103, "asset"), ("bye", 108, ""),
    ]  # fmt: skip
    lines = [json.dumps({"ev": ev, "t": t, "name": name}) for ev, t, name in events]
    (tmp_path / "events.jsonl").write_text("\n".join(lines) + "\n")
    assert stage_seconds(tmp_path) == {"fit": 12, "asset": 5}


def test_rows_are_measured_once_and_the_run_can_be_taken_up_again(duck, tmp_path):
    scene = shutil.copytree(duck, tmp_path / "duck", ignore=shutil.ignore_patterns("*studio*"))
    cameras = json.loads((scene / "transforms_test.json").read_text())
    some = {**cameras, "frames": cameras["frames"][:2]}
    (scene / "transforms_test.json").write_text(json.dumps(some))

    def run(*settings):
        command = [sys.executable, "benchmarks/quality.py", "--scenes", str(scene), *TINY]
        command += ["--settings", *settings, "--work", str(tmp_path / "work")]
        command += ["--out", str(tmp_path / "page")]
        result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
        assert result.returncode == 0, result.stderr
        return result.stdout

    assert run("default").count("fitting") == 1
    output = run("default", "no neural")
    assert output.count("fitting") == 1 and "default: already there" in output
    rows = json.loads((tmp_path / "page.json").read_text())["rows"]
    assert [r["setting"] for r in rows] == ["default", "no neural"]
    assert all(r["seconds"] > 0 and r["peak_gigabytes"] > 0.1 and r["stages"]["fit"] for r in rows)
    text = Path(tmp_path / "page.md").read_text()
    assert re.search(r"\| duck \| no neural \| \d+\.\d\d \|", text)
    assert str(tmp_path) not in text + json.dumps(rows)
