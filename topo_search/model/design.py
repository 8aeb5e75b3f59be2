"""Result of solving one topology: a design, as in `design.json`, or the reason why there is none.

A design has the topology's angles, end-effector position and rotor inputs. Otherwise the result says which
constraint failed, by how much, whether that is proven, and which limits of the task can be relaxed. A user's own
constraints are evaluated, never certified: files hold their names, bounds and values, but not their functions.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_serializer,
    field_validator,
    model_validator,
)

from topo_search.model.arrays import Array, read_only
from topo_search.model.end_effector import Mount
from topo_search.model.features import Relaxed, ShorterRod, Stated, design_html, with_older_defaults
from topo_search.model.kinds import OMIT_EMPTY, Flag, Index, Number, Omitted, Vector
from topo_search.model.proven import at_least
from topo_search.model.task import ResolvedTask, Task
from topo_search.model.topology import Bolt, Joint, Topology
from topo_search.model.value import Broken, Location, Value, every_field, show


def _topology(value: Any) -> Any:
    """Return the topology of a file's list of [parent, parent_port, child_port]."""
    if isinstance(value, Topology):
        return value
    rule = "must be a list of [parent, parent_port, child_port] in whole numbers"
    if not isinstance(value, list | tuple):
        raise ValueError(rule)
    joints: list[Joint] = []
    for i, row in enumerate(value):
        if not isinstance(row, list | tuple) or [type(x) for x in row] != [int, int, int]:
            raise ValueError(f"{rule}, but got {show(row)} for module {i}")
        joints.append((row[0], row[1], row[2]))
    return Topology(tuple(joints))


def _numbers(task: ResolvedTask, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return the numbers of named types; () unless the task has them all."""
    known = {kind.name: k for k, kind in enumerate(task.module_types)}
    return tuple(known[name] for name in names) if set(names) <= set(known) else ()


TopologyRows = Annotated[
    Topology,
    BeforeValidator(_topology, json_schema_input_type=list[Joint]),
    PlainSerializer(lambda topology: [list(joint) for joint in topology.joints], return_type=list[list[int]]),
]
"""Topology; files store it as rows [parent, parent_port, child_port]."""


class SolverRecord(Value):
    """Record of the solver; informative only."""

    status: str
    """Ipopt's status word for the best start."""
    iterations: Index
    """Ipopt iterations of the best start."""
    seconds: Number
    """Wall-clock time over all starts [s]."""
    seed: int
    """Seed of the random starts."""
    start: int
    """Index of the best start; -1, -2, ... are warm starts from the first, second, ... given design."""
    starts: Index
    """Number of starts tried."""
    starts_feasible: Index
    """Number of starts that reached a feasible point."""
    objectives: tuple[Number, ...] = ()
    """J of every feasible start [rad^4/s^4]; empty if the file does not say."""
    corners: Omitted[Index] = None
    """Number of corners of sets of wrenches, reserves and failures required besides the load cases."""
    corners_active: Omitted[Index] = None
    """Number of corners that were constraints of the program; all others were met without."""
    shorter_rod: Omitted[ShorterRod] = None
    """Cost of a shorter rod, if one was tried; the design's own rod is the shortest at its effort, to a tenth."""
    versions: dict[str, str]
    """Versions of the libraries that determine the result."""

    @property
    def starts_at_best(self) -> int:
        """Number of starts that reached the same optimum."""
        same = 1.0e-4  # relative difference of objectives at one optimum
        return sum(J - min(self.objectives) <= same * J for J in self.objectives)


class Geometry(Value):
    """Platform for a task without rotor inputs, as in a design file that omits them.

    Unknown fields of a file are ignored, so that other programs can add their own.
    """

    model_config = ConfigDict(extra="ignore")

    format: Literal["topo-search/design"] = "topo-search/design"
    version: Literal[1] = 1
    types: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Name of each module's type; empty: there is one."""
    task: ResolvedTask
    """The whole task with every default filled in, load cases in N and N m."""
    topology: TopologyRows
    closures: Annotated[tuple[Bolt, ...], OMIT_EMPTY, Field(validate_default=True)] = ()
    """[a, port_a, b, port_b] of the joints of a flat lattice beyond those of `topology`, its spanning tree."""
    topology_key: str | None = None
    root_module: Literal[0] = 0
    root_orientation_rad: Vector
    """psi, alpha_0, alpha_1: R_root = Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    hinge_angles_rad: tuple[Number, ...]
    """alpha_i of every module but the root, in module order."""
    end_effector_m: Vector
    """p'_E in W [m]."""
    mount: Mount | None = None
    """Connector to which the end-effector's rod is bolted; None: not chosen, or no straight rod reaches it."""

    @property
    def bolts(self) -> list[tuple[Bolt, float]]:
        """Bolted connectors with the angle of their hinge [rad], in an order of assembly."""
        angles = (*self.hinge_angles_rad, *(0.0 for _ in self.topology.closures))
        return sorted(zip(self.topology.bolts, angles, strict=True), key=lambda joint: joint[0][2])

    @model_validator(mode="before")
    @classmethod
    def _name_types(cls, data: Any) -> Any:
        """Name the types of a platform's tree."""
        if not isinstance(data, dict) or not isinstance(topology := data.get("topology"), Topology):
            return data
        return {**data, "types": [data["task"].module_types[k].name for k in topology.types]}

    @field_validator("task", mode="before")
    @classmethod
    def _resolve_task(cls, value: Any) -> Any:
        """Resolve the task: derived defaults may be omitted and load cases given in weights.

        Without `rod` and `largest_reach`, a file requires neither; without `flight.tolerances` it requires none.
        """
        if isinstance(value, ResolvedTask):
            return value
        if isinstance(value, dict) and isinstance(end_effector := value.get("end_effector", {}), dict):
            value = {**value, "end_effector": {"rod": "none", "largest_reach": False, **end_effector}}
        task = Task.model_validate(with_older_defaults(value))
        return task.resolve(task.n)

    @field_validator("task")
    @classmethod
    def _place_types(cls, task: ResolvedTask, info: ValidationInfo) -> ResolvedTask:
        """Let the task know which type is where."""
        return task.model_copy(update={"types_of_nodes": _numbers(task, info.data.get("types", ()))})

    @field_validator("topology")
    @classmethod
    def _complete(cls, topology: Topology, info: ValidationInfo) -> Topology:
        """Bolt all neighbours of a flat lattice together, and say of which type the modules are."""
        task = info.data.get("task")
        if task is None:
            return topology
        topology = topology if task.search.lattice is None else topology.closed
        return replace(topology, types=task.types_of_nodes)

    @field_validator("closures")
    @classmethod
    def _fill_closures(cls, closures: tuple[Bolt, ...], info: ValidationInfo) -> tuple[Bolt, ...]:
        """Return those of the topology; other programs may leave them out."""
        topology = info.data.get("topology")
        if topology is not None and closures not in ((), topology.closures):
            rule = "must be all pairs of neighbours without a joint in `topology`, none without search.lattice"
            raise ValueError(f"{rule}: {show(topology.closures)}, but got {show(closures)}")
        return closures if topology is None else tuple(topology.closures)

    @field_serializer("task")
    def _write_every_field(self, task: ResolvedTask) -> dict[str, Any]:
        """Return the task with the fields that task files omit: a design does not depend on defaults."""
        return dict(every_field(task))

    def _value_counts(self) -> Iterator[tuple[Location, str, int, int]]:
        """Yield (field, rule, required number, actual number) of each field with a fixed number of values."""
        n = self.topology.n
        yield ("task", "modules"), "must be the number of rows of `topology`", n, self.task.n
        closures, field = len(self.topology.closures), ("task", "search", "closures")
        yield field, "must be the number of `closures`", closures, self.task.search.closures or 0
        yield "hinge_angles_rad", "must have one angle per non-root module", n - 1, len(self.hinge_angles_rad)

    def _broken_rules(self) -> Broken:
        names = Counter({kind.name: kind.count for kind in self.task.module_types})
        if Counter(self.types) != names:
            rule = f"must name as many modules of each type as the task counts, {show(names)}"
            yield "types", f"{rule}, but got {show(list(self.types))}"
        mismatches = (row for row in self._value_counts() if row[2] != row[3])
        yield from ((field, f"{rule}, {due}, but got {count}") for field, rule, due, count in mismatches)
        mount, rod = self.mount, self.task.end_effector.counted_rod
        given = "none" if mount is None else mount.words
        if rod is not None and mount != Mount(module=rod.module, port=rod.port):
            yield "mount", f"must be that of `task.end_effector.counted_rod`, {rod.words}, but got {given}"
        if mount is not None and (mount.module, mount.port) not in self.topology.free_connectors:
            yield "mount", f"must be a connector without a joint, but got {given}"


class Design(Geometry):
    """Complete platform for a task; the audit recomputes all of its numbers.

    The schema is that of complete designs: it refuses a bare geometry, without `rotor_speeds_squared` and
    `objective`, which commands read as well. Unknown fields of a file are ignored, so that other programs can add
    their own.
    """

    rotor_speeds_squared: tuple[tuple[Number, ...], ...]
    """u_k: a value per rotor in each load case, module-major, 0 for those that a type of module lacks
    [rad^2/s^2]."""
    inputs_computed: Annotated[Flag, OMIT_EMPTY] = False
    """True if the audit computed the inputs, for a geometry without any."""
    objective: Number
    """J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    lower_bound: Number | None = None
    """Lower bound of the objective over all topologies of this size, for wrenches met exactly [rad^4/s^4]."""
    gap: Number | None = None
    """1 - lower_bound / objective."""
    stated: Annotated[tuple[Stated, ...], OMIT_EMPTY] = ()
    """The user's own constraints of the solve, without their functions: evaluated, not certified."""
    solver: dict[str, Any] | None = None

    @property
    def shorter_rod(self) -> str | None:
        """Cost of a shorter rod in words, if the solver's record has it."""
        try:
            return ShorterRod.model_validate((self.solver or {}).get("shorter_rod")).words
        except ValidationError:
            return None

    @field_validator("topology_key", "lower_bound", "gap", "solver", mode="wrap")
    @classmethod
    def _drop_unreadable(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Drop an invalid value: no file is refused for a field that is only informative."""
        try:
            json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
            return handler(value)
        except (TypeError, ValueError, RecursionError):
            return None

    def _value_counts(self) -> Iterator[tuple[Location, str, int, int]]:
        yield from super()._value_counts()
        cases = len(self.task.load_cases)
        yield "rotor_speeds_squared", "must have one list per load case", cases, len(self.rotor_speeds_squared)
        for k, u_k in enumerate(self.rotor_speeds_squared):
            field = "rotor_speeds_squared", k
            rotors = self.topology.n * self.task.rotors_per_module
            yield field, "must have one value per rotor", rotors, len(u_k)

    @property
    def value(self) -> float | None:
        """Value of the maximised quantity; None if effort is minimised."""
        return self.task.search.reached

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key: largest value of a maximised quantity first, then lowest effort."""
        return -(self.value or 0.0), self.objective

    @property
    def inputs(self) -> Array:
        """u as a read-only array, shape (K, n, r) [rad^2/s^2]."""
        return read_only(
            np.asarray(self.rotor_speeds_squared).reshape(len(self.rotor_speeds_squared), self.topology.n, -1)
        )

    _repr_html_ = design_html

    def view(self) -> Any:
        """Return the 3-D view of the design's page, for a cell of a notebook: `topo_search.view(design)`."""
        return import_module("topo_search").view(self)

    @staticmethod
    def gap_of(objective: float, lower_bound: float) -> float | None:
        """Return 1 - lower_bound / objective; None for a task without effort."""
        return None if objective == 0 else 1.0 - lower_bound / objective


class Shortfall(Value):
    """Constraint that some starts violate more than any other."""

    constraint: str
    """Name of the constraint, with the modules or the load case."""
    starts: int
    """Number of starts that violate it more than any other."""
    violation: Number
    """Smallest violation among those starts, positive, in `unit`."""
    unit: str
    """Unit of `violation`."""

    @staticmethod
    def gather(shortfalls: Iterable[Shortfall]) -> tuple[Shortfall, ...]:
        """Return one shortfall per constraint, the most frequent first."""
        least: dict[str, Shortfall] = {}
        starts: Counter[str] = Counter()
        for shortfall in shortfalls:
            name = shortfall.constraint
            starts[name] += shortfall.starts
            if name not in least or shortfall.violation < least[name].violation:
                least[name] = shortfall
        ordered = sorted(least, key=lambda name: (-starts[name], name))
        return tuple(least[name].model_copy(update={"starts": starts[name]}) for name in ordered)


class Infeasible(Value):
    """Topology without a feasible point: none was found, or none exists."""

    format: Literal["topo-search/infeasible"] = "topo-search/infeasible"
    version: Literal[1] = 1
    topology: TopologyRows | None
    """None: holds for every topology of this size."""
    topology_key: str | None
    status: Literal["infeasible", "impossible"]
    """`infeasible`: no start reached a feasible point; `impossible`: proven, whatever the start."""
    worst_constraint: str
    """Constraint that the best start violates most."""
    violation: Number
    """Its violation, positive, in `unit`."""
    unit: str
    """Unit of `violation`."""
    message: str
    """Reason in one sentence."""
    shortfalls: tuple[Shortfall, ...] = ()
    """Largest violations of all starts by constraint, the most frequent first; empty for a proof."""
    solver: SolverRecord | None = None
    """Solver record of the least violated start; None for a proof."""
    closest: Omitted[Geometry] = None
    """Platform of the least violated start; None for a proof, and in older files."""
    relaxed: Omitted[Relaxed] = None
    """Limits that make the tree feasible if relaxed; None if that was not requested."""

    def with_starts(self, shortfalls: Iterable[Shortfall], solver: SolverRecord) -> Infeasible:
        """Return a copy for the least violated of several starts, with the shortfalls of all."""
        gathered, shown = Shortfall.gather(shortfalls), 3
        closest = f"misses {self.worst_constraint} by {_amount(self.violation, 3, self.unit)}"
        parts = [
            f"{s.starts} {s.constraint} (by {_amount(at_least(s.violation, 2), 2, s.unit)} or more)"
            for s in gathered[:shown]
        ]
        if rest := sum(s.starts for s in gathered[shown:]):
            parts.append(f"{rest} another constraint")
        message = f"the closest of {solver.starts} starts {closest}; what they miss most: {', '.join(parts)}"
        if solver.starts == 1:
            message = f"the only start {closest}"
        return self.model_copy(update={"shortfalls": gathered, "solver": solver, "message": message})


def _amount(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}g} {unit}".rstrip()
