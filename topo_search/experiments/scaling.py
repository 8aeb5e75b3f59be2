"""How time, memory and success grow with the number of modules (paper, Sec. IV, its scaling study).

Ten wrenches for each of uniformly drawn topologies, in four exposure settings, without body clearance. The root
turns freely, where the paper's has two angles of at most 90 degrees: every tree is then one problem, whatever its
root. A topology is solved from one start after the other until the first design.

The paper gives no connector distance. The default is that of the shipped tasks, 0.22 m: just above the radius of an
airflow envelope's far end, so that parallel neighbours clear each other. At that distance geometry stops many a
large tree, whatever the wrenches; `--distances 0.3` gives room enough that nearly all trees of a hundred modules
have a design, so that times of all sizes can be compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.experiments.cell import AIRFLOW_ALONE, IDENTITY, Cell, Variant, plan
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.measured import METHOD
from topo_search.experiments.settings import Settings
from topo_search.model.proven import gap_percent

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

EXPOSURES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
SIZES = tuple(range(10, 101, 10))
GROUP = ["method", "distance_m", "task", "n"]
SIMILAR = 3.0
"""Factor up to which times count as of a similar range."""


def cells(settings: Settings) -> list[Cell]:
    """Return the plan."""
    return plan(settings, (Variant("airflow", (AIRFLOW_ALONE,)),), first=True)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row a method, distance, task and size; times and iterations are of topologies with a design."""
    import pandas as pd

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
    """Return the exponents p of seconds = c n^p, fitted to all designs of a method, distance and task.

    `designs` says how many a fit rests on. Series with designs of one size only are left out.
    """
    import pandas as pd

    from topo_search.experiments.power_law import fit

    fits = []
    for group, designs in _solved_rows(rows).groupby(GROUP[:-1]):
        law = fit(designs["n"], designs["seconds"])
        if law is not None:
            fits.append((*group, len(designs), law.exponent, law.at_100))
    return pd.DataFrame(fits, columns=[*GROUP[:-1], "designs", "exponent", "seconds_at_100"])


def slowdown(rows: pd.DataFrame) -> pd.DataFrame:
    """Return what another method takes on the problems that it and this solver solve, a row a distance and size.

    `times_median`: its seconds over this solver's; `memory_median`: the same of the most memory.
    """
    import pandas as pd

    problem = list(IDENTITY[1:])
    designs = _solved_rows(rows)
    ours, others = (designs[(designs["method"] == METHOD) == mine] for mine in (True, False))
    both = others.merge(ours, on=problem, suffixes=("", "_ours"))
    both = both.assign(times=both["seconds"] / both["seconds_ours"], memory=both["peak_mb"] / both["peak_mb_ours"])
    of = both.groupby(["method", "distance_m", "n"])
    return pd.DataFrame(
        {"problems": of.size(), "times_median": of["times"].median(), "memory_median": of["memory"].median()}
    ).reset_index()


def findings(rows: pd.DataFrame) -> list[str]:
    """Return how many topologies were solved, how time and memory grow, and whether exposure changes the time."""
    told = []
    table = summary(rows)
    for (method, distance), series in rows.groupby(["method", "distance_m"], sort=False):
        of = table[(table["method"] == method) & (table["distance_m"] == distance)]
        told.append(_success(f"{method}, {distance:.2f} m", series))
        told += _first_designs(str(method), of)
        fits = growth(series)
        if len(fits):
            low, high = (f"n^{exponent:.1f}" for exponent in (fits["exponent"].min(), fits["exponent"].max()))
            told.append(
                f"{method}: the time to a design grows as {low if low == high else f'{low} to {high}'}, and no "
                f"process held more than {of['peak_mb'].max():.0f} MB."
            )
        medians = of.groupby("n")["seconds_median"].agg(["min", "max", "count"])
        spread = (medians["max"] / medians["min"])[medians["count"] > 1]
        if len(spread):
            alike = spread.median() <= SIMILAR
            told.append(
                "At one size the medians of the exposure settings differ by a factor of "
                f"{spread.median():.1f} in the median over sizes, {spread.max():.1f} at most: that they are of a "
                f"similar range, as the paper finds, is {'confirmed' if alike else 'not confirmed'}."
            )
    for (method, distance), of in slowdown(rows).groupby(["method", "distance_m"]):
        times = ", ".join(f"{row.times_median:.1f} with {row.n} modules" for row in of.itertuples(index=False))
        told.append(
            f"{method}, {distance:.2f} m: on the {of['problems'].sum()} problems that both solve it takes a "
            f"multiple of the seconds of {METHOD}, in the median {times}; with {of['n'].iloc[-1]} it holds "
            f"{of['memory_median'].iloc[-1]:.1f} times the memory."
        )
    return told


def _first_designs(method: str, of: pd.DataFrame) -> list[str]:
    """Return how good the designs are at which the clock stops: the first ones, of the largest size with any."""
    found = of[of["gap_median"].notna()]
    if found.empty:
        return []
    largest = found[found["n"] == found["n"].max()]
    low, high = (gap_percent(gap, decimals=1) for gap in (largest["gap_median"].min(), largest["gap_median"].max()))
    gaps = f"is {high}" if low == high else f"goes from {low} to {high} over the exposure settings"
    return [
        f"{method}: times are to the first design of a tree whose root turns freely, not to a good one: with "
        f"{largest['n'].iloc[0]} modules its median gap to the lower bound {gaps}."
    ]


def _success(whose: str, rows: pd.DataFrame) -> str:
    """Return how many problems of a series have a design."""
    solved, largest = rows["status"] == "feasible", rows["n"] == rows["n"].max()
    audited = rows["verdict"].notna()
    clear = f", {(rows['verdict'] == 'clear').sum()} of them with a clear audit" if audited.any() else ""
    return (
        f"{whose}: {solved.sum()} of {len(rows)} problems have a design{clear}; with {rows['n'].max()} modules "
        f"{(solved & largest).sum()} of {largest.sum()}."
    )


def figure(rows: pd.DataFrame) -> Figure:
    """Return the paper's plot: the distribution of times a size and exposure; below, the share with a design."""
    from matplotlib.figure import Figure

    from topo_search.experiments.distributions import draw, style

    panels = list(rows.groupby("distance_m"))
    drawn = Figure(figsize=(3.0 + 7.0 * len(panels), 6.4), layout="constrained")
    axes = drawn.subplots(2, len(panels), squeeze=False, sharex="col", sharey="row", height_ratios=(3, 1))
    for (upper, lower), (distance, of) in zip(axes.T, panels, strict=True):
        sizes = sorted(of["n"].unique())
        series = [
            (str(task) if method == METHOD else f"{task}, {method}", mine)
            for (method, task), mine in of.groupby(["method", "task"], sort=False)
        ]
        draw(upper, [(name, _solved_rows(mine)) for name, mine in series], "seconds", sizes)
        upper.set(xlabel="", title=f"connectors at {distance:.2f} m", yscale="log")
        for number, (name, mine) in enumerate(series):
            share = 100 * mine.groupby("n")["status"].agg(lambda status: (status == "feasible").mean())
            places = [sizes.index(n) + 0.08 * (number - (len(series) - 1) / 2) for n in share.index]
            lower.plot(places, share.to_numpy(), label=name, **style(number))
        lower.set(xlabel="modules $n$", ylim=(-5, 105))
        lower.grid(alpha=0.3)
    axes[0, 0].set_ylabel("CPU time to a design [s]")
    axes[1, 0].set_ylabel("with a design [%]")
    axes[0, 0].legend(handles=axes[1, 0].get_lines(), fontsize=8)
    drawn.suptitle("Ten wrenches, uniformly drawn topologies: boxes are quartiles, whiskers the whole range")
    return drawn


def _solved_rows(rows: pd.DataFrame) -> pd.DataFrame:
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
