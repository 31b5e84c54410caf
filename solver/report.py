"""A self-contained HTML page of pictures and numbers. Standard library alone."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .replacing import written_beside

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fafafa; margin: 2rem auto;
  max-width: 1100px; padding: 0 1rem }
h1 { font-weight: 600 } table { border-collapse: collapse; margin: 1rem 0 }
td, th { padding: .25rem 1rem .25rem 0; text-align: left } td:last-child { text-align: right;
  font-variant-numeric: tabular-nums }
.row { display: flex; flex-wrap: wrap; gap: .5rem; margin-bottom: 1.2rem }
figure { margin: 0; flex: 1 1 200px; max-width: 50% } figure.wide { max-width: 100% }
img { width: 100%; border-radius: 4px; background: #fff; border: 1px solid #ddd }
figcaption { color: #666; font-size: 13px } h2 { font-size: 16px; margin: 1.2rem 0 .3rem }
"""


@dataclass(frozen=True)
class Row:
    """Pictures side by side: a title and (caption, file name relative to the page)."""

    title: str
    pictures: list[tuple[str, str]]


def write_report(
    path: Path, title: str, intro: str, rows: list[Row], numbers: dict[str, object],
    warnings: Sequence[str] = (),
) -> None:  # fmt: skip
    """Write the page; the pictures lie beside it."""
    intro_and_warnings = f"<p>{html.escape(intro)}</p>"
    if warnings:
        notes = "".join(f"<li>{html.escape(text)}.</li>" for text in warnings)
        intro_and_warnings += f"<p>Warnings:</p><ul>{notes}</ul>"
    table = "".join(
        f"<tr><td>{html.escape(str(name))}</td><td>{html.escape(str(value))}</td></tr>"
        for name, value in numbers.items()
    )
    body = []
    for row in rows:
        wide = ' class="wide"' if len(row.pictures) == 1 else ""
        figures = "".join(
            f'<figure{wide}><img src="{html.escape(file)}" alt="{html.escape(caption)}">'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>"
            for caption, file in row.pictures
        )
        body.append(f'<h2>{html.escape(row.title)}</h2><div class="row">{figures}</div>')
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}'
        f"</title><style>{_STYLE}</style></head><body><h1>{html.escape(title)}</h1>"
        f"{intro_and_warnings}<table>{table}</table>{''.join(body)}</body></html>\n"
    )
    with written_beside(path) as part:
        part.write_text(page, encoding="utf-8")
