r"""The platform of a point of the reduced space: poses, and how every unknown moves what they carry.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | unknowns: psi, alpha_0, alpha_1, hinges, then p'_E if it is free | (N,) | rad, l_arm |
| R_i, p_i, z_i | pose and axis of module i in W | (n,3,3), (n,3), (n,3) | -, l_arm, - |
| omega_l, c_l | axis of angle l, and a point on it | (n+2,3) each | -, l_arm |
| p'_E, p_COM | end-effector and centre of mass in W | (3,) each | l_arm |
| B | centre of mass of the modules and joints (`nlp.numbers.masses`) | (3,) | l_arm |
| dp, dz | derivatives of p_i and z_i by x | (N,n,3) each | |
| dE, dB | derivatives of p'_E and of p_E = p'_E - p_COM by x | (N,3) each | |

.. math::

    \partial p_i / \partial \alpha_l = \omega_l \times (p_i - c_l), \qquad
    \partial z_i / \partial \alpha_l = \omega_l \times z_i      \qquad \text{where } l \text{ moves } i
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlp.numbers import cholesky, jets, kinematics
from nlp.numbers.kinematics import chain
from nlp.reduced.arrays import ReducedProblem
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit, refresh


class Platform(NamedTuple):
    """Positions and axes of the platform."""

    R: Array
    p: Array
    z: Array
    omega: Array
    c: Array
    p_E: Array
    p_COM: Array


class Moved(NamedTuple):
    """Derivatives of the platform by the unknowns."""

    dp: Array
    dz: Array
    dE: Array
    dB: Array


@njit(cache=True)
def platform(problem: ReducedProblem, x: Array) -> Platform:
    """Return where everything is at x."""
    tree = problem.tree
    R, p, omega, c = chain(x, tree.parent, tree.port, tree.kappa, problem.rotors.l_c)
    n, z = len(p), R[:, :, 2].copy()
    p_E, p_COM, rotors = np.empty(3), np.empty(3), problem.rotors
    for k in range(3):
        B = 0.0
        for i in range(n):
            d = R[i, k, 0] * rotors.centres[i, 0] + R[i, k, 1] * rotors.centres[i, 1]
            B += rotors.modules[i] * (p[i, k] + d)
        B /= rotors.bodies
        p_E[k] = B + problem.fixed[k] if len(problem.fixed) else x[n + 2 + k]
        p_COM[k] = (rotors.m_E * p_E[k] + rotors.bodies * B) / (rotors.bodies + rotors.m_E)
    return Platform(R, p, z, omega, c, p_E, p_COM)


# nothing compiled is without this module
refresh(platform, Path(__file__).parent, Path(kinematics.__file__), Path(cholesky.__file__), Path(jets.__file__))


@njit(cache=True)
def motion(problem: ReducedProblem, at: Platform) -> Moved:
    """Return how the unknowns move everything."""
    n, N, rotors = len(at.p), len(problem.lower), problem.rotors
    dp, dz = np.zeros((N, n, 3)), np.zeros((N, n, 3))
    dE, dB = np.zeros((N, 3)), np.zeros((N, 3))
    free = len(problem.fixed) == 0
    for l in range(n + 2):
        u, v, w = at.omega[l]
        a, b, c = at.c[l]
        for i in range(n):
            if problem.tree.moves[l, i]:
                x, y, z = at.p[i, 0] - a, at.p[i, 1] - b, at.p[i, 2] - c
                dp[l, i, 0], dp[l, i, 1], dp[l, i, 2] = v * z - w * y, w * x - u * z, u * y - v * x
                x, y, z = at.z[i, 0], at.z[i, 1], at.z[i, 2]
                dz[l, i, 0], dz[l, i, 1], dz[l, i, 2] = v * z - w * y, w * x - u * z, u * y - v * x
        turned = np.zeros(3)  # derivative of B, times the mass
        for i in range(n):
            if problem.tree.moves[l, i]:
                d, e = rotors.centres[i]
                x, y = d * at.R[i, 0, 0] + e * at.R[i, 0, 1], d * at.R[i, 1, 0] + e * at.R[i, 1, 1]
                z = d * at.R[i, 2, 0] + e * at.R[i, 2, 1]
                turned[0] += rotors.modules[i] * (dp[l, i, 0] + v * z - w * y)
                turned[1] += rotors.modules[i] * (dp[l, i, 1] + w * x - u * z)
                turned[2] += rotors.modules[i] * (dp[l, i, 2] + u * y - v * x)
        for k in range(3):
            by_angle = turned[k] / rotors.bodies
            if free:
                dB[l, k] = -rotors.bodies * by_angle / (rotors.bodies + rotors.m_E)
            else:
                dE[l, k] = by_angle
    if free:
        for k in range(3):
            dE[n + 2 + k, k] = 1.0
            dB[n + 2 + k, k] = rotors.bodies / (rotors.bodies + rotors.m_E)
    return Moved(dp, dz, dE, dB)
