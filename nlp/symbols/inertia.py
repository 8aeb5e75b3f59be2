"""The platform's inertia as symbols, dimensionless; masses are those of `nlp.numbers.masses`.

| symbol | meaning | shape | unit |
|---|---|---|---|
| o_i, R_i | centre of module i from the COM, its orientation | (3,), (3, 3) | l_arm, - |
| q | end-effector from the COM, a point of mass M_E | (3,) | l_arm |
| d | from the foot of the rod that counts to the end-effector | (3,) | l_arm |
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from nlp.numbers.masses import TINY, Body, Masses, RodMass
from topo_search.model import Module


def spread(at: ca.SX) -> ca.SX:
    """Return the inertia of a unit mass somewhere about the COM."""
    return ca.dot(at, at) * ca.DM.eye(3) - at @ at.T


def of_module(R: ca.SX, module: Module) -> ca.SX:
    """Return the inertia of a module alone about its centre."""
    return R @ (ca.diag(ca.DM(module.inertia)) / (module.mass * module.arm_length**2)) @ R.T


def of_body(o: ca.SX, R: ca.SX, body: Body) -> ca.SX:
    """Return the inertia of M_i about the COM."""
    at = o + R[:, :2] @ ca.DM(body.centre)
    return body.mass * spread(at) + R @ ca.DM(body.inertia) @ R.T


def of_rod(d: ca.SX, rod: RodMass) -> ca.SX:
    """Return the inertia of the rod that counts about its middle."""
    around = rod.radius**2 / ca.fmax(ca.dot(d, d), TINY)
    return rod.mass * (spread(d) / 12 + around * d @ d.T)


def beside_halves(d: ca.SX, rod: RodMass) -> ca.SX:
    """Return what the rod's inertia is beside that of its halves at its ends."""
    return of_rod(d, rod) - rod.mass / 4 * spread(d)


def rod_vector(centres: Sequence[ca.SX], orientations: Sequence[ca.SX], q: ca.SX, rod: RodMass) -> ca.SX:
    """Return d."""
    return q - centres[rod.module] - orientations[rod.module] @ ca.DM(rod.foot)


def of_platform(centres: Sequence[ca.SX], orientations: Sequence[ca.SX], q: ca.SX, carried: Masses) -> ca.SX:
    """Return the inertia about the COM."""
    bodies = [of_body(o, R, carried.body(i)) for i, (o, R) in enumerate(zip(centres, orientations, strict=True))]
    J = sum(bodies, start=carried.tip * spread(q))
    if carried.rod.mass:
        J += beside_halves(rod_vector(centres, orientations, q, carried.rod), carried.rod)
    return J
