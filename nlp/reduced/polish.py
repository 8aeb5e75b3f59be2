"""From the ends of many cheap starts to points of the whole problem, made exact by Ipopt.

What the reduced search takes on is said by `reason_against`; a task that it does not express is left to others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlp.assembled import AssembledProgram
from nlp.evaluate import Violation, violations, worst
from nlp.finish import finish
from nlp.ipopt import Answer
from nlp.neighbour import carried_over
from nlp.point import Point
from nlp.reduced.draws import draws
from nlp.reduced.search import FIRST, SECOND, STIFF, End, Phase, ends, point_of
from nlp.reduced.stated import Stated, state
from nlp.starts import generator
from topo_search.model import Design, Local, ResolvedTask, Topology
from topo_search.model.arrays import Array

POLISHED = 2
"""Distinct ends that are polished; more of them as long as none has become a design."""
HOPED = 6
"""Most that are polished."""
ACCEPTED = 0.01
"""What an end may miss and is still polished before those that miss more [l_arm, m_t g, l_arm m_t g]."""
DEEP = 1000
"""Starts of the search that is made before a topology counts as infeasible."""


@dataclass(frozen=True)
class Polished:
    """A point of the whole problem that some starts led to."""

    point: Point
    worst: Violation
    answer: Answer
    starts: tuple[int, ...]
    """Their indices; those of designs carried over are negative, the deep search has none."""

    @property
    def rank(self) -> tuple[bool, float]:
        """Designs first, by effort; then the least violation."""
        return not self.worst.met, self.point.objective if self.worst.met else self.worst.rank


def reason_against(task: ResolvedTask) -> str | None:
    """Return why the reduced search does not express a task; None if it does."""
    if any(isinstance(asked, Local) and asked.radius is None for asked in task.exposure):
        return "boxes and other convex regions have no closed form here"
    if len(task.folds(task.search.margin)) != 1:
        return "hinges have no clear fold, or several between which no descent leads"
    return None


def polished(
    task: ResolvedTask, topology: Topology, *, starts: range, seed: int, near: Sequence[Design] = ()
) -> list[Polished]:
    """Return what the best distinct ends of some starts become.

    If that is no design, and start 0 is among the starts, many more are tried: so that this happens once however
    the starts are cut into ranges.

    Args:
        task: the task; `reason_against` must have none.
        topology: the tree.
        starts: indices of the starts.
        seed: draws them, with the task, the topology and the index.
        near: designs carried over, as the starts -1, -2, ...
    """
    stated, program = state(task, topology), AssembledProgram(task, topology)
    donors = [
        carried_over(task, topology, donor=donor, rng=generator(task, topology, -1 - k, seed))
        for k, donor in enumerate(near)
    ]
    N = len(stated.lower)
    given = np.array([donor.pack()[:N] for donor in donors]).reshape(-1, N)
    drawn = np.concatenate([given, draws(task, topology, stated, starts, f"{seed}")])
    indices = (*range(-1, -1 - len(donors), -1), *starts)
    found = _polish(task, topology, stated, program, drawn, indices)
    if 0 in starts and not any(end.worst.met for end in found):
        deep = draws(task, topology, stated, range(DEEP), f"{seed} deep", anyhow=True)
        found += _polish(task, topology, stated, program, deep, (), STIFF)
    return found


def _polish(
    task: ResolvedTask,
    topology: Topology,
    stated: Stated,
    program: AssembledProgram,
    drawn: Array,
    indices: tuple[int, ...],
    phases: tuple[Phase, Phase] = (FIRST, SECOND),
) -> list[Polished]:
    """Return what the best distinct ends of drawn starts become."""
    best, _ = ends(stated, drawn, phases)
    hopeful = sorted(best, key=lambda end: (end.missing > ACCEPTED, end.merit))
    found: list[Polished] = []
    for end in hopeful[:HOPED]:
        if len(found) >= POLISHED and any(other.worst.met for other in found):
            break
        found.append(_made_exact(program, point_of(task, topology, stated, end.x), end, indices))
    return found


def _made_exact(program: AssembledProgram, start: Point, end: End, indices: tuple[int, ...]) -> Polished:
    answer = program.polish(start)
    point = finish(answer.point) if np.all(np.isfinite(answer.point.pack())) else finish(start)
    return Polished(
        point, worst(violations(point)), answer, tuple(indices[s] for s in end.starts) if indices else ()
    )
