"""Line charts for the pages of docs, all drawn alike."""

from __future__ import annotations

from pathlib import Path

SIZE = 2.6  # inches of a chart


def line_charts(path: Path, charts: list[dict], columns: int) -> None:
    """Draw charts side by side, `columns` a row, and write a PNG.

    Args:
        charts: each with 'x' and 'y', the axes' labels, 'lines', points [(x, y), …] by the name of a
            line, and, if wanted, 'log_x' and 'dashed', more lines, of a name's colour each.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    count = -(-len(charts) // columns)
    figure, axes = plt.subplots(count, columns, figsize=(SIZE * columns, 0.8 * SIZE * count), squeeze=False)
    for axis, chart in zip(axes.flat, charts, strict=False):
        colours = {}
        for name, points in chart["lines"].items():
            axis.plot(*zip(*points, strict=True), marker="o", markersize=3, label=name)
            colours[name] = axis.lines[-1].get_color()
        for name, points in chart.get("dashed", {}).items():
            axis.plot(*zip(*points, strict=True), linestyle="--", linewidth=1, color=colours[name])
        axis.set_xlabel(chart["x"])
        axis.set_ylabel(chart["y"])
        if chart.get("log_x"):
            axis.set_xscale("log")
            # As many labels as find room beside each other: decades, halves and fifths.
            axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.xaxis.set_major_formatter("{x:g}")
            axis.xaxis.set_minor_formatter(NullFormatter())
        else:
            axis.set_ylim(0, 1.08 * axis.get_ylim()[1])
        axis.grid(alpha=0.3)
    for axis in axes.flat[len(charts) :]:
        axis.remove()
    handles, labels = axes.flat[0].get_legend_handles_labels()
    if any(labels):
        # Below the charts, where it hides no line.
        figure.legend(handles, labels, loc="lower center", ncols=5, fontsize=8, frameon=False)
    figure.tight_layout(rect=(0, 0.08 if any(labels) else 0, 1, 1))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
