r"""Angles as points of the plane: every quantity of a proof is affine in each of them.

With the pair (c, s) = (cos theta, sin theta) of every angle, the frame of a module, its centre and the wrench of
its rotors about the origin are products of matrices in which each pair occurs once: they are affine in each pair
with the others fixed. Over an interval the pair moves along an arc, which lies in the triangle of the arc's ends
and the point where the tangents there meet, (P_0 + P_1) / (1 + P_0 . P_1). So a function that is concave in each
pair, such as an affine function less a convex function of affine functions, is nowhere in a box of angles less than
its least value over the 3^A combinations of triangle vertices. There is no remainder.

At a vertex that is not an angle, the "rotation" is a matrix of that form but not a rotation. Products with a
position (p x z) are therefore carried along as a matrix B of their own: for a motion x -> R x + p it is [p]x R, and

    (R, B) (step d) = (R, B + R [d]x),    (R, B) (turn H) = (R H, B H).

| symbol | meaning | shape |
|---|---|---|
| triangles | (c, s) of every angle at the arc's two ends and where its tangents meet | (A, 3, 2) |
| R, B, p | a module in the root's frame, for each combination of vertices of its hinges | (3, 3), (3, 3), (3,) |
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, Indices
from verify.proof.platform import CheckProblem

MAX_WIDTH = 1.6
"""Largest width of an interval with a triangle: no coordinate of a vertex exceeds 1.44 [rad]."""


class ArcFrames(NamedTuple):
    """Frames of all modules; those of module i begin at first[i], and each hinge of its path appends a digit."""

    first: Indices
    """Shape (n + 1,)."""
    R: Array
    """Shape (frames, 3, 3)."""
    B: Array
    """Shape (frames, 3, 3)."""
    p: Array
    """Shape (frames, 3)."""


@njit(cache=True, literals=False)
def empty_frames(problem: CheckProblem, choices: int) -> ArcFrames:
    """Return arrays for the frames of all modules, with `choices` pairs per angle."""
    n = len(problem.parent)
    first = np.zeros(n + 1, np.int64)
    for i in range(n):
        first[i + 1] = first[i] + choices ** problem.depth[i]
    count = first[n]
    return ArcFrames(first, np.zeros((count, 3, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)))


@njit(cache=True, allocates=False)
def fill_triangles(lower: Array, upper: Array, first_angle: int, triangles: Array) -> None:
    """Fill the triangles of the arcs of all angles from `first_angle` on."""
    for a in range(first_angle, len(lower)):
        c0, s0 = math.cos(lower[a]), math.sin(lower[a])
        c1, s1 = math.cos(upper[a]), math.sin(upper[a])
        scale = 1 / (1 + c0 * c1 + s0 * s1)
        triangles[a, 0, 0], triangles[a, 0, 1] = c0, s0
        triangles[a, 1, 0], triangles[a, 1, 1] = c1, s1
        triangles[a, 2, 0], triangles[a, 2, 1] = scale * (c0 + c1), scale * (s0 + s1)


@njit(cache=True, inner=True, allocates=False)
def multiply_by_hinge(M: Array, axis: int, c: float, s: float, product: Array) -> None:
    """Fill the product M H, where H turns about x (axis 0), y (1) or z (2) by the pair (c, s)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    for row in range(3):
        mj, mk = M[row, j], M[row, k]
        product[row, axis] = M[row, axis]
        product[row, j], product[row, k] = c * mj + s * mk, c * mk - s * mj


@njit(cache=True, inner=True, allocates=False)
def fill_root_orientation(psi: Array, alpha_0: Array, alpha_1: Array, R: Array) -> None:
    """Fill R = Rz(psi) Rx(alpha_0) Ry(alpha_1) from pairs (c, s)."""
    R[:] = 0.0
    R[0, 0] = R[1, 1] = R[2, 2] = 1.0
    multiply_by_hinge(R, 2, psi[0], psi[1], R)
    multiply_by_hinge(R, 0, alpha_0[0], alpha_0[1], R)
    multiply_by_hinge(R, 1, alpha_1[0], alpha_1[1], R)


@njit(cache=True, literals=False, allocates=False)
def fill_frames(problem: CheckProblem, pairs: Array, choices: int, frames: ArcFrames) -> None:
    """Fill the frames of all modules for each combination of pairs (c, s), shape (A, choices, 2)."""
    first, R, B, p = frames
    R[0], B[0], p[0] = 0.0, 0.0, 0.0
    R[0, 0, 0] = R[0, 1, 1] = R[0, 2, 2] = 1.0
    for i in range(1, len(problem.parent)):
        h, port = problem.parent[i], problem.port[i]
        axis = 1 if port % 2 == 0 else 0
        column = 0 if port % 2 == 0 else 1
        step = problem.l_c if port < 2 else -problem.l_c
        for v in range(first[h], first[h + 1]):
            for choice in range(choices):
                frame = first[i] + (v - first[h]) * choices + choice
                c, s = pairs[i + 2, choice, 0], pairs[i + 2, choice, 1]
                for row in range(3):
                    p[frame, row] = p[v, row] + step * R[v, row, column]
                    for k in range(3):
                        B[frame, row, k] = B[v, row, k]
                _add_step(R[v], column, step, B[frame])
                multiply_by_hinge(B[frame], axis, c, s, B[frame])
                multiply_by_hinge(R[v], axis, c, s, R[frame])
                for row in range(3):
                    p[frame, row] += step * R[frame, row, column]
                _add_step(R[frame], column, step, B[frame])
                for _ in range(problem.quarter_turns[i]):
                    multiply_by_hinge(R[frame], 2, 0.0, 1.0, R[frame])
                    multiply_by_hinge(B[frame], 2, 0.0, 1.0, B[frame])


@njit(cache=True, inner=True, allocates=False)
def _add_step(R: Array, column: int, step: float, B: Array) -> None:
    """Add R [d]x to B, where d has the length `step` along an axis."""
    j, k = (column + 1) % 3, (column + 2) % 3
    for row in range(3):  # [d]x e_j = d e_k, [d]x e_k = -d e_j
        B[row, j] += step * R[row, k]
        B[row, k] -= step * R[row, j]
