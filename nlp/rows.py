"""Constraints of a program: their violations at a point, and rows that features add to the printed problem."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from nlp.numbers.point import Point
from topo_search.model import ResolvedTask, Topology

if TYPE_CHECKING:
    from nlp.assembled.problem import AssembledProblem, RowBlock


class Violation(NamedTuple):
    """Violation of one constraint at a point."""

    name: str
    amount: float
    """Positive if violated, zero or negative if met, in `unit`."""
    unit: str
    scaled: float
    """The same in l_arm, m_t g, l_arm m_t g or rad, to compare constraints of different kinds."""
    tolerance: float = 0.0
    """Largest `scaled` at which the constraint is met."""
    to_add: tuple[Any, ...] = ()
    """Rows to add to a program once it is violated, for its kind of lazy rows; empty for other constraints."""

    @property
    def met(self) -> bool:
        """True if the constraint holds; NaN never does."""
        return bool(self.scaled <= self.tolerance)

    @property
    def rank(self) -> float:
        """Excess over the tolerance; infinite for NaN."""
        return math.inf if math.isnan(self.scaled) else self.scaled - self.tolerance


class LazyRows(Protocol):
    """Limits of a feature that get rows in a program only near or beyond them, since few of them are active.

    What has rows, the selection, is a value of the feature; None without any.
    """

    one_round: bool
    """True if one round of Ipopt is enough with these rows alone, because more rows follow anyway."""

    def functions(self, task: ResolvedTask) -> Sequence[Any]:
        """Return the compiled functions that the rows of a task need."""

    def violations(self, point: Point) -> Iterator[Violation]:
        """Yield the violation of every limit."""

    def select(self, origin: Point, *, everything: bool = False) -> Any:
        """Return the selection for the first program of a solve; `everything`: also far from the limits."""

    def extend(self, point: Point, violated: Sequence[Violation], selection: Any) -> tuple[Any, set[str]]:
        """Return the selection for the next program, and the names of violations that its new rows may end.

        Args:
            point: the result of the last program.
            violated: all violations there that are not met.
            selection: the selection of the last program.
        """

    def rows(self, program: AssembledProblem, task: ResolvedTask, topology: Topology, selection: Any) -> RowBlock:
        """Return the rows of a selection."""


Selections = Mapping[LazyRows, Any]
"""The selection of every kind of lazy rows that a program has."""
UserConstraints = Sequence[Any]
"""Constraints of the user, each an `OwnConstraint`, which its feature alone reads; usually none."""
