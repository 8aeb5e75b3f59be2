"""The platform's inertia as symbols, dimensionless.

| symbol | meaning | shape | unit |
|---|---|---|---|
| o_i, R_i | centre of module i from the COM, its orientation | (3,), (3, 3) | l_arm, - |
| q | end-effector from the COM, a point of mass m_E | (3,) | l_arm |
| I_i = R_i I R_i^T | inertia of module i about its centre | (3, 3) | m l_arm^2 |
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from topo_search.model import Module


def spread(at: ca.SX) -> ca.SX:
    """Return the inertia of a unit mass somewhere about the COM."""
    return ca.dot(at, at) * ca.DM.eye(3) - at @ at.T


def of_module(R: ca.SX, module: Module) -> ca.SX:
    """Return I_i."""
    return R @ (ca.diag(ca.DM(module.inertia)) / (module.mass * module.arm_length**2)) @ R.T


def of_platform(
    centres: Sequence[ca.SX], orientations: Sequence[ca.SX], q: ca.SX, module: Module, m_E: float
) -> ca.SX:
    """Return the inertia about the COM; `m_E`: mass of the end-effector over that of a module."""
    parts = [spread(o) + of_module(R, module) for o, R in zip(centres, orientations, strict=True)]
    return sum(parts, start=m_E * spread(q))
