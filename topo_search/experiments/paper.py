"""The paper's two studies (its Sec. IV): scaling with the number of modules, and the ablation of the airflow.

Scaling: ten wrenches for each of several uniformly drawn topologies, in four exposure settings, without body
clearance. The root turns freely, whereas the paper's has two angles of at most 90 degrees, so every tree is one
problem whatever its root. A topology is solved from one start after another until the first design. The paper gives
no connector distance. The default is that of the shipped tasks, 0.22 m: just above the radius of an airflow
envelope's far end, so that parallel neighbours clear each other. At that distance many large trees have no design
for geometric reasons, whatever the wrenches. With `--distances 0.3` nearly all trees of a hundred modules have a
design, and times can be compared at all sizes.

Ablation: a minimum distance between module centres replaces the airflow constraints (`search.interference =
"separation"`). The exact audit then measures how severely envelopes overlap, by the paper's three metrics: the
depth of every colliding pair, the largest cluster and the number of colliding pairs of every design. A depth is a
percentage of the deepest overlap that two envelopes can have, twice the radius of their far end. Near 100 % the far
ends of two axes meet; axes that cross elsewhere overlap by the radii at the crossing, 48 % at the modules
themselves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from topo_search.experiments.study import AIRFLOW_ALONE, METHOD, Settings, Study, Variant
from topo_search.export import TWO_COLUMNS, palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXPOSURES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
SIZES = tuple(range(10, 101, 10))
SERIES = ["method", "distance_m", "task"]
PROBLEM = ["distance_m", "task", "n"]
REACHED, FULLY = 95.0, 99.9
"""Percentages of the deepest possible overlap that count as nearly reached and as reached."""


def scaling_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per method, distance, task and size; times and iterations are for trees with a design."""
    every, solved = rows.groupby([*SERIES, "n"]), _designs(rows).groupby([*SERIES, "n"])
    seconds = solved["seconds"]
    columns = {
        "trees": every.size(),
        "share_solved": every["status"].agg(lambda status: (status == "feasible").mean()),
        "share_clear": every["verdict"].agg(lambda verdict: (verdict == "clear").mean()),
        "starts_median": solved["starts"].median(),
        "seconds_median": seconds.median(),
        "seconds_low_quartile": seconds.quantile(0.25),
        "seconds_high_quartile": seconds.quantile(0.75),
        "seconds_max": seconds.max(),
        "iterations_median": solved["iterations"].median(),
        "peak_mb": every["peak_mb"].max(),
        "gap_median": solved["gap"].median(),
    }
    return pd.DataFrame(columns).reset_index()


def growth(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the exponent p of seconds = c n^p for each method, distance and task, fitted to its designs.

    The fit is a least-squares line through the logarithms; `seconds_at_100` is c 100^p [s], `designs` the number of
    designs in the fit. Groups with designs of only one size are omitted.
    """
    fits = []
    for group, designs in _designs(rows).groupby(SERIES):
        if designs["n"].nunique() > 1:
            slope, intercept = np.polyfit(np.log(designs["n"]), np.log(designs["seconds"]), 1)
            fits.append((*group, len(designs), slope, np.exp(intercept + slope * np.log(100))))
    return pd.DataFrame(fits, columns=[*SERIES, "designs", "exponent", "seconds_at_100"])


def scaling_figure(rows: pd.DataFrame) -> Figure:
    """Plot, like the paper, the distribution of times by size and exposure; below, the share with a design."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(TWO_COLUMNS, 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    sizes, designs = sorted(rows["n"].unique()), _designs(rows)
    draw(upper, designs, "seconds", sizes)
    upper.set(xlabel="", ylabel="CPU time to a design [s]", yscale="linear" if designs.empty else "log")
    for number, (name, series) in enumerate(_series(rows)):
        share = 100 * series["status"].eq("feasible").groupby(series["n"]).mean()
        lower.plot([sizes.index(n) for n in share.index], share.to_numpy(), label=name, **style(number))
    upper.legend(handles=lower.get_lines())
    lower.set(xlabel="number of modules $n$", ylabel="with a design [%]", ylim=(-5, 105))
    lower.grid(alpha=0.3)
    figure.suptitle("Ten wrenches, uniformly drawn topologies: boxes are quartiles, whiskers the whole range")
    return figure


def ablation_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per distance, task and size: the paper's three metrics over all designs."""
    designs = _designs(rows).groupby(PROBLEM)
    pairs, deepest = designs["colliding_pairs"], designs["deepest_percent"]
    depths = _pairs(rows).groupby(PROBLEM)["depth_percent"]
    columns = {
        "trees": rows.groupby(PROBLEM).size(),
        "designs": designs.size(),
        "share_colliding": pairs.agg(lambda pairs: (pairs > 0).mean()),
        "deepest_median_percent": deepest.median(),
        "share_deepest_reached": deepest.agg(lambda depth: (depth >= REACHED).mean()),
        "share_deepest_fully_reached": deepest.agg(lambda depth: (depth >= FULLY).mean()),
        "pair_depth_median_percent": depths.median(),
        "share_pairs_reached": depths.agg(lambda depth: (depth >= REACHED).mean()),
        "cluster_median": designs["largest_cluster"].median(),
        "cluster_share_median": designs["cluster_share"].median(),
        "pairs_low_quartile": pairs.quantile(0.25),
        "pairs_median": pairs.median(),
        "pairs_high_quartile": pairs.quantile(0.75),
    }
    return pd.DataFrame(columns).reset_index()


def ablation_figure(rows: pd.DataFrame) -> Figure:
    """Plot, like the paper, the distributions of the three metrics by size."""
    from matplotlib.figure import Figure

    sizes, designs = sorted(rows["n"].unique()), _designs(rows)
    figure = Figure(figsize=(TWO_COLUMNS, 5.0), layout="constrained")
    (depth, deepest), (cluster, number) = figure.subplots(2, 2)
    draw(depth, _pairs(rows), "depth_percent", sizes)
    depth.set(title="Overlap of every colliding pair", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(deepest, designs, "deepest_percent", sizes)
    deepest.set(title="Deepest overlap of a design", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(cluster, designs, "largest_cluster", sizes)
    cluster.plot(range(len(sizes)), [n / 2 for n in sizes], "k--", linewidth=1, label="$n/2$")
    cluster.set(title="Largest cluster of overlapping envelopes", ylabel="modules [-]")
    cluster.legend()
    draw(number, designs, "colliding_pairs", sizes)
    number.set(title="Overlapping pairs of envelopes", ylabel="pairs [-]")
    boxes = "boxes are quartiles, whiskers the whole range"
    figure.suptitle(f"Airflow constraints replaced by a minimum distance: {boxes}")
    return figure


def _designs(rows: pd.DataFrame) -> pd.DataFrame:
    designs = rows[rows["status"] == "feasible"]
    seconds, share = designs["solve_s"] + designs["build_s"].fillna(0.0), designs["largest_cluster"] / designs["n"]
    return designs.assign(seconds=seconds, cluster_share=share.astype("float64"))


def _pairs(rows: pd.DataFrame) -> pd.DataFrame:
    pairs = rows.assign(depth_percent=rows["depths_percent"].str.split(" ")).explode("depth_percent")
    return pairs.dropna(subset="depth_percent").astype({"depth_percent": "float64"})


def _series(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for (method, distance, task), series in rows.groupby(SERIES, sort=False):
        yield f"{task}, {distance:.2f} m{'' if method == METHOD else f', {method}'}", series


def style(number: int) -> dict[str, str]:
    """Return colour and marker of a series; there are more markers than colours, so that no two series agree."""
    return {"color": palette.SERIES[number % len(palette.SERIES)], "marker": "osD^v<>P"[number % 8]}


def draw(axes: Axes, rows: pd.DataFrame, column: str, sizes: Sequence[int]) -> None:
    """Draw a box per size and series: quartiles, the median, and whiskers to the least and the largest value.

    Args:
        axes: the axes to draw on.
        rows: rows with the column.
        column: name of the column with the values.
        sizes: numbers of modules, at 0, 1, ... on the axis.
    """
    series = list(_series(rows))
    width = 0.8 / max(1, len(series))  # in steps between sizes
    for number, (name, group) in enumerate(series):
        colour = style(number)["color"]
        box: dict[str, Any] = {"label": name, "whis": (0, 100), "manage_ticks": False, "patch_artist": True}
        box |= {f"{part}props": {"color": colour} for part in ("whisker", "cap")}
        box |= {"boxprops": {"facecolor": (colour, 0.35), "edgecolor": colour}, "widths": 0.8 * width}
        positions = [k + (number + 0.5) * width - 0.4 for k in range(len(sizes))]
        values = [group.loc[group["n"] == n, column].dropna().to_numpy(float) for n in sizes]
        axes.boxplot(values, positions=positions, medianprops={"color": colour, "linewidth": 1.6}, **box)
    axes.set_xticks(range(len(sizes)), [str(n) for n in sizes])
    axes.set_xlabel("number of modules $n$")
    axes.grid(axis="y", alpha=0.3)


PAPER_STUDIES = (
    Study(
        name="scaling",
        question="How do time, memory and success grow with the number of modules?",
        full=Settings(tasks=tuple((task, SIZES) for task in EXPOSURES), topologies=(50, 10), starts=5),
        small=Settings(tasks=tuple((task, (3, 5)) for task in EXPOSURES), topologies=(2, 2), starts=2),
        variants=(Variant("airflow", (AIRFLOW_ALONE,)),),
        first=True,
        summary=scaling_summary,
        figure=scaling_figure,
    ),
    Study(
        name="ablation",
        question="How severely does airflow interfere when only a minimum distance keeps modules apart?",
        full=Settings(tasks=(("ten-wrenches", SIZES),), topologies=(50, 10), starts=5),
        small=Settings(tasks=(("ten-wrenches", (3, 5)),), topologies=(3, 3), starts=2),
        variants=(Variant("separation", ('search.interference="separation"',)),),
        first=True,
        summary=ablation_summary,
        figure=ablation_figure,
    ),
)
