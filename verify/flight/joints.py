"""Load of each joint: the tree is cut there, and everything beyond the cut is treated as a free body.

| symbol | meaning | shape | unit |
|---|---|---|---|
| j, o_j, m | module beyond the cut, its centre from the COM, its mass | | m, kg |
| c | the connector at which the joint is cut, from the COM | (3,) | m |
| a, w' | acceleration of the COM, angular acceleration (the platform is at rest) | (3,) | m/s^2, rad/s^2 |
| f_E, tau_E | what the platform exerts at the end-effector; the reaction is -f_E, -tau_E | (3,) | N, N m |
| F_c, tau_c | what the joint exerts on what is beyond it | (3,) | N, N m |

Newton and Euler for what is beyond: F_c = sum m a_j - all other forces, and moments about c alike. Other forces are
those of the rotors, the weight, and the reaction if the end-effector is mounted beyond. The whole platform
accelerates by what the case leaves unbalanced, wrench of the rotors less wrench at the end-effector less weight;
nothing in equilibrium. The end-effector is a point of mass m_E; modules have the inertia of the task, the rod none.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from topo_search.model import Design, JointLoad, LoadCase
from topo_search.model.layout import PORT_DIRECTIONS, ROTOR_SPINS
from verify.bodies import Array
from verify.kinematics import Platform
from verify.residuals import clamp


def joint_loads(
    design: Design, found: Platform, case: LoadCase, u: Array, name: str, holder: int | None
) -> Iterator[JointLoad]:
    """Yield what each joint bears in a load case, in the order of the joints.

    Args:
        design: the design.
        found: its geometry.
        case: what is asked of the rotors [N], [N m].
        u: their inputs, shape (n, 4) [rad^2/s^2].
        name: of the case.
        holder: the module that carries the end-effector; None: unknown, each figure of a joint is then the larger
            of both sides that may carry it.
    """
    borne = _Borne(design, found, case, u)
    topology, l_c = design.topology, design.task.module.connector_distance
    beyond = _outward_modules(design)
    for h, i, a, _ in topology.edges():
        R_h = found.poses.R[h]
        c = found.o[h] + l_c * R_h @ PORT_DIRECTIONS[a]
        axis = R_h[:, 1 if a % 2 == 0 else 0]
        sides = (True, False) if holder is None else (bool(beyond[i, holder]),)
        loads = [borne.at(c, beyond[i], tip) for tip in sides]
        yield JointLoad(
            case=name,
            module=h,
            port=a,
            child=i,
            force_N=clamp(max(float(np.linalg.norm(F)) for F, _ in loads)),
            moment_Nm=clamp(max(float(np.linalg.norm(tau)) for _, tau in loads)),
            about_hinge_Nm=clamp(max(abs(float(tau @ axis)) for _, tau in loads)),
            across_hinge_Nm=clamp(max(float(np.linalg.norm(tau - (tau @ axis) * axis)) for _, tau in loads)),
        )


def _outward_modules(design: Design) -> Array:
    """Return which modules, columns, hang at each module, rows, itself included, shape (n, n)."""
    beyond = np.eye(design.topology.n, dtype=bool)
    for h, i, _, _ in reversed(list(design.topology.edges())):
        beyond[h] |= beyond[i]
    return beyond


class _Borne:
    """All forces on the parts of a platform in one load case, and their accelerations."""

    def __init__(self, design: Design, found: Platform, case: LoadCase, u: Array) -> None:
        task, module = design.task, design.task.module
        n, z = design.topology.n, found.poses.z
        self._o, self._p_E, m, m_E = found.o, found.p_e, module.mass, task.end_effector.mass
        thrusts = module.thrust_coefficient * u[:, :, None] * z[:, None, :]
        drags = module.torque_coefficient * (ROTOR_SPINS * u).sum(axis=1)[:, None] * z
        self._f_E, self._tau_E = np.array(case.at_end_effector.force), np.array(case.at_end_effector.torque)
        weight = np.array([0.0, 0.0, -task.gravity])
        F = thrusts.sum(axis=(0, 1)) - self._f_E + (n * m + m_E) * weight
        tau = np.cross(found.rotors, thrusts).sum(axis=(0, 1)) + drags.sum(axis=0) - self._tau_E
        tau -= np.cross(self._p_E, self._f_E)
        points, masses = _masses(design, found)
        a, turned = F / masses.sum(), np.linalg.solve(inertia(design, found), tau)
        # what the joints must exert on each part: its inertia less all other forces on it
        falls = masses[:, None] * (a + np.cross(turned, points) - weight)
        self._forces = falls[:n] - thrusts.sum(axis=1)
        rotor_moments = np.cross(found.rotors - found.o[:, None], thrusts).sum(axis=1) + drags
        self._moments = _inertias(design, found) @ turned - rotor_moments
        self._tip_force = falls[n] + self._f_E

    def at(self, c: Array, beyond: Array, tip: bool) -> tuple[Array, Array]:
        """Return force and moment about c that what is beyond needs there, with the end-effector or without it."""
        F, o = self._forces[beyond], self._o[beyond]
        force = F.sum(axis=0)
        moment = self._moments[beyond].sum(axis=0) + np.cross(o - c, F).sum(axis=0)
        if tip:
            force = force + self._tip_force
            moment = moment + np.cross(self._p_E - c, self._tip_force) + self._tau_E
        return force, moment


def inertia(design: Design, found: Platform) -> Array:
    """Return the inertia of a platform about its centre of mass, shape (3, 3) [kg m^2]."""
    points, masses = _masses(design, found)
    spread = (points**2).sum(axis=1)[:, None, None] * np.eye(3) - points[:, :, None] * points[:, None, :]
    return np.asarray(_inertias(design, found).sum(axis=0) + (masses[:, None, None] * spread).sum(axis=0))


def _inertias(design: Design, found: Platform) -> Array:
    """Return the inertia of every module about its own centre, shape (n, 3, 3) [kg m^2]."""
    R = found.poses.R
    return np.asarray(R * np.array(design.task.module.inertia) @ np.swapaxes(R, 1, 2))


def _masses(design: Design, found: Platform) -> tuple[Array, Array]:
    """Return places, shape (n + 1, 3), and masses of the modules and the end-effector [m], [kg]."""
    task = design.task
    masses = np.append(np.full(design.topology.n, task.module.mass), task.end_effector.mass)
    return np.concatenate([found.o, found.p_e[None]]), masses
