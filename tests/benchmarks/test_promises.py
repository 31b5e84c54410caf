"""The benchmark of limits and times left: what it reads from a job's events, and what its page says."""

import json

import pytest

from benchmarks.promises import errors_of_time_left, last_step, measure, page
from tests.cli.command import TINY


def write_events(folder, told):
    """A fit from 100 s to 200 s whose fractions are (seconds since, left as told, fraction)."""
    events = [{"ev": "hello", "t": 90.0}, {"ev": "stage", "t": 100.0, "name": "fit"}]
    events += [
        {"ev": "progress", "t": 100.0 + since, "stage": "fit", "step": int(since), "fraction": fraction,
         "seconds_left": left}
        for since, left, fraction in told
    ]  # fmt: skip
    events += [{"ev": "stage", "t": 200.0, "name": "asset"}]
    events += [{"ev": "progress", "t": 201.0, "step": 0, "fraction": 0.5, "seconds_left": 7.0}]
    (folder / "events.jsonl").write_text("\n".join(map(json.dumps, events)) + "\n")


def test_times_left_are_held_against_when_the_fit_was_over(tmp_path):
    told = [(5, 500.0, 0.05), (12, None, 0.12), (20, 88.0, 0.3), (50, 40.0, 0.5), (99, 60.0, 0.95)]
    write_events(tmp_path, told)
    assert errors_of_time_left(tmp_path) == pytest.approx([0.1, -0.2])
    assert last_step(tmp_path) == 99


def test_the_page_says_how_much_of_a_limit_was_taken_and_how_far_off_times_were():
    rows = [
        {"scene": "a", "limit": None, "seconds": 80.2, "steps": 400, "errors": [0.1, -0.2, 0.0]},
        {"scene": "a", "limit": 60.0, "seconds": 57.0, "steps": 321, "errors": []},
    ]
    text = page(rows, "About.")
    assert "between 10 % and 90 % of the fit" in text
    assert "| a | – | 80 | – | 400 | -3 % | -20 % |" in text
    assert "| a | 60 | 57 | 95 % | 321 | – | – |" in text


def test_a_job_with_a_limit_is_measured(duck, tmp_path):
    changes = [*TINY[1::2], "fit.steps=100000"]
    row = measure(duck, tmp_path / "job", "draft", 30.0, changes)
    assert row["steps"] > 1 and row["seconds"] > 5 and row["limit"] == 30.0
    assert all(error > -1 for error in row["errors"])
