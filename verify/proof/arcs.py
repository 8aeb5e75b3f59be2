r"""Angles as points of the plane: all that a proof is about is affine in each of them.

With (c, s) = (cos theta, sin theta) of every angle, the frame of a module, its centre, and the wrench of its rotors
about the origin are products of matrices, in which the pair of every angle occurs once: affine in each pair with
the others held. Over an interval the pair runs along an arc, which lies in the triangle of the arc's ends and the
point where the tangents there meet, (P_0 + P_1) / (1 + P_0 . P_1). So if a function is concave in each pair, as is
an affine function less a convex function of affine functions, it is nowhere in a box of angles less than the least
of its values at the 3^A choices of corners. Nothing is left out, and there is no remainder.

At corners that are no angles a "rotation" is a matrix of that kind, not a rotation. What is quadratic in a position
(p x z) is therefore carried along as a number of its own, B: for a motion x -> R x + p it is [p]x R, and

    (R, B) (step d) = (R, B + R [d]x),    (R, B) (turn H) = (R H, B H).

| symbol | meaning | shape |
|---|---|---|
| corners | (c, s) of every angle: the arc's two ends and its tangents' meeting point | (A, 3, 2) |
| R, B, p | of a module, seen from the root, for each choice of its hinges' corners | (3, 3), (3, 3), (3,) |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model.compiled_code import njit
from verify.bodies import Array
from verify.proof.platform import Indices, Numbers

WIDEST = 1.6
"""An interval for which the triangle is used is no wider [rad]: no coordinate of a corner is above 1.44."""


class Frames(NamedTuple):
    """Frames of all modules; those of module i begin at first[i], and a hinge more is a last digit more."""

    first: Indices
    """Shape (n + 1,)."""
    R: Array
    """Shape (frames, 3, 3)."""
    B: Array
    """Shape (frames, 3, 3)."""
    p: Array
    """Shape (frames, 3)."""


@njit(cache=True, literals=False)
def frame_arrays(numbers: Numbers, each: int) -> Frames:
    """Return arrays for frames, with so many points to choose from for every angle."""
    n = len(numbers.parent)
    first = np.zeros(n + 1, np.int64)
    for i in range(n):
        first[i + 1] = first[i] + each ** numbers.depth[i]
    count = first[n]
    return Frames(first, np.zeros((count, 3, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)))


@njit(cache=True, allocates=False)
def fill_corners(lower: Array, upper: Array, first: int, corners: Array) -> None:
    """Fill the corners of the arcs of all angles from the first on."""
    for a in range(first, len(lower)):
        c0, s0 = math.cos(lower[a]), math.sin(lower[a])
        c1, s1 = math.cos(upper[a]), math.sin(upper[a])
        share = 1 / (1 + c0 * c1 + s0 * s1)
        corners[a, 0, 0], corners[a, 0, 1] = c0, s0
        corners[a, 1, 0], corners[a, 1, 1] = c1, s1
        corners[a, 2, 0], corners[a, 2, 1] = share * (c0 + c1), share * (s0 + s1)


@njit(cache=True, allocates=False)
def turn_columns(M: Array, axis: int, c: float, s: float, into: Array) -> None:
    """Fill M H, with H about x (axis 0), y (1) or z (2)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    for row in range(3):
        mj, mk = M[row, j], M[row, k]
        into[row, axis] = M[row, axis]
        into[row, j], into[row, k] = c * mj + s * mk, c * mk - s * mj


@njit(cache=True, allocates=False)
def root_turn(psi: Array, alpha_0: Array, alpha_1: Array, R: Array) -> None:
    """Fill Rz(psi) Rx(alpha_0) Ry(alpha_1) of pairs (c, s)."""
    R[:] = 0.0
    R[0, 0] = R[1, 1] = R[2, 2] = 1.0
    turn_columns(R, 2, psi[0], psi[1], R)
    turn_columns(R, 0, alpha_0[0], alpha_0[1], R)
    turn_columns(R, 1, alpha_1[0], alpha_1[1], R)


@njit(cache=True, literals=False, allocates=False)
def fill_frames(numbers: Numbers, points: Array, each: int, into: Frames) -> None:
    """Fill the frames of all modules for each choice of so many points (c, s) an angle, shape (A, each, 2)."""
    first, R, B, p = into
    R[0], B[0], p[0] = 0.0, 0.0, 0.0
    R[0, 0, 0] = R[0, 1, 1] = R[0, 2, 2] = 1.0
    for i in range(1, len(numbers.parent)):
        h, port = numbers.parent[i], numbers.port[i]
        axis = 1 if port % 2 == 0 else 0
        column = 0 if port % 2 == 0 else 1
        step = numbers.l_c if port < 2 else -numbers.l_c
        for v in range(first[h], first[h + 1]):
            for choice in range(each):
                at = first[i] + (v - first[h]) * each + choice
                c, s = points[i + 2, choice, 0], points[i + 2, choice, 1]
                for row in range(3):
                    p[at, row] = p[v, row] + step * R[v, row, column]
                    for k in range(3):
                        B[at, row, k] = B[v, row, k]
                _add_step(R[v], column, step, B[at])
                turn_columns(B[at], axis, c, s, B[at])
                turn_columns(R[v], axis, c, s, R[at])
                for row in range(3):
                    p[at, row] += step * R[at, row, column]
                _add_step(R[at], column, step, B[at])
                for _ in range(numbers.turns[i]):
                    turn_columns(R[at], 2, 0.0, 1.0, R[at])
                    turn_columns(B[at], 2, 0.0, 1.0, B[at])


@njit(cache=True, allocates=False)
def _add_step(R: Array, column: int, step: float, B: Array) -> None:
    """Add R [d]x to B, d of length `step` along an axis."""
    j, k = (column + 1) % 3, (column + 2) % 3
    for row in range(3):  # [d]x e_j = d e_k, [d]x e_k = -d e_j
        B[row, j] += step * R[row, k]
        B[row, k] -= step * R[row, j]
