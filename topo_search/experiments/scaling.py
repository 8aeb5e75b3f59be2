"""How time, memory and success grow with the number of modules (paper, Sec. IV, its scaling study).

Ten wrenches for each of uniformly drawn topologies, in four exposure settings. A topology is solved from one start
after the other until the first design.

The paper gives no connector distance. The default is that of the shipped tasks, 0.22 m: just above the diameter of
an airflow envelope's far end, so that parallel neighbours clear each other. At that distance geometry stops many a
large tree, whatever the wrenches; `--distances 0.3` gives room enough that nearly all trees of a hundred modules
have a design, so that times of all sizes can be compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.experiments.cell import PAPER, Cell, Variant, plan
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

EXPOSURES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
SIZES = tuple(range(10, 101, 10))
GROUP = ["method", "distance_m", "task", "n"]


def cells(settings: Settings) -> list[Cell]:
    """Return the plan."""
    return plan(settings, (Variant("airflow", (PAPER,)),), first=True)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row a method, distance, task and size; times and iterations are of topologies with a design."""
    import pandas as pd

    solved = _solved(rows).groupby(GROUP)
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
    """Return the exponents p of seconds = c n^p, fitted to all designs of a method, distance and task.

    `designs` says how many a fit rests on. Series with designs of one size only are left out.
    """
    import pandas as pd

    from topo_search.experiments.power_law import fit

    fits = []
    for group, designs in _solved(rows).groupby(GROUP[:-1]):
        law = fit(designs["n"], designs["seconds"])
        if law is not None:
            fits.append((*group, len(designs), law.exponent, law.at_100))
    return pd.DataFrame(fits, columns=[*GROUP[:-1], "designs", "exponent", "seconds_at_100"])


def findings(rows: pd.DataFrame) -> list[str]:
    """Return how many topologies were solved, how the time grows, and whether exposure changes it."""
    told = []
    table = summary(rows)
    for (method, distance), series in rows.groupby(["method", "distance_m"]):
        of = table[(table["method"] == method) & (table["distance_m"] == distance)]
        largest, solved = int(of["n"].max()), series["status"] == "feasible"
        told.append(
            f"{method}, {distance:.2f} m: {solved.sum()} of {len(series)} problems have a design, "
            f"{(series['verdict'] == 'clear').sum()} of them with a clear audit; with {largest} modules "
            f"{(solved & (series['n'] == largest)).sum()} of {(series['n'] == largest).sum()}."
        )
        fits = growth(series)
        if len(fits):
            told.append(
                f"The time grows as n^{fits['exponent'].min():.1f} to n^{fits['exponent'].max():.1f} "
                f"over the {len(fits)} exposure settings."
            )
        spread = of.groupby("n")["seconds_median"].agg(lambda medians: medians.max() / medians.min()).dropna()
        if len(fits) > 1 and len(spread):
            told.append(
                "At one size the medians of the exposure settings differ by a factor of "
                f"{spread.median():.1f} in the median over sizes, {spread.max():.1f} at most."
            )
    return told


def figure(rows: pd.DataFrame) -> Figure:
    """Return the paper's plot: the distribution of times a size and exposure; below, the share with a design."""
    from matplotlib.figure import Figure

    from topo_search.experiments.distributions import draw
    from topo_search.export.palette import SERIES

    panels = list(rows.groupby(["method", "distance_m"]))
    drawn = Figure(figsize=(3.0 + 5.0 * len(panels), 6.4), layout="constrained")
    axes = drawn.subplots(2, len(panels), squeeze=False, sharex="col", height_ratios=(3, 1))
    for (upper, lower), ((method, distance), of) in zip(axes.T, panels, strict=True):
        tasks = list(dict.fromkeys(of["task"]))
        sizes = sorted(of["n"].unique())
        draw(upper, [(task, _solved(of[of["task"] == task])) for task in tasks], "seconds", sizes)
        upper.set(
            xlabel="",
            title=f"{method}, connectors at {distance:.2f} m",
            ylabel="CPU time to a design [s]",
            yscale="log",
        )
        for number, task in enumerate(tasks):
            share = 100 * (of[of["task"] == task].groupby("n")["status"].agg(lambda s: (s == "feasible").mean()))
            marks = {"color": SERIES[number], "marker": "osD^v"[number % 5]}
            lower.plot([sizes.index(n) for n in share.index], share.to_numpy(), label=task, **marks)
        lower.set(xlabel="modules $n$", ylabel="with a design [%]", ylim=(-5, 105))
        lower.grid(alpha=0.3)
    axes[0, 0].legend(handles=axes[1, 0].get_lines(), fontsize=8)
    drawn.suptitle("Ten wrenches, uniformly drawn topologies: boxes are quartiles, whiskers the whole range")
    return drawn


def _solved(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with a design, with all CPU seconds but those of the audit in `seconds`."""
    designs = rows[rows["status"] == "feasible"]
    return designs.assign(seconds=designs["solve_s"] + designs["build_s"].fillna(0.0))


EXPERIMENT = Experiment(
    name="scaling",
    question="How do time, memory and success grow with the number of modules?",
    full=Settings(tasks=tuple((task, SIZES) for task in EXPOSURES), topologies=(50, 10), starts=5),
    small=Settings(tasks=tuple((task, (3, 5)) for task in EXPOSURES), topologies=(2, 2), starts=2),
    cells=cells,
    summary=summary,
    findings=findings,
    figure=figure,
)
