r"""Air speed of a module at a point, with derivatives, and the fastest air of all modules over a region; compiled.

| symbol | meaning | shape | unit |
|---|---|---|---|
| q | the point from the module, in its frame | (3,) | l_arm |
| u | inputs of the module | (r,) | u_hover |
| v_0 | induced speed of a disc of the module's radius with its k_f at u_hover | | m/s |
| C | w_q max(G_q, H_q) for each of r rotors; w_q = v_q^2 / (v_0^2 u_q), 1 if all are equal | (r,) | |
| U | speed of the air, v_0 sqrt(C . u) | | m/s |
| epsilon | width over which kinks are rounded | | - |
| v_q, R | speed that disc q induces, sqrt(k_f u_q / (2 rho pi R^2)), with its k_f and radius | | m/s, l_arm |
| L | distance of opposite rotors, twice `RotorTable.jet_radii` | | l_arm |
| s, r | depth below the module, distance from its axis | | L, l_arm |
| z, r_q, d_q | depth below disc q along its axis; distance from that axis; from the disc | | l_arm |
| c, M | share and speed of the merged jets (Bauersfeld et al., arXiv 2403.13321) | | |
| a_q | share of disc q in the area of all | | |
| S_q | speed of a disc's own slipstream (momentum theory with a shear layer) over v_q | | |
| delta, r_2 | half-width of its shear layer, its outer radius | | l_arm |
| H_q | flow towards the discs | | |
| D, s_0, b | `module.airflow.jet` | | |

The square of a module's air speed is linear in its inputs. Rotors with an envelope of their own
(`RotorTable.has_own_jets`) do not merge: each has its M along its own axis, a_q = 1 and L = 2 R.

.. math::

    U^2 &= \sum_q v_q^2 \max(G_q, H_q), \quad G_q = (1 - c) S_q^2 + c a_q M^2,
        \quad H_q = k_q \sum_p k_p, \quad k_q = (1 + \sqrt 2 d_q / R)^{-2} \\
    M &= \frac{D}{s' + s_0} \big(1 + (\sqrt 2 - 1) \tfrac{r^2}{r_h^2}\big)^{-2},
        \quad c = \tfrac{s - 1}{1.5} \in [0, 1], \quad s' = \max(s, 2.5), \quad r_h = L b (s' + s_0) \\
    S_q &= g\,\tfrac{r_2 - r_q}{2 \delta}, \quad \tfrac{r_2 - r_q}{2 \delta} \in [0, 1],
        \quad g = 1 + z / \sqrt{R^2 + z^2}, \quad \delta = 0.1 (z + R), \quad a = R^2 / g \\
    r_2 &= \tfrac43 \delta + \sqrt{a - \tfrac29 \delta^2} \text{ if } a \ge \tfrac23 \delta^2,
        \text{ else } (24 \delta^2 a)^{1/4}

The slipstream carries g / 2 of its rotor's thrust as momentum, the rest is pressure. S_q is zero above the disc.
The inflow is at least the sum of the sinks, and equal to it for equal rotors (Cauchy's inequality).

min and max are rounded:

.. math::

    \max(a, b) = \tfrac12 \big(a + b + \sqrt{(a - b)^2 + \epsilon^2}\big), \qquad
    \min(1, \max(0, t)) = c(t) / c(1), \quad c(t) = \sqrt{t^2 + \epsilon^2} - \sqrt{(t - 1)^2 + \epsilon^2} + 1

The larger of jet and inflow is rounded to their 4-norm, which is no smaller. Gradients are exact; in second
derivatives those of C are central differences, accurate enough for Newton's method.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit, refresh
from topo_search.model import Array, Module


class JetRounding(NamedTuple):
    """Constants of the jet model and its differences."""

    merged_at: float = 2.5
    """Depth at which the jets of a module have merged [L]."""
    merges_over: float = 1.5
    """Range of depth before that over which they merge [L]."""
    shear: float = 0.1
    """Growth of the shear layer's half-width per depth."""
    idle: float = 1e-6
    """Input added to all inputs, so that the speed of an idle module has a slope [u_hover]."""
    difference: float = 1e-5
    """Step of differences [l_arm]."""


JETS = JetRounding()


class Climb(NamedTuple):
    """Settings of the searches for the fastest air over a region."""

    step: float = 0.5
    """First step size, which is halved repeatedly [l_arm]."""
    min_step: float = 1e-4
    """Step size below which the searches end [l_arm]."""
    moves: int = 8
    """Largest number of steps of one size."""
    gain: float = 1e-7
    """Smallest relative gain of a step."""
    coarse: float = 0.1
    """Smallest step size that counts as coarse [l_arm]."""
    slow_coarse: float = 0.2
    """Share of the fastest air's speed below which a search pauses at coarse steps."""
    slow: float = 0.9
    """The same at smaller steps."""
    same: float = 0.1
    """Distance below which two searches are merged [steps]."""
    max_slope: float = 30.0
    """Largest slope of the projection out of a cone by rotation about its axis, which is singular on the axis."""
    projections: int = 30
    """Number of alternating projections onto a region and a ball."""


CLIMB = Climb()
SHARP, ROUNDED = 1e-12, 0.02
"""epsilon of exact speeds, and of speeds with derivatives."""


class JetConstants(NamedTuple):
    """Jet model of a module type."""

    decay: float
    """D."""
    origin: float
    """s_0."""
    half_width: float
    """b."""
    induced: float
    """v_0 [m/s]."""
    rotors: Array
    """Rows of the rotors, with the columns below, shape (r, 16): passing one array is faster than eight."""


DISC, AXIS, START, AGAINST = 0, 3, 6, 9
"""First columns of vectors: position of a disc, direction of its thrust; start of its merged jet, direction against
it [l_arm]."""
RADIUS, WEIGHT, SHARE, DIAMETER = 12, 13, 14, 15
"""Columns of R [l_arm], w_q, a_q, L [l_arm]."""


def jet_of(module: Module, density: float, gravity: float) -> JetConstants:
    """Return a module's jet in air of some density [kg/m^3]."""
    jet, disc, table = module.airflow.jet, math.pi * module.body.rotor_radius**2, module.rotor_table
    induced = math.sqrt(module.thrust_coefficient * module.hover_input(gravity) / (2 * density * disc))
    radii = module.rotor_radii / module.arm_length
    shares = np.ones(table.count) if table.has_own_jets else radii**2 / (radii**2).sum()
    numbers = radii, table.gains / table.sizes**2, shares, 2 * table.jet_radii(radii)
    rotors = np.column_stack([table.positions, table.axes, *table.jet_axes, *numbers])
    return JetConstants(jet.decay, jet.origin, jet.half_width, induced, rotors)


@njit(cache=True)
def larger(a: float, b: float, epsilon: float) -> tuple[float, float]:
    """Return the rounded maximum of two numbers, and its slope by the first."""
    root = math.sqrt((a - b) ** 2 + epsilon**2)
    return (a + b + root) / 2, (1 + (a - b) / root) / 2


@njit(cache=True)
def clip(t: float, epsilon: float) -> tuple[float, float]:
    """Return a number clipped to [0, 1], rounded, and its slope."""
    low, high = math.sqrt(t * t + epsilon**2), math.sqrt((t - 1) ** 2 + epsilon**2)
    scale = math.sqrt(1 + epsilon**2) - epsilon + 1
    return (low - high + 1) / scale, (t / low - (t - 1) / high) / scale


@njit(cache=True)
def merged_jet(jet: JetConstants, L: float, S: float, across: float) -> tuple[float, float, float]:
    """Return M at the square of a distance from the axis, with the curvature and value of its profile.

    S is s' + s_0.
    """
    curve = (math.sqrt(2) - 1) / (L * jet.half_width * S) ** 2
    profile = 1 + curve * across
    return jet.decay / S / profile**2, curve, profile


@njit(cache=True)
def depth_below(rotors: Array, k: int, start: int, axis: int, q: Array) -> tuple[float, tuple[float, float, float]]:
    """Return the depth of q below a start of rotor k along an axis, both columns, and its offset from that axis."""
    x, y, up = q[0] - rotors[k, start], q[1] - rotors[k, start + 1], q[2] - rotors[k, start + 2]
    a, b, c = rotors[k, axis], rotors[k, axis + 1], rotors[k, axis + 2]
    z = -(x * a + y * b + up * c)
    return z, (x + z * a, y + z * b, up + z * c)


@njit(cache=True)
def find_factors(jet: JetConstants, q: Array, epsilon: float, C: Array, dC: Array) -> None:
    """Compute C and its derivatives.

    Args:
        jet: jet of the module.
        q: the point from the module, shape (3,).
        epsilon: width of rounding.
        C: output, shape (r,).
        dC: output: derivatives of C by q, shape (r, 3); empty: none are computed.
    """
    rotors, k_total, x_total, y_total, z_total = jet.rotors, 0.0, 0.0, 0.0, 0.0
    for k in range(len(C)):  # inflow, before it is multiplied by its sum
        R, (z, w) = rotors[k, RADIUS], depth_below(rotors, k, DISC, AXIS, q)
        r = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + 1e-12)
        beyond, beyond_r = larger(r - R, 0.0, epsilon)
        d = math.sqrt(beyond * beyond + z * z + 1e-12)
        C[k] = 1 / (1 + math.sqrt(2) * d / R) ** 2
        k_total += C[k]
        if len(dC):
            by_d = -2 * math.sqrt(2) / R * C[k] / (1 + math.sqrt(2) * d / R)
            by_r = by_d * beyond * beyond_r / d
            for a in range(3):
                dC[k, a] = by_r * w[a] / r - by_d * z / d * rotors[k, AXIS + a]
            x_total, y_total, z_total = x_total + dC[k, 0], y_total + dC[k, 1], z_total + dC[k, 2]

    by_total, by_far = (x_total, y_total, z_total), (0.0, 0.0, 0.0)
    far, fade, fade_s, g, g_z, delta, delta_z, outer, outer_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    last_z, last_R, L, below_disc, below_disc_z = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(C)):
        if k == 0 or rotors[k, SHARE] == 1.0:
            L = rotors[k, DIAMETER]
            depth, across = depth_below(rotors, k, START, AGAINST, q)
            s = depth / L
            unmerged = (JETS.merged_at - s) / JETS.merges_over
            share, share_t = clip(1 - unmerged, epsilon)
            fade, own_share_t = clip(unmerged, epsilon)
            fade_s = -own_share_t / JETS.merges_over
            S, S_s = larger(s, JETS.merged_at, epsilon)
            S += jet.origin
            merged, curve, profile = merged_jet(jet, L, S, across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
            far = share * merged * merged
            far_s = share_t / JETS.merges_over * merged * merged + far * S_s / S * (8 * (profile - 1) / profile - 2)
            aside, down = -8 * far * curve / profile, -far_s / L
            by_far = (
                aside * across[0] + down * rotors[k, AGAINST + 0],
                aside * across[1] + down * rotors[k, AGAINST + 1],
                aside * across[2] + down * rotors[k, AGAINST + 2],
            )
        R, (z, w) = rotors[k, RADIUS], depth_below(rotors, k, DISC, AXIS, q)
        r = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + 1e-12)
        if k == 0 or z != last_z or last_R != R:  # alike for the parallel rotors of most modules
            last_z, last_R, (below_disc, below_disc_z) = z, R, clip(1 + z / epsilon, epsilon)
            below, below_z = larger(z, 0.0, epsilon)
            root = math.sqrt(R * R + below * below)
            g, g_z = 1 + below / root, R * R / root**3 * below_z
            delta, delta_z, area = JETS.shear * (below + R), JETS.shear * below_z, R * R / g
            if area >= 2 / 3 * delta * delta:
                core = math.sqrt(area - 2 / 9 * delta * delta)
                outer, by_delta, by_area = 4 / 3 * delta + core, 4 / 3 - 2 / 9 * delta / core, 1 / (2 * core)
            else:
                outer = (24 * delta * delta * area) ** 0.25
                by_delta, by_area = outer / (2 * delta), outer / (4 * area)
            outer_z = by_delta * delta_z - by_area * area * g_z / g
        t = (outer - r) / (2 * delta)
        inside, by_t = clip(t, epsilon)
        stream = (g * inside) ** 2
        jet_k, inflow_k = fade * below_disc * stream + rotors[k, SHARE] * far, C[k] * k_total
        rounded = max(jet_k, inflow_k)
        if epsilon > SHARP:
            rounded *= math.sqrt(math.sqrt((jet_k / rounded) ** 4 + (inflow_k / rounded) ** 4))
        weight = rotors[k, WEIGHT]
        if len(dC):
            by_jet, by_inflow = weight * (jet_k / rounded) ** 3, weight * (inflow_k / rounded) ** 3
            by_inside = 2 * fade * below_disc * g * inside
            by_r = -by_inside * g * by_t / (2 * delta)
            t_z = outer_z / (2 * delta) - t * delta_z / delta
            by_z = fade * below_disc_z / epsilon * stream + by_inside * (g_z * inside + g * by_t * t_z)
            by_s = fade_s * below_disc * stream / L
            for a in range(3):
                by_jet_a = by_r * w[a] / r - by_z * rotors[k, AXIS + a] - by_s * rotors[k, AGAINST + a]
                by_jet_a += rotors[k, SHARE] * by_far[a]
                dC[k, a] = by_inflow * (dC[k, a] * k_total + C[k] * by_total[a]) + by_jet * by_jet_a
        C[k] = weight * rounded


@njit(cache=True)
def speed(jet: JetConstants, C: Array, dC: Array, u: Array, slopes: Array) -> float:
    """Return U, and write its gradient by q and u to `slopes`, shape (3 + r,); no gradient if that is empty."""
    square = 0.0
    for k in range(len(C)):
        square += C[k] * (u[k] + JETS.idle)
    U = jet.induced * math.sqrt(square)
    if len(slopes):
        by_square = jet.induced**2 / (2 * U)
        for axis in range(3):
            slopes[axis] = 0.0
            for k in range(len(C)):
                slopes[axis] += by_square * (u[k] + JETS.idle) * dC[k, axis]
        for k in range(len(C)):
            slopes[3 + k] = by_square * C[k]
    return U


class SpeedRegion(NamedTuple):
    """A region with a speed limit, from p'_E [l_arm]: of radius, half_angle and planes only one is nonzero."""

    start: Array
    """Start of a path, a point inside a hull, or the apex of a cone, shape (3,)."""
    axis: Array
    """Vector to the path's end, or the cone's axis, shape (3,)."""
    radius: float
    """Radius around a path."""
    half_angle: float
    """Half-angle of a cone whose outside is the region [rad]."""
    planes: Array
    """Normals of a hull's faces, divided by their distances from the point inside, shape (f, 3)."""
    within: float
    """Largest distance of a point from p'_E."""


@njit(cache=True)
def project_inside(region: SpeedRegion, x: Array, slopes: Array) -> bool:
    """Project x and its derivatives into the region; return whether that succeeded."""
    to_shape(region, x, slopes)
    for _ in range(CLIMB.projections):
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
    """Project x and its derivatives into a ball about p'_E; arguments as in `to_shape`."""
    length = math.sqrt(_dot(x, x))
    if length <= radius:
        return
    for a in range(3):
        x[a] *= radius / length
    if len(slopes):
        slopes *= radius / length
        _project(x / radius, slopes)


@njit(cache=True)
def to_shape(region: SpeedRegion, x: Array, slopes: Array) -> None:
    """Project x and its derivatives into the region, regardless of the distance from p'_E.

    The result is the nearest point for paths, cones and boxes, and a near point for other hulls.

    Args:
        region: the region.
        x: the point, shape (3,); updated in place.
        slopes: derivatives of x, shape (3, k), updated in place for cones and hulls; empty: none are computed.
    """
    o0, o1, o2 = region.start
    a0, a1, a2 = region.axis
    d0, d1, d2 = x[0] - o0, x[1] - o1, x[2] - o2
    planes = region.planes
    if len(planes):
        beyond = 1.0
        for k in range(CLIMB.projections):
            face, beyond = 0, 1.0
            for f in range(len(planes)):
                height = planes[f, 0] * d0 + planes[f, 1] * d1 + planes[f, 2] * d2
                if height > beyond:
                    face, beyond = f, height
            if beyond <= 1.0 + 1e-12 or k == CLIMB.projections - 1:
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
        shift = min(1.0, region.radius / max(math.sqrt(d0 * d0 + d1 * d1 + d2 * d2), 1e-300)) - 1.0
        x[0], x[1], x[2] = x[0] + shift * d0, x[1] + shift * d1, x[2] + shift * d2
        return
    d0, d1, d2 = d0 - along * a0, d1 - along * a1, d2 - along * a2
    r = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    sine, cosine = math.sin(region.half_angle), math.cos(region.half_angle)
    depth = along * sine - r * cosine
    if depth <= 0.0:
        return
    if r < 1e-9:  # on the axis every direction is equally short
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
        tangent = (a1 * d2 - a2 * d1, a2 * d0 - a0 * d2, a0 * d1 - a1 * d0)
        slope = min(depth * cosine / r, CLIMB.max_slope)
        for column in range(slopes.shape[1]):
            change = 0.0
            for a in range(3):
                change += slope * tangent[a] * slopes[a, column]
            for a in range(3):
                slopes[a, column] += change * tangent[a]
        _project(np.array(out), slopes)


@njit(cache=True)
def _project(normal: Array, slopes: Array) -> None:
    """Remove the component along a unit vector from derivatives, shape (3, k) or empty."""
    for column in range(slopes.shape[1] if len(slopes) else 0):
        along = _dot(normal, slopes[:, column])
        for a in range(3):
            slopes[a, column] -= along * normal[a]


@njit(cache=True)
def total_speed(jet: JetConstants, R: Array, p: Array, u: Array, x: Array) -> float:
    """Return the sum of all modules' speeds at a point, not rounded.

    Args:
        jet: jet of the modules.
        R: orientations of the modules, shape (n, 3, 3).
        p: positions of the modules, shape (n, 3) [l_arm].
        u: inputs, shape (n, r) [u_hover].
        x: the point, shape (3,) [l_arm].
    """
    q, C, no_dC, total = np.empty(3), np.empty(len(jet.rotors)), np.empty((0, 3)), 0.0
    for i in range(len(p)):
        for k in range(3):
            q[k] = R[i, 0, k] * (x[0] - p[i, 0]) + R[i, 1, k] * (x[1] - p[i, 1]) + R[i, 2, k] * (x[2] - p[i, 2])
        find_factors(jet, q, SHARP, C, no_dC)
        square = 0.0
        for k in range(len(C)):
            square += C[k] * u[i, k]
        total += jet.induced * math.sqrt(square)
    return total


@njit(cache=True)
def climb(
    jet: JetConstants, R: Array, p: Array, u: Array, region: SpeedRegion, depths: Array, directions: Array
) -> Array:
    """Search for the fastest air over a region by pattern search, one search for each module.

    A search starts below its module or one of its discs. Searches that meet are merged.

    Args:
        jet: same as in `total_speed`.
        R: same as in `total_speed`.
        p: same as in `total_speed`.
        u: same as in `total_speed`.
        region: the region.
        depths: depths where a search may start, shape (d,) [l_arm].
        directions: directions of steps, shape (k, 3).

    Returns:
        Points and speeds, shape (n, 4); the speed is -1 if a search found no start in the region.
    """
    n = len(p)
    maxima, x, best, no_slopes = np.full((n, 4), -1.0), np.empty(3), np.empty(3), np.empty((0, 3))
    for i in range(n):
        for disc in range(len(jet.rotors) + 1):
            best_own = 0.0
            for depth in depths:
                for a in range(3):
                    x[a] = p[i, a] - (depth * R[i, a, 2] if disc == len(jet.rotors) else 0.0)
                    for b in range(3 if disc < len(jet.rotors) else 0):
                        x[a] += R[i, a, b] * (jet.rotors[disc, DISC + b] - depth * jet.rotors[disc, AXIS + b])
                if project_inside(region, x, no_slopes):
                    own_speed = total_speed(jet, R[i : i + 1], p[i : i + 1], u[i : i + 1], x)
                    if own_speed > best_own:
                        best_own, best[:] = own_speed, x
            if best_own > 0.0:
                total = total_speed(jet, R, p, u, best)
                if total > maxima[i, 3]:
                    maxima[i, :3], maxima[i, 3] = best, total
    merged_into, last_direction, step = np.arange(n), np.zeros(n, np.int64), CLIMB.step
    while step > CLIMB.min_step:
        slow = maxima[:, 3].max() * (CLIMB.slow if step < CLIMB.coarse else CLIMB.slow_coarse)
        for i in range(n):
            for _ in range(CLIMB.moves if merged_into[i] == i and maxima[i, 3] >= slow else 0):
                moved = False
                for shift in range(len(directions)):
                    k = (last_direction[i] + shift) % len(directions)
                    for a in range(3):
                        x[a] = maxima[i, a]
                        for b in range(3):
                            x[a] += step * R[i, a, b] * directions[k, b]
                    if not project_inside(region, x, no_slopes):
                        continue
                    total = total_speed(jet, R, p, u, x)
                    if total > maxima[i, 3] * (1 + CLIMB.gain):
                        maxima[i, :3], maxima[i, 3], last_direction[i], moved = x, total, k, True
                        break
                if not moved:
                    break
        for i in range(n):
            for j in range(i):
                distance = np.abs(maxima[i, :3] - maxima[j, :3]).max()
                if merged_into[i] == i and merged_into[j] == j and distance < CLIMB.same * step:
                    merged_into[i] = j
        step /= 2
    for i in range(n):
        maxima[i] = maxima[merged_into[i]]
    return maxima


@njit(cache=True)
def point_of_ball(
    from_tip: Array, radius: float, direction: Array, p: Array, z: Array, x: Array, slopes: Array
) -> None:
    """Compute a point x of a ball that moves with a module, and its derivatives.

    With w from the ball's centre to the module's axis, the direction is given in the frame w / |w|, z x w / |w|, z.
    Without a direction, x is towards the point of the axis, within a radius of w's end, that is nearest to the
    module.

    Args:
        from_tip: centre of the ball from p'_E.
        radius: radius of the ball; 0: the point is its centre.
        direction: direction of x from the centre, shape (3,); zeros: none.
        p: position of the module from p'_E.
        z: axis of the module.
        x: output: the point from p'_E, shape (3,).
        slopes: output: derivatives of x by p and z, shape (3, 6).
    """
    x[:] = from_tip
    slopes[:] = 0.0
    if radius == 0.0:
        return
    along, w, offset, dw, d_offset, dz = 0.0, np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
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
        offset[a] = by_w * w[a] + direction[1] * (z[b] * w[c] - z[c] * w[b]) + (direction[2] * length + up) * z[a]
    size = math.sqrt(_dot(offset, offset) + 1e-12)
    reach, by_size = larger(size, radius, ROUNDED)
    share = radius / reach
    for a in range(3):
        x[a] += share * offset[a]
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
            d_cross = dz[b] * w[c] - dz[c] * w[b] + z[b] * dw[c] - z[c] * dw[b]
            d_offset[a] = by_w * dw[a] + direction[1] * d_cross + d_up * z[a] + (direction[2] * length + up) * dz[a]
        d_size = _dot(offset, d_offset) / size
        for a in range(3):
            slopes[a, column] = share * d_offset[a] - share / reach * by_size * d_size * offset[a]
        dz[k] = 0.0


@njit(cache=True)
def curvature(jet: JetConstants, q: Array, u: Array, hessian: Array) -> None:
    """Compute the Hessian of a rounded speed by q and u, shape (3 + r, 3 + r), from that of its square."""
    r, square = len(u), jet.induced**2
    C, dC, above, below, slopes = np.empty(r), np.empty((r, 3)), np.empty((r, 3)), np.empty((r, 3)), np.empty(3 + r)
    find_factors(jet, q, ROUNDED, C, dC)
    U = speed(jet, C, dC, u, slopes)
    hessian[:] = 0.0
    hessian[3:, :3], hessian[:3, 3:] = square * dC, square * dC.T
    for a in range(3):
        middle = q[a]
        q[a] = middle + JETS.difference
        find_factors(jet, q, ROUNDED, C, above)
        q[a] = middle - JETS.difference
        find_factors(jet, q, ROUNDED, C, below)
        q[a] = middle
        for k in range(r):
            hessian[a, :3] += square * (u[k] + JETS.idle) * (above[k] - below[k]) / (2 * JETS.difference)
    for a in range(3 + r):
        for b in range(3 + r):
            hessian[a, b] = (hessian[a, b] / 2 - slopes[a] * slopes[b]) / U


refresh(climb, Path(__file__).parent)
