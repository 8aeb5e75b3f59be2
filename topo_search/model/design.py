"""A design: one topology with its angles, end-effector position and rotor inputs, as `design.json` holds it."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from topo_search.model.arrays import Array, read_only
from topo_search.model.bad_input import show
from topo_search.model.html import heading, paragraph, table
from topo_search.model.proven import gap_percent
from topo_search.model.stated import Stated
from topo_search.model.task import ResolvedTask, Task, before_requirement
from topo_search.model.topology import PORT_NAMES, Joint, Topology
from topo_search.model.value import Index, Number, Value, Vector, refuse


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


SAME_OPTIMUM = 1.0e-4
"""Relative difference of objectives up to which two starts are said to have reached the same optimum."""


class ShorterRod(Value):
    """What a rod shorter than a design's costs."""

    length_m: Number
    """[m]"""
    cost: Number | None
    """Effort over that of the design, less one; None where no such design was found from there."""

    @property
    def words(self) -> str:
        """Say it in a sentence's part."""
        if self.cost is None:
            return f"no design with a rod of at most {self.length_m:.2f} m was reached from this one"
        return (
            f"a rod of at most {self.length_m:.2f} m adds {100 * self.cost:.2g} % effort, solved from this design"
        )


class SolverRecord(Value):
    """How a result came about; informative."""

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
    corners: Annotated[Index | None, Field(exclude_if=lambda given: given is None)] = None
    """Number of corners of sets of wrenches, reserves and failures that must be possible besides the load cases."""
    corners_active: Annotated[Index | None, Field(exclude_if=lambda given: given is None)] = None
    """How many of them were ever stated in a program; all others were met without."""
    shorter_rod: Annotated[ShorterRod | None, Field(exclude_if=lambda given: given is None)] = None
    """What a shorter rod costs, where one was tried: the design's is the shortest at its effort, to a tenth."""
    versions: dict[str, str]
    """Versions of the libraries that fix the result."""

    @property
    def starts_at_best(self) -> int:
        """Number of starts that reached the same optimum."""
        return sum(J - min(self.objectives) <= SAME_OPTIMUM * J for J in self.objectives)


class Mount(Value):
    """The free connector from which a straight rod carries the end-effector."""

    module: Index
    port: Annotated[int, Field(strict=True, ge=0, le=3)]
    """0..3 for +x, +y, -x, -y."""


class Design(Value):
    """A complete platform for a task. The audit recomputes everything that it states.

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
    """Where the end-effector's rod is bolted; None: not chosen yet, or no straight rod reaches."""
    rotor_speeds_squared: tuple[tuple[Number, ...], ...]
    """u_k: 4 n values per load case, module-major [rad^2/s^2]."""
    objective: Number
    """J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    lower_bound: Number | None = None
    """Lower bound of the objective for every topology of this size [rad^4/s^4]."""
    gap: Number | None = None
    """1 - lower_bound / objective."""
    stated: Annotated[tuple[Stated, ...], Field(exclude_if=lambda given: not given)] = ()
    """The user's own constraints when it was solved, without their functions: evaluated, not certified."""
    solver: dict[str, Any] | None = None

    @property
    def shorter_rod(self) -> str | None:
        """What a shorter rod costs, if the solver's record says it."""
        try:
            return ShorterRod.model_validate((self.solver or {}).get("shorter_rod")).words
        except ValidationError:
            return None

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

    @field_validator("topology_key", "lower_bound", "gap", "solver", mode="wrap")
    @classmethod
    def _drop_unreadable(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Drop what cannot be read or written again: a file is never refused for a field that only informs."""
        try:
            json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
            return handler(value)
        except (TypeError, ValueError, RecursionError):
            return None

    @model_validator(mode="after")
    def _counts_agree(self) -> Self:
        n, cases = self.topology.n, len(self.task.load_cases)
        counts: list[tuple[tuple[str | int, ...], str, int, int]] = [
            (("task", "modules"), "must be the number of rows of `topology`", n, self.task.n),
            (("hinge_angles_rad",), "must have one angle per non-root module", n - 1, len(self.hinge_angles_rad)),
            (("rotor_speeds_squared",), "must have one list per load case", cases, len(self.rotor_speeds_squared)),
        ]
        for k, u_k in enumerate(self.rotor_speeds_squared):
            counts.append((("rotor_speeds_squared", k), "must have four values per module", 4 * n, len(u_k)))
        wrong = [(field, f"{rule}, {due}, but got {got}") for field, rule, due, got in counts if due != got]
        refuse("Design", *wrong)
        return self

    @model_validator(mode="after")
    def _mount_is_free(self) -> Self:
        if self.mount is not None and (self.mount.module, self.mount.port) not in self.topology.free_connectors:
            given = f"port {self.mount.port} of module {self.mount.module}"
            refuse("Design", (("mount",), f"must be a connector without a joint, but got {given}"))
        return self

    @property
    def inputs(self) -> Array:
        """u as a read-only array, shape (K, n, 4) [rad^2/s^2]."""
        return read_only(np.asarray(self.rotor_speeds_squared).reshape(-1, self.topology.n, 4))

    def _repr_html_(self) -> str:
        """Show a notebook what to bolt to what, and what it costs."""
        gap = "" if self.gap is None else f", gap to the lower bound {gap_percent(self.gap)}"
        n = self.topology.n
        title = heading(f"{self.task.name}: {n} module{'s' * (n > 1)}, {self.topology.key}")
        effort = paragraph(f"J = {self.objective:.6g} rad^4/s^4{gap}")
        joints = zip(self.topology.edges(), self.hinge_angles_rad, strict=True)
        rows = [(h, PORT_NAMES[a], i, PORT_NAMES[b], math.degrees(alpha)) for (h, i, a, b), alpha in joints]
        psi, alpha_0, alpha_1 = (f"{math.degrees(angle):.6g}" for angle in self.root_orientation_rad)
        place = ", ".join(f"{x:.6g}" for x in self.end_effector_m)
        return (
            title
            + effort
            + table(("module", "port", "child", "its port", "hinge angle [deg]"), rows)
            + paragraph(f"root module: psi = {psi}, alpha_0 = {alpha_0}, alpha_1 = {alpha_1} deg")
            + paragraph(f"end-effector at [{place}] m from the root module's centre")
        )

    @staticmethod
    def gap_of(objective: float, lower_bound: float) -> float | None:
        """Return 1 - lower_bound / objective; None for a task without effort."""
        return None if objective == 0 else 1.0 - lower_bound / objective
