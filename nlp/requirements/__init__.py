"""Every requirement of the inner problem, stated once.

| room | requirements | of the printed problem |
|---|---|---|
| `balances` | force and torque of every load case; limits of inputs, hinges and root | (2), (3), (10) |
| `modules` | airflow pairs, bodies, parts near airflow | (4), (5), (6) |
| `rod` | reach and path of the end-effector's rod | (7) |
| `exposure` | exclusion, the end-effector near airflow, every kind of exposure | (7) to (9) |

A requirement has the constraint's name, the modules, a smooth form for Ipopt, an exact value and a margin. The
printed problem (`nlp.problem`), its exact evaluation (`nlp.evaluation`), the assembled terms, the untangling of
starts and the rows of the reduced search are all built from these statements. The distances themselves are computed
by `nlp.symbols` (smooth), `nlp.numbers` (exact) and `nlp.reduced.clearance` (compiled).

To add a clearance, write a `Formula` (`statement`): its `local_vectors`, its smooth and exact forms, and its rows
of the compiled search; a row of a new kind also needs its distance in `nlp.reduced.clearance`. Then yield a
`Requirement` with it. A body that keeps out of a region at the end-effector is a `RegionClearance` (`exposure`) of
one of the `bodies` and one region. `tests/test_nlp_requirements.py` compares the forms.
"""

from functools import lru_cache

from nlp.requirements.balances import variable_bounds
from nlp.requirements.exposure import end_effector_clearances, exposure_clearances
from nlp.requirements.modules import module_clearances
from nlp.requirements.rod import rod_clearances
from nlp.requirements.statement import Formula, Requirement
from topo_search.model import ResolvedTask, Topology

__all__ = ["Formula", "Requirement", "clearances", "exposure_clearances", "variable_bounds"]


@lru_cache(maxsize=16)
def clearances(task: ResolvedTask, topology: Topology) -> tuple[Requirement, ...]:
    """Return (4) to (9) of the printed problem, in its order."""
    rod = rod_clearances(task, topology)
    return (*module_clearances(task, topology), *end_effector_clearances(task), *rod, *exposure_clearances(task))
