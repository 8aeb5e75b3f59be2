"""The answer when no design was found: why, by how much, and whether that is proven."""

from __future__ import annotations

from typing import Literal

from topo_search.model.design import SolverRecord, TopologyRows
from topo_search.model.value import Number, Value


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
    solver: SolverRecord | None = None
    """How the closest start came about; None for a proof."""
