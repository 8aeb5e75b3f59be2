"""What becomes of the airflow when nothing keeps the envelopes apart (paper, Sec. IV, its ablation).

The airflow constraints are replaced by a minimum distance of module centres, `search.interference = "separation"`;
the exact audit then says how severely envelopes overlap, by the paper's three metrics: the depth of every colliding
pair, the largest cluster and the number of colliding pairs of every design. A depth is in percent of the deepest
overlap that two envelopes can have, twice the radius of their far end. A depth near 100 % means that the far ends
of two axes meet: axes that cross elsewhere overlap by as much as their radii there, 48 % at the modules themselves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.experiments.cell import Cell, Variant, plan
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SIZES = tuple(range(10, 101, 10))
REACHED = 95.0
"""Percent of the deepest overlap from which it counts as nearly reached."""
FULLY = 99.9
"""Percent of the deepest overlap from which it counts as reached."""
ABOUT_HALF = (0.4, 0.6)
"""Shares of the modules that count as about half."""
OFTEN = 0.25
"""Share of the designs from which on something happens often."""


def cells(settings: Settings) -> list[Cell]:
    """Return the plan."""
    return plan(settings, (Variant("separation", ('search.interference="separation"',)),), first=True)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row a distance, task and size: the paper's three metrics over all designs."""
    import pandas as pd

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


def findings(rows: pd.DataFrame) -> list[str]:
    """Return what overlaps, and whether the paper's three findings are confirmed."""
    from topo_search.experiments.power_law import fit

    designs = _designs(rows)
    if designs.empty:
        return ["No design was found."]
    deepest, depths, (low, high) = designs["deepest_percent"], _pairs(rows)["depth_percent"], ABOUT_HALF
    share = designs["cluster_share"]
    reached, fully = ((deepest >= depth).mean() for depth in (REACHED, FULLY))
    told = [
        f"{(designs['colliding_pairs'] > 0).mean():.0%} of {len(designs)} designs have overlapping airflow.",
        f"The deepest overlap reaches {REACHED:.0f} % of the deepest possible in {reached:.0%} of the designs and "
        f"{FULLY} % in {fully:.0%}; its median is {deepest.median():.0f} %, its least {deepest.min():.0f} %. That "
        f"the deepest possible is often reached, as the paper finds, is {_confirmation(reached >= OFTEN)} where "
        f"{REACHED:.0f} % counts as reached, and {_confirmation(fully >= OFTEN)} where {FULLY} % does.",
        f"The largest cluster holds {share.median():.0%} of the modules in the median; it is about half "
        f"({low:.0%} to {high:.0%}) of them in {share.between(low, high).mean():.0%} of the designs, "
        f"more in {(share > high).mean():.0%}. That clusters of about half of the modules, or more, are "
        f"frequent, as the paper finds, is {_confirmation((share >= low).mean() >= OFTEN)}.",
    ]
    if len(depths):
        told.append(
            f"Over all {len(depths)} colliding pairs the depth is {depths.median():.0f} % of the deepest possible "
            f"in the median; {(depths >= REACHED).mean():.0%} of them reach {REACHED:.0f} %."
        )
    pairs = designs.groupby("n")["colliding_pairs"].median()
    law = fit(designs["n"], designs["colliding_pairs"])
    if law is not None:
        told.append(
            f"The median number of colliding pairs goes from {pairs.iloc[0]:.0f} with {pairs.index[0]} modules to "
            f"{pairs.iloc[-1]:.0f} with {pairs.index[-1]}: it grows as n^{law.exponent:.1f}. That the number "
            f"grows with n, as the paper finds, is {_confirmation(law.exponent > 0)}."
        )
    return told


def _confirmation(holds: bool) -> str:
    return "confirmed" if holds else "not confirmed"


def figure(rows: pd.DataFrame) -> Figure:
    """Return the paper's plot: the distributions of the three metrics over the sizes."""
    from matplotlib.figure import Figure

    from topo_search.experiments.distributions import draw

    named = _designs(rows).groupby(["task", "distance_m"], sort=False)
    designs = [(f"{task}, {distance:.2f} m", of) for (task, distance), of in named]
    sizes = sorted(rows["n"].unique())
    drawn = Figure(figsize=(11.0, 7.6), layout="constrained")
    (depth, deepest), (cluster, number) = drawn.subplots(2, 2)
    draw(depth, [(name, _pairs(of)) for name, of in designs], "depth_percent", sizes)
    depth.set(title="Overlap of every colliding pair", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(deepest, designs, "deepest_percent", sizes)
    deepest.set(title="Deepest overlap of a design", ylabel="depth [% of the deepest possible]", ylim=(0, 105))
    draw(cluster, designs, "largest_cluster", sizes)
    cluster.plot(range(len(sizes)), [n / 2 for n in sizes], "k--", linewidth=1, label="$n/2$")
    cluster.set(title="Largest cluster of overlapping envelopes", ylabel="modules [-]")
    cluster.legend(fontsize=8)
    draw(number, designs, "colliding_pairs", sizes)
    number.set(title="Overlapping pairs of envelopes", ylabel="pairs [-]")
    drawn.suptitle(
        "Airflow constraints replaced by a minimum distance: boxes are quartiles, whiskers the whole range"
    )
    return drawn


def _designs(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with a design, with the share of modules in the largest cluster."""
    designs = rows[rows["status"] == "feasible"]
    return designs.assign(cluster_share=designs["largest_cluster"].astype("float64") / designs["n"])


def _pairs(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each colliding pair of all designs, with its depth."""
    pairs = rows.assign(depth_percent=rows["depths_percent"].str.split(" ")).explode("depth_percent")
    return pairs.dropna(subset="depth_percent").astype({"depth_percent": "float64"})


EXPERIMENT = Experiment(
    name="ablation",
    question="How severely does airflow interfere when only a minimum distance keeps modules apart?",
    full=Settings(tasks=(("ten-wrenches", SIZES),), topologies=(50, 10), starts=5),
    small=Settings(tasks=(("ten-wrenches", (3, 5)),), topologies=(3, 3), starts=2),
    cells=cells,
    summary=summary,
    findings=findings,
    figure=figure,
)
