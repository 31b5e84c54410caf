"""The page of a benchmark: its rows as Markdown tables, the paper's numbers beside."""

from __future__ import annotations

import json
from pathlib import Path

PAPER = json.loads((Path(__file__).parent / "paper.json").read_text(encoding="utf-8"))["rows"]

# Title, key in a row's quality means, digits, whether more is better.
METRICS = [
    ("PSNR dB", "psnr", 2, True),
    ("SSIM", "ssim", 3, True),
    ("MS-SSIM", "ms_ssim", 3, True),
    ("FLIP", "flip", 3, False),
    ("LPIPS", "lpips", 3, False),
    ("normal MAE °", "normal_mae", 2, False),
    ("masked MAE °", "normal_mae_masked", 2, False),
    ("albedo MAE", "albedo_mae", 3, False),
    ("own albedo MAE", "own_albedo_mae", 3, False),
    ("roughness MAE", "roughness_mae", 3, False),
    ("F0 MAE", "f0_mae", 3, False),
    ("light rel. RMSE", "environment_relative_rmse", 2, False),
    ("light MAE, tone-mapped", "environment_mae_tonemapped", 3, False),
    ("relit PSNR dB", "relight_psnr", 2, True),
    ("relit without a factor, dB", "relight_psnr_without_factor", 2, True),
]
ALBEDO = ("albedo_mae", "own_albedo_mae")
STAGES = ("photos", "compile", "geometry", "fit", "asset", "report")


def write_page(rows: list[dict], path: Path) -> None:
    """Write the Markdown page of rows (as in the JSON beside it)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    groups: dict[str, list[dict]] = {}
    for row in rows:
        groups.setdefault(_group(row), []).append(row)
    now = {group: mine for group, mine in groups.items() if not _is_earlier(mine)}
    earlier = {group: mine for group, mine in groups.items() if _is_earlier(mine)}
    parts = [_HEAD, "\n## At a glance\n\n" + _GLANCE_NOTE + "\n", glance_table(now)]
    for group, mine in now.items():
        parts += _section(group, mine)
    if earlier:
        parts.append("\n# Earlier\n\n" + _EARLIER_NOTE + "\n")
        parts.append(glance_table(earlier))
    for group, mine in reversed(earlier.items()):
        if _has_ablations(mine):
            parts += _ablations(mine, f"## Preset {group}: against its default")
    path.write_text("\n".join(parts) + "\n", encoding="utf-8", newline="\n")


def _group(row: dict) -> str:
    """Rows that may be compared: a preset, and what was changed of it for all rows."""
    return " ".join([f"`{row['preset']}`", *(f"`--set {text}`" for text in row["changes"])])


def _is_earlier(rows: list[dict]) -> bool:
    """Whether rows are of a preset as it was: its name then says so after a blank."""
    return " " in rows[0]["preset"]


def _section(group: str, rows: list[dict]) -> list[str]:
    parts = [f"\n## Preset {group}\n", quality_table(rows)]
    if _has_ablations(rows):
        parts += _ablations(rows, "### Against the default")
    return [*parts, "\n### Time and memory\n\n" + _TIME_NOTE + "\n", time_table(rows)]


def _has_ablations(rows: list[dict]) -> bool:
    return any(row["setting"] != "default" for row in rows)


def _ablations(rows: list[dict], heading: str) -> list[str]:
    return [f"\n{heading}\n\n{_ABLATION_NOTE}\n", ablation_table(rows)]


def glance_table(groups: dict[str, list[dict]]) -> str:
    """A line a group: means over its scenes with the default setting."""
    keys = ("psnr", "ssim", "normal_mae", "albedo_mae", "own_albedo_mae", "roughness_mae", "f0_mae",
            "relight_psnr", "relight_psnr_without_factor")  # fmt: skip
    metrics = [m for m in METRICS if m[1] in keys]
    head = ["preset", "scenes", *(m[0] for m in metrics), "minutes", "CPU minutes", "peak GB"]
    lines = [_line(head), _line(["---", *(["---:"] * (len(head) - 1))])]
    for group, rows in groups.items():
        mine = [row for row in rows if row["setting"] == "default"]
        if not mine:
            continue
        cells = [group, str(len(mine))]
        cells += [_number(_mean_quality(mine, key), digits) for _, key, digits, _ in metrics]
        for name, unit, digits in (
            ("seconds", 60, 1),
            ("cpu_seconds", 60, 1),
            ("peak_gigabytes", 1, 2),
        ):
            cells.append(_number(_mean([row[name] / unit for row in mine]), digits))
        lines.append(_line(cells))
    return "\n".join(lines) + "\n"


def _mean_quality(rows: list[dict], key: str) -> float | None:
    """Mean over scenes; None if not every one of them has it, since it would be of other scenes.

    Only of albedo it is of the scenes that have one: those that are all metal have no error of it.
    """
    if key in ALBEDO:
        rows = [row for row in rows if not _is_all_metal(row["quality"]["mean"])]
    values = [row["quality"]["mean"].get(key) for row in rows]
    return None if None in values else _mean(values)


def _is_all_metal(scores: dict[str, float]) -> bool:
    """Whether a scene has true materials, but no albedo (see `solver.fit.evaluate`)."""
    return "f0_mae" in scores and not any(key in scores for key in ALBEDO)


def quality_table(rows: list[dict]) -> str:
    """Every row with every metric that any row has; below it the paper's where the scene is its own."""
    metrics = [m for m in METRICS if any(m[1] in row["quality"]["mean"] for row in rows)]
    lines = [_line(["scene", "setting", *(m[0] for m in metrics)])]
    lines.append(_line(["---", "---", *("---:" for _ in metrics)]))
    for row in sorted(rows, key=lambda r: r["scene"]):
        values = [_number(row["quality"]["mean"].get(key), digits) for _, key, digits, _ in metrics]
        lines.append(_line([row["scene"], row["setting"], *values]))
        if row.get("paper_scene"):
            paper = PAPER.get(row["setting"], {})
            values = [
                _number(paper.get(key, {}).get(row["paper_scene"]), digits) for _, key, digits, _ in metrics
            ]
            lines.append(_line(["", "*paper*", *values]))
    for setting in dict.fromkeys(row["setting"] for row in rows):
        mine = [row for row in rows if row["setting"] == setting]
        if len(mine) > 1:
            values = [_number(_mean_quality(mine, key), digits) for _, key, digits, _ in metrics]
            lines.append(_line([f"**mean of {len(mine)}**", setting, *values]))
    return "\n".join(lines) + "\n"


def ablation_table(rows: list[dict]) -> str:
    """Mean difference of every setting from the default, over the scenes that have both."""
    keys = ("psnr", "ssim", "normal_mae", "relight_psnr")
    titles = [m for m in METRICS if m[1] in keys]
    head = ["setting", "scenes"]
    for title, *_ in titles:
        head += [f"Δ {title}", f"paper's Δ {title}"]
    lines = [_line(head), _line(["---", "---:", *(["---:"] * (len(head) - 2))])]
    base = {row["scene"]: row for row in rows if row["setting"] == "default"}
    for setting in dict.fromkeys(row["setting"] for row in rows):
        if setting == "default":
            continue
        pairs = [
            (row, base[row["scene"]]) for row in rows if row["setting"] == setting and row["scene"] in base
        ]
        if not pairs:
            continue
        cells = [setting, str(len(pairs))]
        for _, key, digits, _ in titles:
            differences = [
                row["quality"]["mean"][key] - other["quality"]["mean"][key]
                for row, other in pairs
                if key in row["quality"]["mean"] and key in other["quality"]["mean"]
            ]
            cells.append(_signed(_mean(differences), digits))
            paper, default = PAPER.get(setting, {}).get(key, {}), PAPER["default"].get(key, {})
            shared = [paper[s] - default[s] for s in default if s in paper]
            cells.append(_signed(_mean(shared), digits))
        lines.append(_line(cells))
    return "\n".join(lines) + "\n"


def time_table(rows: list[dict]) -> str:
    """Minutes by stage, CPU minutes, memory, machine, commit."""
    head = ["scene", "setting", "minutes", "CPU minutes", *STAGES, "peak GB", "machine", "commit"]
    lines = [_line(head), _line(["---", "---", *(["---:"] * (len(head) - 4)), "---", "---"])]
    for row in sorted(rows, key=lambda r: r["scene"]):
        where = row["gpu"] or f"{row['threads']} of {row['cores']} cores, {row['machine']}"
        lines.append(
            _line(
                [
                    row["scene"], row["setting"], _number(row["seconds"] / 60, 1),
                    _number(row["cpu_seconds"] / 60, 1),
                    *(_number(row["stages"].get(stage, 0) / 60, 1) for stage in STAGES),
                    _number(row["peak_gigabytes"], 2), f"{where}, {row['system']}, seed {row['seed']}",
                    row["commit"],
                ]
            )
        )  # fmt: skip
    return "\n".join(lines) + "\n"


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _signed(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:+.{digits}f}"


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


_HEAD = """# Benchmarks: quality

Written by `make benchmark`; do not edit. The same numbers are in the JSON file beside this page;
`JOB/metrics.json` has those of every view. Views are held out; [metrics.md](metrics.md) defines every
column. A dash: not measured (no truth, or LPIPS without
its weights; or no albedo, where all is metal: means of albedo MAE are of the scenes that have one;
or no *albedo MAE*, but the fit's own, in rows from before decision 44).
Scenes are our own unless a line *paper* stands below: a name may be shared with a scene of the paper.

More: [quality over time](curves.md), [limits and times left](promises.md), [kernels](kernels.md),
[scaling](scaling.md), [captures of other programs](captures.md).
"""
_GLANCE_NOTE = """Means over scenes, presets as they come. A time is that of one run, on a machine that may
have had other work; the tables below say on which."""
_EARLIER_NOTE = """What presets were like before a change, oldest first, and the paper's ablations as far as
they were made then. Scene by scene: in the JSON file."""
_ABLATION_NOTE = """Mean over scenes of setting − default. The paper's are those of its own 14 scenes,
at its own length of training: compare signs, not sizes. It relights none of its ablations."""
_TIME_NOTE = """Wall minutes of `reconstruct`, asset and report included, on a machine that may have had
other work; CPU minutes are the process's own. Only the default bakes a full asset, the others a
token one."""
