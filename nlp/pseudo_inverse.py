r"""Reserves of a pseudo-inverse control allocator, as constraints on the geometry only.

Lengths in l_arm; forces in m g, torques in l_arm m g about the COM; inputs over a rotor's maximum input.

| symbol | meaning | shape |
|---|---|---|
| A, A^+ | wrench of every rotor at its maximum input; its pseudo-inverse A^T (A A^T)^-1 | (6, r n), (r n, 6) |
| b; E | wrench of the case; additional wrenches of the required sizes | (6,); (6, d) |
| v, S | their inputs A^+ b and A^+ E | (r n,), (r n, d) |
| v_min | minimum input of a rotor | |

A ball of additional wrenches changes input i by |S_i| at most. The allocator produces all of it if

.. math:: v_i + |S_i| \le 1, \qquad v_i - |S_i| \ge v_{min}

Rotors that cannot exert every wrench, like those of a chain with parallel hinges, may miss b or E: A A^+ b differs
from b. The sum of squares of all misses is one more constraint.

Hover at a tilt t in any direction e needs the force W (sin t e, cos t) in the axes of the body. With (h, c), the
horizontal and vertical parts of W A^+_i for forces, input i is at most |h| sin t + c cos t, which grows with t up
to tan t = |h| / c, and at least c cos t - |h| sin t, which falls. With an uncertain centre of mass the constraints
hold at the corners of the box of errors, where forces have the levers of the error.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from nlp.numbers.masses import masses
from nlp.requirements.balances import WRENCH_TOLERANCE
from nlp.symbols.platform import platform_inertia, wrench_map
from nlp.units import Units
from topo_search.model import Array, LoadCase, ResolvedTask
from topo_search.model.proven import TOLERANCE
from topo_search.model.reserves import AT, POINT_SUFFIXES, box_corners, centres, weight_cases
from topo_search.own_constraint import OwnConstraint, SymbolicPlatform

ROUNDING = 1e-16
"""Added to the square of an input's change, as a share of its maximum, so that its root is smooth at zero."""
SHIFT = 1e-13
"""Shift of the eigenvalues of A A^T over their sum, for platforms that cannot exert every wrench."""
Kind = Literal["tip", "com", "torque", "acceleration", "tilt", "nothing"]


@dataclass(frozen=True)
class _Reserve:
    """A reserve: margins of all inputs to their bounds."""

    case: LoadCase
    kind: Kind
    size: tuple[float, ...]
    """Size along each relevant axis [N], [N m], [rad/s^2]; angle of a tilt [rad]."""
    error: float
    """Half the side of the box of errors of the centre of mass [m]."""

    def rows(self, platform: SymbolicPlatform) -> ca.SX:
        """Return the rows, each at least zero."""
        return ca.vertcat(
            *(self._rows_at(corner, platform) for corner in np.unique(box_corners(self.error), axis=0))
        )

    def _rows_at(self, error: Array, platform: SymbolicPlatform) -> ca.SX:
        """Return the rows for an error of the centre of mass, shape (3,) [m]."""
        task = platform.task
        unit = Units.of(task)
        units = ca.DM([unit.force] * 3 + [unit.torque] * 3)
        limits = task.module.max_thrust_to_weight * task.input_shares.ravel()
        A: ca.SX = wrench_map(platform.orientations, [o / unit.length for o in platform.centres], task)
        A = (A @ ca.diag(ca.SX(ca.DM(limits))))[:, np.flatnonzero(limits).tolist()]
        tip, com = self.case.at_end_effector, self.case.at_com
        levers = ca.cross(platform.end_effector, ca.DM(tip.force)) + np.cross(error, com.force)
        b = ca.vertcat(ca.DM(tip.force) + ca.DM(com.force), ca.DM(tip.torque) + ca.DM(com.torque) + levers)
        wrenches = ca.horzcat(b / units, self._additions(error, platform) / units)
        gram = A @ A.T
        inputs = A.T @ ca.solve(gram + SHIFT * ca.trace(gram) * ca.SX.eye(6), wrenches)
        missed = ca.sumsqr(A @ inputs - wrenches) / TOLERANCE**2
        reached = (1 - missed) / (1 + missed)
        v, S, v_min = inputs[:, 0], inputs[:, 1:], task.module.min_input
        if self.kind != "tilt":
            change = ca.sqrt(ca.sum2(S**2) + ROUNDING)
            return ca.vertcat(reached, 1 - v - change, v - change - v_min)
        sine, cosine = math.sin(self.size[0]), math.cos(self.size[0])
        h, c = ca.sqrt(ca.sum2(S[:, :2] ** 2) + ROUNDING), S[:, 2]
        largest = ca.if_else(h * cosine < c * sine, ca.sqrt(h**2 + c**2), h * sine + c * cosine)
        return ca.vertcat(reached, 1 - largest, c * cosine - h * sine - v_min)

    def _additions(self, error: Array, platform: SymbolicPlatform) -> ca.SX:
        """Return E [N], [N m]."""
        zero, identity = ca.SX.zeros(3, 3), ca.SX.eye(3)
        at_com = ca.vertcat(identity, ca.skew(ca.DM(error)))
        match self.kind:
            case "nothing":
                return ca.SX.zeros(6, 1)
            case "tilt":
                return platform.task.force_unit(platform.n) * at_com
            case "tip":
                added = ca.vertcat(identity, ca.skew(platform.end_effector))
            case "com":
                added = at_com
            case "torque":
                added = ca.vertcat(zero, identity)
            case "acceleration":
                added = ca.vertcat(zero, _inertia(platform))
        return ca.horzcat(*(r * added[:, k] for k, r in enumerate(self.size) if r > 0))


@dataclass(frozen=True)
class _NamedReserve:
    """A reserve by its name, recomputed for the rod of a platform's task."""

    name: str
    declared: _Reserve
    """The reserve of the declared task, for tasks whose rod's mass drops it."""

    def __call__(self, platform: SymbolicPlatform) -> ca.SX:
        """Return the rows, each at least zero."""
        return dict(_reserves(platform.task)).get(self.name, self.declared).rows(platform)


def pseudo_inverse_constraints(task: ResolvedTask) -> tuple[OwnConstraint, ...]:
    """Return the reserves of a task with a pseudo-inverse allocator, named as in the audit; else none."""
    if task.flight.allocator == "optimal":
        return ()
    unit, scale = "of the largest input", WRENCH_TOLERANCE / TOLERANCE
    return tuple(
        OwnConstraint(name, _NamedReserve(name, reserve), lower=0.0, unit=unit, scale=scale)
        for name, reserve in _reserves(task)
    )


def _reserves(task: ResolvedTask) -> Iterator[tuple[str, _Reserve]]:
    """Yield the reserves with their names."""
    flight, error = task.flight, task.flight.com_error
    level = flight.directions == "horizontal"
    for _, label, case in centres(task):
        force = "horizontal force" if level else "force"
        for point in POINT_SUFFIXES[flight.at] if flight.force_reserve else ():
            size = (flight.force_reserve,) * (2 if level else 3)
            yield f"{label}, {force} reserve{AT[point]}", _Reserve(case, "com" if point else "tip", size, error)
        if flight.torque_reserve:
            yield f"{label}, torque reserve", _Reserve(case, "torque", (flight.torque_reserve,) * 3, error)
        for k, a in enumerate(flight.angular_acceleration):
            if a > 0:
                size = tuple(a * (k == axis) for axis in range(3))
                yield f"{label}, angular acceleration about {'xyz'[k]}", _Reserve(case, "acceleration", size, error)
        if flight.com_error:
            yield f"{label}, error of the centre of mass", _Reserve(case, "nothing", (), error)
    if flight.tilt_deg:
        (_, label, case), *_ = weight_cases(task, "hover")
        yield f"{label}, tilt", _Reserve(case, "tilt", (math.radians(flight.tilt_deg),), error)


def _inertia(platform: SymbolicPlatform) -> ca.SX:
    """Return the inertia about the COM [kg m^2]."""
    task, l_arm = platform.task, platform.task.module.arm_length
    o, q = [o / l_arm for o in platform.centres], platform.end_effector / l_arm
    carried = masses(task, platform.topology)
    return task.module.mass * l_arm**2 * platform_inertia(o, platform.orientations, q, carried)
