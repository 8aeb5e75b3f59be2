"""Poses of modules in the root module's frame: at the vertices of a box of hinge angles, and at its middle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import Tree
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


class Frames(NamedTuple):
    """Frames and centres in the root's frame; those of module i at vertex v are at `first[i] + v`.

    The vertices of a module are those of the hinges on its path, outermost first: bit by bit, 0 where the angle is
    least. One step along the path appends a bit.
    """

    x: Array
    y: Array
    z: Array
    p: Array


class Axes(NamedTuple):
    """The axes that angles turn about, in the root's frame, shape (A, 3) each: directions and points."""

    omega: Array
    c: Array


@njit(cache=True, allocates=False)
def moment(at: Frames, v: int, body: Array) -> tuple[float, float, float]:
    """Return the moment of a module's body (`BranchProblem.bodies`) in frame v."""
    w, a, b = body
    return (
        w * at.p[v, 0] + a * at.x[v, 0] + b * at.y[v, 0],
        w * at.p[v, 1] + a * at.x[v, 1] + b * at.y[v, 1],
        w * at.p[v, 2] + a * at.x[v, 2] + b * at.y[v, 2],
    )


@njit(cache=True)
def blank(count: int) -> Frames:
    """Return arrays for so many frames."""
    return Frames(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)))


@njit(cache=True, allocates=False)
def at_vertices(tree: Tree, l_c: float, lower: Array, upper: Array, into: Frames) -> None:
    """Fill the frames of all modules at all vertices of their hinges."""
    _root(into)
    for i in range(1, len(tree.parent)):
        h = tree.parent[i]
        count = tree.first[h + 1] - tree.first[h]
        for bit in range(2):
            angle = upper[i + 2] if bit else lower[i + 2]
            c, s = math.cos(angle), math.sin(angle)
            for v in range(count):
                _child(
                    into,
                    tree.first[h] + v,
                    into,
                    tree.first[i] + 2 * v + bit,
                    tree.port[i],
                    tree.kappa[i],
                    c,
                    s,
                    l_c,
                )


@njit(cache=True, allocates=False)
def at_middle(tree: Tree, l_c: float, middle: Array, into: Frames, axes: Axes) -> None:
    """Fill one frame for every module, and the axes, at given angles."""
    _root(into)
    _root_axes(middle, axes)
    for i in range(1, len(tree.parent)):
        h, port = tree.parent[i], tree.port[i]
        c, s = math.cos(middle[i + 2]), math.sin(middle[i + 2])
        _child(into, h, into, i, port, tree.kappa[i], c, s, l_c)
        sign = 1.0 if port < 2 else -1.0
        for k in range(3):
            axes.omega[i + 2, k] = into.y[h, k] if port % 2 == 0 else into.x[h, k]
            along = into.x[h, k] if port % 2 == 0 else into.y[h, k]
            axes.c[i + 2, k] = into.p[h, k] + l_c * sign * along


@njit(cache=True, allocates=False)
def root_frame(psi: float, alpha_0: float, alpha_1: float, R: Array) -> None:
    """Fill R = Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    c0, s0 = math.cos(psi), math.sin(psi)
    c1, s1 = math.cos(alpha_0), math.sin(alpha_0)
    c2, s2 = math.cos(alpha_1), math.sin(alpha_1)
    R[0, 0], R[0, 1], R[0, 2] = c0 * c2 - s0 * s1 * s2, -s0 * c1, c0 * s2 + s0 * s1 * c2
    R[1, 0], R[1, 1], R[1, 2] = s0 * c2 + c0 * s1 * s2, c0 * c1, s0 * s2 - c0 * s1 * c2
    R[2, 0], R[2, 1], R[2, 2] = -c1 * s2, s1, c1 * c2


@njit(cache=True, allocates=False)
def _root(into: Frames) -> None:
    into.x[0], into.y[0], into.z[0], into.p[0] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


@njit(cache=True, allocates=False)
def _root_axes(middle: Array, axes: Axes) -> None:
    """Fill the axes of psi, alpha_0 and alpha_1: e_z, Rz e_x and Rz Rx e_y in W, all through the origin."""
    c1, s1 = math.cos(middle[1]), math.sin(middle[1])
    c2, s2 = math.cos(middle[2]), math.sin(middle[2])
    axes.omega[0] = -c1 * s2, s1, c1 * c2
    axes.omega[1] = c2, 0.0, s2
    axes.omega[2] = 0.0, 1.0, 0.0
    axes.c[:3] = 0.0


@njit(cache=True, allocates=False)
def _child(of: Frames, h: int, into: Frames, i: int, port: int, kappa: int, c: float, s: float, l_c: float) -> None:
    """Fill frame i of a module from its parent's, frame h: R_i = R_h H(alpha) Rz(kappa pi/2)."""
    sign = 1.0 if port < 2 else -1.0
    for k in range(3):
        rx, ry, rz = of.x[h, k], of.y[h, k], of.z[h, k]
        if port % 2 == 0:  # R_h Ry(alpha)
            hx, hy, hz = c * rx - s * rz, ry, s * rx + c * rz
            steps = rx + hx
        else:  # R_h Rx(alpha)
            hx, hy, hz = rx, c * ry + s * rz, c * rz - s * ry
            steps = ry + hy
        into.p[i, k] = of.p[h, k] + l_c * sign * steps
        into.z[i, k] = hz
        if kappa == 0:
            into.x[i, k], into.y[i, k] = hx, hy
        elif kappa == 1:
            into.x[i, k], into.y[i, k] = hy, -hx
        elif kappa == 2:
            into.x[i, k], into.y[i, k] = -hx, -hy
        else:
            into.x[i, k], into.y[i, k] = -hy, hx
