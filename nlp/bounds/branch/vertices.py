"""Smoothed dual function D at all vertices of a box, and the workspace of its search (`worst_vertex`)."""

import math
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.arrays import ROTORS, BranchProblem
from nlp.bounds.branch.frames import BoxFrames, moment, rotate
from nlp.bounds.branch.multipliers import MIN_WEIGHT, best_input, lever_sum
from nlp.numbers.kinematics import add, cross, dot, row
from topo_search.compiled_code import njit
from topo_search.model import Array, Flags, Indices

MAX_VERTICES = 32
"""Largest number of vertices that enter a step."""


class VertexWorkspace(NamedTuple):
    """Arrays for one search; C is the number of vertices of the hinges."""

    module_of_frame: Indices
    """Module of every frame, shape (frames,)."""
    frame_of_module: Indices
    """Frame of every module at every vertex of the hinges, shape (C, n)."""
    a: Array
    """Wrenches of a module's rotors in W, shape (roots, frames, r, 6)."""
    moment: Array
    """B_i, moment of the module's body in W, shape (roots, frames, 3)."""
    wall: Array
    """n_r . e_r of the module's rows, 0 for other modules' rows, shape (roots, frames, W)."""
    t: Array
    """a_j . y_k, shape (roots, frames, K, r)."""
    module_value: Array
    """Contribution of a module to D, shape (roots, frames)."""
    smoothing_excess: Array
    """Excess of `module_value` from the smoothed kinks, shape (roots, frames)."""
    D: Array
    """D of all vertices, shape (roots C,)."""
    share: Array
    """e^(-D_v / T), up to a common factor; 0 once the vertex is in `order`; shape (roots C,)."""
    order: Indices
    """Vertices that enter a step, shape (MAX_VERTICES,)."""
    frame_share: Array
    """Sum of w_v over the vertices with this frame, shape (roots, frames)."""
    module_gradient: Array
    """Contribution of a module to a gradient, shape (roots, frames, K, 6)."""
    H: Array
    rows: Array
    """Three rows of the condition, then those of the vertices, shape (3 + MAX_VERTICES, K, 6)."""
    wall_rows: Array
    solved: Array
    """H_k^-1 times the rows."""
    S: Array
    """Schur complement of all rows."""
    q: Array
    """First w_v, then multipliers of the rows."""
    gradient: Array
    """Gradient of F, shape (K, 6)."""
    wall_gradient: Array
    ridge: Array
    """r, shape (K, 6)."""
    active: Flags
    """False for idle corners, shape (K,)."""
    y: Array
    """Multipliers that satisfy the condition, shape (K, 6)."""
    sigma: Array
    step: Array
    """Step of y, shape (K, 6)."""
    wall_step: Array
    """Step of sigma, shape (W,)."""
    trial_y: Array
    """y after the trial step."""
    trial_sigma: Array


@njit(cache=True, inner=True)
def vertex_workspace(problem: BranchProblem, roots: int) -> VertexWorkspace:
    """Return the workspace for a task and tree, with 8 vertices of the root, or 4 if psi is one angle."""
    tree, K, W = problem.tree, len(problem.loads.f), len(problem.walls.normal)
    n, count = len(tree.parent), tree.first[-1]
    module_of_frame, frame_of_module = np.zeros(count, np.int64), np.zeros((2 ** (n - 1), n), np.int64)
    for i in range(1, n):
        h = tree.parent[i]
        module_of_frame[tree.first[i] : tree.first[i + 1]] = i
        for c in range(len(frame_of_module)):
            frame_of_module[c, i] = tree.first[i] + 2 * (frame_of_module[c, h] - tree.first[h]) + (c >> (i - 1) & 1)
    rows = 3 + MAX_VERTICES
    return VertexWorkspace(
        module_of_frame,
        frame_of_module,
        np.zeros((roots, count, ROTORS, 6)),
        np.zeros((roots, count, 3)),
        np.zeros((roots, count, W)),
        np.zeros((roots, count, K, ROTORS)),
        np.zeros((roots, count)),
        np.zeros((roots, count)),
        np.zeros(roots * len(frame_of_module)),
        np.zeros(roots * len(frame_of_module)),
        np.zeros(MAX_VERTICES, np.int64),
        np.zeros((roots, count)),
        np.zeros((roots, count, K, 6)),
        np.zeros((K, 6, 6)),
        np.zeros((rows, K, 6)),
        np.zeros((rows, W)),
        np.zeros((rows, K, 6)),
        np.zeros((rows, rows)),
        np.zeros(rows),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(K, np.bool_),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(W),
        np.zeros((K, 6)),
        np.zeros(W),
    )


@njit(cache=True, inner=True, allocates=False)
def fill_frames(problem: BranchProblem, box: BoxFrames, workspace: VertexWorkspace) -> None:
    """Fill the wrenches, moments and wall distances of all frames."""
    walls, vertices = problem.walls, box.vertices
    for root in range(len(workspace.a)):
        R = box.roots[1 + root]
        for v in range(len(workspace.module_of_frame)):
            i, a = workspace.module_of_frame[v], workspace.a[root, v]
            p, x_axis = rotate(R, row(vertices.p, v)), rotate(R, row(vertices.x, v))
            y_axis, z_axis = rotate(R, row(vertices.y, v)), rotate(R, row(vertices.z, v))
            for q in range(ROTORS):
                x, y, z = problem.rotor_torques[q]
                torque = add(add(add(cross(p, z_axis), x, x_axis), y, y_axis), z, z_axis)
                for l in range(3):
                    a[q, l], a[q, 3 + l] = z_axis[l] / ROTORS, torque[l] / ROTORS
            B = rotate(R, moment(vertices, v, problem.bodies[i]))
            workspace.moment[root, v, 0], workspace.moment[root, v, 1], workspace.moment[root, v, 2] = B
            for r in range(len(walls.offset)):
                if walls.module[r] == i:
                    e = add(p, -(walls.end[r] * walls.length), z_axis)
                    workspace.wall[root, v, r] = dot(row(walls.normal, r), e)


@njit(cache=True, inner=True, allocates=False)
def smoothed_value(
    problem: BranchProblem, workspace: VertexWorkspace, y: Array, sigma: Array, T: float, m: float, s: float
) -> tuple[float, float, float]:
    """Return F, the least D without smoothing and the mean of D weighted by the shares; fill D and its terms."""
    loads, walls, n = problem.loads, problem.walls, len(problem.tree.parent)
    u_min, u_max = problem.u_min, problem.u_max
    constant, barrier, (sx, sy, sz) = 0.0, 0.0, lever_sum(loads.h, y)
    for k in range(len(y)):
        if workspace.active[k]:
            for l in range(3):
                constant += loads.f[k, l] * y[k, l] + loads.t[k, l] * y[k, 3 + l]
            for l in range(6):
                constant -= workspace.ridge[k, l] / 2 * y[k, l] ** 2
    for r in range(len(sigma)):
        constant += sigma[r] * walls.offset[r]
        barrier += m * math.log(sigma[r])
    for root in range(len(workspace.a)):
        for v in range(len(workspace.module_of_frame)):
            a, B = workspace.a[root, v], workspace.moment[root, v]
            a0, a1, a2 = a[0, 0], a[0, 1], a[0, 2]
            module_value, excess = B[0] * sx + B[1] * sy + B[2] * sz, 0.0
            for r in range(len(sigma)):
                module_value += workspace.wall[root, v, r] * sigma[r]
            for k in range(len(y)):
                if not workspace.active[k]:
                    continue
                weight, force = loads.weight[k], a0 * y[k, 0] + a1 * y[k, 1] + a2 * y[k, 2]
                dead = loads.dead_rotor[k] - ROTORS * workspace.module_of_frame[v]
                for q in range(ROTORS):
                    t = force + a[q, 3] * y[k, 3] + a[q, 4] * y[k, 4] + a[q, 5] * y[k, 5]
                    workspace.t[root, v, k, q] = t
                    if q == dead:
                        continue
                    if weight == 0.0:
                        smoothing = (u_max - u_min) / 2 * (math.sqrt(t * t + s * s) - s - abs(t))
                        psi = best_input(t, 0.0, u_min, u_max) * t
                        module_value -= psi + smoothing
                        excess -= smoothing
                    else:
                        smoothed_weight = max(weight, MIN_WEIGHT)
                        u = best_input(t, smoothed_weight, u_min, u_max)
                        module_value -= u * (t - smoothed_weight * u)
            workspace.module_value[root, v], workspace.smoothing_excess[root, v] = module_value, excess
    C, minimum, exact_minimum, share_sum, mean = len(workspace.frame_of_module), math.inf, math.inf, 0.0, 0.0
    for vertex in range(len(workspace.D)):
        D, excess = constant, 0.0
        for i in range(n):
            D += workspace.module_value[vertex // C, workspace.frame_of_module[vertex % C, i]]
            excess += workspace.smoothing_excess[vertex // C, workspace.frame_of_module[vertex % C, i]]
        workspace.D[vertex] = D
        minimum = min(minimum, D)
        exact_minimum = min(exact_minimum, D - excess)
    for vertex in range(len(workspace.D)):
        share = math.exp((minimum - workspace.D[vertex]) / T)
        workspace.share[vertex] = share
        share_sum += share
        mean += share * workspace.D[vertex]
    return minimum - T * math.log(share_sum) + barrier, exact_minimum, mean / share_sum
