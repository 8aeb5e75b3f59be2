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

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from topo_search.experiments.conducting import METHOD, Experiment
from topo_search.experiments.plan import AIRFLOW_ALONE, IDENTITY, Settings, Variant, plan
from topo_search.export import palette
from topo_search.model.proven import gap_percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXPOSURES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
SIZES = tuple(range(10, 101, 10))
GROUP = ["method", "distance_m", "task", "n"]
"""Columns by which the scaling study is grouped."""


REACHED = 95.0
"""Percentage of the deepest possible overlap that counts as nearly reached."""
FULLY = 99.9
"""Percentage of the deepest possible overlap that counts as reached."""


def scaling_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per method, distance, task and size; times and iterations are for trees with a design."""
    solved = _solved_rows(rows).groupby(GROUP)
    every = rows.groupby(GROUP)
    return pd.DataFrame(
        {
            "trees": every.size(),
            "share_solved": every["status"].agg(lambda status: (status == "feasible").mean()),
            "share_clear": every["verdict"].agg(lambda verdict: (verdict == "clear").mean()),
            "starts_median": solved["starts"].median(),
            "seconds_median": solved["seconds"].median(),
            "seconds_low_quartile": solved["seconds"].quantile(0.25),
            "seconds_high_quartile": solved["seconds"].quantile(0.75),
            "seconds_max": solved["seconds"].max(),
            "iterations_median": solved["iterations"].median(),
            "peak_mb": every["peak_mb"].max(),
            "gap_median": solved["gap"].median(),
        }
    ).reset_index()


def growth(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the exponent p of seconds = c n^p for each method, distance and task, fitted to its designs.

    `designs` is the number of designs in the fit. Groups with designs of only one size are omitted.
    """
    fits = []
    for group, designs in _solved_rows(rows).groupby(GROUP[:-1]):
        law = fit(designs["n"], designs["seconds"])
        if law is not None:
            fits.append((*group, len(designs), *law))
    return pd.DataFrame(fits, columns=[*GROUP[:-1], "designs", "exponent", "seconds_at_100"])


def slowdown(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the cost of other methods on problems that both they and this solver solve, by distance and size.

    `times_median`: ratio of their CPU time to this solver's; `memory_median`: likewise for peak memory.
    """
    designs = _solved_rows(rows)
    ours, direct = (designs[(designs["method"] == METHOD) == is_ours] for is_ours in (True, False))
    both = direct.merge(ours, on=list(IDENTITY[1:]), suffixes=("", "_ours"))
    both = both.assign(times=both["seconds"] / both["seconds_ours"], memory=both["peak_mb"] / both["peak_mb_ours"])
    groups = both.groupby(["method", "distance_m", "n"])
    return pd.DataFrame(
        {
            "problems": groups.size(),
            "times_median": groups["times"].median(),
            "memory_median": groups["memory"].median(),
        }
    ).reset_index()


def scaling_findings(rows: pd.DataFrame) -> list[str]:
    """Return sentences about success, growth of time and memory, and the influence of exposure on time."""
    sentences = []
    summary = scaling_summary(rows)
    for (method, distance), series in rows.groupby(["method", "distance_m"], sort=False):
        table = summary[(summary["method"] == method) & (summary["distance_m"] == distance)]
        sentences.append(_success(f"{method}, {distance:.2f} m", series))
        with_gap = table[table["gap_median"].notna()]
        if not with_gap.empty:  # gaps of the first designs, at the largest size that has any
            largest = with_gap[with_gap["n"] == with_gap["n"].max()]
            low, high = (gap_percent(gap, decimals=1) for gap in largest["gap_median"].agg(["min", "max"]))
            gaps = f"is {high}" if low == high else f"goes from {low} to {high} over the exposure settings"
            sentences.append(
                f"{method}: times are to the first design of a tree whose root turns freely, not to a good one: "
                f"with {largest['n'].iloc[0]} modules its median gap to the lower bound {gaps}."
            )
        fits = growth(series)
        if len(fits):
            low, high = (f"n^{exponent:.1f}" for exponent in (fits["exponent"].min(), fits["exponent"].max()))
            sentences.append(
                f"{method}: the time to a design grows as {low if low == high else f'{low} to {high}'}, and no "
                f"process held more than {table['peak_mb'].max():.0f} MB."
            )
        medians = table.groupby("n")["seconds_median"].agg(["min", "max", "count"])
        spread = (medians["max"] / medians["min"])[medians["count"] > 1]
        if len(spread):
            sentences.append(
                "At one size the medians of the exposure settings differ by a factor of "
                f"{spread.median():.1f} in the median over sizes, {spread.max():.1f} at most: that they are of a "
                f"similar range, as the paper finds, is {_confirmation(spread.median() <= 3)}."
            )
    for (method, distance), table in slowdown(rows).groupby(["method", "distance_m"]):
        times = ", ".join(f"{row.times_median:.1f} with {row.n} modules" for row in table.itertuples(index=False))
        sentences.append(
            f"{method}, {distance:.2f} m: on the {table['problems'].sum()} problems that both solve it takes a "
            f"multiple of the seconds of {METHOD}, in the median {times}; with {table['n'].iloc[-1]} it holds "
            f"{table['memory_median'].iloc[-1]:.1f} times the memory."
        )
    return sentences


def _success(series: str, rows: pd.DataFrame) -> str:
    """Return a sentence about the share of problems with a design."""
    solved, largest = rows["status"] == "feasible", rows["n"] == rows["n"].max()
    audited = rows["verdict"].notna()
    clear = f", {(rows['verdict'] == 'clear').sum()} of them with a clear audit" if audited.any() else ""
    return (
        f"{series}: {solved.sum()} of {len(rows)} problems have a design{clear}; with {rows['n'].max()} modules "
        f"{(solved & largest).sum()} of {largest.sum()}."
    )


def scaling_figure(rows: pd.DataFrame) -> Figure:
    """Plot, like the paper, the distribution of times by size and exposure; below, the share with a design."""
    from matplotlib.figure import Figure

    panels = list(rows.groupby("distance_m"))
    figure = Figure(figsize=(3.0 + 7.0 * len(panels), 6.4), layout="constrained")
    axes = figure.subplots(2, len(panels), squeeze=False, sharex="col", sharey="row", height_ratios=(3, 1))
    for (upper, lower), (distance, panel) in zip(axes.T, panels, strict=True):
        sizes = sorted(panel["n"].unique())
        series = [
            (str(task) if method == METHOD else f"{task}, {method}", group)
            for (method, task), group in panel.groupby(["method", "task"], sort=False)
        ]
        draw(upper, [(name, _solved_rows(group)) for name, group in series], "seconds", sizes)
        upper.set(xlabel="", title=f"connectors at {distance:.2f} m", yscale="log")
        for number, (name, group) in enumerate(series):
            share = 100 * group.groupby("n")["status"].agg(lambda status: (status == "feasible").mean())
            positions = [sizes.index(n) + 0.08 * (number - (len(series) - 1) / 2) for n in share.index]
            lower.plot(positions, share.to_numpy(), label=name, **style(number))
        lower.set(xlabel="modules $n$", ylim=(-5, 105))
        lower.grid(alpha=0.3)
    axes[0, 0].set_ylabel("CPU time to a design [s]")
    axes[1, 0].set_ylabel("with a design [%]")
    axes[0, 0].legend(handles=axes[1, 0].get_lines(), fontsize=8)
    figure.suptitle("Ten wrenches, uniformly drawn topologies: boxes are quartiles, whiskers the whole range")
    return figure


def _solved_rows(rows: pd.DataFrame) -> pd.DataFrame:
    designs = rows[rows["status"] == "feasible"]
    return designs.assign(seconds=designs["solve_s"] + designs["build_s"].fillna(0.0))


def ablation_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per distance, task and size: the paper's three metrics over all designs."""
    group = ["distance_m", "task", "n"]
    every, designs = rows.groupby(group), _designs(rows).groupby(group)
    depths = _pairs(rows).groupby(group)["depth_percent"]
    return pd.DataFrame(
        {
            "trees": every.size(),
            "designs": designs.size(),
            "share_colliding": designs["colliding_pairs"].agg(lambda pairs: (pairs > 0).mean()),
            "deepest_median_percent": designs["deepest_percent"].median(),
            "share_deepest_reached": designs["deepest_percent"].agg(lambda depth: (depth >= REACHED).mean()),
            "share_deepest_fully_reached": designs["deepest_percent"].agg(lambda depth: (depth >= FULLY).mean()),
            "pair_depth_median_percent": depths.median(),
            "share_pairs_reached": depths.agg(lambda depth: (depth >= REACHED).mean()),
            "cluster_median": designs["largest_cluster"].median(),
            "cluster_share_median": designs["cluster_share"].median(),
            "pairs_low_quartile": designs["colliding_pairs"].quantile(0.25),
            "pairs_median": designs["colliding_pairs"].median(),
            "pairs_high_quartile": designs["colliding_pairs"].quantile(0.75),
        }
    ).reset_index()


def ablation_findings(rows: pd.DataFrame) -> list[str]:
    """Return sentences about the overlaps, and whether they confirm the paper's three findings."""
    designs = _designs(rows)
    if designs.empty:
        return ["No design was found."]
    deepest, depths = designs["deepest_percent"], _pairs(rows)["depth_percent"]
    low, high = 0.4, 0.6  # shares of the modules that count as about half
    often = 0.25  # smallest share of the designs that counts as often
    share = designs["cluster_share"]
    reached, fully = ((deepest >= depth).mean() for depth in (REACHED, FULLY))
    sentences = [
        f"{(designs['colliding_pairs'] > 0).mean():.0%} of {len(designs)} designs have overlapping airflow.",
        f"The deepest overlap reaches {REACHED:.0f} % of the deepest possible in {reached:.0%} of the designs and "
        f"{FULLY} % in {fully:.0%}; its median is {deepest.median():.0f} %, its least {deepest.min():.0f} %. That "
        f"the deepest possible is often reached, as the paper finds, is {_confirmation(reached >= often)} where "
        f"{REACHED:.0f} % counts as reached, and {_confirmation(fully >= often)} where {FULLY} % does.",
        f"The largest cluster holds {share.median():.0%} of the modules in the median; it is about half "
        f"({low:.0%} to {high:.0%}) of them in {share.between(low, high).mean():.0%} of the designs, "
        f"more in {(share > high).mean():.0%}. That clusters of about half of the modules, or more, are "
        f"frequent, as the paper finds, is {_confirmation((share >= low).mean() >= often)}.",
    ]
    if len(depths):
        sentences.append(
            f"Over all {len(depths)} colliding pairs the depth is {depths.median():.0f} % of the deepest possible "
            f"in the median; {(depths >= REACHED).mean():.0%} of them reach {REACHED:.0f} %."
        )
    pairs = designs.groupby("n")["colliding_pairs"].median()
    law = fit(designs["n"], designs["colliding_pairs"])
    if law is not None:
        exponent, _ = law
        sentences.append(
            f"The median number of colliding pairs goes from {pairs.iloc[0]:.0f} with {pairs.index[0]} modules to "
            f"{pairs.iloc[-1]:.0f} with {pairs.index[-1]}: it grows as n^{exponent:.1f}. That the number "
            f"grows with n, as the paper finds, is {_confirmation(exponent > 0)}."
        )
    return sentences


def _confirmation(holds: bool) -> str:
    return "confirmed" if holds else "not confirmed"


def ablation_figure(rows: pd.DataFrame) -> Figure:
    """Plot, like the paper, the distributions of the three metrics by size."""
    from matplotlib.figure import Figure

    groups = _designs(rows).groupby(["task", "distance_m"], sort=False)
    designs = [(f"{task}, {distance:.2f} m", group) for (task, distance), group in groups]
    sizes = sorted(rows["n"].unique())
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    (depth, deepest), (cluster, number) = figure.subplots(2, 2)
    draw(depth, [(name, _pairs(group)) for name, group in designs], "depth_percent", sizes)
    depth.set(title="Overlap of every colliding pair", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(deepest, designs, "deepest_percent", sizes)
    deepest.set(title="Deepest overlap of a design", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(cluster, designs, "largest_cluster", sizes)
    cluster.plot(range(len(sizes)), [n / 2 for n in sizes], "k--", linewidth=1, label="$n/2$")
    cluster.set(title="Largest cluster of overlapping envelopes", ylabel="modules [-]")
    cluster.legend(fontsize=8)
    draw(number, designs, "colliding_pairs", sizes)
    number.set(title="Overlapping pairs of envelopes", ylabel="pairs [-]")
    boxes = "boxes are quartiles, whiskers the whole range"
    figure.suptitle(f"Airflow constraints replaced by a minimum distance: {boxes}")
    return figure


def _designs(rows: pd.DataFrame) -> pd.DataFrame:
    designs = rows[rows["status"] == "feasible"]
    return designs.assign(cluster_share=designs["largest_cluster"].astype("float64") / designs["n"])


def _pairs(rows: pd.DataFrame) -> pd.DataFrame:
    pairs = rows.assign(depth_percent=rows["depths_percent"].str.split(" ")).explode("depth_percent")
    return pairs.dropna(subset="depth_percent").astype({"depth_percent": "float64"})


def fit(n: pd.Series, y: pd.Series) -> tuple[float, float] | None:
    """Fit y = c n^p to points of positive y and return p and y(100); None if all have one size.

    The fit is a least-squares line through the logarithms.
    """
    n, y = n[y > 0], y[y > 0].astype("float64")
    if n.nunique() < 2:
        return None
    slope, intercept = np.polyfit(np.log(n), np.log(y), 1)
    return float(slope), float(np.exp(intercept + slope * np.log(100)))


def style(number: int) -> dict[str, str]:
    """Return colour and marker of a series; there are more markers than colours, so that no two series agree."""
    return {"color": palette.SERIES[number % len(palette.SERIES)], "marker": "osD^v<>P"[number % 8]}


def draw(axes: Axes, series: Sequence[tuple[str, pd.DataFrame]], column: str, sizes: Sequence[int]) -> None:
    """Draw a box per size and series: quartiles, the median, and whiskers to the least and the largest value.

    Args:
        axes: the axes to draw on.
        series: pairs of a name and rows with the columns `n` and `column`.
        column: name of the column with the values.
        sizes: numbers of modules, at 0, 1, ... on the axis.
    """
    total_width = 0.8  # of all boxes of a size, in steps between sizes
    width = total_width / max(1, len(series))
    for number, (name, rows) in enumerate(series):
        colour = style(number)["color"]
        values = [rows.loc[rows["n"] == n, column].dropna().to_numpy(float) for n in sizes]
        axes.boxplot(
            values,
            positions=[k + (number + 0.5) * width - total_width / 2 for k in range(len(sizes))],
            label=name if any(map(len, values)) else None,
            widths=0.8 * width,
            whis=(0, 100),
            manage_ticks=False,
            patch_artist=True,
            boxprops={"facecolor": (colour, 0.35), "edgecolor": colour},
            medianprops={"color": colour, "linewidth": 1.6},
            whiskerprops={"color": colour},
            capprops={"color": colour},
        )
    axes.set_xticks(range(len(sizes)), [str(n) for n in sizes])
    axes.set_xlabel("modules $n$")
    axes.grid(axis="y", alpha=0.3)


PAPER_STUDIES = (
    Experiment(
        name="scaling",
        question="How do time, memory and success grow with the number of modules?",
        full=Settings(tasks=tuple((task, SIZES) for task in EXPOSURES), topologies=(50, 10), starts=5),
        small=Settings(tasks=tuple((task, (3, 5)) for task in EXPOSURES), topologies=(2, 2), starts=2),
        cells=partial(plan, variants=(Variant("airflow", (AIRFLOW_ALONE,)),), first=True),
        summary=scaling_summary,
        findings=scaling_findings,
        figure=scaling_figure,
    ),
    Experiment(
        name="ablation",
        question="How severely does airflow interfere when only a minimum distance keeps modules apart?",
        full=Settings(tasks=(("ten-wrenches", SIZES),), topologies=(50, 10), starts=5),
        small=Settings(tasks=(("ten-wrenches", (3, 5)),), topologies=(3, 3), starts=2),
        cells=partial(plan, variants=(Variant("separation", ('search.interference="separation"',)),), first=True),
        summary=ablation_summary,
        findings=ablation_findings,
        figure=ablation_figure,
    ),
)
