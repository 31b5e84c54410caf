"""Whether jobs keep their time limit, and how right the time left was that they told; docs/promises.md.

    python benchmarks/promises.py --scenes scenes/suzanne [--limits 60 120] [--steps 400]

Every scene is reconstructed without a limit, with fewer steps if `--steps` says so, and once a limit.
Seconds are those of the whole process. What was told of the time left is held against how long the fit then
took, after its first tenth and before its last. Other work on the machine counts as if it were the job's.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.machine import describe_machine  # noqa: E402
from solver.job.events import read_events  # noqa: E402

JUDGED = (0.1, 0.9)  # of a fit: before, little is known, and then little is left


def measure(scene: Path, job: Path, preset: str, limit: float | None, changes: list[str]) -> dict:
    """Seconds of a reconstruction, its fit's steps, and how far off its times left were."""
    command = [sys.executable, "-m", "solver", "reconstruct", str(scene), "--out", str(job)]
    command += ["--preset", preset]
    command += [word for text in changes for word in ("--set", text)]
    command += ["--time-limit", str(limit)] if limit is not None else []
    began = time.monotonic()
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return {
        "scene": scene.name, "limit": limit, "seconds": time.monotonic() - began,
        "steps": last_step(job), "errors": errors_of_time_left(job),
    }  # fmt: skip


def last_step(job: Path) -> int:
    """Steps of a job's fit that were told."""
    steps = [e.data["step"] for e in _events(job) if e.kind == "progress"]
    return max(steps, default=0)


def errors_of_time_left(job: Path) -> list[float]:
    """How much too long (above 0) or short each time left of a fit was, as a share of the true one."""
    events = _events(job)
    begun = next(i for i, e in enumerate(events) if _is_stage(e) and e.data["name"] == "fit")
    end = next(i for i in range(begun + 1, len(events)) if _is_stage(events[i]))
    first, last = JUDGED
    return [
        event.data["seconds_left"] / (events[end].time - event.time) - 1
        for event in events[begun:end]
        if event.kind == "progress"
        and first <= event.data["fraction"] <= last
        and event.data["seconds_left"] is not None
    ]


def _events(job: Path) -> list:
    return read_events(job / "events.jsonl")


def _is_stage(event) -> bool:
    return event.kind == "stage"


def page(rows: list[dict], about: str) -> str:
    """All runs as a Markdown page."""
    lines = [
        "# Benchmarks: promises", "", "Written by `benchmarks/promises.py`; do not edit.", about,
        f"Time left: told minus true, as a share of the true one, between {JUDGED[0]:.0%} and "
        f"{JUDGED[1]:.0%} of the fit.".replace("%", " %"), "",
        "| scene | limit s | took s | of the limit | steps | time left, mean error | worst |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]  # fmt: skip
    for row in rows:
        limit, errors = row["limit"], row["errors"]
        kept = ["–", "–"] if limit is None else [f"{limit:.0f}", f"{100 * row['seconds'] / limit:.0f} %"]
        mean, worst = ("–", "–")
        if errors:
            mean = f"{100 * sum(errors) / len(errors):+.0f} %"
            worst = f"{100 * max(errors, key=abs):+.0f} %"
        cells = [
            row["scene"],
            kept[0],
            f"{row['seconds']:.0f}",
            kept[1],
            str(row["steps"]),
            mean,
            worst,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", type=Path, required=True)
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--limits", nargs="*", type=float, default=[60, 120], metavar="SECONDS")
    parser.add_argument("--steps", type=int, help="of the fits without a limit; else the preset's")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.FIELD=VALUE")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "promises.md")
    options = parser.parse_args()
    steps = [f"fit.steps={options.steps}"] if options.steps else []
    changes = "".join(f" `--set {text}`" for text in options.set)
    shorter = f", fits without a limit of {options.steps} steps" if options.steps else ""
    about = f"Preset `{options.preset}`{changes}{shorter}; {describe_machine()}."
    rows = []
    for scene in (path.resolve() for path in options.scenes):
        for limit in (None, *options.limits):
            with tempfile.TemporaryDirectory() as folder:
                own = options.set + (steps if limit is None else [])
                rows.append(measure(scene, Path(folder) / "job", options.preset, limit, own))
            print({key: value for key, value in rows[-1].items() if key != "errors"}, flush=True)
            options.out.parent.mkdir(parents=True, exist_ok=True)
            options.out.write_text(page(rows, about), encoding="utf-8", newline="\n")
    print(options.out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
