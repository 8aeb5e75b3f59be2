"""The answer of the solver for one topology: a design, as `design.json` holds it, or why there is none.

A design has the topology's angles, end-effector position and rotor inputs. Without a design the answer is why, by
how much, whether that is proven, and which limits of the task can be relaxed. Constraints of a user's own function
are evaluated, never certified: a file holds their name, bounds and values; the function itself stays with its user.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from topo_search.limits import quantity
from topo_search.model.arrays import Array, read_only
from topo_search.model.proven import at_least, gap_percent, lower_text, upper_text
from topo_search.model.task import ResolvedTask, Task, before_requirement
from topo_search.model.text import heading, paragraph, table
from topo_search.model.topology import PORT_NAMES, Joint, Topology
from topo_search.model.value import OMIT_EMPTY, Broken, Flag, Index, Location, Number, Omitted, Value, Vector, show

NOT_CERTIFIED = "stated by the user, not certified"
"""Wording for a claim that nothing proves."""

Line = Annotated[str, Field(max_length=100, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""One line of text."""
Named = Annotated[Line, Field(min_length=1)]
"""One that says something."""


class Versioned(Value):
    """Identity of a user's function: its name and, where the user gives one, its version."""

    name: Named
    version: Named | None = None
    """None: it may have changed."""


class Stated(Versioned):
    """A constraint of a user's own, without its expression: `lower <= expression <= upper`."""

    lower: Number | None = None
    """In `unit`; None: none."""
    upper: Number | None = None
    unit: Line = ""
    invariant: Literal["none", "numbering", "mirror"] = "none"
    """Changes that do not affect its result, as the user states (`topo_search.protocols.OwnConstraint`)."""

    @property
    def bounds(self) -> str:
        """Its bounds in words."""
        sides = (
            None if self.lower is None else f"at least {self.lower:g}",
            None if self.upper is None else f"at most {self.upper:g}",
        )
        if self.lower == self.upper:
            return f"equal to {self.lower:g} {self.unit}".rstrip()
        return f"{' and '.join(side for side in sides if side is not None)} {self.unit}".rstrip()


class StatedCheck(Stated):
    """Result of a user's own constraint on a design."""

    status: Literal["met", "missed", "not checked"]
    """`not checked`: whoever audited the design had its name, but not its expression."""
    value: Number | None = None
    """The value that is farthest from its bounds, or the nearest to them if all are met, in `unit`."""
    off_by: Number | None = None
    """Distance of that value from its bounds; zero or negative when met, in `unit`."""

    @property
    def words(self) -> str:
        """Its result, for a reader."""
        if self.value is None:
            return self.status if self.status == "missed" else "not checked: the design does not hold its function"
        return f"{self.status}: {self.value:.6g} {self.unit}".rstrip()


def _topology(value: Any) -> Any:
    """Read the file's list of [parent, parent_port, child_port]."""
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


TopologyRows = Annotated[
    Topology,
    BeforeValidator(_topology),
    PlainSerializer(lambda topology: [list(joint) for joint in topology.joints], return_type=list[list[int]]),
]
"""A topology that a file writes as rows [parent, parent_port, child_port]."""


class ShorterRod(Value):
    """Cost of a rod shorter than a design's."""

    length_m: Number
    """[m]"""
    cost: Number | None
    """Effort over that of the design, less one; None where no such design was found from there."""

    @property
    def words(self) -> str:
        """Say it in a sentence's part."""
        if self.cost is None:
            return f"no design with a rod of at most {lower_text(self.length_m, 3)} m was reached from this one"
        cost = f"{100 * self.cost:.2g} % control effort"
        return f"a rod of at most {upper_text(self.length_m, 3)} m adds {cost}, solved from this design"


class SolverRecord(Value):
    """Record of how a result came about; informative."""

    status: str
    """Ipopt's status word for the best start."""
    iterations: Index
    """Ipopt iterations of the best start."""
    seconds: Number
    """Wall-clock time over all starts [s]."""
    seed: int
    start: int
    """Index of the best start; -1, -2, ... for the first, second, ... design that was carried over."""
    starts: Index
    """Number of starts tried."""
    starts_feasible: Index
    """Number of starts that reached a feasible point."""
    objectives: tuple[Number, ...] = ()
    """J of every feasible start [rad^4/s^4]; empty in files of programs that do not tell."""
    corners: Omitted[Index] = None
    """Number of corners of sets of wrenches, reserves and failures that must be possible besides the load cases."""
    corners_active: Omitted[Index] = None
    """Number of corners that were ever stated in a program; all others were met without."""
    shorter_rod: Omitted[ShorterRod] = None
    """Cost of a shorter rod, where one was tried: the design's is the shortest at its effort, to a tenth."""
    versions: dict[str, str]
    """Versions of the libraries that fix the result."""

    @property
    def starts_at_best(self) -> int:
        """Number of starts that reached the same optimum."""
        same = 1.0e-4  # relative difference of objectives at one optimum
        return sum(J - min(self.objectives) <= same * J for J in self.objectives)


class Mount(Value):
    """The free connector from which a straight rod carries the end-effector."""

    module: Index
    port: Annotated[int, Field(strict=True, ge=0, le=3)]
    """0..3 for +x, +y, -x, -y."""


class Geometry(Value):
    """A platform for a task without rotor inputs: a design's file that leaves them out.

    Unknown fields of a file are ignored, so that other programs can add their own.
    """

    model_config = ConfigDict(extra="ignore")

    format: Literal["topo-search/design"] = "topo-search/design"
    version: Literal[1] = 1
    task: ResolvedTask
    """The whole task with every default filled in, load cases in N and N m."""
    topology: TopologyRows
    topology_key: str | None = None
    root_module: Literal[0] = 0
    root_orientation_rad: Vector
    """psi, alpha_0, alpha_1: R_root = Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    hinge_angles_rad: tuple[Number, ...]
    """alpha_i of every module but the root, in module order."""
    end_effector_m: Vector
    """p'_E in W [m]."""
    mount: Mount | None = None
    """Connector to which the end-effector's rod is bolted; None: not chosen yet, or no straight rod reaches."""

    @field_validator("task", mode="before")
    @classmethod
    def _resolve_task(cls, value: Any) -> Any:
        """Accept a task with derived defaults left out or load cases in weights: both are unambiguous here.

        A file that says nothing of the rod did not ask for one, nor for tolerances to be kept.
        """
        if isinstance(value, ResolvedTask):
            return value
        if isinstance(value, dict) and isinstance(given := value.get("end_effector", {}), dict):
            value = {**value, "end_effector": {"rod": "none", "largest_reach": False, **given}}
        task = Task.model_validate(before_requirement(value))
        return task.resolve(task.n)

    def _miscounts(self) -> Iterator[tuple[Location, str, int, int]]:
        """Yield how many values fields must have: the field, the rule, the number due and the number given."""
        n = self.topology.n
        yield ("task", "modules"), "must be the number of rows of `topology`", n, self.task.n
        yield "hinge_angles_rad", "must have one angle per non-root module", n - 1, len(self.hinge_angles_rad)

    def _broken_rules(self) -> Broken:
        wrong = (count for count in self._miscounts() if count[2] != count[3])
        yield from ((field, f"{rule}, {due}, but got {got}") for field, rule, due, got in wrong)
        counted = self.task.end_effector.counted_rod
        if counted is not None and self.mount != Mount(module=counted.module, port=counted.port):
            given = "none" if self.mount is None else f"port {self.mount.port} of module {self.mount.module}"
            due = f"port {counted.port} of module {counted.module}"
            yield "mount", f"must be that of `task.end_effector.counted_rod`, {due}, but got {given}"
        if self.mount is not None and (self.mount.module, self.mount.port) not in self.topology.free_connectors:
            given = f"port {self.mount.port} of module {self.mount.module}"
            yield "mount", f"must be a connector without a joint, but got {given}"


class Design(Geometry):
    """A complete platform for a task. The audit recomputes everything that it states.

    Unknown fields of a file are ignored, so that other programs can add their own.
    """

    rotor_speeds_squared: tuple[tuple[Number, ...], ...]
    """u_k: 4 n values per load case, module-major [rad^2/s^2]."""
    inputs_computed: Annotated[Flag, OMIT_EMPTY] = False
    """True if the audit found the inputs, for a geometry that came without."""
    objective: Number
    """J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    lower_bound: Number | None = None
    """Lower bound of the objective for every topology of this size, if each wrench is met exactly [rad^4/s^4]."""
    gap: Number | None = None
    """1 - lower_bound / objective."""
    stated: Annotated[tuple[Stated, ...], OMIT_EMPTY] = ()
    """The user's own constraints when it was solved, without their functions: evaluated, not certified."""
    solver: dict[str, Any] | None = None

    @property
    def shorter_rod(self) -> str | None:
        """Cost of a shorter rod, if the solver's record has it."""
        try:
            return ShorterRod.model_validate((self.solver or {}).get("shorter_rod")).words
        except ValidationError:
            return None

    @field_validator("topology_key", "lower_bound", "gap", "solver", mode="wrap")
    @classmethod
    def _drop_unreadable(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Drop what cannot be read or written again: a file is never refused for a field that only informs."""
        try:
            json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
            return handler(value)
        except (TypeError, ValueError, RecursionError):
            return None

    def _miscounts(self) -> Iterator[tuple[Location, str, int, int]]:
        yield from super()._miscounts()
        cases = len(self.task.load_cases)
        yield "rotor_speeds_squared", "must have one list per load case", cases, len(self.rotor_speeds_squared)
        for k, u_k in enumerate(self.rotor_speeds_squared):
            field = "rotor_speeds_squared", k
            yield field, "must have four values per module", 4 * self.topology.n, len(u_k)

    @property
    def inputs(self) -> Array:
        """u as a read-only array, shape (K, n, 4) [rad^2/s^2]."""
        return read_only(np.asarray(self.rotor_speeds_squared).reshape(-1, self.topology.n, 4))

    def _repr_html_(self) -> str:
        """Show a notebook what to bolt to what, and what it costs."""
        gap = "" if self.gap is None else f", gap to the lower bound {gap_percent(self.gap)}"
        title = heading(f"{self.task.name}: {quantity(self.topology.n, 'module')}, {self.topology.key}")
        effort = paragraph(f"J = {self.objective:.6g} rad^4/s^4{gap}")
        joints = zip(self.topology.edges(), self.hinge_angles_rad, strict=True)
        rows = [(h, PORT_NAMES[a], i, PORT_NAMES[b], math.degrees(alpha)) for (h, i, a, b), alpha in joints]
        psi, alpha_0, alpha_1 = (f"{math.degrees(angle):.6g}" for angle in self.root_orientation_rad)
        position = ", ".join(f"{x:.6g}" for x in self.end_effector_m)
        return (
            title
            + effort
            + table(("module", "port", "child", "its port", "hinge angle [deg]"), rows)
            + paragraph(f"root module: psi = {psi}, alpha_0 = {alpha_0}, alpha_1 = {alpha_1} deg")
            + paragraph(f"end-effector at [{position}] m from the root module's centre")
        )

    @staticmethod
    def gap_of(objective: float, lower_bound: float) -> float | None:
        """Return 1 - lower_bound / objective; None for a task without effort."""
        return None if objective == 0 else 1.0 - lower_bound / objective


STARTS = 4
"""Largest number of starts of each solve with a relaxed limit."""


class Relaxation(Value):
    """One limit, relaxed by the least share that gave a design with a clear audit; no proof that less would not."""

    topology_key: str
    """Key of the tree that then has a design."""
    limit: str
    """Binding limit, in the user's words."""
    change: str
    """Change of the limit, in words."""
    field: str
    """Field of the task."""
    share: Number
    """The change over the limit as it is."""
    given: Number | None = None
    """The limit as it is, in the field's unit; None where it is no single number."""
    enough: Number | None = None
    """Relaxed limit that is enough, in the field's unit."""
    unit: str = ""
    not_enough: Number | None = None
    """The largest share that was tried in vain; None if the least that is tried was enough."""

    tightens: Annotated[bool, OMIT_EMPTY] = False
    """True if the limit is tightened, so that the design is one of the task as it is."""

    @property
    def setting(self) -> str:
        """The field, with its values where it is a single number."""
        unit = f" {self.unit}" if self.unit else ""
        if self.given is None or self.enough is None:
            return self.field
        enough = upper_text(self.enough) if self.enough > self.given else lower_text(self.enough)  # no less is
        return f"{self.field}: {self.given:.6g} -> {enough}{unit}"

    @property
    def words(self) -> str:
        """The change and its setting in a line."""
        return f"{self.limit}: {self.topology_key} becomes feasible with {self.change} ({self.setting})"


class Relaxed(Value):
    """Relaxations tried for the topologies of one size that came closest to a design."""

    format: Literal["topo-search/relaxed"] = "topo-search/relaxed"
    version: Literal[1] = 1
    modules: int
    starts: int
    """Starts of each candidate of the run when it was tried."""
    relaxations: tuple[Relaxation, ...]
    """Relaxations that helped, the least change first."""
    in_vain: tuple[str, ...]
    """Limits none of whose relaxations helped, each with the most that was tried."""
    untried: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Limits of which nothing is known, as the solver or the audit failed, each with the reason."""
    topologies: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Keys of the trees; none in an older file."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Advice, one sentence each: what to relax first, what else helps or does not, what could not be tried."""
        solved = f"from {quantity(min(self.starts, STARTS), 'start')}"
        sentences = []
        if self.relaxations:
            first, *others = self.relaxations
            verb, end = "relax", "a smaller change may be enough"
            if first.tightens:
                verb, end = "try", "the design is one of the task as it is"
            sentences.append(f"{verb} first: {first.words}; solved again {solved}, its audit is clear; {end}")
            sentences += [f"or {other.words}; solved and audited alike" for other in others]
        elif self.in_vain:
            of = f" of {' or '.join(self.topologies)}" if self.topologies else ""
            tried = "; ".join(self.in_vain)
            none = f"no single limit, relaxed on its own, led to a design{of} with a clear audit"
            sentences.append(f"{none} {solved} ({tried})")
        if self.untried:
            sentences.append(f"could not be tried, so nothing is known: {'; '.join(self.untried)}")
        return tuple(sentences)


class Shortfall(Value):
    """A constraint that some starts missed by more than any other."""

    constraint: str
    """In the user's words, with the modules or the load case."""
    starts: int
    """Number of starts that missed it by more than any other."""
    violation: Number
    """The least that one of them missed it by, positive, in `unit`."""
    unit: str

    @staticmethod
    def gather(shortfalls: Iterable[Shortfall]) -> tuple[Shortfall, ...]:
        """Return one for each constraint, the most frequent first."""
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
    """No feasible point of one topology was found, or none can exist."""

    format: Literal["topo-search/infeasible"] = "topo-search/infeasible"
    version: Literal[1] = 1
    topology: TopologyRows | None
    """None: proven for every topology of this size."""
    topology_key: str | None
    status: Literal["infeasible", "impossible"]
    """`infeasible`: no start reached a feasible point; `impossible`: proven, whatever the start."""
    worst_constraint: str
    """The most violated constraint of the start that came closest, in the user's words."""
    violation: Number
    """Shortfall, positive, in `unit`."""
    unit: str
    message: str
    """The whole reason in one sentence."""
    shortfalls: tuple[Shortfall, ...] = ()
    """Constraints that all starts ended short of, the most frequent first; none for a proof."""
    solver: SolverRecord | None = None
    """Solver record of the closest start; None for a proof."""
    relaxed: Omitted[Relaxed] = None
    """Limits that, each relaxed on its own, give the tree a design; None where it was not asked."""

    def with_starts(self, shortfalls: Iterable[Shortfall], solver: SolverRecord) -> Infeasible:
        """Return the same closest start among these starts."""
        gathered, shown = Shortfall.gather(shortfalls), 3
        missed = f"misses `{self.worst_constraint}` by {_amount(self.violation, 3, self.unit)}"
        named = [
            f"{s.starts} `{s.constraint}` (by {_amount(at_least(s.violation, 2), 2, s.unit)} or more)"
            for s in gathered[:shown]
        ]
        if others := sum(s.starts for s in gathered[shown:]):
            named.append(f"{others} another constraint")
        message = f"the closest of {solver.starts} starts {missed}; what they miss most: {', '.join(named)}"
        if solver.starts == 1:
            message = f"the only start {missed}"
        return self.model_copy(update={"shortfalls": gathered, "solver": solver, "message": message})


def _amount(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}g} {unit}".rstrip()
