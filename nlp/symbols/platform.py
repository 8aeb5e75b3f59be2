r"""Symbolic poses, wrenches, masses and inertia of a platform (paper, Sec. II).

| symbol | meaning | shape | unit |
|---|---|---|---|
| psi, alpha_0, alpha_1 | root orientation | scalars | rad |
| alpha_i | hinge angle of the joint of module i > 0 with its parent | scalar | rad |
| R_i, p_i | orientation and position of module i in W | (3,3), (3,) | -, l_arm |
| e_a | direction of port a in the module frame: +x, +y, -x, -y | (3,) | |

.. math::

    R_{root} = R_z(\psi) R_x(\alpha_0) R_y(\alpha_1), \qquad p_{root} = 0

    R_i = R_h H_a(\alpha_i) R_z(\kappa \pi/2), \qquad p_i = p_h + l_{c,h} R_h e_a + l_{c,i} R_h H_a(\alpha_i) e_a

with H_a = Ry for ports on the x axis and Rx for ports on the y axis, kappa = (a + 2 - b) mod 4.

Wrenches of the rotors and of load cases:

| symbol | meaning | shape | unit |
|---|---|---|---|
| u_iq | squared speed of rotor q = 1..r of module i | scalar | u_hover |
| F_i | force of module i, in its own frame, sum_q u_iq a_q / r with r rotors of [module] | (3,) | m g |
| m_i | torque of module i about its centre, in its own frame | (3,) | l_arm m g |
| delta_q, a_q | position and axis of a rotor in the module frame | (3,) each | l_arm, - |

The force is F = sum_i R_i F_i and the torque about the origin of W is tau_W = sum_i p_i x R_i F_i + R_i m_i, with
m_i as in `nlp.numbers.geometry`.

Centre of mass, end-effector and inertia, dimensionless, in the notation of `nlp.numbers.masses`:

| symbol | meaning | shape | unit |
|---|---|---|---|
| o_i, R_i | centre of module i from the COM, its orientation | (3,), (3, 3) | l_arm, - |
| q | end-effector from the COM, a point of mass M_E | (3,) | l_arm |
| d | vector from the foot of a rod with mass to the end-effector | (3,) | l_arm |
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from nlp.numbers.geometry import QUARTER_TURNS, rotor_maps
from nlp.numbers.masses import TINY, Masses, RigidBody, RodMass, masses
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, LoadCase, Module, ResolvedTask, Topology, Vector


@dataclass(frozen=True)
class Pose:
    """Pose of a module: R (3x3) and p (3)."""

    R: ca.SX
    p: ca.SX

    @property
    def z(self) -> ca.SX:
        """The thrust axis R e_z."""
        return self.R[:, 2]


def Rx(angle: ca.SX) -> ca.SX:
    """Return the rotation about x."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[1, 0, 0], [0, c, -s], [0, s, c]])


def Ry(angle: ca.SX) -> ca.SX:
    """Return the rotation about y."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def Rz(angle: ca.SX) -> ca.SX:
    """Return the rotation about z."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def poses(topology: Topology, root: ca.SX, alpha: ca.SX, l_c: Sequence[float]) -> list[Pose]:
    """Return the poses of all modules, in module order.

    Args:
        topology: the tree.
        root: psi, alpha_0, alpha_1 [rad].
        alpha: hinge angles of the modules 1..n-1 [rad].
        l_c: distances from the modules' centres to their connectors, in the unit of length of the result.
    """
    psi, alpha_0, alpha_1 = root[0], root[1], root[2]
    result = [Pose(R=Rz(psi) @ Rx(alpha_0) @ Ry(alpha_1), p=ca.SX.zeros(3))]
    for (h, i, a, _), kappa in zip(topology.edges(), topology.kappas[1:], strict=True):
        parent, e_a = result[h], ca.DM(PORT_DIRECTIONS[a])
        hinge = Ry(alpha[i - 1]) if a % 2 == 0 else Rx(alpha[i - 1])
        R_hinge = parent.R @ hinge
        p_i = parent.p + l_c[h] * (parent.R @ e_a) + l_c[i] * (R_hinge @ e_a)
        result.append(Pose(R=R_hinge @ ca.DM(QUARTER_TURNS[kappa]), p=p_i))
    return result


def wrench_map(orientations: Sequence[ca.SX], positions: Sequence[ca.SX], task: ResolvedTask) -> ca.SX:
    """Return the wrench of every rotor at unit input, shape (6, r n), about the origin of positions [l_arm]."""
    columns = []
    for R, p, forces, torques in zip(orientations, positions, *rotor_maps(task), strict=True):
        turned = R @ ca.DM(forces)
        levers = [ca.cross(p, force) for force in ca.horzsplit(turned)]
        columns.append(ca.vertcat(turned, R @ ca.DM(torques) + ca.horzcat(*levers)))
    return ca.horzcat(*columns)


def required_wrench(case: LoadCase, unit: Units, *, tip: ca.SX, p_COM: ca.SX) -> ca.SX:
    """Return the required wrench of a load case about W's origin, shape (6,) [m g, l_arm m g]."""
    (f_E, f_C), (tau_E, tau_C) = (
        [scale(getattr(wrench, kind), size) for wrench in (case.at_end_effector, case.at_com)]
        for kind, size in (("force", unit.force), ("torque", unit.torque))
    )
    return ca.vertcat(f_E + f_C, tau_E + ca.cross(tip, f_E) + tau_C + ca.cross(p_COM, f_C))


def scale(vector: Vector, unit: float) -> ca.SX:
    """Return an SI vector divided by a unit."""
    return ca.SX(ca.DM(vector)) / unit


def tip_and_com(task: ResolvedTask, topology: Topology, modules: list[Pose], tip: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return p'_E and p_COM [l_arm]; `tip` is p'_E if the task leaves it free."""
    carried, position = masses(task, topology), task.end_effector.fixed_position
    B = ca.SX.zeros(3)
    for pose, M, d in zip(modules, carried.modules, carried.centres, strict=True):
        B += M * (pose.p + pose.R[:, :2] @ ca.DM(d))
    B /= carried.bodies
    if position is not None:
        tip = B + carried.lever * (ca.SX(ca.DM(position)) / task.module.arm_length)
    return tip, (carried.tip * tip + carried.bodies * B) / carried.total


def point_inertia(o: ca.SX) -> ca.SX:
    """Return the inertia about the COM of a unit mass at o."""
    return ca.dot(o, o) * ca.DM.eye(3) - o @ o.T


def module_inertia(R: ca.SX, module: Module, unit: Module) -> ca.SX:
    """Return the inertia of a module without joints about its centre, in units of [module]'s mass and arm."""
    return R @ (ca.diag(ca.DM(module.inertia)) / (unit.mass * unit.arm_length**2)) @ R.T


def body_inertia(o: ca.SX, R: ca.SX, body: RigidBody) -> ca.SX:
    """Return the inertia of module i with its joints about the COM."""
    centre = o + R[:, :2] @ ca.DM(body.centre)
    return body.mass * point_inertia(centre) + R @ ca.DM(body.inertia) @ R.T


def rod_inertia(d: ca.SX, rod: RodMass) -> ca.SX:
    """Return the inertia of a rod about its middle: r^2 / 2 + d^2 / 12 across it, r^2 about its axis."""
    roll = d @ d.T / ca.fmax(ca.dot(d, d), TINY)
    return rod.mass * (point_inertia(d) / 12 + rod.radius**2 / 2 * (ca.DM.eye(3) + roll))


def rod_inertia_beyond_ends(d: ca.SX, rod: RodMass) -> ca.SX:
    """Return a rod's inertia beyond that of half its mass at each end."""
    return rod_inertia(d, rod) - rod.mass / 4 * point_inertia(d)


def rod_vector(centres: Sequence[ca.SX], orientations: Sequence[ca.SX], q: ca.SX, rod: RodMass) -> ca.SX:
    """Return d, the vector along the rod."""
    return q - centres[rod.module] - orientations[rod.module] @ ca.DM(rod.foot)


def platform_inertia(centres: Sequence[ca.SX], orientations: Sequence[ca.SX], q: ca.SX, carried: Masses) -> ca.SX:
    """Return the inertia of the platform about the COM."""
    poses = zip(centres, orientations, strict=True)
    bodies = [body_inertia(o, R, carried.body(i)) for i, (o, R) in enumerate(poses)]
    J = sum(bodies, start=carried.tip * point_inertia(q))
    if carried.rod.mass:
        J += rod_inertia_beyond_ends(rod_vector(centres, orientations, q, carried.rod), carried.rod)
    return J
