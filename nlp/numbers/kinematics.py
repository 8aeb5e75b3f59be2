r"""Compiled kinematic chain: poses of the modules, and the axes of all angles; vectors as tuples, without arrays.

| symbol | meaning | shape | unit |
|---|---|---|---|
| theta | psi, alpha_0, alpha_1 of the root, then the hinge angles | (n+2,) | rad |
| R_i, p_i | pose of module i in W | (n,3,3), (n,3) | -, that of l_c |
| omega_j, c_j | axis of theta_j, and a point on it | (n+2,3) each | -, that of l_c |

Searches and programs use it. Other functions for poses exist for a reason. `nlp.numbers.geometry.poses` serves
random starts and the check of results, which shares no code with the search, and commands that solve nothing and
load no compiler (rounded angles, claims of invariance). `nlp.bounds.branch.frames` and `nlp.bounds.reach` compute
poses for many angles at once: for all corners of a box, and for modules in a row.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Flags, Indices, Topology

Vector = tuple[float, float, float]


class Tree(NamedTuple):
    """Parents of the modules and their joints."""

    parent: Indices
    """Parent of each module, -1 for the root; parents come first."""
    port: Indices
    """Port a of the parent."""
    kappa: Indices
    """Quarter turns of each module."""
    moves: Flags
    """True if angle l (psi, alpha_0, alpha_1, then hinges) moves module i, shape (n+2, n)."""


def tree_of(topology: Topology) -> Tree:
    """Return a topology as arrays for compiled code."""
    n = topology.n
    port, moves = np.zeros(n, dtype=np.int64), np.zeros((n + 2, n), dtype=bool)
    moves[:3] = True
    for h, i, a, _ in topology.edges():
        port[i] = a
        moves[3:, i] = moves[3:, h]
        moves[i + 2, i] = True
    return Tree(np.array(topology.parents), port, np.array(topology.kappas, dtype=np.int64), moves)


@njit(cache=True, forceinline=True)
def row(A: Array, i: int, first: int = 0) -> Vector:
    """Return three numbers of row i; a slice would cost more than a whole clearance."""
    return A[i, first], A[i, first + 1], A[i, first + 2]


@njit(cache=True, forceinline=True)
def add(a: Vector, t: float, b: Vector) -> Vector:
    """Return a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


@njit(cache=True, forceinline=True)
def multiply(t: float, a: Vector) -> Vector:
    """Return t a."""
    return t * a[0], t * a[1], t * a[2]


@njit(cache=True, forceinline=True)
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, forceinline=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def chain(theta: Array, parent: Indices, port: Indices, kappa: Indices, l_c: Array) -> tuple[Array, ...]:
    """Return R, p, omega and c.

    Args:
        theta: the angles [rad].
        parent: parents of the modules, the root first, parents before children, shape (n,).
        port: ports of the parents, shape (n,).
        kappa: quarter turns of the modules, shape (n,).
        l_c: distances from the modules' centres to their connectors, shape (n,).
    """
    n = len(parent)
    R, p = np.empty((n, 3, 3)), np.zeros((n, 3))
    omega, c = np.zeros((n + 2, 3)), np.zeros((n + 2, 3))
    c0, s0 = math.cos(theta[0]), math.sin(theta[0])
    c1, s1 = math.cos(theta[1]), math.sin(theta[1])
    c2, s2 = math.cos(theta[2]), math.sin(theta[2])
    omega[0, 2], omega[1, 0], omega[1, 1] = 1.0, c0, s0
    omega[2, 0], omega[2, 1], omega[2, 2] = y = -s0 * c1, c0 * c1, s1
    R[0, 0, 1], R[0, 1, 1], R[0, 2, 1] = y
    R[0, 0, 0], R[0, 1, 0], R[0, 2, 0] = c0 * c2 - s0 * s1 * s2, s0 * c2 + c0 * s1 * s2, -c1 * s2
    R[0, 0, 2], R[0, 1, 2], R[0, 2, 2] = c0 * s2 + s0 * s1 * c2, s0 * s2 - c0 * s1 * c2, c1 * c2
    for i in range(1, n):
        h, a, angle = parent[i], port[i], theta[i + 2]
        ca, sa = math.cos(angle), math.sin(angle)
        sign = 1.0 if a < 2 else -1.0
        turns = kappa[i]
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
            c[i + 2, k] = p[h, k] + l_c[h] * along
            p[i, k] = c[i + 2, k] + l_c[i] * out
            R[i, k, 2] = hz
            if turns == 0:
                R[i, k, 0], R[i, k, 1] = hx, hy
            elif turns == 1:
                R[i, k, 0], R[i, k, 1] = hy, -hx
            elif turns == 2:
                R[i, k, 0], R[i, k, 1] = -hx, -hy
            else:
                R[i, k, 0], R[i, k, 1] = -hy, hx
    return R, p, omega, c
