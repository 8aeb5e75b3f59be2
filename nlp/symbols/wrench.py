"""The wrench that the rotors produce against the wrench that a load case asks for (paper, Sec. II).

| symbol | meaning | shape | unit |
|---|---|---|---|
| u_iq | squared speed of rotor q = 1..4 of module i | scalar | u_hover |
| s_i | thrust of module i, sum_q u_iq / 4 | scalar | m g |
| m_i | torque of module i about its centre, in its own frame | (3,) | l_arm m g |
| delta_q | rotor position in the module frame | (3,) | l_arm |

F = sum_i s_i z_i and, about the origin of W, tau_W = sum_i p_i x s_i z_i + R_i m_i with
m_i = sum_q (u_iq / 4) (delta_q x e_z + (-1)^q k_tau / (k_f l_arm) e_z).
"""

from __future__ import annotations

import casadi as ca

from nlp.numbers.rotors import torque_map
from nlp.symbols.kinematics import Pose
from nlp.units import Units
from topo_search.model import LoadCase, Module
from topo_search.model.value import Vector


def thrust(u_i: ca.SX) -> ca.SX:
    """Return s_i, from the four inputs of module i."""
    return ca.sum1(u_i) / 4


def force_residual(case: LoadCase, modules: list[Pose], u: ca.SX, unit: Units) -> ca.SX:
    """Return what the rotors' force exceeds the asked force by [m g], equation (2)."""
    produced = ca.SX.zeros(3)
    for i, pose in enumerate(modules):
        produced += thrust(u[4 * i : 4 * i + 4]) * pose.z
    asked = scale(case.at_end_effector.force, unit.force) + scale(case.at_com.force, unit.force)
    return produced - asked


def torque_residual(
    case: LoadCase, modules: list[Pose], u: ca.SX, unit: Units, *, p_E: ca.SX, p_COM: ca.SX, module: Module
) -> ca.SX:
    """Return what the rotors' torque about W's origin exceeds the asked torque by [l_arm m g], equation (3)."""
    own_torque = ca.DM(torque_map(module))
    produced = ca.SX.zeros(3)
    for i, pose in enumerate(modules):
        u_i = u[4 * i : 4 * i + 4]
        produced += ca.cross(pose.p, thrust(u_i) * pose.z) + pose.R @ (own_torque @ u_i)
    tip, com = case.at_end_effector, case.at_com
    asked = scale(tip.torque, unit.torque) + ca.cross(p_E, scale(tip.force, unit.force))
    asked += scale(com.torque, unit.torque) + ca.cross(p_COM, scale(com.force, unit.force))
    return produced - asked


def scale(vector: Vector, unit: float) -> ca.SX:
    """Return an SI vector in a dimensionless unit."""
    return ca.SX(ca.DM(vector)) / unit
