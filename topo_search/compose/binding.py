"""From user input to what a run takes.

Own code and designs are checked, an airflow envelope that a task states by an air speed becomes a cone-sphere, and
solver, audit and bounds get the user's constraints and the processes that they run in.
"""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from typing import TypeVar, Unpack, get_args

import cloudpickle

import nlp
import verify
from topo_search.engine import Backends, CallingProcess, Certificates, DaskWorkers, Workers, computing_versions
from topo_search.engine.strategy import OwnSampler, SamplerFactory, TopologySampler
from topo_search.engine.workers import SolveOptions
from topo_search.limits import LIMITS
from topo_search.model import (
    Audit,
    BadInput,
    Design,
    Fault,
    Geometry,
    Infeasible,
    Module,
    ResolvedTask,
    Status,
    Task,
    Topology,
)
from topo_search.model.audit import SpeedEnvelope
from topo_search.model.module import RegionAirflow, Thrust
from topo_search.model.proven import lower_text, upper_text
from topo_search.protocols import (
    ConstraintExpression,
    Expression,
    OwnConstraint,
    SymbolicPlatform,
)
from topo_search.study import Observer, Sampler
from verify.air.envelope import Unreached, enclose

Item = TypeVar("Item")


@dataclass(frozen=True)
class Composed:
    """Solver and audit, given a user's constraints; the rod of every design's end-effector is bolted on."""

    constraints: tuple[OwnConstraint, ...] = ()

    def solve(self, task: ResolvedTask, topology: Topology, **options: Unpack[SolveOptions]) -> Design | Infeasible:
        """Solve one topology."""
        outcome = nlp.solve(task, topology, constraints=self.constraints, **options)
        return self._mount(task, outcome) if isinstance(outcome, Design) else outcome

    def local_optima(
        self, task: ResolvedTask, topology: Topology, *, most_effort: float, **options: Unpack[SolveOptions]
    ) -> list[Design]:
        """Find the local optima of one topology."""
        found = nlp.local_optima(task, topology, constraints=self.constraints, most_effort=most_effort, **options)
        return [self._mount(task, design) for design in found]

    def audit(self, geometry: Geometry) -> Audit:
        """Audit a design, and evaluate the constraints at the poses that the audit derives."""
        if not self.constraints:
            return verify.audit(geometry)
        from verify.kinematics import platform

        design = verify.complete(geometry)
        audited, at = verify.audit(design), platform(design)
        poses = {"orientations": at.poses.R, "centres": at.o, "end_effector": at.p_e}
        checks = nlp.check_user_constraints(self.constraints, design, **poses)
        names = {one.name for one in checks}
        missed = any(one.status == "missed" for one in checks)
        return audited.model_copy(
            update={
                "stated": (*checks, *(one for one in audited.stated if one.name not in names)),
                "verdict": Status.worst([audited.verdict, Status.VIOLATED if missed else Status.CLEAR]),
            }
        )

    def _mount(self, task: ResolvedTask, design: Design) -> Design:
        """Return a design of a task with its rod bolted on."""
        mount = verify.choose_mount(design)
        if task.end_effector.rod_mass == "ignored":
            return design.model_copy(update={"mount": mount})
        if mount not in (None, design.mount):
            # the solver counts a rod within its limits; where parts or airflow block it, another is bolted on
            design = nlp.move_rod(design, mount, self.constraints)
        # to the last digit the given task with that rod, by whatever rods the solver went
        return design.model_copy(update={"task": task.with_rod(design.task.end_effector.counted_rod)})


def backends(constraints: Sequence[OwnConstraint]) -> Backends:
    """Return solver, audit and bounds; own constraints are the business of the first two."""
    if not constraints:
        return BACKENDS
    own = Composed(tuple(constraints))
    return replace(BACKENDS, solve=own.solve, audit=own.audit, local_optima=own.local_optima)


_PLAIN = Composed()
BACKENDS = Backends(_PLAIN.solve, _PLAIN.audit, nlp.proven_bound, nlp.prove_impossible, _PLAIN.local_optima)


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
            raise BadInput("dask_tls", "certificates need the address of a Dask scheduler, in dask")
        return Workers(workers or available_cores())
    if workers is not None:
        raise BadInput("workers", "cannot be chosen with dask: all workers of the scheduler are used")
    same = {**computing_versions(), **versions}
    return DaskWorkers(dask, same, note=observer.note, certificates=certificates)


def processes(workers: int) -> Workers | CallingProcess:
    """Return a pool of this many worker processes; 0: the calling process, which crashes or hangs with a job."""
    return Workers(workers) if workers else CallingProcess()


def available_cores() -> int:
    """Return the number of cores that this process may use, at most the largest number of workers."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, LIMITS.workers)


AnySampler = Sampler | OwnSampler | SamplerFactory | TopologySampler
"""Samplers that `search` takes."""


def starting_points(near: Iterable[Design]) -> tuple[Design, ...]:
    """Return the designs to start from; BadInput for anything else, or too many."""
    return tuple(_items("near", near, Design, "designs", LIMITS.near))


def own_constraints(constraints: Iterable[OwnConstraint]) -> tuple[OwnConstraint, ...]:
    """Return own constraints as they can be sent to workers.

    Raises:
        BadInput: two have one name, one is no constraint or cannot be sent, or there are too many.
    """
    given = _items("constraints", constraints, OwnConstraint, "OwnConstraint", LIMITS.own_constraints)
    faults = list[Fault]()
    for k, one in enumerate(given):
        try:
            given[k] = _sendable(one)
        except (AttributeError, TypeError, pickle.PicklingError) as error:  # it refers to a file, a lock, ...
            how = "write it as a function at the top of a module, with `functools.partial` for its numbers"
            faults.append(Fault(one.name, f"cannot be sent to worker processes ({error}); {how}"))
    names = Counter(one.name for one in given)
    faults += [Fault(name, "must be the name of one constraint") for name, times in names.items() if times > 1]
    if faults:
        raise BadInput("constraints", faults)
    return tuple(given)


def _items(name: str, values: Iterable[Item], kind: type[Item], plural: str, most: int) -> list[Item]:
    """Return the values of a list of at most so many of a kind; BadInput for anything else."""
    if isinstance(values, kind | str) or not isinstance(values, Iterable):
        one = f"one {kind.__name__}: write it in brackets" if isinstance(values, kind) else type(values).__name__
        raise BadInput(name, f"must be a list of {plural}, but got {one}")
    items = list(islice(values, most + 1))
    if len(items) > most:
        raise BadInput(name, f"must be at most {most:,} {plural}, but got more")
    article = "an" if kind.__name__.startswith(tuple("AEIOU")) else "a"
    if faults := [
        Fault(f"[{k}]", f"must be {article} {kind.__name__}, but got {type(item).__name__}")
        for k, item in enumerate(items)
        if not isinstance(item, kind)
    ]:
        raise BadInput(name, faults)
    return items


@dataclass(frozen=True)
class ByValue:
    """An expression of a script, a notebook, a prompt or inside a function, which no other process imports."""

    content: bytes
    """It and all that it refers to there, pickled."""

    def __call__(self, platform: SymbolicPlatform, /) -> Expression:
        """Return what it returns."""
        return _expression(self.content)(platform)


@cache
def _expression(content: bytes) -> ConstraintExpression:
    expression: ConstraintExpression = pickle.loads(content)
    return expression


def _sendable(one: OwnConstraint) -> OwnConstraint:
    """Return a constraint with its expression by value if workers cannot import it."""
    with suppress(AttributeError, TypeError, pickle.PicklingError):
        if b"__main__" not in pickle.dumps(one.expression):
            return one
    return replace(one, expression=ByValue(cloudpickle.dumps(one.expression)))


def named_sampler(sampler: AnySampler) -> OwnSampler | None:
    """Return a user's own sampler with a name; None for one of ours."""
    if isinstance(sampler, str):
        return None
    if isinstance(sampler, OwnSampler):
        return sampler
    if callable(sampler):
        return OwnSampler(getattr(sampler, "__qualname__", type(sampler).__name__), sampler)
    if isinstance(sampler, TopologySampler):  # one without a state: the same for every seed
        return OwnSampler(type(sampler).__name__, lambda _: sampler)
    known = ", ".join(get_args(Sampler))
    rule = f"must be {known}, or make one for a seed, such as `lambda seed: {type(sampler).__name__}(seed=seed)`"
    raise ValueError(f"sampler {rule}, but got {sampler!r}")


def enclose_speed(task: Task) -> Task:
    """Return a task whose `module.airflow.speed` is replaced by its cone-sphere, in `module.airflow.regions`.

    Raises:
        BadInput: no air of one module is as fast, or the thrust at which it should be is beyond the rotors.
    """
    module, flow = task.module, task.module.airflow
    if flow.speed is None:
        return task
    envelope = envelope_of_speed(module, task.air_density, task.gravity, flow.speed, flow.at, source=task.name)
    regions = RegionAirflow(
        start_radius=envelope.start_radius_m, spread_angle_deg=envelope.spread_angle_deg, reach=envelope.reach_m
    )
    airflow = flow.model_copy(update={"speed": None, "at": "hover", "regions": regions})
    return task.model_copy(update={"module": module.model_copy(update={"airflow": airflow})})


def envelope_of_speed(
    module: Module, density: float, gravity: float, speed: float, at: Thrust, *, source: str
) -> SpeedEnvelope:
    """Return the cone-sphere of an air speed.

    Args:
        module: one module alone.
        density: rho [kg/m^3].
        gravity: g [m/s^2].
        speed: [m/s].
        at: the module's thrust.
        source: name of what states them.

    Raises:
        BadInput: see `enclose_speed`.
    """
    ratio = module.thrust_over_weight(at)
    if ratio > module.max_thrust_to_weight:
        rule = f"must be at most {module.max_thrust_to_weight:g} times the module's weight, but got {ratio:g}"
        raise BadInput(source, [Fault("module.airflow.at", rule)])
    thrust = ratio * module.mass * gravity
    where = f"{ratio:.4g} times the weight of a module, {thrust:.4g} N"
    try:
        return enclose(module, density, thrust, speed)
    except Unreached as error:
        most = f"{lower_text(error.bound.at_least, 4)} m/s (proven: at most {upper_text(error.bound.at_most, 4)})"
        rule = f"must be a speed that is reached; at {where}, that is up to {most}, but got {speed:g}"
    except ArithmeticError as error:
        rule = str(error)
    raise BadInput(source, [Fault("module.airflow.speed", rule)])
