"""Preparation of a run: checks of user input, backends with the user's constraints, and worker processes.

The user's code and designs are checked, and an airflow envelope given by an air speed becomes a cone-sphere.
"""

import math
import os
import pickle
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, get_args

import nlp
import verify
from topo_search.compose.maximizing import MostCapable
from topo_search.engine import Backends, CallingProcess, DaskWorkers, Job, Workers
from topo_search.engine.own_sampler import OwnSampler, TopologySampler
from topo_search.engine.strategy import SamplerFactory
from topo_search.limits import LIMITS
from topo_search.model import Audit, Design, Geometry, Infeasible, Module, ResolvedTask, Status, Task
from topo_search.model.air import SpeedEnvelope
from topo_search.model.airflow import RegionAirflow, Thrust
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import BadInput, Fault
from topo_search.own_constraint import ConstraintExpression, Expression, OwnConstraint, SymbolicPlatform
from topo_search.study import Observer, Sampler
from verify.air.envelope import Unreached, enclose

Item = TypeVar("Item")


@dataclass(frozen=True)
class SolverAndAudit:
    """Solver and audit with a user's constraints; every design gets the rod of its end-effector mounted."""

    constraints: tuple[OwnConstraint, ...] = ()

    def solve(self, job: Job) -> Design | Infeasible:
        """Solve one topology, with the mass of all its joints."""
        job = _on_its_tree(job)
        if job.task.search.maximize is not None:
            return MostCapable(job, self._solve, self.local_optima, self.audit, self.constraints).best()
        return self._solve(job)

    def _solve(self, job: Job) -> Design | Infeasible:
        outcome = nlp.solve(job.task, job.topology, **self._options(job))
        return self.mount_rod(job.task, outcome) if isinstance(outcome, Design) else outcome

    def local_optima(self, job: Job, max_effort: float) -> list[Design]:
        """Find the local optima of one topology."""
        job = _on_its_tree(job)
        designs = nlp.local_optima(job.task, job.topology, most_effort=max_effort, **self._options(job))
        return [self.mount_rod(job.task, design) for design in designs]

    def audit(self, geometry: Geometry) -> Audit:
        """Audit a design, and evaluate the user's constraints at the poses that the audit computes."""
        if not self.constraints:
            return verify.audit(geometry)
        from verify import kinematics

        design = verify.complete(geometry)
        audited, platform = verify.audit(design), kinematics.platform(design)
        poses = {"orientations": platform.poses.R, "centres": platform.o, "end_effector": platform.p_e}
        checks = nlp.check_user_constraints(self.constraints, design, **poses)
        names = {check.name for check in checks}
        missed = any(check.status == "missed" for check in checks)
        judged = {
            "stated": (*checks, *(check for check in audited.stated if check.name not in names)),
            "verdict": Status.worst([audited.verdict, Status.VIOLATED if missed else Status.CLEAR]),
        }
        return audited.model_copy(update=judged)

    def _options(self, job: Job) -> dict[str, Any]:
        return {"starts": job.starts, "seed": job.seed, "near": job.near, "constraints": self.constraints}

    def mount_rod(self, task: ResolvedTask, design: Design) -> Design:
        """Return a design with its rod at the best mount, for a task with that rod."""
        mount, ignored = verify.choose_mount(design), task.end_effector.rod_mass == "ignored"
        if mount not in (None, design.mount) and not (ignored and task.rod_axis is None):
            # the solver assumes a rod within its limits; if parts or airflow block that, another one is mounted
            design = nlp.move_rod(design, mount, self.constraints)
        if ignored:
            return design.model_copy(update={"mount": mount, "task": task})
        # the given task to the last digit, with that rod, whatever rods the solver tried
        return design.model_copy(update={"task": task.with_rod(design.task.end_effector.counted_rod)})


def _on_its_tree(job: Job) -> Job:
    return replace(job, task=job.task.on(job.topology))


def backends(constraints: Sequence[OwnConstraint]) -> Backends:
    """Return solver, audit and bounds; constraints affect only the first two."""
    if not constraints:
        return BACKENDS
    both = SolverAndAudit(tuple(constraints))
    return replace(BACKENDS, solve=both.solve, audit=both.audit, local_optima=both.local_optima)


def proven_bound(task: ResolvedTask) -> float:
    """Return a lower bound of the effort for this size, or an upper bound of the maximised value."""
    return nlp.proven_bound(task) if task.search.maximize is None else nlp.largest_value(task)


_PLAIN = SolverAndAudit()


def solve_near(design: Design, task: ResolvedTask) -> Design | Infeasible | None:
    """Return the result of `nlp.solve_near`, a design with a mount for its rod and the given design's task."""
    outcome = nlp.solve_near(design, task)
    if not isinstance(outcome, Design):
        return outcome
    mounted = _PLAIN.mount_rod(design.task, outcome)
    return mounted.model_copy(update={"stated": design.stated})


BACKENDS = Backends(_PLAIN.solve, _PLAIN.audit, proven_bound, nlp.prove_impossible, _PLAIN.local_optima)


def open_engine(workers: int | None, dask: str | None, observer: Observer) -> Workers | DaskWorkers:
    """Return local workers, or those of a Dask scheduler."""
    if dask is None:
        return Workers(workers or available_cores())
    if workers is not None:
        raise BadInput("workers", "cannot be chosen with dask: all workers of the scheduler are used")
    return DaskWorkers(dask, note=observer.note)


def processes(workers: int) -> Workers | CallingProcess:
    """Return a pool of worker processes; for 0 the calling process, which crashes or hangs with its job."""
    return Workers(workers) if workers else CallingProcess()


def available_cores() -> int:
    """Return the number of cores that this process may use, at most the largest number of workers."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return math.ceil(min(cores, LIMITS.workers, cpu_quota(Path("/"))))


def cpu_quota(root: Path) -> float:
    """Return the number of cores whose CPU time this process may use, as a container limits it.

    The limits are those of its control group and the groups above (Linux, cgroups(7), version 2).

    Args:
        root: root of the file system.
    """
    quota, member = math.inf, root / "proc/self/cgroup"
    for line in member.read_text().splitlines() if member.exists() else ():
        group = root / "sys/fs/cgroup" / line.removeprefix("0::/")
        for folder in (group, *group.parents) if line.startswith("0::/") else ():
            with suppress(OSError):
                limit, period = (folder / "cpu.max").read_text().split()
                quota = min(quota, math.inf if limit == "max" else int(limit) / int(period))
    return quota


AnySampler = Sampler | OwnSampler | SamplerFactory | TopologySampler
"""Samplers that `search` accepts."""


def starting_points(near: Iterable[Design]) -> tuple[Design, ...]:
    """Return the designs to start from; BadInput if there are too many, or items of another type."""
    return tuple(_items("near", near, Design, "designs", LIMITS.near))


def own_constraints(constraints: Iterable[OwnConstraint]) -> tuple[OwnConstraint, ...]:
    """Return a user's constraints in a form that can be sent to workers.

    Raises:
        BadInput: two have the same name, one is not an OwnConstraint or cannot be sent, or there are too many.
    """
    checked = _items("constraints", constraints, OwnConstraint, "OwnConstraint", LIMITS.own_constraints)
    faults = list[Fault]()
    for k, constraint in enumerate(checked):
        try:
            checked[k] = _sendable(constraint)
        except (AttributeError, TypeError, pickle.PicklingError) as error:  # it refers to a file, a lock, ...
            remedy = "write it as a function at the top of a module, with `functools.partial` for its numbers"
            faults.append(Fault(constraint.name, f"cannot be sent to worker processes ({error}); {remedy}"))
    names = Counter(constraint.name for constraint in checked)
    faults += [Fault(name, "must be the name of one constraint") for name, times in names.items() if times > 1]
    if faults:
        raise BadInput("constraints", faults)
    return tuple(checked)


def _items(name: str, values: Iterable[Item], kind: type[Item], plural: str, largest: int) -> list[Item]:
    """Return the items of a list; BadInput if there are more than `largest`, or items of another type."""
    items = list(islice(values, largest + 1))
    if len(items) > largest:
        raise BadInput(name, f"must be at most {largest:,} {plural}, but got more")
    wrong = ((k, type(item).__name__) for k, item in enumerate(items) if not isinstance(item, kind))
    if faults := [Fault(f"[{k}]", f"must be of the type {kind.__name__}, but got {got}") for k, got in wrong]:
        raise BadInput(name, faults)
    return items


@dataclass(frozen=True)
class ByValue:
    """An expression that workers cannot import, from a script, a notebook, a prompt or the body of a function."""

    content: bytes
    """The pickled expression, with everything there that it refers to."""

    def __call__(self, platform: SymbolicPlatform, /) -> Expression:
        """Return the value of the expression."""
        return _expression(self.content)(platform)


@cache
def _expression(content: bytes) -> ConstraintExpression:
    expression: ConstraintExpression = pickle.loads(content)
    return expression


def _sendable(constraint: OwnConstraint) -> OwnConstraint:
    """Return a constraint whose expression is pickled by value if workers cannot import it."""
    with suppress(AttributeError, TypeError, pickle.PicklingError):
        if b"__main__" not in pickle.dumps(constraint.expression):
            return constraint
    import cloudpickle  # slow to import, and few runs have constraints

    return replace(constraint, expression=ByValue(cloudpickle.dumps(constraint.expression)))


def named_sampler(sampler: AnySampler) -> OwnSampler | None:
    """Return a user's sampler with a name; None for a built-in one."""
    if isinstance(sampler, str):
        return None
    if isinstance(sampler, OwnSampler):
        return sampler
    if callable(sampler):
        return OwnSampler(getattr(sampler, "__qualname__", type(sampler).__name__), sampler)
    if isinstance(sampler, TopologySampler):  # without state: the same for every seed
        return OwnSampler(type(sampler).__name__, lambda _: sampler)
    names = ", ".join(get_args(Sampler))
    rule = f"must be {names}, or make one for a seed, such as `lambda seed: {type(sampler).__name__}(seed=seed)`"
    raise ValueError(f"sampler {rule}, but got {sampler!r}")


def enclose_speed(task: Task) -> Task:
    """Return a task whose `airflow.speed` is replaced by its cone-sphere, in `airflow.regions`, for each module.

    Raises:
        BadInput: no air of one module is that fast, or the rotors cannot produce the thrust `at`.
    """

    def enclose(module: Module, path: str = "module") -> Module:
        flow, speed = module.airflow, module.airflow.speed
        if speed is None:
            return module
        changed: dict[str, Any] = {"speed": None, "at": "hover"}
        if module.rotor_table.count:
            numbers = task.air_density, task.gravity, speed, flow.at
            air = envelope_of_speed(module, *numbers, source=task.name, path=path)
            sizes = {"start_radius": air.start_radius_m, "reach": air.reach_m}
            changed["regions"] = RegionAirflow(spread_angle_deg=air.spread_angle_deg, **sizes)
        return module.model_copy(update={"airflow": flow.model_copy(update=changed)})

    types = tuple(enclose(kind, f"module_types[{k}]") for k, kind in enumerate(task.module_types))
    return task.model_copy(update={"module": enclose(task.module), "module_types": types})


def envelope_of_speed(
    module: Module, density: float, gravity: float, speed: float, at: Thrust, *, source: str, path: str = "module"
) -> SpeedEnvelope:
    """Return the smallest cone-sphere around all air of one module that is at least as fast as a speed.

    Args:
        module: the module, alone in free air.
        density: rho, density of air [kg/m^3].
        gravity: g [m/s^2].
        speed: air speed [m/s].
        at: thrust of the module.
        source: file or option that faults name.
        path: table of the module there.

    Raises:
        BadInput: see `enclose_speed`.
    """
    ratio = module.thrust_over_weight(at)
    if ratio > module.max_thrust_to_weight:
        rule = f"must be at most {module.max_thrust_to_weight:g} times the module's weight, but got {ratio:g}"
        raise BadInput(source, [Fault(f"{path}.airflow.at", rule)])
    thrust = ratio * module.mass * gravity
    thrust_text = f"{ratio:.4g} times the weight of a module, {thrust:.4g} N"
    try:
        return enclose(module, density, thrust, speed)
    except Unreached as error:
        low, high = lower_text(error.bound.at_least, 4), upper_text(error.bound.at_most, 4)
        reached = f"up to {low} m/s (proven: at most {high})"
        rule = f"must be a speed that is reached; at {thrust_text}, that is {reached}, but got {speed:g}"
    except ArithmeticError as error:
        rule = str(error)
    raise BadInput(source, [Fault(f"{path}.airflow.speed", rule)])
