"""Joint loads: the tree is cut at a joint, and everything beyond the cut is a free body.

| symbol | meaning | shape | unit |
|---|---|---|---|
| j, o_j, m | module beyond the cut, its centre from the COM, its mass | | m, kg |
| c | the connector at which the joint is cut, from the COM | (3,) | m |
| a, w' | acceleration of the COM, angular acceleration (the platform is at rest) | (3,) | m/s^2, rad/s^2 |
| f_E, tau_E | wrench that the platform exerts at the end-effector; the reaction is -f_E, -tau_E | (3,) | N, N m |
| F_c, tau_c | wrench of the joint on the free body beyond it | (3,) | N, N m |

Newton-Euler equations of the free body: F_c = sum m a_j - all other forces, and the same for moments about c. The
other forces are those of the rotors, the weight, and the reaction if the end-effector is beyond the cut. The
platform accelerates by the unbalanced wrench: that of the rotors minus that at the end-effector minus the weight,
zero in equilibrium. The end-effector is a point mass m_E, and a joint is a point mass at its connector; the joint
at the cut is not beyond it. A rod whose mass counts is on the end-effector's side. Modules have the inertia of
their type in the task. No single cut parts a cycle of a lattice: the loads of its joints are statically
indeterminate.
"""

import operator
from collections.abc import Iterator

import numpy as np

from topo_search.model import Array, Design, JointLoad, LoadCase, Topology
from verify.kinematics import Platform, per_rotor
from verify.residuals import clamp


def joint_loads(
    design: Design, platform: Platform, case: LoadCase, u: Array, name: str, holder: int | None
) -> Iterator[JointLoad]:
    """Yield the load of each joint outside of cycles in a load case, in the order of the joints.

    Args:
        design: the design.
        platform: its geometry.
        case: the load case [N], [N m].
        u: rotor inputs, shape (n, r) [rad^2/s^2].
        name: name of the case.
        holder: the module that carries the end-effector. If None, each load is the larger one with the end-effector
            on either side of the joint.
    """
    platform_loads, in_cycles = _PlatformLoads(design, platform, case, u), children_in_cycles(design.topology)
    edges = list(design.topology.edges())
    beyond = np.eye(design.topology.n, dtype=bool)  # [i, j]: module j is in the subtree of module i
    for h, i, _, _ in reversed(edges):
        beyond[h] |= beyond[i]
    for h, i, a, _ in edges:
        if i in in_cycles:
            continue
        axis = platform.poses.R[h][:, 1 if a % 2 == 0 else 0]
        sides = (True, False) if holder is None else (bool(beyond[i, holder]),)
        loads = [platform_loads.at_joint(i, beyond[i], with_tip) for with_tip in sides]
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


def children_in_cycles(topology: Topology) -> frozenset[int]:
    """Return the modules whose joint with their parent is in a cycle of a lattice."""
    paths = [frozenset(topology.path(i, j)) for i, _, j, _ in topology.closures]
    return frozenset[int]().union(*(path - {min(path)} for path in paths))


class _PlatformLoads:
    """Wrenches that joints must exert on the parts of a platform in one load case."""

    def __init__(self, design: Design, platform: Platform, case: LoadCase, u: Array) -> None:
        task, modules, n = design.task, design.task.modules_of_nodes, design.topology.n
        self._o, self._p_E, self._c = platform.o, platform.p_e, platform.joints
        self._closing = np.array([i for i, _, _, _ in design.topology.closures], dtype=int)
        gains, drags, axes = (
            per_rotor(modules, operator.attrgetter(f"rotor_table.{name}")) for name in ("gains", "drags", "axes")
        )
        k_f, k_tau = (
            np.array([getattr(module, f"{name}_coefficient") for module in modules])[:, None]
            for name in ("thrust", "torque")
        )
        thrusts = k_f[..., None] * (gains * u)[:, :, None] * platform.thrust_axes
        drags = k_tau * ((drags * u)[:, :, None] * axes).sum(axis=1)
        drags = np.einsum("nij,nj->ni", platform.R, drags)
        self._f_E, self._tau_E = np.array(case.at_end_effector.force), np.array(case.at_end_effector.torque)
        weight = np.array([0.0, 0.0, -task.gravity])
        points, masses = _masses(design, platform)
        F = thrusts.sum(axis=(0, 1)) - self._f_E + masses.sum() * weight
        tau = np.cross(platform.rotors, thrusts).sum(axis=(0, 1)) + drags.sum(axis=0) - self._tau_E
        tau -= np.cross(self._p_E, self._f_E)
        a, alpha = F / masses.sum(), np.linalg.solve(inertia(design, platform), tau)
        # mass times acceleration, minus the weight
        forces = masses[:, None] * (a + np.cross(alpha, points) - weight)
        self._forces = forces[:n] - thrusts.sum(axis=1)
        rotor_moments = np.cross(platform.rotors - platform.o[:, None], thrusts).sum(axis=1) + drags
        self._moments = _inertias(design, platform) @ alpha - rotor_moments
        tip = n + len(platform.joints)
        self._joint_forces, self._tip_force = forces[n:tip], forces[tip] + self._f_E
        self._rod_force, self._rod_centre = forces[tip + 1 :].sum(axis=0), platform.rod[:, 0].sum(axis=0)
        self._rod_moment = rod_inertia(design, platform) @ alpha

    def at_joint(self, child: int, beyond: Array, with_tip: bool) -> tuple[Array, Array]:
        """Return the force and moment of a joint on everything beyond it.

        Args:
            child: the joint's child module.
            beyond: True for the modules beyond the joint, shape (n,).
            with_tip: True if the end-effector is beyond.
        """
        inner = np.append(beyond[1:], beyond[self._closing])  # joints, indexed by child, then closures
        inner[child - 1] = False
        c = self._c[child - 1]
        F = np.concatenate([self._forces[beyond], self._joint_forces[inner]])
        levers = np.concatenate([self._o[beyond], self._c[inner]]) - c
        force = F.sum(axis=0)
        moment = self._moments[beyond].sum(axis=0) + np.cross(levers, F).sum(axis=0)
        if with_tip:
            force = force + self._tip_force + self._rod_force
            moment = moment + np.cross(self._p_E - c, self._tip_force) + self._tau_E
            moment = moment + np.cross(self._rod_centre - c, self._rod_force) + self._rod_moment
        return force, moment


def inertia(design: Design, platform: Platform) -> Array:
    """Return the inertia of a platform about its centre of mass, shape (3, 3) [kg m^2]."""
    points, masses = _masses(design, platform)
    steiner = (points**2).sum(axis=1)[:, None, None] * np.eye(3) - points[:, :, None] * points[:, None, :]
    part_inertia = _inertias(design, platform).sum(axis=0) + rod_inertia(design, platform)
    return np.asarray(part_inertia + (masses[:, None, None] * steiner).sum(axis=0))


def rod_inertia(design: Design, platform: Platform) -> Array:
    """Return the inertia of the counted rod about its centre, as a thin-walled tube, shape (3, 3) [kg m^2]."""
    rod, J = design.task.end_effector.counted_rod, np.zeros((3, 3))
    for half in platform.rod[:, 1]:
        if rod is not None and (square := float(half @ half)) > 0:
            J = rod.mass / 3 * (square * np.eye(3) - np.outer(half, half))
            along = np.outer(half, half) / square
            J += rod.mass * design.task.end_effector.rod_radius**2 / 2 * (np.eye(3) + along)
    return J


def _inertias(design: Design, platform: Platform) -> Array:
    """Return the inertia of every module about its own centre, shape (n, 3, 3) [kg m^2]."""
    R = platform.poses.R
    moments = np.array([module.inertia for module in design.task.modules_of_nodes])
    return np.asarray(R * moments[:, None] @ np.swapaxes(R, 1, 2))


def _masses(design: Design, platform: Platform) -> tuple[Array, Array]:
    """Return positions, shape (m, 3), and masses of modules, joints, end-effector and rod [m], [kg]."""
    task, rod = design.task, design.task.end_effector.counted_rod
    masses = [task.module.joint_mass, task.end_effector.mass, rod.mass if rod else 0.0]
    of_modules = [module.mass for module in task.modules_of_nodes]
    points = np.concatenate([platform.o, platform.joints, platform.p_e[None], platform.rod[:, 0]])
    return points, np.append(of_modules, np.repeat(masses, [len(platform.joints), 1, len(platform.rod)]))
