"""The compiled functions of the reduced search: made once an installation, and again after a change.

numba keeps a compiled function with the date of its own file, not of the files that it calls into: after a change
in one of them what is kept of the others would be used on. So what is kept is marked with a digest of all sources.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from nlp.reduced.draws import draws
from nlp.reduced.search import descents, ends, point_of
from nlp.reduced.stated import state
from topo_search.model import ResolvedTask, Topology
from topo_search.model.topology import ROOT

MARK = "reduced.sha256"
"""Beside what is kept: the digest of the sources that it was compiled from."""


def prepare(task: ResolvedTask, tell: Callable[[str], None]) -> None:
    """Compile what the reduced search needs, unless that is kept and up to date.

    Args:
        task: a task that the reduced search expresses.
        tell: is told if it takes a while.
    """
    sources = sorted(Path(__file__).parent.glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
    folder = Path(str(descents.stats.cache_path))
    mark = folder / MARK
    current = mark.exists() and mark.read_text() == digest
    if not current:
        for source in sources:
            for kept in folder.glob(f"{source.stem}.*.nb[ci]"):
                kept.unlink(missing_ok=True)
    if not any(folder.glob("search.descents*.nbc")):
        tell("compiling the solver, once an installation: about a minute")
    chain = Topology((ROOT, *((i, 0, 2) for i in range(task.n - 1))))
    stated = state(task, chain)
    best = ends(stated, draws(task, chain, stated, range(1), "compile"))
    point_of(task, chain, stated, best[0].x)
    if not current:
        mark.write_text(digest)
