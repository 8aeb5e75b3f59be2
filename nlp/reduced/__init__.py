"""The problem of `nlp.problem` in the space of angles and end-effector alone: many cheap starts, compiled.

The rotor inputs are eliminated by their dual (`inputs`), clearances are exact (`clearance`), and a descent on the
augmented Lagrangian (`descent`) leads from every draw (`draws`) to an end. The best distinct ends
(`search`) lie next to designs, which Ipopt makes exact (`starts`). `tests/test_nlp_reduced.py` holds values and
derivatives to the printed problem. `reason_against` says for which
tasks all this stands.
"""

from __future__ import annotations

from topo_search.model import ResolvedTask

REDUCED_UP_TO = 20
"""Largest platform for which the reduced search leads; with more, starts are untangled and solved in rounds.

`tests/benchmarks/sampled.py --both` compares them: with 10, 12 and 20 modules it is as good in half the CPU time
or less; with 40 it misses designs that untangled starts find.
"""


def reason_against(task: ResolvedTask) -> str | None:
    """Return why the reduced search does not express a task; None if it does."""
    if task.n > REDUCED_UP_TO:
        return f"more than {REDUCED_UP_TO} modules are untangled before they descend"
    if len(task.folds(task.search.margin)) != 1:
        return "hinges have no clear fold, or several between which no descent leads"
    return None
