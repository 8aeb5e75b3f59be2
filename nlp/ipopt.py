"""Ipopt: its call and its result.

It is not called without room for its BLAS, which waits without end for memory that it cannot have.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.numbers.point import Point
from topo_search.model import ResolvedTask, Topology

MEMORY = 256 * 2**20
"""Address space that a process needs before its first call of Ipopt [bytes]: the plugin, and buffers of its BLAS.

Measured with `ulimit -v`: with 40 to 128 MB more than after loading CasADi a first solve never returns, with 192 MB
it ends with an error, with 256 MB it solves.
"""
BETA = 200.0
"""Sharpness of the log-sum-exp: it asks for log(9)/200 = 0.011 l_arm^2 more than the exact minimum at most.

Where the end of an axis is nearest, three KKT candidates coincide, which asks for log(3)/200 too much: 0.07 mm
between envelopes of the default module. So far above the margin designs end.
"""
OPTIONS: dict[str, int | float | str | bool] = {
    "print_time": False,
    "show_eval_warnings": False,  # of values that are no numbers: Ipopt turns back, and the result says so
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 300,  # a limit in iterations, not in time: the result must not depend on the machine's speed
    "ipopt.mu_strategy": "adaptive",
    "ipopt.bound_relax_factor": 0.0,  # inputs and angles end inside their bounds, not 1e-8 outside
}


@dataclass(frozen=True)
class IpoptResult:
    """Result of Ipopt from one start."""

    point: Point
    status: str
    iterations: int

    @property
    def finite(self) -> bool:
        """True if all values are numbers; an evaluation that failed leaves none behind."""
        return bool(np.all(np.isfinite(self.point.pack())))


def ipopt(name: str, problem: Any, options: dict[str, Any]) -> ca.Function:
    """Return Ipopt for a problem; MemoryError if it would not get the memory that it begins with."""
    _require_memory()
    return ca.nlpsol(name, "ipopt", problem, options)


@cache  # once it was called it has its buffers
def _require_memory() -> None:
    try:
        mmap.mmap(-1, MEMORY).close()  # no page of it is touched
    except OSError as error:
        raise MemoryError(f"Ipopt needs {MEMORY // 2**20} MB of address space") from error


def result_of(
    solver: ca.Function, solution: dict[str, ca.DM], task: ResolvedTask, topology: Topology
) -> IpoptResult:
    """Return what a solver returns."""
    stats = solver.stats()
    x = np.asarray(solution["x"], dtype=float).ravel()
    iterations = max(0, int(stats["iter_count"]))  # -1 where Ipopt does not begin, for there are too few unknowns
    return IpoptResult(Point.unpack(task, topology, x), str(stats["return_status"]), iterations)
