"""What the engine is told to do with a candidate: the solver and the audit come in as plain functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from topo_search.model import Audit, Design, Infeasible, ResolvedTask, Topology


class Solve(Protocol):
    """Solves one topology from some of its starts: a pure function that can be sent to another process.

    Start s is drawn from (task, topology, s, seed) alone: the best of two ranges is the best of their union.
    """

    def __call__(
        self, task: ResolvedTask, topology: Topology, *, starts: range, seed: int, near: Sequence[Design] = ()
    ) -> Design | Infeasible:
        """Return the best design over the starts, or the start that came closest.

        Args:
            task: the task.
            topology: the tree.
            starts: indices of the starts.
            seed: draws them.
            near: designs of other topologies that can be carried over, each as one more start before these.
        """
        ...


AuditDesign = Callable[[Design], Audit]


@dataclass(frozen=True)
class Backends:
    """The functions that know the physics."""

    solve: Solve
    audit: AuditDesign
    lower_bound: Callable[[ResolvedTask], float]
    """A value that no objective of this task's size can go below [rad^4/s^4]."""
    prove_impossible: Callable[[ResolvedTask], Infeasible | None]
    """A proof that no topology of this task's size can do it, if there is a simple one."""


@dataclass(frozen=True)
class Failed:
    """A job that ended without an answer."""

    kind: Literal["crash", "timeout", "memory", "error"]
    reason: str
    """What happened, in one line."""

    @property
    def may_pass(self) -> bool:
        """Whether a second attempt may end otherwise: a pure function raises again, but is not killed again."""
        return self.kind != "error"


Outcome = Design | Infeasible | Failed
