"""Interface for a user's own constraints.

A function, or an object with the right method, is enough; no base class is needed. Code that affects the result of
a run has a name and, for the run to be resumable, a version.

| interface | passed to | consists of |
|---|---|---|
| `OwnConstraint` | `solve`, `search`, `audit`: `constraints=` | a `ConstraintExpression` with name and bounds |
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from topo_search.model import Mount, ResolvedTask, Topology
from topo_search.model.features import Stated
from topo_search.model.folds import FOLD

Expression = Any
"""`casadi.SX`: symbolic expression."""

Invariance = Literal["none", "numbering", "mirror"]


@dataclass(frozen=True)
class SymbolicPlatform:
    """Argument of your constraint: a platform as CasADi expressions, in SI, about the centre of mass, in task axes.

    Modules are numbered as in the topology's key: in preorder, children in the order of the ports.
    """

    task: ResolvedTask
    topology: Topology
    centres: tuple[Expression, ...]
    """o_i: module centres from the centre of mass, (3, 1) each [m]."""
    orientations: tuple[Expression, ...]
    """R_i: module orientations, (3, 3) each; the columns are the module's axes."""
    end_effector: Expression
    """p_E: end-effector from the centre of mass, (3, 1) [m]."""
    hinge_angles: Expression
    """alpha_i: hinge angles of modules 1 to n - 1, (n - 1, 1) [rad]."""
    mount: Mount | None
    """Connector of the rod, if the solver or the audit has chosen it."""
    rod: Expression
    """Rod from its connector to p_E, (3, 1) [m]; without a mount, from the nearest free connector."""
    inputs: tuple[Expression, ...]
    """u_k: squared rotor speeds of every load case, module-major, (r n, 1) each [rad^2/s^2]."""

    @property
    def n(self) -> int:
        """Number of modules."""
        return self.topology.n

    @property
    def axes(self) -> tuple[Expression, ...]:
        """z_i: thrust axis of every module, (3, 1) each."""
        return tuple(R[:, 2] for R in self.orientations)

    @property
    def folds(self) -> tuple[Expression, ...]:
        """Fold of every joint: the hinge angle, positive if it turns the airflows of both modules apart [rad].

        Unlike the hinge angle, its sign does not depend on which of the two modules is the parent.
        """
        return tuple(FOLD[a] * self.hinge_angles[i - 1] for _, i, a, _ in self.topology.edges())


ConstraintExpression = Callable[[SymbolicPlatform], Expression]
"""Function of a constraint: pure and picklable, such as a function at the top level of a module.

It returns an expression or a column of them, twice differentiable wherever designs may be.
"""


@dataclass(frozen=True)
class OwnConstraint:
    """Your own constraint: `lower <= expression(platform) <= upper`, enforced by Ipopt.

    The audit evaluates it but does not certify it. Lower bounds and proofs of impossibility ignore it and remain
    valid, because a constraint never lowers the effort.
    """

    name: str
    """Name in results and audits."""
    expression: ConstraintExpression
    """Function of the platform."""
    lower: float = -math.inf
    """Lower bound, in `unit`."""
    upper: float = math.inf
    """Upper bound, in `unit`."""
    unit: str = ""
    """Unit of the expression and its bounds."""
    version: str | None = None
    """Version; change it when the expression changes. A run with an unversioned constraint cannot be resumed."""
    scale: float | None = None
    """Typical value, in `unit`; the constraint is met to within 1e-6 of it. Default: the arm length for m, the
    weight for N, arm length times weight for N m, the largest input for rad^2/s^2, otherwise 1."""
    invariant: Invariance = "none"
    """Changes that do not affect its largest violation, so that the search may merge trees into one candidate.

    `none`: it may depend on module numbers. `numbering`: it does not depend on the module from which the tree is
    numbered, nor on half turns of modules. `mirror`: nor on mirroring the platform. The claim is tested on random
    platforms before a search starts, which finds many mistakes but is not a proof.
    """

    def __post_init__(self) -> None:
        """Check the fields; ValueError names the rule and the value."""
        if not self.lower <= self.upper:
            raise ValueError(f"`lower <= upper` must hold, but got lower={self.lower}, upper={self.upper}")
        if not (math.isfinite(self.lower) or math.isfinite(self.upper)):
            raise ValueError(f"lower or upper must be a number, but got {self.lower} and {self.upper}")
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise ValueError(f"`0 < scale < inf` must hold, but got {self.scale}")
        _ = self.stated  # which checks name, version and unit

    @property
    def stated(self) -> Stated:
        """Record of the constraint in a design file."""
        lower, upper = (None if math.isinf(side) else float(side) for side in (self.lower, self.upper))
        return Stated(
            name=self.name, version=self.version, lower=lower, upper=upper, unit=self.unit, invariant=self.invariant
        )
