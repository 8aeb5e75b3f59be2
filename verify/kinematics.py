"""Forward kinematics and rotor wrenches in plain numbers (paper, Sec. II).

| symbol | meaning | shape | unit |
|---|---|---|---|
| psi, alpha_0, alpha_1 | root orientation, R_root = Rz(psi) Rx(alpha_0) Ry(alpha_1) | scalars | rad |
| alpha_i | hinge angle between module i > 0 and its parent h | scalar | rad |
| a, b | port of the parent, port of the child | | |
| e_a | direction of port a in the module frame: +x, +y, -x, -y | (3,) | |
| l_c | module centre to connector, of its type of module | scalar | m |
| R_i, p_i | orientation and position of module i in W, p_root = 0 | (3,3), (3,) | -, m |
| z_i | axis of a module, R_i e_z | (3,) | |
| p_COM, o_i, p_E | platform COM in W; module centre and end-effector from the COM | (3,) | m |
| delta_q, o_iq | rotor q = 1..r in the module frame; from the COM, o_i + R_i delta_q | (3,) | m |
| a_iq | its thrust axis in W | (3,) | |

The axis of a joint lies in the plane of the parent's arms, perpendicular to the arm: y at the x ports, x at the y
ports. From the parent's centre to the hinge it is the parent's l_c e_a, then to the child's centre the child's l_c
e_a, turned by the hinge.

| symbol | meaning | shape | unit |
|---|---|---|---|
| u_k | squared rotor speeds of load case k | (n, r) | rad^2/s^2 |
| A | wrench map about the COM, W_k = A u_k | (6, r n) | N, N m per rad^2/s^2 |
| b_k | required wrench about the COM: force f_E + f_C, torque tau_E + p_E x f_E + tau_C | (6,) | N, N m |

Column (i, q) of A is k_f a_iq over k_f o_iq x a_iq - s_q k_tau a_iq, with s_q = 1 for a rotor that turns
counter-clockwise seen against its thrust, otherwise -1. Gravity is a load case like any other. A type of
module with fewer than r rotors has columns of zeros, and inputs of 0, for the rest.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from topo_search.model import PORT_DIRECTIONS, Array, Design, Flags, LoadCase, Module, ResolvedTask, Topology


class Poses(NamedTuple):
    """Poses of all modules in W."""

    R: Array
    """Orientations, shape (n, 3, 3)."""
    p: Array
    """Positions, shape (n, 3) [unit of l_c]."""

    @property
    def z(self) -> Array:
        """Axes z_i, shape (n, 3)."""
        return self.R[:, :, 2]


class Platform(NamedTuple):
    """A design's geometry about its centre of mass, in W's axes and SI."""

    poses: Poses
    p_com: Array
    """Platform COM in W, shape (3,) [m]."""
    o: Array
    """Module centres from the COM, shape (n, 3) [m]."""
    p_e: Array
    """End-effector from the COM, shape (3,) [m]."""
    end_effector: Array
    """End-effector in W, shape (3,) [m]."""
    rotors: Array
    """o_iq, rotor positions from the COM, shape (n, r, 3) [m]."""
    thrust_axes: Array
    """a_iq, shape (n, r, 3)."""
    joints: Array
    """Joints of modules 1..n-1 with their parents, then closures, from the COM, shape (n - 1 + c, 3) [m]."""
    rod: Array = np.zeros((0, 2, 3))
    """Midpoint of the rod from the COM, vector from there to p_E, shape (1, 2, 3) [m]; empty if mass is ignored."""

    @property
    def R(self) -> Array:
        """Orientations, shape (n, 3, 3)."""
        return self.poses.R

    @property
    def p(self) -> Array:
        """Module centres in W, shape (n, 3) [m]."""
        return self.poses.p

    @property
    def z(self) -> Array:
        """Axes of the modules, shape (n, 3)."""
        return self.poses.z


def rotation(axis: int, angle: float) -> Array:
    """Return the rotation by `angle` [rad] about coordinate axis 0, 1 or 2, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    R = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R[j, j], R[j, k], R[k, j], R[k, k] = c, -s, s, c
    return R


@functools.cache
def quarter_turns(kappa: int) -> Array:
    """Return Rz(kappa pi/2) with entries of exactly 0 and +-1, shape (3, 3)."""
    x, y = PORT_DIRECTIONS[kappa % 4], PORT_DIRECTIONS[(kappa + 1) % 4]
    return np.stack([x, y, np.array([0.0, 0.0, 1.0])], axis=1)


def poses(
    topology: Topology, root_orientation: Sequence[float], hinge_angles: Sequence[float], l_c: float | Array
) -> Poses:
    """Return the poses of all modules in W.

    Args:
        topology: the tree.
        root_orientation: psi, alpha_0, alpha_1 [rad].
        hinge_angles: alpha_i of the modules 1..n-1 [rad].
        l_c: distance from module centre to connector, of all modules or of each, (n,); positions are in its unit.
    """
    psi, alpha_0, alpha_1 = root_orientation
    R = np.empty((topology.n, 3, 3))
    p, l = np.zeros((topology.n, 3)), np.broadcast_to(l_c, topology.n)
    R[0] = rotation(2, psi) @ rotation(0, alpha_0) @ rotation(1, alpha_1)
    for h, i, a, b in topology.edges():
        R_hinge = R[h] @ rotation(1 if a % 2 == 0 else 0, hinge_angles[i - 1])
        R[i] = R_hinge @ quarter_turns(a + 2 - b)
        p[i] = p[h] + (l[i] * (R[h] + R_hinge) + (l[h] - l[i]) * R[h]) @ PORT_DIRECTIONS[a]
    return Poses(R, p)


def poses_of(design: Design) -> Poses:
    """Return the poses of all modules of a design in W [m]."""
    l_c = design.task.connector_distances
    return poses(design.topology, design.root_orientation_rad, design.hinge_angles_rad, l_c)


def per_rotor(modules: Sequence[Module], values: Callable[[Module], Array]) -> Array:
    """Return values (r_i, ...) of the rotors of each module i as one array (n, r, ...), 0 for rotors it lacks."""
    of_types = {id(module): values(module) for module in {id(module): module for module in modules}.values()}
    rows = [of_types[id(module)] for module in modules]
    result = np.zeros((len(rows), max(map(len, rows)), *rows[0].shape[1:]))
    for row, of_module in zip(result, rows, strict=True):
        row[: len(of_module)] = of_module
    return result


def has_rotor(task: ResolvedTask) -> Flags:
    """Return which of the inputs of a platform are of rotors that its modules have, shape (n, r)."""
    return np.asarray(task.input_limits > 0)


def platform(design: Design, actual_poses: Poses | None = None) -> Platform:
    """Return a design's poses, COM, end-effector and rotor positions.

    Args:
        design: the design.
        actual_poses: poses of a platform built with errors [m]; None: the design's own.

    Example:
        >>> from topo_search import platform, read_design
        >>> platform(read_design("hover-2/best.json")).rotors.shape
        (2, 4, 3)
    """
    task, modules, n = design.task, design.task.modules_of_nodes, design.topology.n
    l_c = task.connector_distances
    poses = poses_of(design) if actual_poses is None else actual_poses
    p_E_in_W = np.array(design.end_effector_m)
    connectors = [poses.p[h] + l_c[h] * poses.R[h] @ PORT_DIRECTIONS[a] for h, a, _, _ in design.topology.bolts]
    joints = np.array(connectors).reshape(-1, 3)
    masses = np.array([module.mass for module in modules]) / task.module.mass
    moment = task.module.mass * (masses[:, None] * poses.p).sum(axis=0)
    moment += task.module.joint_mass * joints.sum(axis=0)
    moment += task.end_effector.mass * p_E_in_W
    rod, counted = np.zeros((0, 2, 3)), task.end_effector.counted_rod
    if counted is not None:
        i = counted.module
        half = (p_E_in_W - poses.p[i] - l_c[i] * poses.R[i] @ PORT_DIRECTIONS[counted.port]) / 2
        rod = np.array([[p_E_in_W - half, half]])
        moment += counted.mass * rod[0, 0]
    p_com = moment / task.total_mass(n)
    rod -= [p_com, np.zeros(3)]
    o = poses.p - p_com
    positions = per_rotor(modules, lambda module: module.arm_length * module.rotor_table.positions)
    rotors = o[:, None, :] + np.einsum("nij,nqj->nqi", poses.R, positions)
    axes = np.einsum("nij,nqj->nqi", poses.R, per_rotor(modules, lambda module: module.rotor_table.axes))
    return Platform(poses, p_com, o, p_E_in_W - p_com, p_E_in_W, rotors, axes, joints - p_com, rod)


def wrench_map(platform: Platform, modules: Module | Sequence[Module]) -> Array:
    """Return A, shape (6, r n), columns module by module.

    Args:
        platform: its geometry.
        modules: the module at each node, or that of all.
    """
    axes, modules = platform.thrust_axes, (modules,) * len(platform.o) if isinstance(modules, Module) else modules
    k_f = per_rotor(modules, lambda module: module.thrust_coefficient * module.rotor_table.gains)[..., None]
    drags = per_rotor(modules, lambda module: module.torque_coefficient * module.rotor_table.drags)
    drag = drags[..., None] * axes
    force, torque = k_f * axes, k_f * np.cross(platform.rotors, axes) + drag
    return np.concatenate([force, torque], axis=-1).reshape(-1, 6).T


def required_wrench(case: LoadCase, p_E: Array) -> Array:
    """Return b_k, shape (6,), of a load case in SI."""
    f_E, tau_E = np.array(case.at_end_effector.force), np.array(case.at_end_effector.torque)
    f_C, tau_C = np.array(case.at_com.force), np.array(case.at_com.torque)
    return np.concatenate([f_E + f_C, tau_E + np.cross(p_E, f_E) + tau_C])


def wrench_errors(design: Design, platform: Platform) -> Array:
    """Return the produced minus the required wrench of each load case, shape (K, 6) [N, N m]."""
    u = design.inputs.reshape(len(design.task.load_cases), -1)
    required = [required_wrench(case, platform.p_e) for case in design.task.load_cases]
    return np.asarray(u @ wrench_map(platform, design.task.modules_of_nodes).T - np.array(required))


def objective(design: Design) -> float:
    """Return J = sum_k lambda_k ||u_k||^2 [rad^4/s^4]."""
    weights = np.array([case.weight for case in design.task.load_cases])
    return float(weights @ np.sum(design.inputs**2, axis=(1, 2)))
