"""Flight capability of a design, or of any set of rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| N, K | numbers of rotors and load cases; types of module may have fewer than r | | |
| v | inputs over the largest input of a rotor | (N,) | |
| A | wrench map about the COM, W = A v | (6, N) | m_t g, l_arm m_t g |
| b_k | wrench of hover (k = 0) and of every load case | (6,) | the same |
| p_E | end-effector from the COM | (3,) | l_arm |
| J | inertia about the COM | (3, 3) | l_arm m_t g s^2 |

Each b_k is first replaced by a wrench that some v produces exactly, within the audit's tolerance of it. A force f
at the end-effector adds [f, p_E x f], which does not change the torque about p_E: with that torque fixed, the
forces of A v minus that of b_k are the ones that can be added. A force at the COM adds [f, 0]; an added torque
leaves the force unchanged. Hover at a tilt t requires [f, 0] in body axes with a force f of the weight's size at
the angle t from z. If the centre of mass is off by c, torques are about the actual one, and p_E becomes p_E - c.
Torques are linear in c, so whatever can be added at all vertices of a box of errors can be added everywhere in it.
In reserves and load factors, rotors run between the module's smallest and largest input; a dead rotor has input
zero.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from functools import cache, cached_property
from itertools import product
from typing import Any

import numpy as np

from topo_search.model import (
    Array,
    CaseFlight,
    Design,
    Flags,
    Flight,
    Indices,
    JointLoad,
    LoadCase,
    ResolvedTask,
    RotorsOut,
    Wrench,
)
from topo_search.model.kinds import Vector
from topo_search.model.proven import TOLERANCE
from topo_search.model.reserves import ROTOR_OUT_TORQUE, weight_cases
from verify.assembly import rod_moment
from verify.flight import balls
from verify.flight.joints import children_in_cycles, inertia, joint_loads
from verify.flight.programs import LARGEST, Bounds, Solvable, find_solutions, greatest, least_inputs
from verify.kinematics import Platform, has_rotor, platform, required_wrench, wrench_map
from verify.residuals import clamp
from verify.sections import Findings

HOVER = "hover"

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Vertices of a cube, shape (8, 3)."""
CASES = 20
"""Number of cases whose reserves are computed in one batch."""


def flight(found: Findings) -> Flight | None:
    """Return the flight capability of a design beyond its task; None if its numbers are too large."""
    design, placed, mount = found.scene.design, found.scene.platform, found.sheet.mount
    task, tip, errors = design.task, found.sheet.end_effector, found.figures["sensitivity"]
    analysis = _analysis(design, np.zeros(3))
    if not analysis.in_range:
        return None
    rod, of_task = None if tip is None else tip.rod, task.end_effector
    is_ignored = (of_task.rod, of_task.rod_mass) == ("straight", "ignored")
    angle = None if errors is None else errors.hinge_angle_deg
    rotors, flying = placed.rotors[has_rotor(task)], [kind for kind in task.types if kind.rotor_table.count]
    span = max(float(np.linalg.norm(rotors - rotor, axis=1).max()) for rotor in rotors)
    return Flight(
        cases=case_reserves(design, analysis),
        rotors_out_hover=analysis.rotors_out([0]),
        rotors_out_all=analysis.rotors_out(range(len(analysis.names))),
        rotors_out_asked=None
        if task.flight.rotor_out == "none"
        else analysis.rotors_out([number for number, _, _ in weight_cases(task, task.flight.rotor_out)]),
        joints=_joint_loads(analysis, design, placed, None if mount is None else mount.module),
        joints_in_cycles=len(children_in_cycles(design.topology)) + len(design.topology.closures),
        hinge_tolerance_deg=None if angle is None else angle.tolerated,
        hover_input=analysis.hover_input,
        hover_power_ratio=analysis.hover_power_ratio,
        rod_length_m=None if rod is None else rod.length_m,
        rod_mass_share=None if rod is None else rod.mass_kg / task.total_mass(task.n),
        rod_moment_Nm=None if rod is None or not is_ignored else rod_moment(rod, placed, task.gravity),
        span_m=clamp(span + 2 * max(float(kind.rotor_radii.max()) for kind in flying)),
    )


def case_reserves(design: Design, analysis: CapabilityAnalysis | None = None) -> tuple[CaseFlight, ...]:
    """Return the reserves in hover and in every load case, anywhere within the error of the centre of mass.

    `analysis`: that of the design without the error, if it is known.
    """
    cases, error = (analysis or _analysis(design, np.zeros(3))).cases(), design.task.flight.com_error
    if not error:
        return cases
    off_centre = [_analysis(design, error * c).cases() for c in CUBE]
    return tuple(_worst_case(*rows) for rows in zip(cases, *off_centre, strict=True))


def _analysis(design: Design, offset: Array) -> CapabilityAnalysis:
    """Return the analysis of a design whose centre of mass is off by a vector [m]."""
    task, placed = design.task, platform(design)
    exists, max_inputs = has_rotor(task), _max_inputs(task)
    A = wrench_map(placed, task.modules_of_nodes)[:, exists.ravel()] * max_inputs
    N = A.shape[1]
    return CapabilityAnalysis(
        np.vstack([A[:3], _torques_about(offset, A)]),
        placed.p_e - offset,
        (task.force_unit(task.n), task.module.arm_length),
        Bounds(np.full(N, task.module.min_input), np.ones(N)),
        dict(zip(task.case_labels, task.load_cases, strict=True)),
        [None, *(design.inputs[:, exists] / max_inputs)],
        inertia(design, placed),
        task.flight.rotor_out_torque,
        np.argwhere(exists),
    )


def _max_inputs(task: ResolvedTask) -> Array:
    """Return the largest squared speeds of all rotors, shape (N,) [rad^2/s^2]."""
    return np.concatenate([module.max_inputs(task.gravity) for module in task.modules_of_nodes])


class CapabilityAnalysis:
    """Flight capability of a set of rotors, in units of the weight, an arm and the largest inputs.

    Args:
        A: wrenches of the rotors at their largest inputs, shape (6, N) [N, N m].
        p_E: end-effector from the COM, shape (3,) [m].
        units: the weight [N] and the arm length [m].
        box: bounds on the inputs, shape (N,) each.
        cases: load cases in SI by name.
        inputs: inputs in hover and in every case, shape (N,) each; None: those of least effort.
        J: inertia about the COM, shape (3, 3) [kg m^2]; None: unknown.
        rotor_out_torque: torque of any direction that must be left after a rotor failure [N m], which is then
            computed; None: the default decides which failures are survived.
        numbers: module and number of each rotor there, shape (N, 2); None: all are of one module.
    """

    def __init__(
        self,
        A: Array,
        p_E: Array,
        units: tuple[float, float],
        box: Bounds,
        cases: dict[str, LoadCase],
        inputs: Sequence[Array | None],
        J: Array | None,
        rotor_out_torque: float | None = None,
        numbers: Indices | None = None,
    ) -> None:
        self._numbers = np.argwhere(np.ones((1, A.shape[1]))) if numbers is None else numbers
        self.force, arm = units
        self.torque = arm * self.force
        unit = np.repeat([self.force, self.torque], 3)
        self.A, self.p_E, self.box, self.inputs = A / unit[:, None], p_E / arm, box, inputs
        self.J = None if J is None else J / self.torque
        self.is_left_computed = rotor_out_torque is not None
        left = ROTOR_OUT_TORQUE if rotor_out_torque is None else rotor_out_torque / self.torque
        self.enough_left = left - TOLERANCE
        hover = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, self.force)))
        self.load_cases, self.names = (hover, *cases.values()), (HOVER, *cases)
        self.b = np.array([required_wrench(case, p_E) / unit for case in self.load_cases])
        _, first, distinct = np.unique(np.round(self.b, 12), axis=0, return_index=True, return_inverse=True)
        self.wrenches, self.wrench_index = self.b[first], distinct.ravel()  # equal wrenches are solved only once

    @cached_property
    def solvable(self) -> Solvable:
        """Feasibility of the distinct wrenches."""
        return find_solutions(self.A, self.wrenches, self.box)

    @cached_property
    def v(self) -> list[Array | None]:
        """Inputs in hover and in every case; None if those of least effort are not found."""
        return [
            least_inputs(self.A, self.A @ self.solvable.v[row], self.box)[0]
            if v is None and self.solvable.yes[row]
            else v
            for v, row in zip(self.inputs, self.wrench_index, strict=True)
        ]

    @cached_property
    def in_range(self) -> bool:
        """True if numbers are small enough for the precision of the programs."""
        return bool(np.all(np.abs(self.A) <= LARGEST) and np.all(np.abs(self.b) <= LARGEST))

    def cases(self) -> tuple[CaseFlight, ...]:
        """Return the reserves in hover and in every load case."""
        yes, no = self.solvable.yes, self.solvable.no
        b = self.solvable.v[yes] @ self.A.T
        attainable = np.cumsum(yes) - 1  # number of a wrench among those with reserves
        hover = int(attainable[self.wrench_index[0]])
        reserves = [row for k in range(0, len(b), CASES) for row in self._reserves(b[k : k + CASES], hover - k)]
        more_fields = cache(lambda k, force: self._load_factor(b[k], force) | self._com_error(b[k], force))
        rows = []
        for name, case, v, row in zip(self.names, self.load_cases, self.v, self.wrench_index, strict=True):
            possible = True if yes[row] else False if no[row] else None
            fields = dict[str, Any]()
            if possible:
                k = int(attainable[row])
                fields = reserves[k] | more_fields(k, case.at_com.force)
            if name != HOVER:
                fields = {field: value for field, value in fields.items() if not field.startswith("tilt")}
            rows.append(CaseFlight(name=name, possible=possible, **fields, **self._input_fields(v)))
        return tuple(rows)

    def _reserves(self, b: Array, hover: int) -> list[dict[str, Any]]:
        """Return the fields of the forces and torques that can be added to attainable wrenches, shape (B, 6).

        About the tip or the COM, some rows of forces or torques vary while others are fixed. The row `hover` also
        has the fields of the tilt.
        """
        fields, at_com = self._accelerations(b), np.zeros(3)
        force, side, torque, torque_and_lift = slice(0, 3), slice(0, 2), slice(3, 6), slice(3, 7)
        quantities = (
            # an added torque is the same about every point and leaves the force unchanged
            ("torque", "", "Nm", at_com, torque, force),
            ("force", "", "N", self.p_E, force, torque),
            ("horizontal", "", "N", self.p_E, side, torque_and_lift),
            ("force", "_com", "N", at_com, force, torque),
            ("horizontal", "_com", "N", at_com, side, torque_and_lift),
        )
        groups = list[balls.Polytopes]()
        for _, _, _, p, varied, fixed in quantities:
            M, w = (np.vstack([W[:3], _torques_about(p, W), W[2:3]]) for W in (self.A, b.T))
            groups.append(balls.Polytopes(M[varied], M[fixed], w[varied].T, w[fixed].T))
        level = b[hover : hover + 1] if hover >= 0 else b[:0]
        groups.append(balls.Polytopes(self.A[force], self.A[torque], level[:, force], level[:, torque], caps=True))
        *inner, caps = balls.largest_balls(groups, self.box)
        for (quantity, point, unit, p, varied, _), row_balls in zip(quantities, inner, strict=True):
            name, scale = f"{quantity}_reserve{point}{{}}_{unit}", self.force if unit == "N" else self.torque
            E = np.eye(6)
            E[3:, :3] = np.cross(p, np.eye(3)).T
            for row, ball, wrench in zip(fields, row_balls, b, strict=True):
                row |= _ball_fields(name, f"{quantity}_weakest{point}", ball, scale)
                row[f"{name.format('')}_pseudo_inverse"] = self.pseudo_inverse.ball(wrench, E[:, varied]) * scale
        for cap in caps:
            fields[hover] |= _ball_fields("tilt{}_deg", "tilt_weakest", cap, math.degrees(1.0))
            fields[hover]["tilt_deg_pseudo_inverse"] = math.degrees(self.pseudo_inverse.cap(b[hover]))
        return fields

    def _accelerations(self, b: Array) -> list[dict[str, Any]]:
        """Return the fields of accelerations about each axis: the greatest s for which A v = b +- s J e / |J e|."""
        if self.J is None:
            return [{} for _ in b]
        norms, directions = np.linalg.norm(self.J, axis=0), balls.TORQUES @ self.J
        by_inverse = [tuple(self.pseudo_inverse.ball(w, directions[:, [k]]) for k in range(3)) for w in b]
        fields: list[dict[str, Any]] = [{"angular_acceleration_rad_s2_pseudo_inverse": a} for a in by_inverse]
        if not norms.all():
            return fields
        torques = np.hstack([np.zeros((3, 3)), (self.J / norms).T])
        steps = self._greatest_steps(b, np.vstack([torques, -torques]))
        lower, upper = (np.reshape(bound, (-1, 2, 3)).min(axis=1) / norms for bound in steps)
        for row, at_least, at_most in zip(fields, lower, upper, strict=True):
            row["angular_acceleration_rad_s2"] = tuple(np.maximum(at_least, 0.0).tolist())
            row["angular_acceleration_at_most_rad_s2"] = tuple(clamp(x) for x in np.maximum(at_most, 0.0).tolist())
        return fields

    def _greatest_steps(self, b: Array, directions: Array) -> tuple[Array, Array]:
        """Return lower and upper bounds on the greatest s for which A v = b + s d is feasible, shape (B, D) each.

        Args:
            b: wrenches, shape (B, 6).
            directions: d, shape (D, 6).
        """
        (B, _), (D, _), N = b.shape, directions.shape, self.A.shape[1]
        largest, one_hot = np.argmax(np.abs(directions), axis=1), np.tile(np.eye(D), (B, 1))
        max_wrench = np.abs(self.A) @ np.maximum(np.abs(self.box.low), np.abs(self.box.high))
        limits = 1.01 * (max_wrench + np.abs(b))[:, largest] / np.abs(directions[np.arange(D), largest])
        bounds = self.box.rows(B * D)
        low = np.hstack([bounds.low, np.zeros_like(one_hot)])
        box = Bounds(low, np.hstack([bounds.high, limits.reshape(-1, 1) * one_hot]))
        costs = np.hstack([np.zeros((B * D, N)), one_hot])
        optima = greatest(costs, np.hstack([self.A, -directions.T]), np.repeat(b, D, axis=0), box)
        return optima.attained.reshape(B, D), optima.upper.reshape(B, D)

    @cached_property
    def pseudo_inverse(self) -> balls.PseudoInverse:
        """Reserves of a pseudo-inverse allocator."""
        return balls.PseudoInverse(self.A, self.box)

    def rotors_out(self, cases: Sequence[int]) -> RotorsOut:
        """Return the single rotors whose failure cases survive, given their numbers (0: hover)."""
        failures = [self._failures[row] for row in np.unique(self.wrench_index[list(cases)])]
        possible = np.all([row.possible for row in failures], axis=0)
        lost: Flags = np.any([row.impossible for row in failures], axis=0)
        lower, upper = (np.min([row[side] for row in failures], axis=0) for side in (2, 3))
        survived, hover_only = possible & (lower >= self.enough_left), possible & (upper < self.enough_left)
        left = dict[str, Any]()
        if self.is_left_computed:
            weakest = int(np.argmin(lower))
            left["torque_reserve_Nm"] = float(lower[weakest]) * self.torque
            left["torque_reserve_at_most_Nm"] = clamp(float(upper.min()) * self.torque)
            left["weakest"] = tuple(self._numbers[weakest].tolist())
        return RotorsOut(
            survive=int(survived.sum()),
            hover_only=int(hover_only.sum()),
            of=survived.size,
            lost=self._rotors(lost),
            undecided=self._rotors(~(survived | hover_only | lost)),
            **left,
        )

    def _rotors(self, which: Flags) -> tuple[tuple[int, int], ...]:
        """Return module and rotor numbers of the selected rotors, shape (N,)."""
        return tuple((i, q) for i, q in self._numbers[which].tolist())

    @cached_property
    def _failures(self) -> list[balls.RotorFailures]:
        level = None if self.is_left_computed else self.enough_left
        return [balls.rotor_failures(self.A, b, self.box, level) for b in self.wrenches]

    def _load_factor(self, b: Array, force: Vector) -> dict[str, float]:
        """Return the load factor, the greatest s for which A v = w + s (b - w) has a solution.

        w is the weight if the case carries it at the COM and exerts more than that, else zero.
        """
        w = np.zeros(6)
        w[2] = float(force[2] >= self.force * (1 - TOLERANCE))
        if np.abs(b - w).max() <= TOLERANCE:
            w[2] = 0.0
        load = b - w
        if not load.any():
            return {}
        lower, upper = (float(bound[0, 0]) for bound in self._greatest_steps(w[None], load[None]))
        at_most = {"load_factor_at_most": clamp(upper)}
        return at_most if math.isinf(lower) else {"load_factor": lower, **at_most}

    def _com_error(self, b: Array, force: Vector) -> dict[str, float]:
        """Return the largest error of the centre of mass, at the vertices of a box; it adds a torque."""
        torques = np.cross(CUBE, force) / self.force
        directions = np.hstack([np.zeros_like(torques), torques])[torques.any(axis=1)]
        if not len(directions):
            return {}
        lower, upper = (float(bound.min()) for bound in self._greatest_steps(b[None], directions))
        arm = self.torque / self.force
        return {
            "com_error_m": max(0.0, lower) * arm,
            "com_error_at_most_m": clamp(max(0.0, upper) * arm),
            "com_error_m_pseudo_inverse": min(self.pseudo_inverse.ball(b, d[:, None]) for d in directions) * arm,
        }

    def _input_fields(self, v: Array | None) -> dict[str, float]:
        """Return the extreme inputs and the number of inputs at a limit."""
        if v is None:
            return {}
        tolerance = 1e-3 * (self.box.high - self.box.low)
        at_limit = (v <= self.box.low + tolerance) | (v >= self.box.high - tolerance)
        return {
            "largest_input": clamp(float(v.max())),
            "least_input": max(float(v.min()), -sys.float_info.max),
            "inputs_at_limit": int(at_limit.sum()),
        }

    @property
    def hover_input(self) -> float | None:
        """Mean input in hover."""
        return None if self.v[0] is None else float(self.v[0].mean())

    @property
    def hover_power_ratio(self) -> float | None:
        """Power in hover over that of parallel thrust; None unless all rotors are equal."""
        thrusts = np.linalg.norm(self.A[:3], axis=0)
        if self.v[0] is None or not np.allclose(thrusts, thrusts[0], rtol=TOLERANCE, atol=0):
            return None
        return clamp(float(np.mean((np.abs(self.v[0]) * thrusts.sum()) ** 1.5)))


def _torques_about(p: Array, W: Array) -> Array:
    """Return torques about p of wrenches about the COM, shape (6, ...)."""
    return np.asarray(W[3:] - np.cross(p, W[:3], axisb=0, axisc=0))


def _worst_case(nominal: CaseFlight, *off_centre: CaseFlight) -> CaseFlight:
    """Return a case with its smallest reserves over all errors of the centre of mass; zero if one is impossible."""
    worst, weakest = dict[str, Any](), 0
    for name in CaseFlight.model_fields:
        if not name.startswith(("force", "horizontal", "torque", "tilt", "angular")):
            continue
        values = [getattr(case, name) for case in off_centre]
        if any(case.possible is False for case in off_centre):
            zero = np.zeros(3 if name.startswith("angular") else ()).tolist()
            worst[name] = None if "weakest" in name else tuple(zero) if isinstance(zero, list) else zero
        elif "weakest" in name:  # the direction of the upper bound, which is the preceding field
            worst[name] = values[weakest]
        elif None in values:
            worst[name] = None
        else:
            weakest = int(np.argmin([np.min(value) for value in values]))
            smallest = np.min(values, axis=0).tolist()
            worst[name] = tuple(smallest) if isinstance(smallest, list) else smallest
    return nominal.model_copy(update=worst)


def _joint_loads(
    analysis: CapabilityAnalysis, design: Design, platform: Platform, holder: int | None
) -> tuple[JointLoad, ...]:
    """Return the load of every joint in every case that has inputs."""
    exists, max_inputs, loads = has_rotor(design.task), _max_inputs(design.task), list[JointLoad]()
    for case, v, name in zip(analysis.load_cases, analysis.v, analysis.names, strict=True):
        if v is not None:
            u = np.zeros(exists.shape)
            u[exists] = v * max_inputs
            loads += joint_loads(design, platform, case, u, name, holder)
    return tuple(loads)


def _ball_fields(name: str, weakest: str, ball: balls.BallBound, scale: float) -> dict[str, Any]:
    """Return the fields of a reserve; empty if nothing is proven.

    Args:
        name: name of the lower bound's field, with braces where that of the upper bound has a suffix.
        weakest: name of the direction's field.
        ball: the reserve.
        scale: unit of the ball's radius.
    """
    if not np.isfinite(ball.upper):
        return {}
    x = np.append(ball.weakest, np.zeros(3 - len(ball.weakest)))
    return {
        name.format(""): ball.lower * scale,
        name.format("_at_most"): max(ball.upper, 0.0) * scale,
        weakest: (float(x[0]), float(x[1]), float(x[2])),
    }
