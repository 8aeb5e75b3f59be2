"""Comparisons of problem variants, tree by tree: their cost in effort, and in trees that still have a design.

A comparison has a reference and further variants. Efforts are compared over the trees that have a design under
both; if a variant has several rows for one tree, one for each of its roots, the best of them counts. With random
wrenches every tree has its own task, so no tree is the best.

- `placement`: an end-effector at the centre of mass, against one with an optimised position. At the centre of mass
  it must still keep its distance from every module's centre, so the platform needs a hole there; `com, inside
  allowed` drops that requirement (`end_effector.exclusion = false`), as if it could be inside a module. Exterior
  requirements cannot take part, as their cone has no axis there.
- `root`: the paper's root, with two angles within 90 degrees, against a root that turns freely. With a free root
  all roots of a tree give the same design; with the paper's, a tree is tried with each of its modules as the root.
  Every root gets as many starts as a tree with a free root, so the paper's variant gets n times as many.
- `body`: frames that keep clear of each other, against the paper's clearances, where only airflow keeps modules
  apart (`airflow only`, `search.body_clearance = false`). `body clearance` requires the default distance between
  the centres of modules that are not bolted together.
- `hinges`: hinge angles from a set, multiples of a step, against any angles.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import pandas as pd

from topo_search.experiments.study import AIRFLOW_ALONE, Settings, Study, Variant
from topo_search.export import TWO_COLUMNS, palette
from topo_search.model import Topology
from topo_search.topologies import candidate_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PROBLEM = ["task", "distance_m", "n"]
Tasks = tuple[tuple[str, tuple[int, ...]], ...]
"""Shipped examples with their numbers of modules."""


def comparison(name: str, question: str, title: str, tasks: Tasks, variants: tuple[Variant, ...]) -> Study:
    """Return the study that solves every tree under all variants; the first variant is the reference."""
    names = [variant.name for variant in variants]
    return Study(
        name=name,
        question=question,
        full=Settings(tasks, topologies=(50, 10), starts=24),
        small=Settings(tasks=(("push", (3,)),), topologies=(4, 4), starts=2),
        variants=variants,
        first=False,
        summary=partial(summary, names=names),
        figure=partial(figure, names=names, title=title),
    )


def summary(rows: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Return one row per problem and variant.

    `effort_ratio`: J over J of the reference, for trees with a design under both (`trees_compared`); `best_ratio`:
    the same for the best design of all trees; `best_gap`: gap of that design to the lower bound. The latter two are
    NaN if every tree has its own wrenches.
    """
    table = []
    for problem, group in rows.groupby(PROBLEM):
        best = best_of_trees(group, names)
        same_task = 1.0 if group["task_seed"].isna().all() else math.nan
        for name in names:
            solved, efforts = group[group["variant"] == name], best[name]
            if solved.empty:
                continue
            ratio = (efforts / best[names[0]]).dropna()
            row = {
                **dict(zip(PROBLEM, problem, strict=True)),
                "variant": name,
                "topologies": len(solved),
                "share_solved": (solved["status"] == "feasible").mean(),
                "share_clear": (solved["verdict"] == "clear").mean(),
                "trees": solved["key"].map(tree_of).nunique(),
                "trees_solved": int(efforts.notna().sum()),
                "trees_compared": len(ratio),
                "effort_ratio_median": ratio.median(),
                "effort_ratio_max": ratio.max(),
                "best_ratio": same_task * efforts.min() / best[names[0]].min(),
                "best_gap": same_task * solved.nsmallest(1, "objective")["gap"].min(),
                "gap_median": solved["gap"].median(),
                "offset_median_m": solved["offset_m"].median(),
            }
            table.append(row)
    return pd.DataFrame(table)


def figure(rows: pd.DataFrame, names: list[str], title: str) -> Figure:
    """Plot the ratios of effort, one point per tree, and the shares of trees with a design, as bars."""
    from matplotlib.figure import Figure

    table, problems = summary(rows, names), list(rows.groupby(PROBLEM))
    figure = Figure(figsize=(TWO_COLUMNS, 3.2), layout="constrained")
    effort, share = figure.subplots(1, 2, sharex=True)
    width = 0.8 / len(names)
    for number, name in enumerate(names):
        look = {"color": palette.SERIES[number], "label": name}
        places = [place + (number + 0.5) * width - 0.4 for place in range(len(problems))]
        efforts = [best_of_trees(group, names) for _, group in problems]
        above = [(100 * (best[name] / best[names[0]] - 1)).dropna() for best in efforts]
        points = [(place, value) for place, values in zip(places, above, strict=True) for value in values]
        effort.plot([x for x, _ in points], [y for _, y in points], "osD^v<"[number], alpha=0.5, **look)
        shown = table[table["variant"] == name].set_index(PROBLEM).reindex([problem for problem, _ in problems])
        share.bar(places, 100 * shown["trees_solved"] / shown["trees"], 0.9 * width, **look)
    effort.set(title="Effort of trees with a design under both", ylabel=f"effort J above {names[0]} [%]")
    share.set(title="Trees with a design", ylabel="share of all trees [%]", ylim=(0, 105))
    labels = [f"{task}\n$n$ = {n}, {distance:.2f} m" for (task, distance, n), _ in problems]
    for axes in (effort, share):
        axes.legend()
        axes.set_xticks(range(len(problems)), labels)
        axes.grid(axis="y", alpha=0.3)
        axes.set_xlabel("task")
    figure.suptitle(title)
    return figure


def best_of_trees(rows: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Return the least effort of every tree (index) under every variant (columns); NaN where it has no design."""
    trees = rows["key"].map(tree_of).rename("tree")
    return rows.groupby([trees, "variant"])["objective"].min().unstack("variant").reindex(columns=names)


def tree_of(key: str) -> str:
    """Return the key of a topology's tree, whichever module is its root."""
    return candidate_of(Topology.from_key(key)).key


INSIDE = "end_effector.exclusion=false"
AT_COM = 'end_effector.position="com"'
COMPARISONS = (
    comparison(
        "placement",
        "What does an end-effector at the centre of mass cost, compared with an optimised position?",
        "What an end-effector at the centre of mass costs: each point a tree, compared with itself",
        (("push", (5,)), ("push-local", (5,)), ("push-directional", (5,)), ("ten-wrenches", (10, 20))),
        (Variant("free"), Variant("com", (AT_COM,)), Variant("com, inside allowed", (AT_COM, INSIDE))),
    ),
    comparison(
        "body",
        "What does it cost to keep frames apart?",
        "What body clearance costs: each point a tree, compared with itself",
        (
            *((f"push{kind}", (5,)) for kind in ("", "-local", "-directional", "-exterior-60")),
            ("ten-wrenches", (10, 20)),
        ),
        (Variant("airflow only", (AIRFLOW_ALONE,)), Variant("body clearance")),
    ),
    comparison(
        "hinges",
        "What do hinge angles from a set cost, compared with any angles?",
        "What hinge angles from a set cost: each point a tree, compared with itself",
        tuple((task, (3, 4, 5, 6)) for task in ("push", "push-local", "wall-push")),
        (
            Variant("free"),
            *(Variant(f"{step} deg", (f"search.hinge_step_deg={step}",)) for step in (5, 10, 15, 30, 45)),
        ),
    ),
    comparison(
        "root",
        "What does the paper's root cost, compared with one that turns freely?",
        "What the paper's root costs: each point a tree, its best root compared with a free one",
        (("push", (3, 4, 5)), ("push-exterior-60", (3, 4, 5))),
        (Variant("free root"), Variant("paper root", ('search.root="paper"',), every_root=True)),
    ),
)
