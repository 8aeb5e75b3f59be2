"""The end-effector and the centre of mass as symbols; the notation is that of `nlp.numbers.masses`."""

from __future__ import annotations

import casadi as ca

from nlp.numbers.masses import masses
from nlp.symbols.kinematics import Pose
from topo_search.model import EndEffector, Module, Topology


def tip_and_com(
    module: Module, end_effector: EndEffector, topology: Topology, modules: list[Pose], tip: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return p'_E and p_COM [l_arm]; `tip` is p'_E where the task leaves it free."""
    carried, position = masses(module, end_effector, topology), end_effector.fixed_position
    B = ca.SX.zeros(3)
    for pose, M, d in zip(modules, carried.modules, carried.centres, strict=True):
        B += M * (pose.p + pose.R[:, :2] @ ca.DM(d))
    B /= carried.bodies
    p_E = tip if position is None else B + carried.lever * (ca.SX(ca.DM(position)) / module.arm_length)
    return p_E, (carried.tip * p_E + carried.bodies * B) / carried.total
