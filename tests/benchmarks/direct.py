"""The baseline: a direct implementation of the paper's formulation in CasADi.

One SX graph with all pairs, built for every topology; exact derivatives by CasADi; Ipopt with MUMPS; uniformly
random starts. It uses the reference problem that the solver's programs are tested against (`nlp.problem`): the same
variables in the same units, the same constraints with the same margin and sharpness. Ipopt has the options that
worked best (`OPTIONS`), so that the baseline is as strong as possible.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlp.ipopt import BETA
from nlp.numbers.geometry import poses, root_rotation
from nlp.numbers.point import Point, fixed_end_effector
from nlp.problem import problem
from topo_search.model import ResolvedTask, Topology

OPTIONS: dict[str, int | float | str | bool] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.max_iter": 300,
    "ipopt.bound_relax_factor": 0.0,
}


class Direct:
    """The nonlinear program of one task and topology as one graph."""

    def __init__(self, task: ResolvedTask, topology: Topology) -> None:
        """Build the graph and its derivatives."""
        self._task, self._topology = task, topology
        reference = problem(task, topology)
        rows = [(row.expression, row.lower, row.upper) for row in reference.constraints]
        self._bounds = {
            "lbx": reference.lower,
            "ubx": reference.upper,
            "lbg": np.concatenate([np.full(g.numel(), lower) for g, lower, _ in rows]),
            "ubg": np.concatenate([np.full(g.numel(), upper) for g, _, upper in rows]),
            "p": BETA,
        }
        g = ca.vertcat(*(ca.vec(expression) for expression, _, _ in rows))
        nlp = {"x": reference.variables.vector(), "p": reference.beta, "f": reference.objective, "g": g}
        self._solver = ca.nlpsol("direct", "ipopt", nlp, OPTIONS)

    def solve(self, start: Point) -> tuple[Point, int]:
        """Return the point that Ipopt reaches from a start, and its iterations."""
        x = self._solver(x0=start.pack(), **self._bounds)["x"]
        point = Point.unpack(self._task, self._topology, np.asarray(x, dtype=float).ravel())
        return point, int(self._solver.stats()["iter_count"])


def random_start(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Point:
    """Return a start with uniform angles, a uniform end-effector position and every rotor at the hover input.

    The position is uniform in the bounding box of the module centres, enlarged by the connector distance.
    """
    n, right, l_c = topology.n, np.pi / 2, task.module.connector_distance
    limits = np.array([np.pi, right, np.pi]) if task.search.root == "free" else np.array([0.0, right, right])
    root = rng.uniform(-limits, limits)
    alpha = rng.uniform(-right, right, n - 1)
    _, p = poses(topology, root_rotation(root), alpha, l_c)
    p_E = rng.uniform(p.min(axis=0) - l_c, p.max(axis=0) + l_c)
    if task.end_effector.fixed_position is not None:
        p_E = fixed_end_effector(task, topology, root, alpha)
    u = np.full((len(task.load_cases), n, 4), task.module.hover_input(task.gravity))
    return Point(task, topology, root, alpha, p_E, u)
