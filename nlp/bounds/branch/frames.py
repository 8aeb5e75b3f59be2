"""Frames of modules in the root's frame, at the vertices of a box of hinge angles and at its middle."""

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import TreePaths
from nlp.numbers.kinematics import Vector, add, row
from topo_search.compiled_code import njit
from topo_search.model.arrays import Array


class Frames(NamedTuple):
    """Axes and centres of modules in the root's frame; module i at vertex v has the index `first[i] + v`.

    The bits of v are the hinges on the module's path, outermost first: 0 for the least angle, 1 for the greatest.
    One step along the path appends a bit.
    """

    x: Array
    y: Array
    z: Array
    p: Array


class Axes(NamedTuple):
    """Directions and points of the axes of all angles in the root's frame, shape (A, 3) each."""

    omega: Array
    c: Array


class BoxFrames(NamedTuple):
    """Angles and frames of a box of angles."""

    roots: Array
    """Root orientations at the middle and at the 8 vertices, or 4 if psi is one angle, shape (1 + roots, 3, 3)."""
    centre: Array
    """Angles at the middle, shape (A,) [rad]."""
    rho: Array
    """Half widths, shape (A,) [rad]."""
    middle: Frames
    """Frames at the middle of the box."""
    axes: Axes
    """Axes of the angles at the middle."""
    vertices: Frames
    """Frames at the vertices of the hinges."""


@njit(cache=True, forceinline=True)
def rotate(R: Array, a: Vector) -> Vector:
    """Return R a."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@njit(cache=True, inner=True, allocates=False)
def moment(frames: Frames, v: int, body: Array) -> Vector:
    """Return the moment of a module's body (`BranchProblem.bodies`) in frame v."""
    w, a, b = body
    p = (w * frames.p[v, 0], w * frames.p[v, 1], w * frames.p[v, 2])
    return add(add(p, a, row(frames.x, v)), b, row(frames.y, v))


@njit(cache=True)
def empty_frames(count: int) -> Frames:
    """Return arrays for `count` frames."""
    return Frames(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)))


@njit(cache=True)
def empty_box(tree: TreePaths, roots: int = 8) -> BoxFrames:
    """Return the arrays of a box with 8 vertices of the root, or 4 if psi is one angle."""
    n, A = len(tree.parent), len(tree.parent) + 2
    middle, axes = empty_frames(n), Axes(np.zeros((A, 3)), np.zeros((A, 3)))
    return BoxFrames(
        np.zeros((1 + roots, 3, 3)), np.zeros(A), np.zeros(A), middle, axes, empty_frames(tree.first[-1])
    )


@njit(cache=True, allocates=False)
def fill_box(tree: TreePaths, l_c: float, lower: Array, upper: Array, box: BoxFrames) -> None:
    """Fill a box between the least and the greatest angles, except for its roots."""
    for a in range(len(lower)):
        box.centre[a], box.rho[a] = (lower[a] + upper[a]) / 2, (upper[a] - lower[a]) / 2
    fill_middle_frames(tree, l_c, box.centre, box.middle, box.axes)
    fill_vertex_frames(tree, l_c, lower, upper, box.vertices)


@njit(cache=True, allocates=False)
def fill_roots(lower: Array, upper: Array, box: BoxFrames) -> None:
    """Fill the root orientations at the middle and at the vertices."""
    fill_root_orientation(box.centre[0], box.centre[1], box.centre[2], box.roots[0])
    for v in range(len(box.roots) - 1):
        psi = upper[0] if v & 4 else lower[0]
        alpha_0 = upper[1] if v & 2 else lower[1]
        alpha_1 = upper[2] if v & 1 else lower[2]
        fill_root_orientation(psi, alpha_0, alpha_1, box.roots[1 + v])


@njit(cache=True, allocates=False)
def fill_vertex_frames(tree: TreePaths, l_c: float, lower: Array, upper: Array, frames: Frames) -> None:
    """Fill the frames of all modules at the vertices of the hinges on their paths."""
    _fill_root(frames)
    for i in range(1, len(tree.parent)):
        h = tree.parent[i]
        count = tree.first[h + 1] - tree.first[h]
        for bit in range(2):
            angle = upper[i + 2] if bit else lower[i + 2]
            c, s = math.cos(angle), math.sin(angle)
            for v in range(count):
                parent, child = tree.first[h] + v, tree.first[i] + 2 * v + bit
                _fill_child(frames, parent, child, tree.port[i], tree.kappa[i], c, s, l_c)


@njit(cache=True, allocates=False)
def fill_middle_frames(tree: TreePaths, l_c: float, middle: Array, frames: Frames, axes: Axes) -> None:
    """Fill one frame per module, and the axes, at the angles `middle`."""
    _fill_root(frames)
    _fill_root_axes(middle, axes)
    for i in range(1, len(tree.parent)):
        h, port = tree.parent[i], tree.port[i]
        c, s = math.cos(middle[i + 2]), math.sin(middle[i + 2])
        _fill_child(frames, h, i, port, tree.kappa[i], c, s, l_c)
        sign = 1.0 if port < 2 else -1.0
        for k in range(3):
            axes.omega[i + 2, k] = frames.y[h, k] if port % 2 == 0 else frames.x[h, k]
            along = frames.x[h, k] if port % 2 == 0 else frames.y[h, k]
            axes.c[i + 2, k] = frames.p[h, k] + l_c * sign * along


@njit(cache=True, inner=True, allocates=False)
def fill_root_orientation(psi: float, alpha_0: float, alpha_1: float, R: Array) -> None:
    """Fill R = Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    c0, s0 = math.cos(psi), math.sin(psi)
    c1, s1 = math.cos(alpha_0), math.sin(alpha_0)
    c2, s2 = math.cos(alpha_1), math.sin(alpha_1)
    R[0, 0], R[0, 1], R[0, 2] = c0 * c2 - s0 * s1 * s2, -s0 * c1, c0 * s2 + s0 * s1 * c2
    R[1, 0], R[1, 1], R[1, 2] = s0 * c2 + c0 * s1 * s2, c0 * c1, s0 * s2 - c0 * s1 * c2
    R[2, 0], R[2, 1], R[2, 2] = -c1 * s2, s1, c1 * c2


@njit(cache=True, inner=True, allocates=False)
def _fill_root(frames: Frames) -> None:
    frames.x[0], frames.y[0] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    frames.z[0], frames.p[0] = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


@njit(cache=True, inner=True, allocates=False)
def _fill_root_axes(middle: Array, axes: Axes) -> None:
    """Fill the axes of psi, alpha_0 and alpha_1 (e_z, Rz e_x and Rz Rx e_y in W), all through the origin."""
    c1, s1 = math.cos(middle[1]), math.sin(middle[1])
    c2, s2 = math.cos(middle[2]), math.sin(middle[2])
    axes.omega[0] = -c1 * s2, s1, c1 * c2
    axes.omega[1] = c2, 0.0, s2
    axes.omega[2] = 0.0, 1.0, 0.0
    axes.c[:3] = 0.0


@njit(cache=True, inner=True, allocates=False)
def _fill_child(frames: Frames, h: int, i: int, port: int, kappa: int, c: float, s: float, l_c: float) -> None:
    """Fill frame i of a module from frame h of its parent: R_i = R_h H(alpha) Rz(kappa pi/2)."""
    sign = 1.0 if port < 2 else -1.0
    for k in range(3):
        rx, ry, rz = frames.x[h, k], frames.y[h, k], frames.z[h, k]
        if port % 2 == 0:  # R_h Ry(alpha)
            hx, hy, hz = c * rx - s * rz, ry, s * rx + c * rz
            arms = rx + hx
        else:  # R_h Rx(alpha)
            hx, hy, hz = rx, c * ry + s * rz, c * rz - s * ry
            arms = ry + hy
        frames.p[i, k] = frames.p[h, k] + l_c * sign * arms
        frames.z[i, k] = hz
        if kappa == 0:
            frames.x[i, k], frames.y[i, k] = hx, hy
        elif kappa == 1:
            frames.x[i, k], frames.y[i, k] = hy, -hx
        elif kappa == 2:
            frames.x[i, k], frames.y[i, k] = -hx, -hy
        else:
            frames.x[i, k], frames.y[i, k] = -hy, hx
