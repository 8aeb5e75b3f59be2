"""The objective of a run that maximises a quantity of its task."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from topo_search.model.maximized import QUANTITIES, Quantity
from topo_search.model.objective import LEAST_EFFORT, ROUNDING, Objective, Rated
from topo_search.model.proven import lower_text, upper_text

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask, Task


@dataclass(frozen=True)
class LargestValue(Objective):
    """The largest value of a quantity."""

    quantity: Quantity = QUANTITIES["force_reserve"]

    def number(self, of: Rated) -> float | None:
        """Return the value, in the quantity's unit."""
        value: float | None = of.value
        return value

    def gap(self, of: Rated, bound: float) -> float | None:
        """Return bound / value - 1; None of a value of 0."""
        return bound / of.value - 1 if of.value else None

    def excess(self, of: Rated, best: Rated) -> float:
        """Return the value of the best / value - 1."""
        value, largest = of.value or 0.0, best.value or 0.0
        return 0.0 if value >= largest else largest / value - 1 if value else math.inf

    def breaks(self, of: Rated, bound: float) -> bool:
        """Return whether the value is above the bound."""
        return of.value is not None and of.value > bound * (1 + ROUNDING)

    def gap_after(self, gap: float, excess: float) -> float:
        """Return (1 + gap) (1 + excess) - 1."""
        return (1 + gap) * (1 + excess) - 1

    def words(self, of: Rated, digits: int = 3) -> str:
        """Return the value and its effort in words."""
        return f"{self.value_words(of, digits)}, J = {of.objective:.{digits}g} rad^4/s^4"

    def bound_words(self, of: Rated) -> str:
        """Return the largest value that any topology may have."""
        return f"has more than {upper_text(of.value_bound or 0.0, 4)} {self.quantity.unit}"

    def value_words(self, of: Rated, digits: int = 3) -> str:
        """Return the value in words."""
        return f"{self.quantity.words} {lower_text(of.value or 0.0, digits)} {self.quantity.unit}"

    def improvement(self, of: Rated, gap: float) -> str:
        """Return the value that none exceeds."""
        return f"has more than {upper_text((of.value or 0.0) * (1 + gap), 4)} {self.quantity.unit}"

    def difference(self, of: Rated, best: Rated) -> str:
        """Return by what share the value is smaller."""
        return f"-{100 * (1 - (of.value or 0.0) / best.value) if best.value else 0.0:.2f} %"

    def ability(self, task: ResolvedTask) -> str | None:
        """Return what a design for a task does with its value."""
        return ability(task, task.search.reached)

    def claim(self, bound: float) -> str:
        """Return the value that none holds in words."""
        return f"{self.quantity.words} < {upper_text(bound)} {self.quantity.unit}"

    def bounds(self, bound: float) -> tuple[float | None, float | None]:
        """Return an upper bound of the value."""
        return None, bound


def objective_of(task: Task) -> Objective:
    """Return the objective of a task."""
    if task.search.maximize is None:
        return LEAST_EFFORT
    quantity = QUANTITIES[task.search.maximize]
    least, name = f"largest {quantity.words}", quantity.words
    return LargestValue(least, f"{least} [{quantity.unit}]", "upper bound", name, "more", quantity)


AT_POINT = {"tip": "end-effector", "com": "centre of mass", "both": "end-effector or at the centre of mass"}
"""Points of `flight.at` in words."""


def ability(task: ResolvedTask, value: float | None = None) -> str:
    """Return what a platform with a value of the task's maximised quantity does; without one, what is maximised."""
    assert task.search.maximize is not None
    flight, quantity = task.flight, QUANTITIES[task.search.maximize]
    size = "" if value is None else f" up to {lower_text(value, 4)} {quantity.unit}"
    around = "in hover" + " and in every load case that carries the weight" * (flight.around != "hover")
    if task.search.maximize == "force_reserve":
        weights = "" if value is None else f" ({lower_text(value / task.force_unit(task.n), 3)} m_t g)"
        which = "horizontal force" if flight.directions == "horizontal" else "force"
        return f"holds any {which}{size}{weights} at the {AT_POINT[flight.at]} {around}"
    if task.search.maximize == "torque_reserve":
        return f"holds any torque{size} {around}"
    if task.search.maximize == "payload":
        return f"carries a payload{size} at the end-effector"
    times = "" if value is None else f", up to {lower_text(value, 4)} times as large"
    return f"holds all wrenches of the load cases at the end-effector{times}"
