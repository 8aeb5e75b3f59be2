"""All local optima of one topology that its starts reach, up to an effort."""

from collections.abc import Sequence

from nlp.solving import Solve
from nlp.start_result import StartResult
from topo_search.model import Design, ResolvedTask, Topology
from topo_search.own_constraint import OwnConstraint

SAME_EFFORT = 1e-4
"""Relative difference in effort below which two local optima count as one."""


def local_optima(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
    most_effort: float,
) -> list[Design]:
    """Return the local optima of a topology that the starts reach, up to an effort, the best first.

    Optima of equal effort count as one, which also merges symmetric copies.

    Args:
        task: same as in `solve`, like all arguments but the last.
        topology: the tree of modules.
        starts: indices of the starts to try.
        seed: seeds the random starts.
        near: designs to carry over.
        constraints: the user's constraints beyond the task.
        most_effort: largest effort of a returned design [rad^4/s^4].
    """
    request = Solve(task, topology, starts, seed, near, constraints, most_effort)
    results = request.solve_starts()
    for k, source in enumerate(near):
        results += request.adopt(source, -1 - k)
    results = request.count_rods(results)
    groups = list[list[StartResult]]()
    for result in sorted(results, key=lambda result: result.rank):
        if not result.worst.met or result.objective > most_effort:
            continue
        if groups and result.objective - groups[-1][0].objective <= SAME_EFFORT * result.objective:
            groups[-1].append(result)
        else:
            groups.append([result])
    outcomes = [request.outcome(group[0], group) for group in groups]
    return [outcome for outcome in outcomes if isinstance(outcome, Design)]
