"""Solving one topology from many starts: a design, or the reason why there is none."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from importlib.metadata import version
from typing import Any

import numpy as np

from nlp.bounds import bound_of
from nlp.evaluation import correct
from nlp.features import prove_impossible, pseudo_inverse_constraints
from nlp.lazy_solve import judge, solve_lazily, without_corners
from nlp.numbers.point import Point, weigh_rod
from nlp.reduced import REDUCED_UP_TO, reason_against
from nlp.requirements.bodies import divide
from nlp.requirements.rod import rod_of
from nlp.rows import UserConstraints
from nlp.start_result import StartResult
from nlp.starts.random_starts import draw, generator
from nlp.starts.warm_start import common_subtrees, warm_start
from topo_search.model import Design, Geometry, Infeasible, Mount, ResolvedTask, Task, Topology
from topo_search.model.corners import to_corners
from topo_search.model.design import Shortfall, SolverRecord

UNTANGLED_STARTS = 24
"""Default number of starts per topology for the full Ipopt solver."""
REDUCED_STARTS = {5: 8, 9: 20, 12: 40, REDUCED_UP_TO: 48}
"""Default number of starts of the reduced search, by upper limit of modules; see `tests/benchmarks/reduced.py`."""


def default_starts(task: Task) -> int:
    """Return the default number of starts per topology of a task."""
    largest = max(task.sizes)
    if reason_against(task.resolve(largest)):
        return UNTANGLED_STARTS
    return next(starts for up_to, starts in REDUCED_STARTS.items() if largest <= up_to)


def prepare(task: Task, tell: Callable[[str], None]) -> None:
    """Compile the solver for a task, so that no worker has to.

    `tell` is called with a message if compiling takes long, and with the reason if the reduced search does not
    apply. If compiled code cannot be cached, every process compiles its own.
    """
    if reason := reason_against(task.resolve(max(task.sizes))):
        tell(f"without the reduced search: {reason}")
    smallest = task.resolve(min(task.sizes))
    if reason_against(smallest) is None:
        from nlp.multistart import compile_reduced

        compile_reduced(smallest, tell)


def solve(
    task: ResolvedTask,
    topology: Topology,
    *,
    starts: range,
    seed: int,
    near: Sequence[Design] = (),
    constraints: UserConstraints = (),
) -> Design | Infeasible:
    """Return the best design of a topology over some starts, or the start that came closest to one.

    The random points of a start depend on its index alone, not on what ran before it. A topology that is proven
    impossible is not tried. The reduced search is used if it can express the task; it compares the random points of
    all starts of a call and continues from the best. Otherwise Ipopt solves the full problem from every start. If
    hinge angles come from a set, both first solve with free angles, then combinations of the set near their results
    are tried.

    Args:
        task: the task, resolved for `topology.n` modules.
        topology: the tree of modules.
        starts: indices of the starts to try; at least one, unless there is a design to carry over.
        seed: seeds the random starts, together with the task, the topology and the index.
        near: designs of other topologies, or of this one for another task. Each is carried over as one more start,
            before the others: the starts -1, -2, ...
        constraints: the user's constraints beyond the task; proofs of impossibility ignore them.

    Raises:
        ValueError: no starts, or the task has another number of modules.
        BoundBroken: a design undercuts the lower bound: a bug of the program, not a fault of the task.
    """
    if task.n != topology.n:
        raise ValueError(f"`task.n == topology.n` must hold, but got {task.n} != {topology.n}")
    if not starts and not near:
        raise ValueError(f"`starts` must have at least one index, but got {starts}")
    if proof := prove_impossible(task, topology):
        return proof
    solve_variant = partial(solve, topology=topology, starts=starts, seed=seed, near=near, constraints=constraints)
    request = Solve(task, topology, starts, seed, near, constraints)
    results = request.solve_starts()
    for k, source in enumerate(near):
        results[k] = _best([results[k], *request.adopt(source, results[k].start)])
    unweighed, results = _best(results), request.count_rods(results)
    best = _best(results)
    if unweighed.worst.met and not best.worst.met and task.end_effector.counted_rod is None:
        # designs found without the rod's mass cannot lift it: search with its mass from the start
        return solve_variant(weigh_rod(unweighed.point, rod_of(unweighed.point)).task.declared)
    if not best.worst.met and (narrower := _with_default_reach(task, best.point)):
        within_reach = solve_variant(narrower)
        if isinstance(within_reach, Design):
            best = _best([best, *request.count_rods(request.adopt(within_reach, best.start))])
            results = [best if result.start == best.start else result for result in results]
    return request.outcome(best, results)


@dataclass(frozen=True)
class Solve:
    """Arguments of `solve` and `nlp.local_optima`, and the steps they share."""

    task: ResolvedTask
    topology: Topology
    starts: range
    seed: int
    near: Sequence[Design]
    user_constraints: UserConstraints
    most_effort: float | None = None
    began: float = field(default_factory=time.perf_counter)

    @cached_property
    def constraints(self) -> UserConstraints:
        """Constraints of the user and of the task's control allocator."""
        return (*self.user_constraints, *pseudo_inverse_constraints(self.task.declared))

    def outcome(self, best: StartResult, results: Sequence[StartResult]) -> Design | Infeasible:
        """Return the best result as a design with the shortest rod, or as an infeasible topology."""
        task, shorter_rod = best.point.task, None
        if best.worst.met and task.end_effector.rod == "straight" and task.end_effector.fixed_position is None:
            from nlp.shortest_rod import shorten_rod  # compiled code, which other commands need not load

            best, shorter_rod = shorten_rod(best, self.constraints)
        corners = len(task.load_cases) - len(task.declared.load_cases)
        active = frozenset[str]().union(*(result.corners for result in results))
        record = SolverRecord(
            status=best.result.status,
            iterations=best.result.iterations,
            seconds=time.perf_counter() - self.began,
            seed=self.seed,
            start=best.start,
            starts=len(results),
            starts_feasible=sum(result.worst.met for result in results),
            objectives=tuple(result.objective for result in results if result.worst.met),
            corners=corners or None,
            corners_active=len(active) if corners else None,
            shorter_rod=shorter_rod,
            versions=_versions(),
        )
        if best.worst.met:
            return design_of(best, record, self.user_constraints)
        return _infeasible(results, best, record)

    def count_rods(self, results: list[StartResult]) -> list[StartResult]:
        """Return the results with the mass of their rods, if the task counts it."""
        if self.task.end_effector.rod_mass == "ignored":
            return results
        from nlp.shortest_rod import count_rods  # compiled code, which other commands need not load

        return count_rods(results, self.constraints, self.most_effort)

    def adopt(self, source: Design, start: int) -> list[StartResult]:
        """Return a design of the same tree, unchanged and polished; nothing if it violates this task.

        A descent at low prices may leave the design it starts from, so Ipopt starts from the design itself.
        """
        task, topology, constraints = to_corners(self.task), self.topology, self.constraints
        if len(common_subtrees(topology, source.topology)[0]) < max(topology.n, source.topology.n):
            return []
        plain = without_corners(task)
        point = correct(self._carry_over(plain, source, start), refit=True)
        unchanged = judge(task, start, point, "carried over", constraints)
        if not unchanged.worst.met:
            return []
        polished = solve_lazily(task, start, point, constraints)
        # designs are judged without a margin, so one of a task with a smaller margin looks better than it is
        comparable = source.task.search.margin >= task.search.margin or not polished.worst.met
        return [unchanged, polished] if comparable else [polished]

    def solve_starts(self) -> list[StartResult]:
        """Return the result of each start and each design carried over, judged by the task with its corners.

        With `most_effort` the results are all local optima up to it, if the reduced search expresses the task. If
        hinge angles come from a set, the starts are solved with free angles first.
        """
        free = to_corners(self.task.model_copy(update={"search": self.task.search.any_angle}))
        if reason_against(self.task):
            results = self._solve_full_problem(free)
        else:
            from nlp.multistart import solve_starts  # compiled code, which other commands need not load

            options: dict[str, Any] = {"constraints": self.constraints, "most_effort": self.most_effort}
            carried = self._carried_points(free)
            results = solve_starts(free, self.topology, self.starts, self.seed, carried, **options)
        if self.task.search.hinge_set_deg is None:
            return results
        from nlp.hinge_sets import solve_on_set  # compiled code, which other commands need not load

        return solve_on_set(to_corners(self.task), self.topology, results, self.constraints, self.most_effort)

    def _solve_full_problem(self, task: ResolvedTask) -> list[StartResult]:
        """Return the results of Ipopt on the full problem, from untangled starts."""
        plain, topology = without_corners(task), self.topology
        drawn = {s: draw(plain, topology, generator(plain, topology, s, self.seed)) for s in self.starts}
        origins = {**self._carried_points(task), **drawn}
        return [solve_lazily(task, s, origin, self.constraints, far=True) for s, origin in origins.items()]

    def _carried_points(self, task: ResolvedTask) -> dict[int, Point]:
        """Return a point of each design carried over, by the index of its start."""
        plain = without_corners(task)
        return {-1 - k: self._carry_over(plain, source, -1 - k) for k, source in enumerate(self.near)}

    def _carry_over(self, plain: ResolvedTask, source: Design, start: int) -> Point:
        return warm_start(plain, self.topology, source, generator(plain, self.topology, start, self.seed))


def _best(results: Iterable[StartResult]) -> StartResult:
    return min(results, key=lambda result: result.rank)


def move_rod(design: Design, mount: Mount, constraints: UserConstraints = ()) -> Design:
    """Return a design solved again with its rod at another connector, or the design itself if that fails."""
    from nlp.shortest_rod import count_rod  # compiled code, which other commands need not load

    user_constraints = (*constraints, *pseudo_inverse_constraints(design.task))
    unmoved = judge(to_corners(design.task), 0, Point.of(design), "moved", user_constraints)
    moved = count_rod(unmoved, user_constraints, (mount.module, mount.port))
    record = SolverRecord.model_validate(design.solver)
    return design_of(moved, record, constraints) if moved.worst.met else design


def _with_default_reach(task: ResolvedTask, least_violated: Point) -> ResolvedTask | None:
    """Return the task with the default reach if the least violated point exceeds it, as it may at no cost."""
    default_reach = task.declared.end_effector.model_copy(update={"largest_reach": None})
    narrower = task.declared.model_copy(update={"end_effector": default_reach})
    reach, allowed = narrower.largest_reach(task.n), task.largest_reach(task.n)
    from_centres = np.linalg.norm(least_violated.tip - least_violated.poses[1], axis=1)
    distance = min((from_centres - task.connector_distances).min(), allowed or np.inf)
    return narrower if reach is not None and reach < distance else None


def design_of(best: StartResult, record: SolverRecord, constraints: UserConstraints) -> Design:
    """Return a result as a design, with the user's constraints that it meets."""
    point, J, K = best.point, best.objective, len(best.point.task.declared.load_cases)
    bound = None if point.task.search.maximize else bound_of(point.task, J)
    inputs = point.u[:K].reshape(K, -1)  # without those of corners
    return Design(
        **dict(_geometry(point)),
        rotor_speeds_squared=tuple(tuple(u_k) for u_k in inputs.tolist()),
        objective=J,
        lower_bound=bound,
        gap=None if bound is None else Design.gap_of(J, bound),
        stated=tuple(constraint.stated for constraint in constraints),
        solver=record.model_dump(mode="json"),
    )


def _geometry(point: Point) -> Geometry:
    task = point.task.declared
    rod = task.end_effector.counted_rod
    return Geometry(
        task=task,
        topology=point.topology,
        topology_key=point.topology.key,
        root_orientation_rad=divide(point.root, 1.0),
        hinge_angles_rad=tuple((point.alpha + 0.0).tolist()),
        end_effector_m=divide(point.tip, 1.0),
        mount=rod and Mount(module=rod.module, port=rod.port),
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
        closest=_geometry(best.point),
    )
    violations = (result.worst for result in results)
    shortfalls = (Shortfall(constraint=w.name, starts=1, violation=w.amount, unit=w.unit) for w in violations)
    return closest.with_starts(shortfalls, record)


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in ("topo-search", "casadi", "numpy")}
