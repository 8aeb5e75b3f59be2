"""The objective of a run as a value: how designs compare with each other and with a bound, in numbers and words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from topo_search.model.proven import improvement, lower_text

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask

Rated = Any
"""A design, or the row or event of a run that has its numbers."""

ROUNDING = 3.0e-6
"""Relative error of a bound by rounding, and in older ledgers, which leave tolerances to the audit."""


@dataclass(frozen=True)
class Objective:
    """Order of designs by J, the lower the better; `largest_value` has the one by a maximised quantity."""

    least: str = "least control effort"
    """The best of it, in words."""
    column: str = "J [rad^4/s^4]"
    """Name and unit of the number, as the title of a column."""
    bound: str = "lower bound"
    """Kind of bound that is proven for all designs."""
    number_words: str = "J"
    """The number, in words."""
    better: Literal["less", "more"] = "less"
    """Better numbers."""

    def number(self, of: Rated) -> float | None:
        """Return J [rad^4/s^4]."""
        J: float | None = of.objective
        return J

    def gap(self, of: Rated, bound: float) -> float | None:
        """Return 1 - bound / J; None without effort."""
        return None if not of.objective else 1.0 - bound / of.objective

    def excess(self, of: Rated, best: Rated) -> float:
        """Return J / J of the best - 1."""
        return (of.objective or 0.0) / best.objective - 1 if best.objective else 0.0

    def breaks(self, of: Rated, bound: float) -> bool:
        """Return whether J is below the bound."""
        return of.objective is not None and bool(of.objective < bound * (1 - ROUNDING))

    def gap_after(self, gap: float, excess: float) -> float:
        """Return 1 - (1 - gap) / (1 + excess)."""
        return max(0.0, 1 - (1 - gap) / (1 + excess))

    def words(self, of: Rated, digits: int = 3) -> str:
        """Return J in words."""
        return f"J = {of.objective:.{digits}g} rad^4/s^4"

    def bound_words(self, of: Rated) -> str:
        """Return by how much any topology may be better."""
        return f"is {improvement(of.gap or 0.0)}"

    def improvement(self, of: Rated, gap: float) -> str:
        """Return what no other platform of a design's size does, given the gap, after `no platform`."""
        return "can save more control effort"

    def difference(self, of: Rated, best: Rated) -> str:
        """Return the difference of a design's number from that of the best, as a share in words."""
        return f"+{100 * self.excess(of, best):.2f} %"

    def ability(self, task: ResolvedTask) -> str | None:
        """Return what a design for a task does with its value of the maximised quantity."""
        return None

    def claim(self, bound: float) -> str:
        """Return the lower bound of J in words."""
        return f"J >= {lower_text(bound)} rad^4/s^4"

    def bounds(self, bound: float) -> tuple[float | None, float | None]:
        """Return a lower bound of J."""
        return bound, None


LEAST_EFFORT = Objective()
