r"""Air of one module, compiled: its speed at a point, with derivatives; the fastest air of all over a region.

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
from topo_search.model.arrays import ROTOR_DIRECTIONS, Array
from topo_search.model.compiled_code import njit


class JetRounding(NamedTuple):
    """Where the three parts of the air of a module give way to each other."""

    merged_at: float = 2.5
    """Depth at which the jets of a module have merged [2 l_arm]."""
    idle: float = 1e-6
    """Input added to all before they are derived, for the root of an input has no slope at 0 [u_hover]."""
    difference: float = 1e-5
    """Step of differences [l_arm, m/s]."""


JETS = JetRounding()


class Climb(NamedTuple):
    """Searches for the fastest air over a region."""

    step: float = 0.5
    """First step, which is halved again and again [l_arm]."""
    least_step: float = 1e-4
    """Step below which they end [l_arm]."""
    moves: int = 8
    """Largest number of steps of a size."""
    gain: float = 1e-7
    """Least relative gain of a step."""
    coarse: float = 0.1
    """Step up to which also slow searches go on [l_arm]."""
    slow_at_first: float = 0.2
    """Share of the fastest air's speed below which a search does not go on with such steps."""
    slow: float = 0.9
    """The same with smaller ones."""
    same: float = 0.1
    """Distance between two searches that are one [steps]."""
    turns: float = 30.0
    """Largest slope of the point nearest to a place inside a cone, which turns about the axis next to it."""
    pulls: int = 30
    """Number of projections, in turns, that bring a point into a region and a ball."""


CLIMB = Climb()
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
    """Return U, and find its gradient by q and v, shape (7,), or empty where only U counts."""
    C, dC = np.empty(9), np.empty((9 if len(slopes) else 0, 3))
    find_parts(jet, q, epsilon, C, dC)
    return join_parts(C, dC, v, epsilon, slopes)


@njit(cache=True)
def merged_jets(jet: Jet, q: Array, S: float) -> tuple[float, float, float]:
    """Return the speed of merged jets over U_H, the curve of their profile, and that; S is s' + s_0."""
    curve = (math.sqrt(2) - 1) / (2 * jet.half_width * S) ** 2
    profile = 1 + curve * (q[0] * q[0] + q[1] * q[1])
    return jet.decay / S / profile**2, curve, profile


@njit(cache=True)
def find_parts(jet: Jet, q: Array, epsilon: float, C: Array, dC: Array) -> None:
    """Find merged jets over U_H; slipstreams and flow towards the discs, four each, over their v.

    Args:
        jet: of the module.
        q: shape (3,).
        epsilon: see the module.
        C: shape (9,).
        dC: its derivatives by q, shape (9, 3), or empty where they do not count.
    """
    R, z, s = jet.radius, -q[2], -q[2] / 2
    begins, begins_t = clip(s / JETS.merged_at, epsilon)
    S, deeper = larger(s, JETS.merged_at, epsilon)
    S += jet.origin
    merged, curve, profile = merged_jets(jet, q, S)
    C[0] = begins * merged
    if len(dC):
        dC[0, 0], dC[0, 1] = -4 * C[0] * curve / profile * q[0], -4 * C[0] * curve / profile * q[1]
        by_s = begins_t / JETS.merged_at * merged + C[0] * deeper / S * (4 * (profile - 1) / profile - 1)
        dC[0, 2] = -by_s / 2

    below = 2 * JETS.merged_at * begins
    root = math.sqrt(R * R + below * below)
    g, g_z = 1 + below / root, R * R / root**3 * begins_t
    unmerged, unmerged_s = clip((JETS.merged_at - s) / 1.5, epsilon)
    starts, starts_z = clip(1 + z / epsilon, epsilon)
    fade, fade_z = unmerged * starts, unmerged * starts_z / epsilon - unmerged_s / 3 * starts
    width, edge = 0.2 * (below + R), R / math.sqrt(g)
    for k in range(4):
        x, y = q[0] - DISCS[k, 0], q[1] - DISCS[k, 1]
        r = math.sqrt(x * x + y * y + 1e-12)
        t = 0.5 + (edge - r) / width
        inside, by_t = clip(t, epsilon)
        C[1 + k] = g * fade * inside
        beyond, beyond_r = larger(r - R, 0.0, epsilon)
        d = math.sqrt(beyond * beyond + z * z + 1e-12)
        C[5 + k] = 1 / (1 + math.sqrt(2) * d / R) ** 2
        if len(dC):
            t_z = -edge * g_z / (2 * g * width) - (t - 0.5) * begins_t / (below + R)
            by_r = -g * fade * by_t / width
            dC[1 + k, 0], dC[1 + k, 1] = by_r * x / r, by_r * y / r
            dC[1 + k, 2] = -(g_z * fade * inside + g * fade_z * inside + g * fade * by_t * t_z)
            by_d = -2 * math.sqrt(2) / R * C[5 + k] / (1 + math.sqrt(2) * d / R)
            by_r = by_d * beyond * beyond_r / d
            dC[5 + k, 0], dC[5 + k, 1], dC[5 + k, 2] = by_r * x / r, by_r * y / r, -by_d * z / d


@njit(cache=True)
def join_parts(C: Array, dC: Array, v: Array, epsilon: float, slopes: Array) -> float:
    """Return U, and find its gradient unless it is SHARP.

    Args:
        C: as of `find_parts`.
        dC: the same.
        v: shape (4,).
        epsilon: see the module.
        slopes: the gradient by q and v, shape (7,), or empty where only U counts.
    """
    squares = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3]
    mean = math.sqrt(squares / 4)
    merged, inflow = C[0] * mean, C[5] * v[0] + C[6] * v[1] + C[7] * v[2] + C[8] * v[3]
    U: float = max(merged, inflow, C[1] * v[0], C[2] * v[1], C[3] * v[2], C[4] * v[3])
    if epsilon == SHARP:
        return U
    total = (merged / U) ** 8 + (inflow / U) ** 8
    for k in range(4):
        total += (C[1 + k] * v[k] / U) ** 8
    U *= math.sqrt(math.sqrt(math.sqrt(total)))
    if len(slopes) == 0:
        return U
    by_merged, by_inflow = (merged / U) ** 7, (inflow / U) ** 7
    for axis in range(3):
        slopes[axis] = by_merged * mean * dC[0, axis]
    for k in range(4):
        by_slipstream = (C[1 + k] * v[k] / U) ** 7
        for axis in range(3):
            slopes[axis] += v[k] * (by_slipstream * dC[1 + k, axis] + by_inflow * dC[5 + k, axis])
        slopes[3 + k] = by_merged * merged * v[k] / squares + by_slipstream * C[1 + k] + by_inflow * C[5 + k]
    return U


@njit(cache=True)
def by_inputs(jet: Jet, u: Array, v: Array) -> None:
    """Find v of a module's inputs."""
    for k in range(4):
        v[k] = jet.induced * math.sqrt(u[k] + JETS.idle)


class Region(NamedTuple):
    """A region of the air, from p'_E [l_arm]; one of its sizes is not zero."""

    start: Array
    """Start of a path, a point inside a hull, or the apex of a cone, shape (3,)."""
    axis: Array
    """From there to the path's end, or the cone's axis, shape (3,)."""
    radius: float
    """Radius about a path."""
    half_angle: float
    """That of a cone whose outside it is [rad]."""
    planes: Array
    """Normals of a hull's faces over their distances from the point inside, shape (f, 3)."""
    within: float
    """Largest distance of its points from p'_E."""


@njit(cache=True)
def pull_inside(region: Region, x: Array, slopes: Array) -> bool:
    """Move x to a point of the region that is near, its derivatives with it, and return whether there is one."""
    to_shape(region, x, slopes)
    for _ in range(CLIMB.pulls):
        if math.sqrt(_dot(x, x)) <= region.within * (1 + 1e-6):
            return True
        to_ball(region.within, x, slopes)
        to_shape(region, x, slopes)
    return math.sqrt(_dot(x, x)) <= region.within * (1 + 1e-6)


@njit(cache=True)
def _dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True)
def to_ball(radius: float, x: Array, slopes: Array) -> None:
    """Move x into a ball about p'_E, and its derivatives with it; see `to_shape`."""
    length = math.sqrt(_dot(x, x))
    if length <= radius:
        return
    for a in range(3):
        x[a] *= radius / length
    if len(slopes):
        slopes *= radius / length
        _project(x / radius, slopes)


@njit(cache=True)
def to_shape(region: Region, x: Array, slopes: Array) -> None:
    """Move x to a point of the region that is near, however far that is from p'_E, and its derivatives with it.

    Of a path, a cone and a box it is the nearest.

    Args:
        region: the region.
        x: shape (3,).
        slopes: derivatives of x beside cones and hulls, a column each, shape (3, k), or empty where only x counts.
    """
    o0, o1, o2 = region.start
    a0, a1, a2 = region.axis
    d0, d1, d2 = x[0] - o0, x[1] - o1, x[2] - o2
    planes = region.planes
    if len(planes):
        beyond = 1.0
        for pull in range(CLIMB.pulls):
            face, beyond = 0, 1.0
            for f in range(len(planes)):
                height = planes[f, 0] * d0 + planes[f, 1] * d1 + planes[f, 2] * d2
                if height > beyond:
                    face, beyond = f, height
            if beyond <= 1.0 + 1e-12 or pull == CLIMB.pulls - 1:
                break
            square = _dot(planes[face], planes[face])
            step = (beyond - 1.0) / square
            d0, d1, d2 = d0 - step * planes[face, 0], d1 - step * planes[face, 1], d2 - step * planes[face, 2]
            _project(planes[face] / math.sqrt(square), slopes)
        x[0], x[1], x[2] = o0 + d0 / beyond, o1 + d1 / beyond, o2 + d2 / beyond
        return
    along = d0 * a0 + d1 * a1 + d2 * a2
    if region.half_angle == 0.0:
        along = min(max(along / max(a0 * a0 + a1 * a1 + a2 * a2, 1e-300), 0.0), 1.0)
        d0, d1, d2 = d0 - along * a0, d1 - along * a1, d2 - along * a2
        back = min(1.0, region.radius / max(math.sqrt(d0 * d0 + d1 * d1 + d2 * d2), 1e-300)) - 1.0
        x[0], x[1], x[2] = x[0] + back * d0, x[1] + back * d1, x[2] + back * d2
        return
    d0, d1, d2 = d0 - along * a0, d1 - along * a1, d2 - along * a2
    r, sine, cosine = (
        math.sqrt(d0 * d0 + d1 * d1 + d2 * d2),
        math.sin(region.half_angle),
        math.cos(region.half_angle),
    )
    depth = along * sine - r * cosine
    if depth <= 0.0:
        return
    if r < 1e-9:  # on the axis, any way out is as short
        if abs(a0) < 0.6:
            d0, d1, d2 = 0.0, -a2, a1
        else:
            d0, d1, d2 = a2, 0.0, -a0
        r = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    d0, d1, d2 = d0 / r, d1 / r, d2 / r
    out = (sine * a0 - cosine * d0, sine * a1 - cosine * d1, sine * a2 - cosine * d2)
    for a in range(3):
        x[a] -= depth * out[a]
    if len(slopes):
        around = (a1 * d2 - a2 * d1, a2 * d0 - a0 * d2, a0 * d1 - a1 * d0)
        turns = min(depth * cosine / r, CLIMB.turns)
        for column in range(slopes.shape[1]):
            turned = 0.0
            for a in range(3):
                turned += turns * around[a] * slopes[a, column]
            for a in range(3):
                slopes[a, column] += turned * around[a]
        _project(np.array(out), slopes)


@njit(cache=True)
def _project(normal: Array, slopes: Array) -> None:
    """Take the part along a unit vector out of derivatives, shape (3, k) or empty."""
    for column in range(slopes.shape[1] if len(slopes) else 0):
        along = _dot(normal, slopes[:, column])
        for a in range(3):
            slopes[a, column] -= along * normal[a]


@njit(cache=True)
def total_speed(jet: Jet, R: Array, p: Array, v: Array, x: Array) -> float:
    """Return the sum of all modules' speeds at a point.

    Args:
        jet: of the modules.
        R: their orientations, shape (n, 3, 3).
        p: their places, shape (n, 3) [l_arm].
        v: shape (n, 4).
        x: the point, shape (3,) [l_arm].
    """
    q, C, no_dC, no_slopes, total = np.empty(3), np.empty(9), np.empty((0, 3)), np.empty(0), 0.0
    for i in range(len(p)):
        for k in range(3):
            q[k] = R[i, 0, k] * (x[0] - p[i, 0]) + R[i, 1, k] * (x[1] - p[i, 1]) + R[i, 2, k] * (x[2] - p[i, 2])
        find_parts(jet, q, SHARP, C, no_dC)
        total += join_parts(C, no_dC, v[i], SHARP, no_slopes)
    return total


@njit(cache=True)
def climb(jet: Jet, R: Array, p: Array, v: Array, region: Region, depths: Array, around: Array) -> Array:
    """Return where searches for faster air among neighbours stop, one for each module, shape (n, 4).

    A search begins below its module or one of its discs. One that meets another goes on as that.

    Args:
        jet: as of `total_speed`.
        R: the same.
        p: the same.
        v: the same.
        region: where to search.
        depths: where a search may begin, shape (d,) [l_arm].
        around: the neighbours, shape (k, 3).

    Returns:
        Points and speeds; -1 where a search could not begin in the region.
    """
    n = len(p)
    tops, x, best, no_slopes = np.full((n, 4), -1.0), np.empty(3), np.empty(3), np.empty((0, 3))
    for i in range(n):
        for disc in range(5):
            alone = 0.0
            for depth in depths:
                for a in range(3):
                    x[a] = p[i, a] - depth * R[i, a, 2]
                    if disc < 4:
                        x[a] += DISCS[disc, 0] * R[i, a, 0] + DISCS[disc, 1] * R[i, a, 1]
                if pull_inside(region, x, no_slopes):
                    blown = total_speed(jet, R[i : i + 1], p[i : i + 1], v[i : i + 1], x)
                    if blown > alone:
                        alone, best[:] = blown, x
            if alone > 0.0:
                total = total_speed(jet, R, p, v, best)
                if total > tops[i, 3]:
                    tops[i, :3], tops[i, 3] = best, total
    goes_as, last, step = np.arange(n), np.zeros(n, np.int64), CLIMB.step
    while step > CLIMB.least_step:
        slow = tops[:, 3].max() * (CLIMB.slow if step < CLIMB.coarse else CLIMB.slow_at_first)
        for i in range(n):
            for _ in range(CLIMB.moves if goes_as[i] == i and tops[i, 3] >= slow else 0):
                moved = False
                for tried in range(len(around)):
                    k = (last[i] + tried) % len(around)
                    for a in range(3):
                        x[a] = tops[i, a]
                        for b in range(3):
                            x[a] += step * R[i, a, b] * around[k, b]
                    if not pull_inside(region, x, no_slopes):
                        continue
                    total = total_speed(jet, R, p, v, x)
                    if total > tops[i, 3] * (1 + CLIMB.gain):
                        tops[i, :3], tops[i, 3], last[i], moved = x, total, k, True
                        break
                if not moved:
                    break
        for i in range(n):
            for j in range(i):
                apart = np.abs(tops[i, :3] - tops[j, :3]).max()
                if goes_as[i] == i and goes_as[j] == j and apart < CLIMB.same * step:
                    goes_as[i] = j
        step /= 2
    for i in range(n):
        tops[i] = tops[goes_as[i]]
    return tops


@njit(cache=True)
def point_of_ball(
    from_tip: Array, radius: float, direction: Array, p: Array, z: Array, x: Array, slopes: Array
) -> None:
    """Find a point x of a ball that moves with a module, and its derivatives by p and z, shape (3, 6).

    With w from the ball's centre to the module's axis, the direction is in the frame w / |w|, z x w / |w|, z.
    Without one, x is towards the point of the axis that is nearest to the module within a radius of w's end.

    Args:
        from_tip: centre of the ball from p'_E.
        radius: of the ball; 0: the point is its centre.
        direction: shape (3,); zeros: none.
        p: place of the module from p'_E.
        z: its axis.
        x: from p'_E, shape (3,).
        slopes: see above.
    """
    x[:] = from_tip
    slopes[:] = 0.0
    if radius == 0.0:
        return
    along, w, to, dw, dto, dz = 0.0, np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    for a in range(3):
        along += z[a] * (from_tip[a] - p[a])
    for a in range(3):
        w[a] = p[a] + along * z[a] - from_tip[a]
    length = math.sqrt(_dot(w, w) + 1e-12)
    by_w, up, by_along = direction[0], 0.0, 0.0
    if not direction.any():
        reach, by_reach = larger(abs(along), radius, ROUNDED)
        by_w, up = 1.0, -along * radius / reach
        by_along = -radius / reach * (1 - abs(along) * by_reach / reach)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        to[a] = by_w * w[a] + direction[1] * (z[b] * w[c] - z[c] * w[b]) + (direction[2] * length + up) * z[a]
    size = math.sqrt(_dot(to, to) + 1e-12)
    reach, by_size = larger(size, radius, ROUNDED)
    share = radius / reach
    for a in range(3):
        x[a] += share * to[a]
    for column in range(6):
        k = column % 3
        dz[k] = 0.0 if column < 3 else 1.0
        d_along = from_tip[k] - p[k] if column > 2 else -z[k]
        for a in range(3):
            dw[a] = along * dz[a] + z[a] * d_along
            if column == a:
                dw[a] += 1.0
        d_up = direction[2] * _dot(w, dw) / length + by_along * d_along
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            turned = dz[b] * w[c] - dz[c] * w[b] + z[b] * dw[c] - z[c] * dw[b]
            dto[a] = by_w * dw[a] + direction[1] * turned + d_up * z[a] + (direction[2] * length + up) * dz[a]
        d_size = _dot(to, dto) / size
        for a in range(3):
            slopes[a, column] = share * dto[a] - share / reach * by_size * d_size * to[a]
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
