"""The reduced search: `nlp.problem` over angles and end-effector only, with many cheap starts, compiled.

The rotor inputs are eliminated by duality (`inputs`) and clearances have closed forms (`clearance`). From every
random point (`nlp.starts.reduced_starts`) a descent on the augmented Lagrangian (`descent`) leads to a local
minimum. The best distinct minima (`search`) are close to designs, which Ipopt makes exact (`nlp.multistart`).
`tests/test_nlp_reduced.py` compares values and derivatives with the printed problem.
"""

from topo_search.model import ResolvedTask

REDUCED_UP_TO = 20
"""Largest number of modules for the reduced search; with more, starts are untangled and solved in rounds.

`tests/benchmarks/sampled.py --both` compares them: with 10, 12 and 20 modules it is as good in half the CPU time
or less; with 40 it misses designs that untangled starts find.
"""


def reason_against(task: ResolvedTask) -> str | None:
    """Return why the reduced search cannot express a task; None if it can."""
    if task.n > REDUCED_UP_TO:
        return f"more than {REDUCED_UP_TO} modules are untangled before they descend"
    if len(task.folds(task.search.margin)) != 1:
        return "hinges have no clear fold, or several, and no descent crosses from one to another"
    return None
