"""Solver, audit and bounds as the search takes them, with constraints of a user's own bound in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import nlp
import verify
from topo_search.engine import Backends
from topo_search.model import Audit, Design, Infeasible, ResolvedTask, Status, Topology
from topo_search.protocols import OwnConstraint


def solve_mounted(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
) -> Design | Infeasible:
    """Solve one topology, and choose where the rod of a design's end-effector is bolted."""
    outcome = nlp.solve(task, topology, starts=starts, seed=seed, near=near, constraints=constraints)
    return _mount(task, outcome, constraints) if isinstance(outcome, Design) else outcome


def _mount(task: ResolvedTask, design: Design, constraints: Sequence[OwnConstraint]) -> Design:
    """Return a design of a task with its rod bolted on."""
    mount = verify.choose_mount(design)
    if task.end_effector.rod_mass == "ignored":
        return design.model_copy(update={"mount": mount})
    if mount not in (None, design.mount):
        # the solver counts a rod within its limits; where parts or airflow block it, another is bolted on
        design = nlp.hold_rod(design, mount, constraints)
    # to the last digit the given task with that rod, by whatever rods the solver went
    return design.model_copy(update={"task": task.with_rod(design.task.end_effector.counted_rod)})


def local_optima_mounted(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    most_effort: float,
    constraints: Sequence[OwnConstraint] = (),
) -> list[Design]:
    """Find the local optima of one topology, and choose where the rod of each is bolted."""
    found = nlp.local_optima(
        task, topology, starts=starts, seed=seed, near=near, constraints=constraints, most_effort=most_effort
    )
    return [_mount(task, design, constraints) for design in found]


def audit_exactly(design: Design) -> Audit:
    """Audit a design; the audit and its libraries load with the first one."""
    return verify.audit(design)


def audit_stated(design: Design, *, constraints: Sequence[OwnConstraint]) -> Audit:
    """Audit a design, and evaluate own constraints at the poses that the audit derives."""
    from verify.kinematics import platform

    audited, at = verify.audit(design), platform(design)
    found = nlp.check_stated(constraints, design, orientations=at.poses.R, centres=at.o, end_effector=at.p_e)
    here = {one.name for one in found}
    missed = any(one.status == "missed" for one in found)
    return audited.model_copy(
        update={
            "stated": (*found, *(one for one in audited.stated if one.name not in here)),
            "verdict": Status.worst([audited.verdict, Status.VIOLATED if missed else Status.CLEAR]),
        }
    )


def backends(constraints: Sequence[OwnConstraint]) -> Backends:
    """Return solver, audit and bounds; own constraints are the business of the first two."""
    if not constraints:
        return BACKENDS
    given = tuple(constraints)
    return replace(
        BACKENDS,
        solve=partial(solve_mounted, constraints=given),
        audit=partial(audit_stated, constraints=given),
        local_optima=partial(local_optima_mounted, constraints=given),
    )


BACKENDS = Backends(
    solve=solve_mounted,
    audit=audit_exactly,
    lower_bound=nlp.proven_bound,
    prove_impossible=nlp.prove_impossible,
    local_optima=local_optima_mounted,
)
