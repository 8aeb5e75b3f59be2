"""A design: one topology with its angles, end-effector position and rotor inputs, as `design.json` holds it."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, PlainSerializer, field_validator, model_validator

from topo_search.model.arrays import Array, read_only
from topo_search.model.task import ResolvedTask, Task
from topo_search.model.topology import Joint, Topology
from topo_search.model.value import Number, Value, Vector


def _topology(value: Any) -> Any:
    """Read the file's list of [parent, parent_port, child_port]."""
    if isinstance(value, Topology):
        return value
    rows = value if isinstance(value, (list, tuple)) else [None]
    joints: list[Joint] = []
    for row in rows:
        if not isinstance(row, (list, tuple)) or [type(x) for x in row] != [int, int, int]:
            raise ValueError("must be a list of [parent, parent_port, child_port] with whole numbers")
        joints.append((row[0], row[1], row[2]))
    return Topology(tuple(joints))


TopologyRows = Annotated[
    Topology,
    BeforeValidator(_topology),
    PlainSerializer(lambda topology: [list(joint) for joint in topology.joints], return_type=list[list[int]]),
]
"""A topology that a file writes as rows [parent, parent_port, child_port]."""


class SolverRecord(Value):
    """How a result came about; informative."""

    status: str
    """Ipopt's status word for the best start."""
    iterations: int
    """Ipopt iterations of the best start."""
    seconds: float
    """Wall-clock time over all starts [s]."""
    seed: int
    start: int
    """Index of the best start."""
    starts: int
    """Number of starts tried."""
    starts_feasible: int
    """Number of starts that reached a feasible point."""
    versions: dict[str, str]
    """Versions of the libraries that fix the result."""


class Design(Value):
    """A platform that claims to do its task; everything but the claim is derived again by the audit."""

    format: Literal["topo-search/design"] = "topo-search/design"
    version: Literal[1] = 1
    task: ResolvedTask
    """The whole task with every default filled in, load cases in N and N m."""
    topology: TopologyRows
    topology_key: str | None = None
    root_module: Annotated[int, Field(strict=True, ge=0, le=0)] = 0
    root_orientation_rad: Vector
    """psi, alpha_0, alpha_1: R_root = Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    hinge_angles_rad: tuple[Number, ...]
    """alpha_i of every module but the root, in module order."""
    end_effector_m: Vector
    """p'_E in W [m]."""
    rotor_speeds_squared: tuple[tuple[Number, ...], ...]
    """u_k: 4 n values a load case, module-major [rad^2/s^2]."""
    objective: Number
    """J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    lower_bound: float | None = None
    gap: float | None = None
    solver: dict[str, Any] | None = None

    @field_validator("task", mode="before")
    @classmethod
    def _resolve_task(cls, value: Any) -> Any:
        """Accept a task with derived defaults left out or load cases in weights: both are unambiguous here."""
        if isinstance(value, ResolvedTask):
            return value
        task = Task.model_validate(value)
        return task.resolve(task.n)

    @field_validator("topology_key", "lower_bound", "gap", "solver", mode="wrap")
    @classmethod
    def _informative(cls, value: Any, handler: Any) -> Any:
        """Drop what cannot be read: a file is never refused for a field that only informs."""
        try:
            return handler(value)
        except ValueError:
            return None

    @model_validator(mode="after")
    def _counts_agree(self) -> Self:
        n, cases = self.topology.n, len(self.task.load_cases)
        for rule, expected, got in (
            ("task.modules must be the number of rows of `topology`", n, self.task.n),
            ("hinge_angles_rad must have one angle a non-root module", n - 1, len(self.hinge_angles_rad)),
            ("rotor_speeds_squared must have one list a load case", cases, len(self.rotor_speeds_squared)),
            *(
                (f"rotor_speeds_squared[{k}] must have 4 values a module", 4 * n, len(u_k))
                for k, u_k in enumerate(self.rotor_speeds_squared)
            ),
        ):
            if expected != got:
                raise ValueError(f"{rule}, {expected}, but got {got}")
        return self

    @property
    def inputs(self) -> Array:
        """u as a read-only array, shape (K, n, 4) [rad^2/s^2]."""
        return read_only(np.asarray(self.rotor_speeds_squared).reshape(-1, self.topology.n, 4))

    @staticmethod
    def gap_of(objective: float, lower_bound: float) -> float | None:
        """Return 1 - lower_bound / objective; None for a task without effort."""
        return None if math.isclose(objective, 0.0, abs_tol=0.0) else 1.0 - lower_bound / objective
