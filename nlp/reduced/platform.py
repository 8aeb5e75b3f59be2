r"""The platform of a point of the reduced space: poses, and how every unknown moves what they carry.

| symbol | meaning | shape | unit |
|---|---|---|---|
| x | unknowns: psi, alpha_0, alpha_1, hinges, then p'_E if it is free | (N,) | rad, l_arm |
| R_i, p_i, z_i | pose and axis of module i in W | (n,3,3), (n,3), (n,3) | -, l_arm, - |
| omega_l, c_l | axis of angle l, and a point on it | (n+2,3) each | -, l_arm |
| p'_E, p_COM | end-effector and centre of mass in W | (3,) each | l_arm |
| dp, dz | derivatives of p_i and z_i by x | (N,n,3) each | |
| dE, dB | derivatives of p'_E and of p_E = p'_E - p_COM by x | (N,3) each | |

.. math::

    \partial p_i / \partial \alpha_l = \omega_l \times (p_i - c_l), \qquad
    \partial z_i / \partial \alpha_l = \omega_l \times z_i      \qquad \text{where } l \text{ moves } i
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from nlp.reduced.stated import Stated
from topo_search.model.arrays import Array


class Platform(NamedTuple):
    """Where everything is."""

    R: Array
    p: Array
    z: Array
    omega: Array
    c: Array
    p_E: Array
    p_COM: Array


class Moved(NamedTuple):
    """How the unknowns move it."""

    dp: Array
    dz: Array
    dE: Array
    dB: Array


@njit(cache=True)
def platform(stated: Stated, x: Array) -> Platform:
    """Return where everything is at x."""
    tree, l_c, n = stated.tree, stated.rotors.l_c, len(stated.tree.parent)
    R, p, z = np.empty((n, 3, 3)), np.zeros((n, 3)), np.empty((n, 3))
    omega, c = np.zeros((n + 2, 3)), np.zeros((n + 2, 3))
    c0, s0 = math.cos(x[0]), math.sin(x[0])
    c1, s1 = math.cos(x[1]), math.sin(x[1])
    c2, s2 = math.cos(x[2]), math.sin(x[2])
    omega[0, 2] = 1.0
    omega[1] = c0, s0, 0.0
    omega[2] = -s0 * c1, c0 * c1, s1
    R[0, :, 1] = omega[2]
    R[0, :, 0] = c0 * c2 - s0 * s1 * s2, s0 * c2 + c0 * s1 * s2, -c1 * s2
    R[0, :, 2] = c0 * s2 + s0 * s1 * c2, s0 * s2 - c0 * s1 * c2, c1 * c2
    for i in range(1, n):
        h, a, angle = tree.parent[i], tree.port[i], x[i + 2]
        ca, sa = math.cos(angle), math.sin(angle)
        sign = 1.0 if a < 2 else -1.0
        kappa = tree.kappa[i]
        for k in range(3):
            rx, ry, rz = R[h, k, 0], R[h, k, 1], R[h, k, 2]
            if a % 2 == 0:  # R_h Ry(alpha)
                omega[i + 2, k] = ry
                along = sign * rx
                hx, hy, hz = ca * rx - sa * rz, ry, sa * rx + ca * rz
                out = sign * hx
            else:  # R_h Rx(alpha)
                omega[i + 2, k] = rx
                along = sign * ry
                hx, hy, hz = rx, ca * ry + sa * rz, ca * rz - sa * ry
                out = sign * hy
            c[i + 2, k] = p[h, k] + l_c * along
            p[i, k] = c[i + 2, k] + l_c * out
            R[i, k, 2] = hz
            if kappa == 0:
                R[i, k, 0], R[i, k, 1] = hx, hy
            elif kappa == 1:
                R[i, k, 0], R[i, k, 1] = hy, -hx
            elif kappa == 2:
                R[i, k, 0], R[i, k, 1] = -hx, -hy
            else:
                R[i, k, 0], R[i, k, 1] = -hy, hx
    z[:] = R[:, :, 2]
    p_E, p_COM, m_E = np.empty(3), np.empty(3), stated.rotors.m_E
    for k in range(3):
        centroid = 0.0
        for i in range(n):
            centroid += p[i, k]
        centroid /= n
        p_E[k] = centroid + stated.fixed[k] if len(stated.fixed) else x[n + 2 + k]
        p_COM[k] = (m_E * p_E[k] + n * centroid) / (n + m_E)
    return Platform(R, p, z, omega, c, p_E, p_COM)


@njit(cache=True)
def moved(stated: Stated, at: Platform) -> Moved:
    """Return how the unknowns move everything."""
    n, N, m_E = len(at.p), len(stated.lower), stated.rotors.m_E
    dp, dz = np.zeros((N, n, 3)), np.zeros((N, n, 3))
    dE, dB = np.zeros((N, 3)), np.zeros((N, 3))
    free = len(stated.fixed) == 0
    for l in range(n + 2):
        u, v, w = at.omega[l]
        a, b, c = at.c[l]
        for i in range(n):
            if stated.tree.moves[l, i]:
                x, y, z = at.p[i, 0] - a, at.p[i, 1] - b, at.p[i, 2] - c
                dp[l, i, 0], dp[l, i, 1], dp[l, i, 2] = v * z - w * y, w * x - u * z, u * y - v * x
                x, y, z = at.z[i, 0], at.z[i, 1], at.z[i, 2]
                dz[l, i, 0], dz[l, i, 1], dz[l, i, 2] = v * z - w * y, w * x - u * z, u * y - v * x
        for k in range(3):
            centroid = 0.0
            for i in range(n):
                centroid += dp[l, i, k]
            centroid /= n
            if free:
                dB[l, k] = -n * centroid / (n + m_E)
            else:
                dE[l, k] = centroid
    if free:
        for k in range(3):
            dE[n + 2 + k, k] = 1.0
            dB[n + 2 + k, k] = n / (n + m_E)
    return Moved(dp, dz, dE, dB)
