"""The share of topologies with a design against the connector distance, drawn from measured rows.

python tests/benchmarks/performance.py share --out ROWS.jsonl ...
python tests/benchmarks/share_picture.py ROWS.jsonl PICTURE.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure
from part_share import PART
from rows import Row, Rows

COLOURS = {"ten-wrenches": "#0072b2", "ten-wrenches-exterior-60": "#d55e00"}
"""Colours of the tasks with a curve, which colour-blind people can distinguish (Okabe and Ito)."""
LINES = {"airflow only": ("-", "o"), "with body clearance": ("--", "s")}


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path)
    parser.add_argument("picture", type=Path)
    arguments = parser.parse_args()
    rows = Rows(arguments.rows)
    draw(rows).savefig(arguments.picture, dpi=120)


def draw(rows: Rows) -> Figure:
    """Return the figure, with a panel per size and a curve per task and problem."""
    measured = [row for row in rows.where(part=PART) if row["example"] in COLOURS]
    sizes = sorted({row["n"] for row in measured})
    figure = Figure(figsize=(4.2 * len(sizes), 4.0), layout="constrained")
    for axes, n in zip(figure.subplots(1, len(sizes), sharey=True, squeeze=False)[0], sizes, strict=True):
        trees = len({row["key"] for row in measured if row["n"] == n})
        for example, colour in COLOURS.items():
            for problem, (line, marker) in LINES.items():
                curve_rows = [
                    row for row in measured if (row["n"], row["example"], row["problem"]) == (n, example, problem)
                ]
                if not curve_rows:
                    continue
                distances = sorted({row["distance"] for row in curve_rows})
                shares = [share([row for row in curve_rows if row["distance"] == d]) for d in distances]
                label = f"{example}, {problem}"
                axes.plot(distances, shares, line, marker=marker, color=colour, label=label, clip_on=False)
        axes.set(title=f"{n} modules, {trees} trees", xlabel="connector distance [m]", ylim=(0, 100))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("trees with a design after five starts [%]")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    figure.suptitle("Share of uniformly drawn trees that can exert the ten wrenches")
    return figure


def share(rows: list[Row]) -> float:
    """Return the share of solved rows [%]."""
    return 100.0 * len([row for row in rows if row["solved"]]) / len(rows)


if __name__ == "__main__":
    main()
