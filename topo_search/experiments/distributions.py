"""Distributions against the number of modules, drawn side by side as the paper does (its Figs. 7 and 8)."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes

from topo_search.export.palette import SERIES

WIDTH = 0.8
"""Room of all boxes of a size, in steps between sizes."""

MARKERS = "osD^v<>P"
"""More than there are colours, so that series of one colour are told apart."""


def style(number: int) -> dict[str, str]:
    """Return the colour and the marker of a series."""
    return {"color": SERIES[number % len(SERIES)], "marker": MARKERS[number % len(MARKERS)]}


def draw(axes: Axes, series: Sequence[tuple[str, pd.DataFrame]], column: str, sizes: Sequence[int]) -> None:
    """Draw a box a size and series: quartiles, the median, and whiskers to the least and the largest value.

    Args:
        axes: where.
        series: named rows with the columns `n` and `column`.
        column: what is distributed.
        sizes: the numbers of modules, which stand at 0, 1, ... on the axis.
    """
    width = WIDTH / max(1, len(series))
    for number, (name, rows) in enumerate(series):
        colour = style(number)["color"]
        values = {n: rows.loc[rows["n"] == n, column].dropna().to_numpy(float) for n in sizes}
        drawn = [place for place, n in enumerate(sizes) if len(values[n])]
        if drawn:
            boxes = axes.boxplot(
                [values[sizes[place]] for place in drawn],
                positions=[place + (number + 0.5) * width - WIDTH / 2 for place in drawn],
                widths=0.8 * width,
                whis=(0, 100),
                manage_ticks=False,
                patch_artist=True,
                boxprops={"facecolor": (colour, 0.35), "edgecolor": colour},
                medianprops={"color": colour, "linewidth": 1.6},
                whiskerprops={"color": colour},
                capprops={"color": colour},
            )
            boxes["boxes"][0].set_label(name)
    axes.set_xticks(range(len(sizes)), [str(n) for n in sizes])
    axes.set_xlabel("modules $n$")
    axes.grid(axis="y", alpha=0.3)
