"""One topology solved from many starts: a design, or the reason why there is none."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version

import numpy as np

from nlp.bounds import bound_of, prove_impossible
from nlp.evaluate import Violation, violations, worst
from nlp.finish import finish
from nlp.ipopt import Answer
from nlp.neighbour import carried_over
from nlp.point import Point
from nlp.program import Program, program
from nlp.starts import draw, generator
from topo_search.model import Design, Infeasible, ResolvedTask, Shortfall, SolverRecord, Topology
from topo_search.model.corners import cornered

DEFAULT_STARTS = 24
"""Starts a topology when nobody says otherwise."""


@dataclass(frozen=True)
class _Trial:
    """One start's outcome."""

    start: int
    answer: Answer
    point: Point
    worst: Violation
    objective: float

    @property
    def rank(self) -> tuple[bool, float, int]:
        """Feasible first, then the least objective or the least violation; the earlier start breaks ties."""
        met = self.worst.met
        return not met, self.objective if met else self.worst.rank, self.start


def solve(
    task: ResolvedTask, topology: Topology, *, starts: range, seed: int, near: Sequence[Design] = ()
) -> Design | Infeasible:
    """Return the best design of a topology over some starts, or the start that came closest to one.

    The program is built once. Starts are independent: the best of range(0, 8) and of range(8, 16) is the result
    of range(0, 16). What is proven to be impossible is not tried.

    Args:
        task: the task, resolved for `topology.n` modules.
        topology: the tree of modules.
        starts: indices of the starts to try; at least one, unless there is a design to carry over.
        seed: draws the starts, together with the task, the topology and the index.
        near: designs of other topologies, or of this one for another task, each carried over as one more start
            before the others. They count as the starts -1, -2, ...

    Raises:
        ValueError: no starts, or a task of another size.
        BoundBroken: a design undercuts the lower bound: a fault of the program, not of the task.
    """
    if task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    if not starts and not near:
        raise ValueError(f"`starts` must have at least one index, but got {starts}")
    if proof := prove_impossible(task, topology):
        return proof
    task, began = cornered(task), time.perf_counter()
    ready = program(task, topology)
    draws: list[tuple[int, Callable[..., Point]]]
    draws = [(-1 - k, partial(carried_over, donor=donor)) for k, donor in enumerate(near)]
    draws += [(s, draw) for s in starts]
    trials = [_trial(ready, start(task, topology, rng=generator(task, topology, s, seed)), s) for s, start in draws]
    best = min(trials, key=lambda trial: trial.rank)
    record = SolverRecord(
        status=best.answer.status,
        iterations=best.answer.iterations,
        seconds=time.perf_counter() - began,
        seed=seed,
        start=best.start,
        starts=len(trials),
        starts_feasible=sum(trial.worst.met for trial in trials),
        objectives=tuple(trial.objective for trial in trials if trial.worst.met),
        versions=_versions(),
    )
    return _design(best, record) if best.worst.met else _infeasible(trials, best, record)


def _trial(program: Program, start: Point, index: int) -> _Trial:
    answer = program.solve(start)
    # an evaluation that failed leaves no numbers behind: then the start itself is what was reached
    point = finish(answer.point) if np.all(np.isfinite(answer.point.pack())) else start
    return _Trial(index, answer, point, worst(violations(point)), point.objective)


def _design(best: _Trial, record: SolverRecord) -> Design:
    point, J = best.point, best.objective
    bound = bound_of(point.task, J)
    task = point.task.declared
    inputs = point.u[: len(task.load_cases)].reshape(len(task.load_cases), -1)  # corners have none of their own
    return Design(
        task=task,
        topology=point.topology,
        topology_key=point.topology.key,
        root_orientation_rad=_vector(point.root),
        hinge_angles_rad=tuple(point.alpha.tolist()),
        end_effector_m=_vector(point.p_E),
        rotor_speeds_squared=tuple(tuple(u_k) for u_k in inputs.tolist()),
        objective=J,
        lower_bound=bound,
        gap=Design.gap_of(J, bound),
        solver=record.model_dump(mode="json"),
    )


def _infeasible(trials: list[_Trial], best: _Trial, record: SolverRecord) -> Infeasible:
    closest = Infeasible(
        topology=best.point.topology,
        topology_key=best.point.topology.key,
        status="infeasible",
        worst_constraint=best.worst.name,
        violation=best.worst.amount,
        unit=best.worst.unit,
        message="",
    )
    return closest.with_starts((_shortfall(trial.worst) for trial in trials), record)


def _shortfall(worst: Violation) -> Shortfall:
    return Shortfall(constraint=worst.name, starts=1, violation=worst.amount, unit=worst.unit)


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in ("topo-search", "casadi", "numpy")}
