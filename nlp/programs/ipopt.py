"""How Ipopt is called, and what it says."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlp.numbers.point import Point
from topo_search.model import ResolvedTask, Topology

BETA = 200.0
"""Sharpness of the log-sum-exp: it asks for log(9)/200 = 0.011 l_arm^2 more than the exact minimum at most.

Where the end of an axis is nearest, three candidates coincide, which asks for log(3)/200 too much: 0.07 mm between
envelopes of the default module. So far above the margin designs end.
"""
OPTIONS: dict[str, int | float | str | bool] = {
    "print_time": False,
    "show_eval_warnings": False,  # of values that are no numbers: Ipopt turns back, and the result says so
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 300,  # a limit in iterations, not in time: the answer must not depend on the machine's speed
    "ipopt.mu_strategy": "adaptive",
    "ipopt.bound_relax_factor": 0.0,  # inputs and angles end inside their bounds, not 1e-8 outside
}


@dataclass(frozen=True)
class IpoptResult:
    """What Ipopt says after one start."""

    point: Point
    status: str
    iterations: int

    @property
    def finite(self) -> bool:
        """Whether all values are numbers; an evaluation that failed leaves none behind."""
        return bool(np.all(np.isfinite(self.point.pack())))


def answer_of(solver: ca.Function, result: dict[str, ca.DM], task: ResolvedTask, topology: Topology) -> IpoptResult:
    """Return what a solver says after a solve."""
    stats = solver.stats()
    x = np.asarray(result["x"], dtype=float).ravel()
    iterations = max(0, int(stats["iter_count"]))  # -1 where Ipopt does not begin, for there are too few unknowns
    return IpoptResult(Point.unpack(task, topology, x), str(stats["return_status"]), iterations)
