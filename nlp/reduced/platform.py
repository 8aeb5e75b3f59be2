r"""The platform at a point of the reduced search, and its motion with the unknowns.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | unknowns: psi, alpha_0, alpha_1, hinges, then p'_E if it is free | (N,) | rad, l_arm |
| R_i, p_i, z_i | pose and axis of module i in W | (n,3,3), (n,3), (n,3) | -, l_arm, - |
| o_i, p_E | module i and end-effector from the COM | (n,3), (3,) | l_arm |
| p_COM, B | centre of mass in W; that of the modules and joints (`nlp.numbers.masses`) | (3,) each | l_arm |
| omega_l, v_l | angular velocity of the modules that angle l moves; velocity at the COM | (n+2,3) each | -, l_arm |
| dC_l | derivative of p_COM by angle l | (n+2,3) | l_arm |
| F_i, T_i | gradient by the pose of module i: a force, and its torque about the COM | (n,3) each | |
| E | gradient by the position of the end-effector | (3,) | |

All derived quantities are functions of positions from the COM and of the modules' orientations. Each angle moves
everything outward of it as one rigid body, and the COM by dC_l. With s, the end-effector's share of the mass,

.. math::

    \partial f / \partial \alpha_l = \sum_{i \text{ moved}} (\omega_l \cdot T_i + v_l \cdot F_i)
        - dC_l \cdot (E + \sum_i F_i), \qquad
    \partial f / \partial p'_E = E - s\, (E + \sum_i F_i)

If the task fixes the end-effector from the COM, it moves with the COM, and E does not contribute.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlp.numbers.kinematics import Vector, add, chain, cross, dot, multiply, row
from nlp.reduced.arrays import ReducedProblem
from topo_search.compiled_code import njit, refresh
from topo_search.model.arrays import Array


class ReducedPlatform(NamedTuple):
    """Positions and axes of the platform, and its motion with the angles; see the module's table."""

    R: Array
    p: Array
    z: Array
    o: Array
    p_E: Array
    p_COM: Array
    omega: Array
    v: Array
    dC: Array


@njit(cache=True, forceinline=True)
def rotate(R: Array, i: int, a: Vector) -> Vector:
    """Return a vector from module i's frame in W."""
    return (
        R[i, 0, 0] * a[0] + R[i, 0, 1] * a[1] + R[i, 0, 2] * a[2],
        R[i, 1, 0] * a[0] + R[i, 1, 1] * a[1] + R[i, 1, 2] * a[2],
        R[i, 2, 0] * a[0] + R[i, 2, 1] * a[1] + R[i, 2, 2] * a[2],
    )


@njit(cache=True, forceinline=True)
def p_E_of(pose: ReducedPlatform) -> Vector:
    """Return p_E as a vector."""
    return pose.p_E[0], pose.p_E[1], pose.p_E[2]


@njit(cache=True, inner=True)
def platform(problem: ReducedProblem, x: Array) -> ReducedPlatform:
    """Return the platform at x."""
    tree, rotors = problem.tree, problem.rotors
    R, p, omega, c = chain(x, tree.parent, tree.port, tree.kappa, rotors.l_c)
    parent, masses, centres = tree.parent, rotors.modules, rotors.centres
    n, z, free = len(p), R[:, :, 2].copy(), len(problem.fixed) == 0
    p_E, p_COM, o, v, dC = np.empty(3), np.empty(3), np.empty((n, 3)), np.empty((n + 2, 3)), np.empty((n + 2, 3))
    outward = np.zeros((n, 4))  # first moment about the COM and mass, of each module and all outward of it
    for k in range(3):
        B = 0.0
        for i in range(n):
            d = R[i, k, 0] * centres[i, 0] + R[i, k, 1] * centres[i, 1]
            outward[i, k] = masses[i] * (p[i, k] + d)
            B += outward[i, k]
        B /= rotors.bodies
        tip = x[n + 2 + k] if free else B + problem.fixed[k]
        p_COM[k] = (rotors.m_E * tip + rotors.bodies * B) / (rotors.bodies + rotors.m_E)
        p_E[k] = tip - p_COM[k]
        for i in range(n):
            o[i, k] = p[i, k] - p_COM[k]
            outward[i, k] -= masses[i] * p_COM[k]
    for i in range(n - 1, -1, -1):
        outward[i, 3] += masses[i]
        for k in range(4 if i else 0):
            outward[parent[i], k] += outward[i, k]
    mass, com = rotors.bodies + (rotors.m_E if free else 0.0), (p_COM[0], p_COM[1], p_COM[2])
    for l in range(n + 2):
        i, turn = max(0, l - 2), row(omega, l)
        v[l, 0], v[l, 1], v[l, 2] = velocity = cross(turn, add(com, -1.0, row(c, l)))
        moment = add(cross(turn, row(outward, i)), outward[i, 3], velocity)
        dC[l, 0], dC[l, 1], dC[l, 2] = multiply(1 / mass, moment)
    return ReducedPlatform(R, p, z, o, p_E, p_COM, omega, v, dC)


# every compiled function of the search depends on this module
room = Path(__file__).parent
refresh(platform, room, *(room.with_name(name) for name in ("numbers", "requirements", "air")))


@njit(cache=True, inner=True, allocates=False)
def add_slopes(problem: ReducedProblem, pose: ReducedPlatform, forces: Array, E: Array, slopes: Array) -> None:
    """Convert a gradient by poses to one by x, and add it.

    Args:
        problem: the task and topology.
        pose: the platform.
        forces: F and T of all modules, shape (n, 6); each module's are increased by those of all outward of it.
        E: gradient by the position of the end-effector, shape (3,).
        slopes: increased by the gradient, shape (N,).
    """
    parent, omega, v = problem.tree.parent, pose.omega, pose.v
    for i in range(len(forces) - 1, 0, -1):
        for a in range(6):
            forces[parent[i], a] += forces[i, a]
    for l in range(len(omega)):
        i = max(0, l - 2)
        slopes[l] += dot(row(omega, l), row(forces, i, 3)) + dot(row(v, l), row(forces, i))
    add_reaction(problem, pose, row(forces, 0), (E[0], E[1], E[2]), slopes)


@njit(cache=True, inner=True, forceinline=True)
def add_reaction(problem: ReducedProblem, pose: ReducedPlatform, F: Vector, E: Vector, slopes: Array) -> None:
    """Add the part of a gradient by x that comes from the motion of COM and end-effector; F is the sum of all."""
    free, dC = len(problem.fixed) == 0, pose.dC
    F = add(F, 1.0 if free else 0.0, E)
    for l in range(len(dC)):
        slopes[l] -= dot(row(dC, l), F)
    if free:
        share, n = problem.rotors.m_E / (problem.rotors.bodies + problem.rotors.m_E), len(dC)
        slopes[n], slopes[n + 1], slopes[n + 2] = add(E, -share, F)
