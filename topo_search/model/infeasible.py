"""The answer when no design was found: why, by how much, and whether that is proven."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.design import SolverRecord, TopologyRows
from topo_search.model.proven import at_least
from topo_search.model.relaxation import Relaxed
from topo_search.model.value import Number, Value

NAMED = 3
"""Most constraints that a message names beside the closest."""


class Shortfall(Value):
    """A constraint that some starts missed by more than any other."""

    constraint: str
    """In the user's words, with the modules or the load case."""
    starts: int
    """How many."""
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
    """By how much it is missed, positive, in `unit`."""
    unit: str
    message: str
    """The whole reason in one sentence."""
    shortfalls: tuple[Shortfall, ...] = ()
    """What all starts ended short of, the most frequent first; none for a proof."""
    solver: SolverRecord | None = None
    """How the closest start came about; None for a proof."""
    relaxed: Annotated[Relaxed | None, Field(exclude_if=lambda given: given is None)] = None
    """Which limits, relaxed alone, give the tree a design; None where it was not asked."""

    def with_starts(self, shortfalls: Iterable[Shortfall], solver: SolverRecord) -> Infeasible:
        """Return the same closest start among these starts."""
        gathered = Shortfall.gather(shortfalls)
        update = {"shortfalls": gathered, "solver": solver, "message": self._message(gathered, solver.starts)}
        return self.model_copy(update=update)

    def _message(self, shortfalls: tuple[Shortfall, ...], starts: int) -> str:
        missed = f"misses `{self.worst_constraint}` by {_amount(self.violation, 3, self.unit)}"
        if starts == 1:
            return f"the only start {missed}"
        named = [
            f"{s.starts} `{s.constraint}` (by {_amount(at_least(s.violation, 2), 2, s.unit)} or more)"
            for s in shortfalls[:NAMED]
        ]
        others = sum(s.starts for s in shortfalls[NAMED:])
        if others:
            named.append(f"{others} another constraint")
        return f"the closest of {starts} starts {missed}; what they miss most: {', '.join(named)}"


def _amount(value: float, digits: int, unit: str) -> str:
    """Return a number with its unit, if it has any."""
    return f"{value:.{digits}g} {unit}".rstrip()
