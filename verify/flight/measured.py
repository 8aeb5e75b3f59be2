"""All figures of flight of one design, or of any rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| N = 4n, K | rotors, load cases | | |
| v | inputs over the largest input of a rotor | (N,) | |
| A | wrench map about the COM, W = A v | (6, N) | m_t g, l_arm m_t g |
| b_k | wrench of hover (k = 0) and of every load case | (6,) | the same |
| p_E | end-effector from the COM | (3,) | l_arm |
| J | inertia about the COM | (3, 3) | l_arm m_t g s^2 |

Each b_k is first replaced by a wrench that some v produce exactly, within the audit's tolerance of it. A force f at
the end-effector adds [f, p_E x f], so that it leaves the torque about p_E alone: with that held, the forces of A v
less that of b_k are those that can be added. One at the COM adds [f, 0], and a torque leaves the force alone.
To hold hover at a tilt t is to exert [f, 0] with a force f of the weight's size at the angle t from z, in the axes
of the body. With the centre of mass off by c torques are about it, and p_E is p_E - c. Torques are linear in c, so
that what can be added at the corners of a box of errors can be so all over it. Reserves and load factors are of
rotors that run between the module's least and largest input; a dead one stands still.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topo_search.model import (
    Assembly,
    CaseFlight,
    Design,
    Flight,
    JointLoad,
    LoadCase,
    RotorsOut,
    Sensitivity,
    Wrench,
)
from topo_search.model.load_case import centres_of
from topo_search.model.proven import TOLERANCE
from verify.bodies import Array
from verify.flight.balls import TORQUES, Ball, PseudoInverse, largest_balls, largest_caps, rotor_failures
from verify.flight.joints import inertia, joint_loads
from verify.flight.programs import LARGEST, Box, Solvable, find_solutions, greatest, least_inputs
from verify.kinematics import Platform, required_wrench, wrench_map
from verify.residuals import clamp

HOVER = "hover"

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Corners of a box, shape (8, 3)."""
CASES = 20
"""Cases whose reserves are looked for at once."""
TOGETHER = 200
"""Dead rotors and cases that are looked at at once."""


def flight(design: Design, platform: Platform, sheet: Assembly, errors: Sensitivity | None) -> Flight | None:
    """Return what a design can do beyond its task; None where its numbers are too large to compute with.

    Args:
        design: the design.
        platform: its geometry.
        sheet: how it is assembled.
        errors: what its clearances tolerate.
    """
    task, tip = design.task, sheet.end_effector
    most = task.module.max_input(task.gravity)
    N, A = 4 * design.topology.n, wrench_map(platform, task.module) * most
    inputs = [None, *(design.inputs.reshape(len(task.load_cases), N) / most)]

    def measured_about(c: Array) -> Measured:
        return Measured(
            np.vstack([A[:3], _torques_about(c, A)]),
            platform.p_e - c,
            (task.force_unit(task.n), task.module.arm_length),
            Box(np.full(N, task.module.min_input), np.ones(N)),
            dict(zip(task.case_labels, task.load_cases, strict=True)),
            inputs,
            inertia(design, platform),
        )

    measured = measured_about(np.zeros(3))
    if not measured.in_range:
        return None
    cases = measured.cases()
    if error := task.flight.com_error:
        off = [measured_about(error * c).cases() for c in CUBE]
        cases = tuple(_least(*rows) for rows in zip(cases, *off, strict=True))
    rod = None if tip is None else tip.rod
    angle = None if errors is None else errors.hinge_angle_deg
    at = platform.rotors.reshape(-1, 3)
    span = max(float(np.linalg.norm(at - one, axis=1).max()) for one in at)  # of the rotors' centres
    return Flight(
        cases=cases,
        rotors_out_hover=measured.rotors_out(1),
        rotors_out_all=measured.rotors_out(len(measured.names)),
        rotors_out_asked=_rotors_asked(measured, design),
        joints=_joint_loads(measured, design, platform, None if sheet.mount is None else sheet.mount.module),
        hinge_tolerance_deg=None if angle is None else angle.tolerated,
        hover_input=measured.hover_input,
        hover_power_ratio=measured.hover_power_ratio,
        rod_length_m=None if rod is None else rod.length_m,
        rod_mass_share=None if rod is None else rod.mass_kg / task.total_mass(task.n),
        span_m=clamp(span + 2 * task.module.body.rotor_radius),
    )


class Measured:
    """Capability of the rotors, in weights and largest inputs.

    Args:
        A: wrenches of the rotors at their largest inputs, shape (6, N) [N, N m].
        p_E: end-effector from the COM, shape (3,) [m].
        units: the weight [N], and an arm [m].
        box: bounds of the inputs, shape (N,) each.
        cases: load cases in SI by name.
        inputs: of hover and of every case, shape (N,) each; None: those of least effort.
        J: inertia about the COM, shape (3, 3) [kg m^2]; None: unknown.
    """

    def __init__(
        self,
        A: Array,
        p_E: Array,
        units: tuple[float, float],
        box: Box,
        cases: dict[str, LoadCase],
        inputs: Sequence[Array | None],
        J: Array | None,
    ) -> None:
        self.force, arm = units
        self.torque = arm * self.force
        unit = np.repeat([self.force, self.torque], 3)
        self.A, self.p_E, self.box, self.inputs = A / unit[:, None], p_E / arm, box, inputs
        self.J = None if J is None else J / self.torque
        hover = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, self.force)))
        self.load_cases, self.names = (hover, *cases.values()), (HOVER, *cases)
        self.b = np.array([required_wrench(case, p_E) / unit for case in self.load_cases])
        _, first, same = np.unique(np.round(self.b, 12), axis=0, return_index=True, return_inverse=True)
        self.wrenches, self.same = self.b[first], same.ravel()  # what several cases ask for is looked at once

    @cached_property
    def reached(self) -> Solvable:
        """Wrenches that can be produced."""
        return find_solutions(self.A, self.wrenches, self.box)

    @cached_property
    def v(self) -> list[Array | None]:
        """Inputs of hover and of every case; None where those of least effort are not found."""
        return [
            least_inputs(self.A, self.A @ self.reached.v[row], self.box)
            if v is None and self.reached.yes[row]
            else v
            for v, row in zip(self.inputs, self.same, strict=True)
        ]

    @cached_property
    def in_range(self) -> bool:
        """True if numbers are small enough for their digits to reach the residuals of programs."""
        return bool(np.all(np.abs(self.A) <= LARGEST) and np.all(np.abs(self.b) <= LARGEST))

    def cases(self) -> tuple[CaseFlight, ...]:
        """Return what hover and every load case leave."""
        yes, no = self.reached.yes, self.reached.no
        b = self.reached.v[yes] @ self.A.T
        reserves = [left for k in range(0, len(b), CASES) for left in self._reserves(b[k : k + CASES])]
        rows = []
        for name, case, v, row in zip(self.names, self.load_cases, self.v, self.same, strict=True):
            possible = True if yes[row] else False if no[row] else None
            index = np.count_nonzero(yes[:row])
            left = {}
            if possible:
                left = reserves[index] | self._load_factor(b[index], case) | self._com_error(b[index], case)
            if possible and name == HOVER:
                (cap,) = largest_caps(self.A[:3], self.A[3:], b[[index], :3], b[[index], 3:], self.box)
                left |= _ball("tilt{}_deg", "tilt_weakest", cap, math.degrees(1.0))
                left["tilt_deg_pseudo_inverse"] = math.degrees(self.pseudo_inverse.cap(b[index]))
            rows.append(CaseFlight(name=name, possible=possible, **left, **self._inputs(v)))
        return tuple(rows)

    def _reserves(self, b: Array) -> list[dict[str, Any]]:
        """Return the fields of what can be added to wrenches that some v produce, shape (B, 6).

        About the tip or the COM, some rows of forces or torques grow while others are held.
        """
        fields = self._accelerations(b)
        force, side, torque, torque_and_lift = slice(0, 3), slice(0, 2), slice(3, 6), slice(3, 7)
        for which, point, unit, grow, hold in (
            ("torque", "", "Nm", torque, force),
            ("force", "", "N", force, torque),
            ("horizontal", "", "N", side, torque_and_lift),
            ("force", "_com", "N", force, torque),
            ("horizontal", "_com", "N", side, torque_and_lift),
        ):
            name, size = f"{which}_reserve{point}{{}}_{unit}", self.force if unit == "N" else self.torque
            # a torque is the same about all points, but leaves the force at the COM alone
            p = np.zeros(3) if point or which == "torque" else self.p_E
            M, w = (np.vstack([W[:3], _torques_about(p, W), W[2:3]]) for W in (self.A, b.T))
            balls = largest_balls(M[grow], M[hold], w[grow].T, w[hold].T, self.box)
            E = np.eye(6)
            E[3:, :3] = np.cross(p, np.eye(3)).T
            for row, ball, one in zip(fields, balls, b, strict=True):
                row |= _ball(name, f"{which}_weakest{point}", ball, size)
                row[f"{name.format('')}_pseudo_inverse"] = self.pseudo_inverse.ball(one, E[:, grow]) * size
        return fields

    def _accelerations(self, b: Array) -> list[dict[str, Any]]:
        """Return the fields of accelerations about each axis: the greatest s of which A v = b +- s J e / |J e|."""
        if self.J is None:
            return [{} for _ in b]
        sizes, ways = np.linalg.norm(self.J, axis=0), TORQUES @ self.J
        multiplied = [tuple(self.pseudo_inverse.ball(one, ways[:, [k]]) for k in range(3)) for one in b]
        fields: list[dict[str, Any]] = [{"angular_acceleration_rad_s2_pseudo_inverse": one} for one in multiplied]
        if not sizes.all():
            return fields
        turns = np.hstack([np.zeros((3, 3)), (self.J / sizes).T])
        steps = self._greatest_steps(b, np.vstack([turns, -turns]))
        lower, upper = (np.reshape(side, (-1, 2, 3)).min(axis=1) / sizes for side in steps)
        for row, least, at_most in zip(fields, lower, upper, strict=True):
            row["angular_acceleration_rad_s2"] = tuple(np.maximum(least, 0.0).tolist())
            row["angular_acceleration_at_most_rad_s2"] = tuple(clamp(x) for x in np.maximum(at_most, 0.0).tolist())
        return fields

    def _greatest_steps(self, b: Array, ways: Array) -> tuple[Array, Array]:
        """Return the greatest s of which A v = b + s d, at least and at most, for each b and d, shape (B, D) each.

        Args:
            b: wrenches, shape (B, 6).
            ways: d, shape (D, 6).
        """
        (B, _), (D, _), N = b.shape, ways.shape, self.A.shape[1]
        largest, each = np.argmax(np.abs(ways), axis=1), np.tile(np.eye(D), (B, 1))
        most = np.abs(self.A) @ np.maximum(np.abs(self.box.low), np.abs(self.box.high))
        limits = 1.01 * (most + np.abs(b))[:, largest] / np.abs(ways[np.arange(D), largest])
        bounds = self.box.rows(B * D)
        box = Box(
            np.hstack([bounds.low, np.zeros_like(each)]), np.hstack([bounds.high, limits.reshape(-1, 1) * each])
        )
        costs = np.hstack([np.zeros((B * D, N)), each])
        optima = greatest(costs, np.hstack([self.A, -ways.T]), np.repeat(b, D, axis=0), box)
        return optima.attained.reshape(B, D), optima.upper.reshape(B, D)

    @cached_property
    def pseudo_inverse(self) -> PseudoInverse:
        """The allocator that only multiplies."""
        return PseudoInverse(self.A, self.box)

    def rotors_out(self, cases: int) -> RotorsOut:
        """Return which single rotors may fail in the first so many cases."""
        survive, lost = self._failures
        keep, lose = np.asarray(survive[:cases].all(axis=0)), np.asarray(lost[:cases].any(axis=0))
        open_ = ~keep & ~lose
        return RotorsOut(survive=int(keep.sum()), of=keep.size, lost=_rotors(lose), undecided=_rotors(open_))

    @cached_property
    def _failures(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return whether each case, rows, is proven possible, and impossible, with each rotor dead, columns."""
        N, K = self.A.shape[1], len(self.wrenches)
        yes, no = np.zeros(N * K, dtype=bool), np.zeros(N * K, dtype=bool)
        for start in range(0, N * K, TOGETHER):
            case, dead = np.divmod(np.arange(start, min(start + TOGETHER, N * K)), N)
            alive = np.ones((len(dead), N))
            alive[np.arange(len(dead)), dead] = 0.0
            box = Box(self.box.low * alive, self.box.high * alive)
            solvable = find_solutions(self.A, self.wrenches[case], box, self.reached.bases[case])
            yes[start : start + len(dead)], no[start : start + len(dead)] = solvable.yes, solvable.no
        return yes.reshape(K, N)[self.same], no.reshape(K, N)[self.same]

    def _load_factor(self, b: Array, case: LoadCase) -> dict[str, float]:
        """Return by how much a load can grow: the greatest s of which A v = w + s (b - w) has a solution.

        w is the weight, where the case carries it at the COM and asks for more than that; else zero.
        """
        w = np.zeros(6)
        w[2] = float(case.at_com.force[2] >= self.force * (1 - TOLERANCE))
        if np.abs(b - w).max() <= TOLERANCE:
            w[2] = 0.0
        load = b - w
        if not load.any():
            return {}
        lower, upper = (float(side[0, 0]) for side in self._greatest_steps(w[None], load[None]))
        at_most = {"load_factor_at_most": clamp(upper)}
        return at_most if math.isinf(lower) else {"load_factor": lower, **at_most}

    def _com_error(self, b: Array, case: LoadCase) -> dict[str, float]:
        """Return how far the centre of mass may be off, at the corners of a box: forces there act beside it."""
        levers = np.cross(CUBE, case.at_com.force) / self.force
        ways = np.hstack([np.zeros_like(levers), levers])[levers.any(axis=1)]
        if not len(ways):
            return {}
        lower, upper = (float(side.min()) for side in self._greatest_steps(b[None], ways))
        arm = self.torque / self.force
        return {
            "com_error_m": max(0.0, lower) * arm,
            "com_error_at_most_m": clamp(max(0.0, upper) * arm),
            "com_error_m_pseudo_inverse": min(self.pseudo_inverse.ball(b, d[:, None]) for d in ways) * arm,
        }

    def _inputs(self, v: Array | None) -> dict[str, float]:
        """Return the extremes of some inputs, and how many are at a limit."""
        if v is None:
            return {}
        near = 1e-3 * (self.box.high - self.box.low)  # so near to its limit an input counts as at it
        limited = (v <= self.box.low + near) | (v >= self.box.high - near)
        return {
            "largest_input": clamp(float(v.max())),
            "least_input": max(float(v.min()), -sys.float_info.max),
            "inputs_at_limit": int(limited.sum()),
        }

    @property
    def hover_input(self) -> float | None:
        """Mean input in hover."""
        return None if self.v[0] is None else float(self.v[0].mean())

    @property
    def hover_power_ratio(self) -> float | None:
        """Power in hover over that of parallel thrust, of rotors that are all alike."""
        thrusts = np.linalg.norm(self.A[:3], axis=0)
        if self.v[0] is None or not np.allclose(thrusts, thrusts[0], rtol=TOLERANCE, atol=0):
            return None
        return clamp(float(np.mean((np.abs(self.v[0]) * thrusts.sum()) ** 1.5)))


def _torques_about(p: Array, W: Array) -> Array:
    """Return torques about p of wrenches about the COM, shape (6, ...)."""
    return np.asarray(W[3:] - np.cross(p, W[:3], axisb=0, axisc=0))


def _least(nominal: CaseFlight, *off: CaseFlight) -> CaseFlight:
    """Return a case with the least that is left with the centre of mass off: nothing where it is impossible."""
    least, weakest = dict[str, Any](), 0
    for name in CaseFlight.model_fields:
        if not name.startswith(("force", "horizontal", "torque", "tilt", "angular")):
            continue
        values = [getattr(one, name) for one in off]
        if any(one.possible is False for one in off):
            nothing = np.zeros(3 if name.startswith("angular") else ()).tolist()
            least[name] = None if "weakest" in name else tuple(nothing) if isinstance(nothing, list) else nothing
        elif "weakest" in name:  # of the upper bound, which is the field before
            least[name] = values[weakest]
        elif None in values:
            least[name] = None
        else:
            weakest = int(np.argmin([np.min(value) for value in values]))
            sides = np.min(values, axis=0).tolist()
            least[name] = tuple(sides) if isinstance(sides, list) else sides
    return nominal.model_copy(update=least)


def _rotors_asked(measured: Measured, design: Design) -> RotorsOut | None:
    """Return which single rotors may fail in the cases for which that is asked, and what is left then."""
    rotor_out = design.task.flight.rotor_out
    if rotor_out == "none":
        return None
    numbers = [number for number, _, _ in centres_of(design.task, rotor_out)]
    wrenches = measured.wrenches[np.unique(measured.same[numbers])]
    yes, no, lower, upper = zip(*(rotor_failures(measured.A, b, measured.box) for b in wrenches), strict=True)
    keep, lose, lower, upper = np.all(yes, axis=0), np.any(no, axis=0), np.min(lower, axis=0), np.min(upper, axis=0)
    least = int(np.argmin(lower))
    return RotorsOut(
        survive=int(keep.sum()),
        of=keep.size,
        lost=_rotors(lose),
        undecided=_rotors(~keep & ~lose),
        torque_reserve_Nm=float(lower[least]) * measured.torque,
        torque_reserve_at_most_Nm=clamp(float(upper.min()) * measured.torque),
        weakest=(least // 4, least % 4),
    )


def _joint_loads(
    measured: Measured, design: Design, platform: Platform, holder: int | None
) -> tuple[JointLoad, ...]:
    """Return what every joint bears in every case that has inputs."""
    most = design.task.module.max_input(design.task.gravity)
    return tuple(
        load
        for case, v, name in zip(measured.load_cases, measured.v, measured.names, strict=True)
        if v is not None
        for load in joint_loads(design, platform, case, v.reshape(-1, 4) * most, name, holder)
    )


def _ball(name: str, weakest: str, ball: Ball, size: float) -> dict[str, Any]:
    """Return the fields of a reserve; nothing where the programs proved nothing.

    Args:
        name: of the field of what is proven, with braces where that of the upper bound says so.
        weakest: name of the field of the direction.
        ball: the reserve.
        size: its unit.
    """
    if not np.isfinite(ball.upper):
        return {}
    x = np.append(ball.weakest, np.zeros(3 - len(ball.weakest)))
    return {
        name.format(""): ball.lower * size,
        name.format("_at_most"): max(ball.upper, 0.0) * size,
        weakest: (float(x[0]), float(x[1]), float(x[2])),
    }


def _rotors(which: NDArray[np.bool_]) -> tuple[tuple[int, int], ...]:
    """Return module and rotor of those that are meant, shape (4n,)."""
    return tuple((int(j) // 4, int(j) % 4) for j in np.flatnonzero(which))
