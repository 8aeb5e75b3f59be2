"""What the paper's root costs, whose two angles stay within a right angle, against a root that turns freely.

A free root makes all roots of a tree the same design; with the paper's a tree has to be tried with each of its
modules as the root. Every root gets as many starts as a tree with a free one, so that the paper's has n times more.
"""

from __future__ import annotations

from dataclasses import replace

from topo_search.experiments.cell import Cell, Variant, cell_count, require_few
from topo_search.experiments.comparison import Comparison
from topo_search.experiments.conducting import Experiment
from topo_search.experiments.settings import Settings
from topo_search.topologies.rooted import Rooted, key_of, reroot, rooted_of, text_of, turn

PAPER_ROOT = Variant("paper root", ('search.root="paper"',))

COMPARISON = Comparison(
    (Variant("free root"), PAPER_ROOT),
    "What the paper's root costs: each point a tree, its best root compared with a free one",
)


def cells(settings: Settings) -> list[Cell]:
    """Return the plan: every tree with a free root, then with each of its modules as the paper's root.

    Raises:
        BadInput: there would be more than CELLS.
    """
    require_few(cell_count(settings, lambda n: 1 + n // 4))  # at least: half and quarter turns make some roots one
    rooted = []
    for cell in COMPARISON.cells(settings):
        keys = roots(cell.key) if cell.variant == PAPER_ROOT else [cell.key]
        rooted += [replace(cell, key=key) for key in keys]
        require_few(len(rooted))
    return rooted


def roots(key: str) -> list[str]:
    """Return the keys of a tree with each of its modules as the root, as it lies and after a half turn."""
    trees = rootings(rooted_of(key))
    return sorted({key_of(text_of(turn(tree, quarters))) for tree in trees for quarters in (0, 2)})


def rootings(tree: Rooted, entered: int | None = None) -> list[Rooted]:
    """Return an aligned tree with each of its modules as the root; none beyond the port where it was entered."""
    beyond = (port for port in range(4) if tree[port] and port != entered)
    return [tree, *(other for port in beyond for other in rootings(reroot(tree, port), (port + 2) % 4))]


EXPERIMENT = Experiment(
    name="root",
    question="What does the paper's root cost, compared with one that turns freely?",
    full=Settings(tasks=(("push", (3, 4, 5)), ("push-exterior-60", (3, 4, 5))), topologies=(50, 10), starts=24),
    small=Settings(tasks=(("push", (3,)),), topologies=(4, 4), starts=2),
    cells=cells,
    summary=COMPARISON.summary,
    findings=COMPARISON.findings,
    figure=COMPARISON.figure,
)
