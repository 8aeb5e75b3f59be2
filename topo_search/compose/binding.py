"""Solver, audit and bounds as the search takes them, with a user's own constraints bound in, and where they run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Unpack

import nlp
import verify
from topo_search.engine import Backends, CallingProcess, Certificates, DaskWorkers, Workers, computing_versions
from topo_search.engine.jobs import Given
from topo_search.limits import WORKERS
from topo_search.model import Audit, BadInput, Design, Fault, Geometry, Infeasible, ResolvedTask, Status, Topology
from topo_search.protocols import OwnConstraint
from topo_search.study import Observer


def solve_mounted(
    task: ResolvedTask, topology: Topology, *, constraints: Sequence[OwnConstraint] = (), **given: Unpack[Given]
) -> Design | Infeasible:
    """Solve one topology, and choose where the rod of a design's end-effector is bolted."""
    outcome = nlp.solve(task, topology, constraints=constraints, **given)
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
    most_effort: float,
    constraints: Sequence[OwnConstraint] = (),
    **given: Unpack[Given],
) -> list[Design]:
    """Find the local optima of one topology, and choose where the rod of each is bolted."""
    found = nlp.local_optima(task, topology, constraints=constraints, most_effort=most_effort, **given)
    return [_mount(task, design, constraints) for design in found]


def audit_exactly(design: Geometry) -> Audit:
    """Audit a design; the audit and its libraries load with the first one."""
    return verify.audit(design)


def audit_stated(geometry: Geometry, *, constraints: Sequence[OwnConstraint]) -> Audit:
    """Audit a design, and evaluate own constraints at the poses that the audit derives."""
    from verify.kinematics import platform

    design = verify.complete(geometry)
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


def open_engine(
    workers: int | None,
    dask: str | None,
    certificates: Certificates | None,
    versions: Mapping[str, str],
    observer: Observer,
) -> Workers | DaskWorkers:
    """Return the workers; those of a scheduler must have the same versions of the libraries."""
    if dask is None:
        if certificates is not None:
            raise BadInput("dask_tls", [Fault("", "certificates need the address of a Dask scheduler, in dask")])
        return Workers(workers or available_cores())
    if workers is not None:
        raise BadInput("workers", [Fault("", "cannot be chosen with dask: all workers of the scheduler are used")])
    same = {**computing_versions(), **versions}
    return DaskWorkers(dask, same, note=observer.note, certificates=certificates)


def processes(workers: int) -> Workers | CallingProcess:
    """Return a pool of this many worker processes; 0: the calling process, which crashes or hangs with a job."""
    return Workers(workers) if workers else CallingProcess()


def available_cores() -> int:
    """Return the number of cores that this process may use, at most the largest number of workers."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, WORKERS)
