"""Calls of Ipopt and their results.

Ipopt is called only if there is enough memory for its BLAS, which otherwise waits for memory forever.
"""

import mmap
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from nlp.numbers.point import Point
from topo_search.model import ResolvedTask, Topology

MEMORY = 256 * 2**20
"""Address space needed before the first call of Ipopt, for the plugin and buffers of its BLAS [bytes].

Measured with `ulimit -v`: with 40 to 128 MB beyond the memory after loading CasADi a first solve never returns,
with 192 MB it fails, with 256 MB it succeeds.
"""
BETA = 200.0
"""Sharpness of the log-sum-exp: it requires at most log(9)/200 = 0.011 l_arm^2 more than the exact minimum.

If the end of an axis is nearest, three KKT candidates coincide, which requires log(3)/200 too much: designs keep
0.07 mm more than the margin between envelopes of the default module.
"""
OPTIONS: dict[str, int | float | str | bool] = {
    "print_time": False,
    "show_eval_warnings": False,  # about NaN: Ipopt backtracks, and its status tells
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 300,  # not a time limit: results must not depend on the machine's speed
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
        """True if all values are finite, which they are not after a failed evaluation."""
        return bool(np.all(np.isfinite(self.point.pack())))


def ipopt(name: str, problem: Any, options: dict[str, Any]) -> ca.Function:
    """Return Ipopt for a problem; raise MemoryError if there is too little memory to start it."""
    _require_memory()
    return ca.nlpsol(name, "ipopt", problem, options)


@cache  # after the first call Ipopt has its buffers
def _require_memory() -> None:
    try:
        mmap.mmap(-1, MEMORY).close()  # reserves addresses only: no page is touched
    except OSError as error:
        raise MemoryError(f"Ipopt needs {MEMORY // 2**20} MB of address space") from error


def result_of(
    solver: ca.Function, solution: dict[str, ca.DM], task: ResolvedTask, topology: Topology
) -> IpoptResult:
    """Return the result of a solver."""
    stats = solver.stats()
    x = np.asarray(solution["x"], dtype=float).ravel()
    iterations = max(0, int(stats["iter_count"]))  # -1 if Ipopt does not start, with too few unknowns
    return IpoptResult(Point.unpack(task, topology, x), str(stats["return_status"]), iterations)
