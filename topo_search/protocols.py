"""The doors for a user's own code: constraints, samplers, formats. What is handed in, and what it is called with.

Nothing has to be subclassed, and no file of this package edited: a function, or an object with the right method, is
enough. Whatever changes what a run finds has a name and, if runs are to be resumed, a version.

| door | goes to | is |
|---|---|---|
| `OwnConstraint` | `solve`, `search`, `audit`: `constraints=` | a `ConstraintExpression` with name and bounds |
| `OwnSampler` | `search`: `sampler=` | a `SamplerFactory`: it makes an Optuna sampler or a `TopologySampler` |
| `OwnFormat` | `register_format`, or an entry point `topo_search.formats` | a `DesignWriter` with a name |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, Literal, Protocol, runtime_checkable

from topo_search.model import Design, ResolvedTask, Topology
from topo_search.model.folds import FOLD
from topo_search.model.stated import Stated, Versioned

Expression = Any
"""`casadi.SX`: a symbol, or what is made of symbols."""

Invariance = Literal["none", "numbering", "mirror"]


@dataclass(frozen=True)
class SymbolicPlatform:
    """A platform as an own constraint sees it: CasADi expressions in SI, about the centre of mass, in task axes.

    Modules are numbered as in the topology's key: in preorder, children in the order of the ports.
    """

    task: ResolvedTask
    topology: Topology
    centres: tuple[Expression, ...]
    """o_i: centre of every module from the centre of mass, (3, 1) each [m]."""
    orientations: tuple[Expression, ...]
    """R_i of every module, (3, 3) each: its columns are the module's axes."""
    end_effector: Expression
    """p_E: end-effector from the centre of mass, (3, 1) [m]."""
    hinge_angles: Expression
    """alpha_i of the modules 1 to n - 1, (n - 1, 1) [rad]."""
    inputs: tuple[Expression, ...]
    """u_k: squared rotor speeds of every load case, module-major, (4 n, 1) each [rad^2/s^2]."""

    @property
    def n(self) -> int:
        """The number of modules."""
        return self.topology.n

    @property
    def axes(self) -> tuple[Expression, ...]:
        """z_i: thrust axis of every module, (3, 1) each."""
        return tuple(R[:, 2] for R in self.orientations)

    @property
    def folds(self) -> tuple[Expression, ...]:
        """Fold of every joint [rad]: the hinge angle, positive where it leans the airflows of both modules apart.

        Unlike the angle it has one sign whichever of the two modules is the parent.
        """
        return tuple(FOLD[a] * self.hinge_angles[i - 1] for _, i, a, _ in self.topology.edges())


class ConstraintExpression(Protocol):
    """What an own constraint bounds: a pure function that can be pickled, such as one at the top of a module."""

    def __call__(self, platform: SymbolicPlatform, /) -> Expression:
        """Return one expression, or a column of them; twice differentiable where designs are."""
        ...


@dataclass(frozen=True)
class OwnConstraint:
    """A constraint of your own: `lower <= expression(platform) <= upper`, imposed by Ipopt and checked at the end.

    It is evaluated, not certified: lower bounds and proofs of impossibility ignore it, and remain valid, since to
    ask for more never makes a task cheaper.
    """

    name: str
    """How it is told of wherever it is missed or met."""
    expression: ConstraintExpression
    lower: float = -math.inf
    """In `unit`."""
    upper: float = math.inf
    unit: str = ""
    version: str | None = None
    """Raise it when the expression changes. A run whose constraints have none is never resumed."""
    scale: float | None = None
    """What counts as much, in `unit`: it is met within 1e-6 of this. Default: the arm length for m, the weight for
    N, the weight at the arm length for N m, the largest input for rad^2/s^2, else 1."""
    invariant: Invariance = "none"
    """What leaves the most that it is missed by as it was, so that a search may take several trees for one.

    `none`: it may tell modules apart by their numbers. `numbering`: it is missed by as much from whichever module
    the tree is listed, and if modules are turned by half. `mirror`: so it is for a mirrored platform as well. This
    is tried on random platforms before a search begins; that finds many mistakes, and proves nothing.
    """

    def __post_init__(self) -> None:
        """Refuse what bounds nothing; ValueError names the rule and the value."""
        if not callable(self.expression):
            raise ValueError(f"expression must be a function of a SymbolicPlatform, but got {self.expression!r}")
        if not self.lower <= self.upper:
            raise ValueError(f"`lower <= upper` must hold, but got lower={self.lower}, upper={self.upper}")
        if not (math.isfinite(self.lower) or math.isfinite(self.upper)):
            raise ValueError(f"lower or upper must be a number, but got {self.lower} and {self.upper}")
        if self.lower == math.inf or self.upper == -math.inf:
            raise ValueError(f"lower or upper leaves nothing, but got lower={self.lower}, upper={self.upper}")
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise ValueError(f"`0 < scale < inf` must hold, but got {self.scale}")
        _ = self.stated  # its rules for texts

    @property
    def stated(self) -> Stated:
        """What a file keeps of it."""
        lower, upper = (None if math.isinf(side) else float(side) for side in (self.lower, self.upper))
        return Stated(
            name=self.name,
            version=self.version,
            lower=lower,
            upper=upper,
            unit=self.unit,
            invariant=self.invariant,
        )


class Candidates(Protocol):
    """The trees that a search may propose, of one number of modules."""

    @property
    def task(self) -> ResolvedTask:
        """The task, with its connectors and root."""
        ...

    @property
    def n(self) -> int:
        """The number of modules."""
        ...

    def count(self) -> int:
        """Return how many there are."""
        ...

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m of them, drawn independently and uniformly."""
        ...


class Tried(Protocol):
    """What became of a candidate after so many starts."""

    @property
    def key(self) -> str:
        """Of its topology."""
        ...

    @property
    def starts(self) -> int:
        """Number of starts so far."""
        ...

    @property
    def status(self) -> str:
        """Feasible, infeasible, impossible or failed."""
        ...

    @property
    def objective(self) -> float | None:
        """J of its best design [rad^4/s^4]."""
        ...

    @property
    def violation(self) -> float | None:
        """How far its closest start was from feasible; None where there is a design."""
        ...


@runtime_checkable
class TopologySampler(Protocol):
    """Proposes trees one by one.

    A stopped run is replayed: asked again with the same arguments, it must propose the same.
    """

    def propose(self, candidates: Candidates, tried: Sequence[Tried], random: Random, /) -> Topology | str:
        """Return a tree to solve, or its key.

        Args:
            candidates: the trees there are.
            tried: what became of those of completed rounds, in the order of their proposals; several rows of one
                tree where it had more starts.
            random: the only source of chance.

        A tree that was proposed before is passed over, and another one asked for; after 64 in a row one is drawn.
        """
        ...


class SamplerFactory(Protocol):
    """Makes a sampler for one number of modules."""

    def __call__(self, seed: int, /) -> Any:
        """Return an Optuna sampler, which is handed the fixed-length encoding of trees, or a `TopologySampler`."""
        ...


@dataclass(frozen=True)
class OwnSampler:
    """A sampler of your own with the name, and the version, that a run is known by."""

    name: str
    make: SamplerFactory
    version: str | None = None
    """Raise it when it proposes otherwise. A run whose sampler has none is never resumed."""

    @property
    def stated(self) -> Versioned:
        """What a file keeps of it."""
        return Versioned(name=self.name, version=self.version)


DesignWriter = Callable[[Design], str | bytes]
"""Returns the content of a file that shows a design; what it raises as ValueError is told to the user."""


@dataclass(frozen=True)
class OwnFormat:
    """A kind of file that a design can be exported as."""

    name: str
    """Small letters, digits and dashes: the value of `--format`."""
    write: DesignWriter
    suffixes: tuple[str, ...] = ()
    """Ends of file names that mean it, such as `.step`."""
    says: str = ""
    """What it is for, in a few words, for `export --help`."""
