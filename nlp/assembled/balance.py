r"""The wrench balances (2) and (3) of `nlp.problem` with their derivatives along the kinematic chain, compiled.

| symbol | meaning | shape |
|---|---|---|
| A | wrench of every rotor at unit input about W's origin, over n | (n, 4, 6) |
| u | inputs of every load case | (K, n, 4) |
| f_E, f_C, tau | required forces at the end-effector and the COM, the sum of both torques, over n | (K, 3) each |
| mu | multipliers of the balances | (K, 6) |
| omega, v | axes of the angles, and the velocities that they give W's origin (`chain`) | (n+2, 3) |
| g | number of geometric unknowns (`local_vectors`) | |

A force with its torque, a = (f, m), that a module carries is moved by every angle inward of it:

.. math::

    \partial_j a = X_j a = (\omega_j \times f,\; v_j \times f + \omega_j \times m), \quad
    \mu \cdot X_j a = (X_j^T \mu) \cdot a
"""

from __future__ import annotations

import numpy as np

from nlp.assembled.local_vectors import Indices, add_cross, dot
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit


@njit(cache=True)
def rotors(R: Array, p: Array, torque_map: Array) -> Array:
    """Return A; `torque_map`: from a module's inputs to its torque in its own frame, shape (3, 4)."""
    n = len(p)
    A = np.zeros((n, 4, 6))
    for i in range(n):
        z = R[i, :, 2]
        for q in range(4):
            A[i, q, :3] = z / (4 * n)
            add_cross(p[i], A[i, q, :3], 1.0, A[i, q, 3:])
            for row in range(3):
                for column in range(3):
                    A[i, q, 3 + row] += R[i, row, column] * torque_map[column, q] / n
    return A


@njit(cache=True)
def balances(A: Array, u: Array, p_E: Array, p_COM: Array, f_E: Array, f_C: Array, tau: Array) -> Array:
    """Return what the rotors produce less what the load cases ask for, shape (K, 6)."""
    residuals = np.zeros((len(u), 6))
    for k in range(len(u)):
        residual = residuals[k]
        for i in range(len(A)):
            for q in range(4):
                for axis in range(6):
                    residual[axis] += u[k, i, q] * A[i, q, axis]
        residual[:3] -= f_E[k] + f_C[k]
        residual[3:] -= tau[k]
        add_cross(p_E, f_E[k], -1.0, residual[3:])
        add_cross(p_COM, f_C[k], -1.0, residual[3:])
    return residuals


@njit(cache=True)
def slopes(
    A: Array,
    u: Array,
    omega: Array,
    v: Array,
    parents: Indices,
    f_E: Array,
    f_C: Array,
    dp_E: Array,
    dp_COM: Array,
) -> Array:
    """Return the derivatives of the balances by the geometric unknowns, shape (K, 6, g).

    Args:
        A: see the notation.
        u: see the notation.
        omega: see the notation.
        v: see the notation.
        parents: of the modules.
        f_E: see the notation.
        f_C: see the notation.
        dp_E: derivatives of p'_E by the geometric unknowns, shape (g, 3).
        dp_COM: those of p_COM, shape (g, 3).
    """
    n, K, g = len(A), len(u), len(dp_E)
    outward = np.zeros((n, K, 6))  # wrenches of all modules that a module carries, and of itself
    for i in range(n):
        for k in range(K):
            for q in range(4):
                for axis in range(6):
                    outward[i, k, axis] += u[k, i, q] * A[i, q, axis]
    for i in range(n - 1, 0, -1):
        outward[parents[i]] += outward[i]
    result = np.zeros((K, 6, g))
    slope = np.empty(6)
    for j in range(g):
        for k in range(K):
            slope[:] = 0.0
            if j < n + 2:
                a = outward[max(0, j - 2), k]
                add_cross(omega[j], a[:3], 1.0, slope[:3])
                add_cross(v[j], a[:3], 1.0, slope[3:])
                add_cross(omega[j], a[3:], 1.0, slope[3:])
            add_cross(f_E[k], dp_E[j], 1.0, slope[3:])
            add_cross(f_C[k], dp_COM[j], 1.0, slope[3:])
            result[k, :, j] = slope
    return result


@njit(cache=True)
def by_point(mu: Array, f: Array) -> Array:
    """Return the gradient of mu . balances by the point where the asked forces f, shape (K, 3), act."""
    gradient = np.zeros(3)
    for k in range(len(mu)):
        add_cross(mu[k, 3:], f[k], 1.0, gradient)
    return gradient


@njit(cache=True)
def add_bends(
    A: Array,
    u: Array,
    mu: Array,
    omega: Array,
    v: Array,
    parents: Indices,
    p: Array,
    axes: Array,
    g_p: Array,
    g_axes: Array,
    H: Array,
) -> None:
    """Add the second derivatives by the angles of mu . balances and of what p and axes move to H, upper triangle.

    With j inward of k or the same, the second derivative of what a module carries is that of the inner angle of
    the derivative by the outer one, and linear in the sums of x y^T over the module's vectors x, where y is the
    gradient by x.

    Args:
        A: see the notation.
        u: see the notation.
        mu: see the notation.
        omega: see the notation.
        v: see the notation.
        parents: of the modules.
        p: positions of the modules, shape (n, 3).
        axes: their axes, all z, then all x, then all y, shape (3n, 3).
        g_p: gradient by the positions, shape (n, 3).
        g_axes: gradient by the axes, shape (3n, 3).
        H: is added to, shape (g, g).
    """
    n, K = len(A), len(u)
    T, N, g = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), g_p.copy()
    by_a = np.empty(6)
    for i in range(n):
        for q in range(4):
            by_a[:] = 0.0  # gradient by a rotor's wrench
            for k in range(K):
                for axis in range(6):
                    by_a[axis] += u[k, i, q] * mu[k, axis]
            for a in range(3):
                for b in range(3):
                    T[i, a, b] += A[i, q, a] * by_a[b] + A[i, q, 3 + a] * by_a[3 + b]
                    N[i, a, b] += A[i, q, a] * by_a[3 + b]
        for a in range(3):
            for b in range(3):
                T[i, a, b] += p[i, a] * g_p[i, b]
                for k in (i, n + i, 2 * n + i):
                    T[i, a, b] += axes[k, a] * g_axes[k, b]
    for i in range(n - 1, 0, -1):
        T[parents[i]] += T[i]
        N[parents[i]] += N[i]
        g[parents[i]] += g[i]
    by_omega, by_v, moved, turned = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for k in range(n + 2):
        i = max(0, k - 2)
        moved[:] = 0.0
        turned[:] = 0.0
        for column in range(3):
            add_cross(omega[k], N[i, :, column], 1.0, turned[:, column])
            add_cross(omega[k], T[i, :, column], 1.0, moved[:, column])
            add_cross(v[k], N[i, :, column], 1.0, moved[:, column])
            for row in range(3):
                moved[row, column] += v[k, row] * g[i, column]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            by_omega[a] = moved[b, c] - moved[c, b]
            by_v[a] = turned[b, c] - turned[c, b]
        while i > 0:
            H[i + 2, k] += dot(omega[i + 2], by_omega) + dot(v[i + 2], by_v)
            i = parents[i]
        for j in range(min(k + 1, 3)):
            H[j, k] += dot(omega[j], by_omega) + dot(v[j], by_v)


@njit(cache=True)
def by_inputs(
    A: Array, mu: Array, omega: Array, v: Array, starts: Indices, angles: Indices, diagonal: Array
) -> Array:
    """Return the Hessian's columns of the inputs, upper triangle: first by the angles, then on the diagonal.

    Args:
        A: see the notation.
        mu: see the notation.
        omega: see the notation.
        v: see the notation.
        starts: of each module's angles in `angles`, shape (n+1,).
        angles: that move a module, in ascending order.
        diagonal: entry of all inputs of a load case, shape (K,).
    """
    n, K = len(A), len(mu)
    entries = np.empty(4 * K * (len(angles) + n))
    work = np.zeros((n + 2, 6))  # X_j^T mu_k
    e = 0
    for k in range(K):
        work[:] = 0.0
        for j in range(n + 2):
            add_cross(mu[k, :3], omega[j], 1.0, work[j, :3])
            add_cross(mu[k, 3:], v[j], 1.0, work[j, :3])
            add_cross(mu[k, 3:], omega[j], 1.0, work[j, 3:])
        for i in range(n):
            for q in range(4):
                a = A[i, q]
                for one in range(starts[i], starts[i + 1]):
                    w = work[angles[one]]
                    entries[e] = w[0] * a[0] + w[1] * a[1] + w[2] * a[2] + w[3] * a[3] + w[4] * a[4] + w[5] * a[5]
                    e += 1
                entries[e] = diagonal[k]
                e += 1
    return entries
