"""The compiled functions of the reduced search: made once an installation, and again after a change."""

from __future__ import annotations

from collections.abc import Callable

from nlp.reduced.arrays import to_arrays
from nlp.reduced.draws import draws
from nlp.reduced.search import descend_all, ends, point_of
from topo_search.model import ResolvedTask, Topology
from topo_search.model.compiled_code import cache_folder
from topo_search.model.topology import ROOT


def prepare(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile what the reduced search needs, unless that is kept and up to date.

    Args:
        task: a task that the reduced search expresses.
        tell: is told if it takes a while.
    """
    if not any(cache_folder(descend_all).glob("search.descend_all*.nbc")):
        tell("compiling the solver (once per installation, about a minute)")
    chain = Topology((ROOT, *((i, 0, 2) for i in range(task.n - 1))))
    stated = to_arrays(task, chain)
    best, _ = ends(stated, draws(task, chain, stated, range(1), "compile"))
    point_of(task, chain, stated, best[0])
