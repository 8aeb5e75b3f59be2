"""One topology solved from many starts: a design, or the reason why there is none."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from importlib.metadata import version

import numpy as np

from nlp.bounds import bound_of, prove_impossible
from nlp.corners import judge, take_in_corners, without_corners
from nlp.evaluation import correct
from nlp.joints import rod_of
from nlp.numbers.point import Point, weigh_rod
from nlp.pseudo_inverse import pseudo_inverse_constraints
from nlp.reduced import REDUCED_UP_TO, reason_against
from nlp.start_result import StartResult
from nlp.starts.random_starts import draw, generator
from nlp.starts.warm_start import common_subtrees, warm_start
from nlp.user_constraints import UserConstraints
from topo_search.model import Design, Infeasible, Mount, ResolvedTask, Shortfall, SolverRecord, Task, Topology
from topo_search.model.corners import to_corners
from topo_search.protocols import OwnConstraint

UNTANGLED_STARTS = 24
"""Default number of starts per topology for the full Ipopt solver."""
REDUCED_STARTS = {5: 8, 9: 20, 12: 40, REDUCED_UP_TO: 48}
"""Default number of starts of the reduced search by most modules; `tests/benchmarks/reduced.py` compares them."""
SAME_EFFORT = 1e-4
"""Relative difference of the efforts of local optima that count as one."""


def default_starts(task: Task) -> int:
    """Return the default number of starts per topology of a task."""
    largest = max(task.sizes)
    if reason_against(task.resolve(largest)):
        return UNTANGLED_STARTS
    return next(starts for most, starts in REDUCED_STARTS.items() if largest <= most)


def prepare(task: Task, tell: Callable[[str], None]) -> None:
    """Compile what solving a task takes, so that no worker has to.

    `tell` is told if that takes a while, and why a task is solved without the reduced search. Where compiled code
    cannot be kept every process compiles for itself.
    """
    if reason := reason_against(task.resolve(max(task.sizes))):
        tell(f"without the reduced search: {reason}")
    least = task.resolve(min(task.sizes))
    if reason_against(least) is None:
        from nlp.multistart import compile_reduced

        compile_reduced(least, tell)


def solve(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    constraints: Sequence[OwnConstraint] = (),
) -> Design | Infeasible:
    """Return the best design of a topology over some starts, or the start that came closest to one.

    Each start is drawn from its index, whatever ran before it. What is proven to be impossible is not tried. Tasks
    that the reduced search expresses take it, where the best draws of all starts of a call go on; for others Ipopt
    solves the whole problem from every start. Where hinge angles come from a set, both do so with any angles, and
    combinations of the set are sought from where they end.

    Args:
        task: the task, resolved for `topology.n` modules.
        topology: the tree of modules.
        starts: indices of the starts to try; at least one, unless there is a design to carry over.
        seed: draws the starts, together with the task, the topology and the index.
        near: designs of other topologies, or of this one for another task, each carried over as one more start
            before the others. They count as the starts -1, -2, ...
        constraints: what a user states beyond the task; proofs of impossibility ignore it.

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
    again = partial(solve, topology=topology, starts=starts, seed=seed, near=near, constraints=constraints)
    request = _Request(task, topology, starts, seed, near, constraints)
    results = request.solve_starts()
    for k, source in enumerate(near):
        results[k] = _best([results[k], *request.carry_over(source, results[k].start)])
    light, results = _best(results), request.count_rods(results)
    best = _best(results)
    if light.worst.met and not best.worst.met and task.end_effector.counted_rod is None:
        # designs of a platform without the rod's mass have no room for it: search with it from the start
        return again(weigh_rod(light.point, rod_of(light.point)).task.declared)
    if not best.worst.met and (narrower := _within_usual_reach(task, best.point)):
        nearer = again(narrower)
        if isinstance(nearer, Design):
            best = _best([best, *request.count_rods(request.carry_over(nearer, best.start))])
            results = [best if one.start == best.start else one for one in results]
    return request.outcome(best, results)


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
    """Return every local optimum of a topology that starts reach and that costs little enough, the best first.

    Optima whose efforts agree are one: so are symmetric copies.

    Args:
        task: as of `solve`, and so is what follows.
        topology: the tree of modules.
        starts: indices of the starts to try.
        seed: draws the starts.
        near: designs that are carried over.
        constraints: what a user states beyond the task.
        most_effort: largest effort of a design [rad^4/s^4].
    """
    request = _Request(task, topology, starts, seed, near, constraints, most_effort)
    results = request.solve_starts()
    for k, source in enumerate(near):
        results += request.carry_over(source, -1 - k)
    results = request.count_rods(results)
    alike = list[list[StartResult]]()
    for one in sorted(results, key=lambda one: one.rank):
        if not one.worst.met or one.objective > most_effort:
            continue
        if alike and one.objective - alike[-1][0].objective <= SAME_EFFORT * one.objective:
            alike[-1].append(one)
        else:
            alike.append([one])
    outcomes = [request.outcome(same[0], same) for same in alike]
    return [outcome for outcome in outcomes if isinstance(outcome, Design)]


@dataclass(frozen=True)
class _Request:
    """Arguments of `solve` and `local_optima`, and the steps that both take."""

    task: ResolvedTask
    topology: Topology
    starts: range
    seed: int
    near: Sequence[Design]
    given: Sequence[OwnConstraint]
    most_effort: float | None = None
    began: float = field(default_factory=time.perf_counter)

    @cached_property
    def constraints(self) -> UserConstraints:
        """Constraints of the user, and of the task's allocator."""
        return (*self.given, *pseudo_inverse_constraints(self.task.declared))

    def outcome(self, best: StartResult, results: Sequence[StartResult]) -> Design | Infeasible:
        """Return what the best of some results stands for: a design with the shortest rod, or a shortfall."""
        task, shorter = best.point.task, None
        if best.worst.met and task.end_effector.rod == "straight" and task.end_effector.fixed_position is None:
            from nlp.shortest_rod import shorten_rod  # compiled code, which other commands need not load

            best, shorter = shorten_rod(best, self.constraints)
        corners = len(task.load_cases) - len(task.declared.load_cases)
        record = SolverRecord(
            status=best.result.status,
            iterations=best.result.iterations,
            seconds=time.perf_counter() - self.began,
            seed=self.seed,
            start=best.start,
            starts=len(results),
            starts_feasible=sum(one.worst.met for one in results),
            objectives=tuple(one.objective for one in results if one.worst.met),
            corners=corners or None,
            corners_active=len(frozenset[str]().union(*(one.corners for one in results))) if corners else None,
            shorter_rod=shorter,
            versions=_versions(),
        )
        return _design(best, record, self.given) if best.worst.met else _infeasible(results, best, record)

    def count_rods(self, results: list[StartResult]) -> list[StartResult]:
        """Return results with the mass of their rods, where the task counts it."""
        if self.task.end_effector.rod_mass == "ignored":
            return results
        from nlp.shortest_rod import count_rods  # compiled code, which other commands need not load

        return count_rods(results, self.constraints, self.most_effort)

    def carry_over(self, source: Design, start: int) -> list[StartResult]:
        """Return a design of the same tree that is one of this task too, and where it leads; else nothing.

        A descent at low prices may lose what it begins with; Ipopt begins with the design itself.
        """
        task, topology, constraints = to_corners(self.task), self.topology, self.constraints
        if len(common_subtrees(topology, source.topology)[0]) < max(topology.n, source.topology.n):
            return []
        plain = without_corners(task)
        point = warm_start(plain, topology, source=source, rng=generator(plain, topology, start, self.seed))
        point = correct(point, refit=True)
        kept = judge(task, start, point, "carried over", constraints)
        if not kept.worst.met:
            return []
        polished = take_in_corners(task, start, point, constraints)
        # a design of a task with a smaller margin is not as good as it looks: designs are judged without one
        comparable = source.task.search.margin >= task.search.margin or not polished.worst.met
        return [kept, polished] if comparable else [polished]

    def solve_starts(self) -> list[StartResult]:
        """Return the outcome of each start and each design carried over, judged by the task with its corners.

        With an effort it is all local optima that cost no more, if the reduced search expresses the task. Where
        hinge angles come from a set, starts end with any angles first.
        """
        free = to_corners(self.task.model_copy(update={"search": self.task.search.any_angle}))
        if reason_against(self.task):
            results = self._solve_whole_problem(free)
        else:
            from nlp.multistart import solve_starts  # compiled code, which other commands need not load

            results = solve_starts(
                free,
                self.topology,
                self.starts,
                self.seed,
                self.near,
                constraints=self.constraints,
                most_effort=self.most_effort,
            )
        if self.task.search.hinge_set_deg is None:
            return results
        from nlp.hinge_sets import solve_on_set  # compiled code, which other commands need not load

        return solve_on_set(to_corners(self.task), self.topology, results, self.constraints, self.most_effort)

    def _solve_whole_problem(self, task: ResolvedTask) -> list[StartResult]:
        """Return the results of Ipopt on the whole problem, from untangled starts."""
        plain, results = without_corners(task), []
        draws: list[tuple[int, Callable[..., Point]]]
        draws = [(-1 - k, partial(warm_start, source=source)) for k, source in enumerate(self.near)]
        draws += [(s, draw) for s in self.starts]
        for s, start in draws:
            origin = start(plain, self.topology, rng=generator(plain, self.topology, s, self.seed))
            results.append(take_in_corners(task, s, origin, self.constraints, rounds=True))
        return results


def _best(results: Iterable[StartResult]) -> StartResult:
    return min(results, key=lambda one: one.rank)


def hold_rod(design: Design, mount: Mount, constraints: Sequence[OwnConstraint] = ()) -> Design:
    """Solve again with the rod at another connector; return the design itself where that fails."""
    from nlp.shortest_rod import count_rod  # compiled code, which other commands need not load

    numbers = design.root_orientation_rad, design.hinge_angles_rad, design.end_effector_m, design.inputs
    point = Point(design.task, design.topology, *map(np.array, numbers))
    user_constraints = (*constraints, *pseudo_inverse_constraints(design.task))
    kept = judge(to_corners(design.task), 0, point, "held", user_constraints)
    held = count_rod(kept, user_constraints, (mount.module, mount.port))
    record = SolverRecord.model_validate(design.solver)
    return _design(held, record, constraints) if held.worst.met else design


def _within_usual_reach(task: ResolvedTask, closest: Point) -> ResolvedTask | None:
    """Return the task with its default reach if all descents left that, as they may where reach costs nothing."""
    usual = task.declared.end_effector.model_copy(update={"largest_reach": None})
    narrower = task.declared.model_copy(update={"end_effector": usual})
    reach, allowed = narrower.largest_reach(task.n), task.largest_reach(task.n)
    distance = np.linalg.norm(closest.p_E - closest.poses[1], axis=1).min() - task.module.connector_distance
    return narrower if reach is not None and reach < min(distance, allowed or np.inf) else None


def _design(best: StartResult, record: SolverRecord, constraints: Sequence[OwnConstraint]) -> Design:
    point, J = best.point, best.objective
    bound = bound_of(point.task, J)
    task = point.task.declared
    rod = task.end_effector.counted_rod
    inputs = point.u[: len(task.load_cases)].reshape(len(task.load_cases), -1)  # corners have none of their own
    return Design(
        task=task,
        topology=point.topology,
        topology_key=point.topology.key,
        root_orientation_rad=_vector(point.root),
        hinge_angles_rad=tuple(point.alpha.tolist()),
        end_effector_m=_vector(point.p_E),
        mount=rod and Mount(module=rod.module, port=rod.port),
        rotor_speeds_squared=tuple(tuple(u_k) for u_k in inputs.tolist()),
        objective=J,
        lower_bound=bound,
        gap=Design.gap_of(J, bound),
        stated=tuple(one.stated for one in constraints),
        solver=record.model_dump(mode="json"),
    )


def _infeasible(results: Sequence[StartResult], best: StartResult, record: SolverRecord) -> Infeasible:
    closest = Infeasible(
        topology=best.point.topology,
        topology_key=best.point.topology.key,
        status="infeasible",
        worst_constraint=best.worst.name,
        violation=best.worst.amount,
        unit=best.worst.unit,
        message="",
    )
    violations = (one.worst for one in results)
    shortfalls = (Shortfall(constraint=w.name, starts=1, violation=w.amount, unit=w.unit) for w in violations)
    return closest.with_starts(shortfalls, record)


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in ("topo-search", "casadi", "numpy")}
