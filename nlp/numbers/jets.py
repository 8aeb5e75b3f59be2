r"""Air of one module, compiled: its speed at a point, with derivatives.

| symbol | meaning | shape | unit |
|---|---|---|---|
| q | the point from the module, in its frame | (3,) | l_arm |
| v | speed that each disc induces, sqrt(k_f u_q / (2 rho pi R^2)) | (4,) | m/s |
| U | speed of the air | | m/s |
| epsilon | width over which bends are rounded | | - |

The formulas are those of `nlp.airspeed`. Where they have bends, min and max are rounded there:

.. math::

    \max(a, b) = \tfrac12 \big(a + b + \sqrt{(a - b)^2 + \epsilon^2}\big), \qquad
    \min(1, \max(0, t)) = c(t) / c(1), \quad c(t) = \sqrt{t^2 + \epsilon^2} - \sqrt{(t - 1)^2 + \epsilon^2} + 1

Rounded, the largest of a module's parts is their 8-norm, which is no less. Gradients are exact; second derivatives
are their central differences, which are more accurate than a step of Newton's method needs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from topo_search.model import Module
from topo_search.model.arrays import Array
from topo_search.model.compiled_code import njit
from topo_search.model.layout import ROTOR_DIRECTIONS


class JetRounding(NamedTuple):
    """Where the three parts of the air of a module give way to each other."""

    merged_at: float = 2.5
    """Depth at which the jets of a module have merged [2 l_arm]."""
    idle: float = 1e-6
    """Input added to all before they are derived, for the root of an input has no slope at 0 [u_hover]."""
    difference: float = 1e-5
    """Step of differences [l_arm, m/s]."""


JETS = JetRounding()


SHARP, ROUNDED = 1e-12, 0.02
"""epsilon of speeds that count, and of those that are derived."""
DISCS = np.ascontiguousarray(ROTOR_DIRECTIONS[:, :2])
"""Places of the discs in the module's plane, shape (4, 2) [l_arm]."""


class Jet(NamedTuple):
    """Air of a kind of module."""

    decay: float
    """D."""
    origin: float
    """s_0."""
    half_width: float
    """b."""
    radius: float
    """R [l_arm]."""
    induced: float
    """Speed that a disc induces at u_hover [m/s]."""


def jet_of(module: Module, density: float, gravity: float) -> Jet:
    """Return a module's jet in air of a density [kg/m^3]."""
    jet, disc = module.airflow.jet, math.pi * module.body.rotor_radius**2
    induced = math.sqrt(module.thrust_coefficient * module.hover_input(gravity) / (2 * density * disc))
    return Jet(jet.decay, jet.origin, jet.half_width, module.body.rotor_radius / module.arm_length, induced)


@njit(cache=True)
def larger(a: float, b: float, epsilon: float) -> tuple[float, float]:
    """Return the rounded larger of two numbers, and its slope by the first."""
    root = math.sqrt((a - b) ** 2 + epsilon**2)
    return (a + b + root) / 2, (1 + (a - b) / root) / 2


@njit(cache=True)
def clip(t: float, epsilon: float) -> tuple[float, float]:
    """Return a number within [0, 1], rounded, and its slope."""
    low, high = math.sqrt(t * t + epsilon**2), math.sqrt((t - 1) ** 2 + epsilon**2)
    scale = math.sqrt(1 + epsilon**2) - epsilon + 1
    return (low - high + 1) / scale, (t / low - (t - 1) / high) / scale


@njit(cache=True)
def speed(jet: Jet, q: Array, v: Array, epsilon: float, slopes: Array) -> float:
    """Return U, and find its gradient by q and v, shape (7,); at SHARP it is that of the largest part alone."""
    R, z, s = jet.radius, -q[2], -q[2] / 2
    parts, by_part = np.empty(6), np.zeros((6, 7))  # merged jets, four slipstreams, flow towards the discs

    begins, by_s = clip(s / JETS.merged_at, epsilon)
    S, deeper = larger(s, JETS.merged_at, epsilon)
    S += jet.origin
    squares = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3]
    curve = (math.sqrt(2) - 1) / (2 * jet.half_width * S) ** 2
    profile = 1 + curve * (q[0] * q[0] + q[1] * q[1])
    merged = jet.decay * math.sqrt(squares / 4) / S / profile**2
    parts[0] = begins * merged
    by_s = by_s / JETS.merged_at * merged + parts[0] * deeper / S * (4 * (profile - 1) / profile - 1)
    for axis in range(2):
        by_part[0, axis] = -4 * parts[0] * curve / profile * q[axis]
    by_part[0, 2] = -by_s / 2
    for k in range(4):
        by_part[0, 3 + k] = parts[0] * v[k] / max(squares, 1e-300)

    share, by_z = clip(s / JETS.merged_at, epsilon)
    below, below_z = 2 * JETS.merged_at * share, by_z
    root = math.sqrt(R * R + below * below)
    g, g_z = 1 + below / root, R * R / root**3 * below_z
    ends, ends_s = clip((JETS.merged_at - s) / 1.5, epsilon)
    starts, starts_z = clip(1 + z / epsilon, epsilon)
    fade, fade_z = ends * starts, ends * starts_z / epsilon - ends_s / 3 * starts
    width, edge = 0.2 * (below + R), R / math.sqrt(g)
    parts[5] = 0.0
    for k in range(4):
        x, y = q[0] - DISCS[k, 0], q[1] - DISCS[k, 1]
        r = math.sqrt(x * x + y * y + 1e-12)
        t = 0.5 + (edge - r) / width
        inside, by_t = clip(t, epsilon)
        t_z = -edge * g_z / (2 * g * width) - (t - 0.5) * below_z / (below + R)
        parts[1 + k] = v[k] * g * fade * inside
        by_r = -v[k] * g * fade * by_t / width
        by_part[1 + k, 0], by_part[1 + k, 1] = by_r * x / r, by_r * y / r
        by_part[1 + k, 2] = -v[k] * (g_z * fade * inside + g * fade_z * inside + g * fade * by_t * t_z)
        by_part[1 + k, 3 + k] = g * fade * inside
        beyond, beyond_r = larger(r - R, 0.0, epsilon)
        d = math.sqrt(beyond * beyond + z * z + 1e-12)
        share = 1 / (1 + math.sqrt(2) * d / R) ** 2
        parts[5] += v[k] * share
        by_d = -2 * math.sqrt(2) / R * v[k] * share / (1 + math.sqrt(2) * d / R)
        by_r = by_d * beyond * beyond_r / d
        by_part[5, 0] += by_r * x / r
        by_part[5, 1] += by_r * y / r
        by_part[5, 2] -= by_d * z / d
        by_part[5, 3 + k] = share

    largest = int(np.argmax(parts))
    U: float = parts[largest]
    if epsilon == SHARP or U <= 0.0:
        slopes[:] = by_part[largest]
        return U
    total = 0.0
    for part in parts:
        total += (part / U) ** 8
    U *= math.sqrt(math.sqrt(math.sqrt(total)))
    slopes[:] = 0.0
    for k in range(6):
        weight = (parts[k] / U) ** 7
        for axis in range(7):
            slopes[axis] += weight * by_part[k, axis]
    return U


@njit(cache=True)
def by_inputs(jet: Jet, u: Array, v: Array) -> None:
    """Find v of a module's inputs."""
    for k in range(4):
        v[k] = jet.induced * math.sqrt(u[k] + JETS.idle)


@njit(cache=True)
def total_speeds(jet: Jet, R: Array, p: Array, v: Array, x: Array) -> Array:
    """Return the sum of all modules' speeds at points, shape (m,).

    Args:
        jet: of the modules.
        R: their orientations, shape (n, 3, 3).
        p: their places, shape (n, 3) [l_arm].
        v: shape (n, 4).
        x: the points, shape (m, 3) [l_arm].
    """
    total, q, slopes = np.zeros(len(x)), np.empty(3), np.empty(7)
    for m in range(len(x)):
        for i in range(len(p)):
            a, b, c = x[m, 0] - p[i, 0], x[m, 1] - p[i, 1], x[m, 2] - p[i, 2]
            for k in range(3):
                q[k] = R[i, 0, k] * a + R[i, 1, k] * b + R[i, 2, k] * c
            total[m] += speed(jet, q, v[i], SHARP, slopes)
    return total


@njit(cache=True)
def point_of_ball(
    from_tip: Array, radius: float, direction: Array, p: Array, z: Array, x: Array, slopes: Array
) -> None:
    """Find a point x of a ball that moves with a module, and its derivatives by p and z, shape (3, 6).

    With w from the ball's centre to the module's axis, the direction is in the frame w / |w|, z x w / |w|, z.

    Args:
        from_tip: centre of the ball from p'_E.
        radius: of the ball; 0: the point is its centre.
        direction: shape (3,); (1, 0, 0): x is the point that is nearest to the axis.
        p: place of the module from p'_E.
        z: its axis.
        x: from p'_E, shape (3,).
        slopes: see above.
    """
    x[:] = from_tip
    slopes[:] = 0.0
    if radius == 0.0:
        return
    along, squares, w, to, dw, dz = 0.0, 0.0, np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    for a in range(3):
        along += z[a] * (from_tip[a] - p[a])
    for a in range(3):
        w[a] = p[a] + along * z[a] - from_tip[a]
        squares += w[a] * w[a]
    length = math.sqrt(squares + 1e-12)
    reach, by_length = larger(length, radius, ROUNDED)
    share = radius / reach
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        to[a] = direction[0] * w[a] + direction[1] * (z[b] * w[c] - z[c] * w[b]) + direction[2] * length * z[a]
        x[a] += share * to[a]
    for column in range(6):
        k, change = column % 3, 0.0
        dz[k] = 0.0 if column < 3 else 1.0
        for a in range(3):
            dw[a] = along * dz[a] + z[a] * ((from_tip[k] - p[k]) if column > 2 else -z[k])
            if column == a:
                dw[a] += 1.0
            change += w[a] * dw[a] / length
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            turned = dz[b] * w[c] - dz[c] * w[b] + z[b] * dw[c] - z[c] * dw[b]
            moved = direction[0] * dw[a] + direction[1] * turned + direction[2] * (change * z[a] + length * dz[a])
            slopes[a, column] = share * moved - share / reach * by_length * change * to[a]
        dz[k] = 0.0


@njit(cache=True)
def curvature(jet: Jet, q: Array, v: Array, hessian: Array) -> None:
    """Find the Hessian of a rounded speed by q and v, shape (7, 7)."""
    above, below = np.empty(7), np.empty(7)
    for k in range(7):
        at, index = (q, k) if k < 3 else (v, k - 3)
        middle = at[index]
        at[index] = middle + JETS.difference
        speed(jet, q, v, ROUNDED, above)
        at[index] = middle - JETS.difference
        speed(jet, q, v, ROUNDED, below)
        at[index] = middle
        for other in range(7):
            hessian[k, other] = (above[other] - below[other]) / (2 * JETS.difference)
