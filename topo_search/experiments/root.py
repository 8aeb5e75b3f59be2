"""What the paper's root costs, whose two angles stay within a right angle, against a root that turns freely.

A free root makes all roots of a tree the same design; with the paper's a tree has to be tried with each of its
modules as the root. Every root gets as many starts as a tree with a free one, so that the paper's has n times more.
"""

from __future__ import annotations

from dataclasses import replace

from topo_search.experiments.cell import Cell, Variant
from topo_search.experiments.comparison import Comparison, tree_of
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings
from topo_search.topologies import candidates

PAPER_ROOT = Variant("paper root", ('search.root="paper"',))

COMPARISON = Comparison(
    (Variant("free root"), PAPER_ROOT),
    "What the paper's root costs: each point a tree, its best root compared with a free one",
)


def cells(settings: Settings) -> list[Cell]:
    """Return the plan: every tree with a free root, then with each of its modules as the paper's root."""
    planned, rooted = [], dict[int, dict[str, list[str]]]()
    for cell in COMPARISON.cells(settings):
        if cell.variant != PAPER_ROOT:
            planned.append(cell)
            continue
        if cell.n not in rooted:
            rooted[cell.n] = _roots(cell.n)
        planned += [replace(cell, key=key) for key in rooted[cell.n][cell.key]]
    return planned


def _roots(n: int) -> dict[str, list[str]]:
    """Return the keys of all rooted trees of n modules, by their trees."""
    roots: dict[str, list[str]] = {}
    for candidate in candidates(n, symmetry="none", root="paper"):
        roots.setdefault(tree_of(candidate.key), []).append(candidate.key)
    return roots


EXPERIMENT = Experiment(
    name="root",
    question="What does the paper's root cost, against one that turns freely?",
    full=Settings(tasks=(("push", (3, 4, 5)), ("push-exterior-60", (3, 4, 5))), topologies=(50, 10), starts=24),
    small=Settings(tasks=(("push", (3,)),), topologies=(4, 4), starts=2),
    cells=cells,
    summary=COMPARISON.summary,
    findings=COMPARISON.findings,
    figure=COMPARISON.figure,
)
