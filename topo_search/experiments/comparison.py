"""One problem against another, tree by tree: what the difference costs, and how many trees it leaves a design.

A comparison has a reference and other variants. Efforts are compared over the trees that have a design under both;
where a variant has several rows of one tree, one for each of its roots, the best of them counts. Trees of random
wrenches each have their own, so that there is no best of them.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from topo_search.experiments.cell import Cell, Variant, plan
from topo_search.experiments.settings import Settings
from topo_search.model import Topology
from topo_search.model.proven import gap_percent
from topo_search.topologies import candidate_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PROBLEM = ["task", "distance_m", "n"]


@dataclass(frozen=True)
class Comparison:
    """Which problems are compared, and how to speak of them."""

    variants: tuple[Variant, ...]
    """The first is the reference."""
    title: str

    @property
    def names(self) -> list[str]:
        """The variants' names, the reference first."""
        return [variant.name for variant in self.variants]

    def cells(self, settings: Settings) -> list[Cell]:
        """Return the plan: every tree under all variants, from all starts."""
        return plan(settings, self.variants, first=False)

    def summary(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return one row a problem and variant.

        `effort_ratio`: J over that of the reference, over the trees with a design under both (`trees_compared`);
        `best_ratio`: the same of the best designs of all trees; `best_gap`: that design's gap to the lower bound.
        Trees with wrenches of their own have no best.
        """
        table = []
        for problem, of in rows.groupby(PROBLEM):
            trees = best_of_trees(of)
            reference = trees[self.names[0]] if self.names[0] in trees else pd.Series(dtype=float)
            for name in self.names:
                mine = of[of["variant"] == name]
                if mine.empty:
                    continue
                efforts = trees[name]
                ratio = (efforts / reference).dropna()
                same_task, best = bool(of["task_seed"].isna().all()), mine.nsmallest(1, "objective")
                table.append(
                    {
                        **dict(zip(PROBLEM, problem, strict=True)),
                        "variant": name,
                        "topologies": len(mine),
                        "share_solved": (mine["status"] == "feasible").mean(),
                        "share_clear": (mine["verdict"] == "clear").mean(),
                        "trees": mine["key"].map(tree_of).nunique(),
                        "trees_solved": int(efforts.notna().sum()),
                        "trees_compared": len(ratio),
                        "effort_ratio_median": ratio.median(),
                        "effort_ratio_max": ratio.max(),
                        "best_ratio": efforts.min() / reference.min() if same_task else math.nan,
                        "best_gap": best["gap"].min() if same_task else math.nan,
                        "gap_median": mine["gap"].median(),
                        "offset_median_m": mine["offset_m"].median(),
                    }
                )
        return pd.DataFrame(table)

    def findings(self, rows: pd.DataFrame) -> list[str]:
        """Return for each problem and variant what it costs."""
        told = []
        for (task, distance, n), of in self.summary(rows).groupby(PROBLEM):
            reference, *others = of.to_dict(orient="records")
            if reference["variant"] == self.names[0]:  # else it has no rows yet
                told += [f"{task}, {n} modules at {distance:.2f} m: {_cost(row, reference)}" for row in others]
        return told

    def figure(self, rows: pd.DataFrame) -> Figure:
        """Return ratios of effort and shares of trees with a design, a group of marks for each problem."""
        from matplotlib.figure import Figure

        table = self.summary(rows)
        problems = list(table.groupby(PROBLEM, sort=False))
        drawn = Figure(figsize=(8.0 + 1.6 * len(problems), 4.6), layout="constrained")
        effort, share = drawn.subplots(1, 2, sharex=True)
        _draw_efforts(effort, list(self._ratios(rows)), self.names)
        _draw_shares(share, table, self.names)
        labels = [f"{task}\n$n$ = {n}, {distance:.2f} m" for (task, distance, n), _ in problems]
        for axes in (effort, share):
            axes.set_xticks(range(len(problems)), labels, fontsize=7)
            axes.grid(axis="y", alpha=0.3)
            axes.set_xlabel("task")
        drawn.suptitle(self.title)
        return drawn

    def _ratios(self, rows: pd.DataFrame) -> Iterator[dict[str, pd.Series]]:
        """Yield the ratios of effort of every problem, in percent above the reference, by variant."""
        for _, of in rows.groupby(PROBLEM):
            trees = best_of_trees(of).reindex(columns=self.names)
            reference = trees[self.names[0]]
            yield {name: (100 * (trees[name] / reference - 1)).dropna() for name in self.names[1:]}


def best_of_trees(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the least effort of every tree (index) under every variant (columns); NaN where it has no design."""
    trees = rows.assign(tree=rows["key"].map(tree_of))
    return trees.groupby(["tree", "variant"])["objective"].min().unstack("variant")


def tree_of(key: str) -> str:
    """Return the key of a topology's tree, whichever module is its root."""
    return candidate_of(Topology.from_key(key)).key


def _cost(row: dict[Hashable, Any], reference: dict[Hashable, Any]) -> str:
    """Return in words what a variant costs."""
    name, other = row["variant"], reference["variant"]
    solved = (
        f"{name}: {row['trees_solved']} of {row['trees']} trees have a design, {other}: {reference['trees_solved']}"
    )
    if not row["trees_compared"]:
        return f"{solved}."
    both = (
        f"{solved}; where both have one, {name} takes {_percent(row['effort_ratio_median'])} effort in the median "
        f"({_percent(row['effort_ratio_max'])} at most)"
    )
    which = "gap_median" if pd.isna(row["best_ratio"]) else "best_gap"
    mine, others = (gap_percent(of[which], decimals=1) for of in (row, reference))
    if which == "gap_median":
        return f"{both}; median gap {mine}, {other}: {others}."
    return f"{both}; its best design takes {_percent(row['best_ratio'])}, gap {mine} instead of {others}."


def _percent(ratio: float) -> str:
    """Return by how many percent a ratio is above one."""
    return f"{round(ratio - 1, 3) + 0.0:+.1%}"  # adding zero turns -0.0 into 0.0


def _draw_efforts(axes: Axes, ratios: list[dict[str, pd.Series]], names: list[str]) -> None:
    """Draw every tree's ratio as a point, beside its problem."""
    from topo_search.export.palette import SERIES

    for number, name in enumerate(names[1:], start=1):
        places = [
            place + 0.8 * ((number - 0.5) / (len(names) - 1) - 0.5)
            for place, of in enumerate(ratios)
            for _ in of[name]
        ]
        values = [value for of in ratios for value in of[name]]
        axes.plot(places, values, "osD^"[number % 4], color=SERIES[number], alpha=0.5, label=name)
    axes.axhline(0.0, color="black", linewidth=1, label=names[0])
    axes.set(title="Effort of trees with a design under both", ylabel=f"effort J above {names[0]} [%]")
    axes.legend(fontsize=8)


def _draw_shares(axes: Axes, table: pd.DataFrame, names: list[str]) -> None:
    """Draw a bar for each problem and variant."""
    from topo_search.export.palette import SERIES

    width = 0.8 / len(names)
    places = table.groupby(PROBLEM).ngroup()
    for number, name in enumerate(names):
        of = table[table["variant"] == name]
        shares = 100 * of["trees_solved"] / of["trees"]
        axes.bar(
            places[of.index] + (number + 0.5) * width - 0.4, shares, 0.9 * width, color=SERIES[number], label=name
        )
    axes.set(title="Trees with a design", ylabel="share of all trees [%]", ylim=(0, 105))
    axes.legend(fontsize=8)
