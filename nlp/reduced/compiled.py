"""The compiled functions of the reduced search: made once an installation, and again after a change."""

from __future__ import annotations

from collections.abc import Callable

from nlp.reduced.arrays import to_arrays
from nlp.reduced.draws import draws
from nlp.reduced.search import descend_all, ends, point_of
from topo_search.model import ResolvedTask
from topo_search.model.compiled_code import is_kept
from topo_search.model.topology import straight_chain


def prepare(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile what the reduced search needs, unless that is kept and up to date.

    Args:
        task: a task that the reduced search expresses.
        tell: is told if it takes a while.
    """
    if not is_kept(descend_all):
        tell("compiling the solver (once per installation, about a minute)")
    tree = straight_chain(task.n)
    stated = to_arrays(task, tree)
    best, _ = ends(stated, draws(task, tree, stated, range(1), "compile"))
    point_of(task, tree, stated, best[0])
