r"""The smallest cone-sphere around all air of a module that reaches a speed, and the speeds on a given cone-sphere.

The module is level at the origin, and its rotors have equal inputs. Points are (z, r, phi): depth, distance
from the axis, angle from the vertical plane through a rotor. The flow has the symmetry of the rotors, so in an X
phi from 0 to half the angle between two of them covers all of it; for other rotors phi goes all around.

A cell is the set of points with z and r within h of its centre and phi within an angle. Its air is bounded in a
ball about (z, r, phi) that is turned by the angle (`verify.air.jets`). The angle is halved with h where it raises
the bound: where the rotors' jets have not merged, and where inflow counts. Cells outside a
cone-sphere are split until their bounds are below the speed, which proves that the cone-sphere encloses that speed,
or until a point that reaches it is found. The cone-sphere of minimum volume around all such points is computed,
widened slightly, and tested, until no such point is outside. Lengths are in l_arm.

The cone-sphere of minimum volume around points has its axis on the module's and starts at the origin:

| symbol | meaning |
|---|---|
| z, r | depth of a point along the axis, its distance from the axis |
| a, l, g | first ball's radius, length of the axis, growth of the radius per length, 0 <= g <= 1 |

A ball of the family has its centre at t and the radius a + g t, 0 <= t <= l. The first ball that contains (z, r)
has

.. math:: t = \frac{z^2 + r^2 - a^2}{z + a g + \sqrt{(z + a g)^2 - (1 - g^2)(z^2 + r^2 - a^2)}}

and l is the largest such t. It decreases with a and g, while the volume increases with a, g and l. So in a box of a
and g no volume is less than that of its lower corner with the length at its upper corner, which is the lower bound
of the branch and bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from topo_search.model import Array, Flags, Module
from topo_search.model.air import EnvelopeAir, SpeedEnvelope
from topo_search.model.airflow import Airflow
from topo_search.model.proven import at_most
from verify.air.bound import SEARCH as BOUND
from verify.air.bound import SpeedBound, bound_beyond, bound_speed
from verify.air.jets import MODEL, Jets, jets, speeds
from verify.bodies import ball
from verify.certificate import RoundBody


class VolumeSearch(NamedTuple):
    """Settings of the search for the cone-sphere of minimum volume."""

    enough: float = 1.002
    """Ratio of the volume to its lower bound at which the search ends."""
    shortest: float = 1e-3
    """Smallest length of the axis [a]."""


VOLUME_SEARCH = VolumeSearch()


class MinimumVolume(NamedTuple):
    """A cone-sphere around points, and a lower bound on the volume of all such cone-spheres."""

    a: float
    g: float
    l: float
    least_volume: float


def volume(a: Array | float, g: Array | float, l: Array | float) -> Array:
    """Return volumes of cone-spheres: a frustum between the tangent circles of cone and balls, and two caps."""
    b = a + g * l
    frustum = (1 - g**2) ** 2 * l * (a * a + a * b + b * b)
    caps = a**3 * (1 - g) ** 2 * (2 + g) + b**3 * (1 + g) ** 2 * (2 - g)
    return np.asarray(math.pi / 3 * (frustum + caps))


def smallest_cone_sphere(z: Array, r: Array) -> MinimumVolume:
    """Return a cone-sphere around points (z, r), (m,) each, within VOLUME_SEARCH.enough of the minimum volume."""
    corners, size = np.zeros((1, 2)), np.array([float(np.hypot(z, r).max()) * (1 + VOLUME_SEARCH.shortest), 1.0])
    best, best_volume = np.zeros(3), math.inf
    while True:
        lengths = _length(corners + size, z, r)
        corners, lengths = corners[np.isfinite(lengths)], lengths[np.isfinite(lengths)]
        a, g = (corners + size).T
        candidates = np.stack([a, g, np.maximum(lengths, VOLUME_SEARCH.shortest * a)], axis=1)
        volumes, bounds = volume(a, g, candidates[:, 2]), volume(corners[:, 0], corners[:, 1], lengths)
        if volumes.min() < best_volume:
            best, best_volume = candidates[np.argmin(volumes)], float(volumes.min())
        if best_volume <= VOLUME_SEARCH.enough * bounds.min():
            return MinimumVolume(float(best[0]), float(best[1]), float(best[2]), float(bounds.min()))
        quarters = size * np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) / 2
        corners = (corners[bounds < best_volume][:, None] + quarters).reshape(-1, 2)
        size = size / 2


def _length(sizes: Array, z: Array, r: Array) -> Array:
    """Return the smallest l of cone-spheres with (a, g), (k, 2), around points; infinite if none exists, (k,)."""
    a, g = sizes[:, :1], sizes[:, 1:]
    power, depth = z**2 + r**2 - a**2, z + a * g  # power of the point with respect to the first ball
    root = depth**2 - (1 - g**2) * power
    exists = (root >= 0) & (depth > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = power / (depth + np.sqrt(np.maximum(root, 0.0)))
    return np.asarray(np.where(power <= 0, 0.0, np.where(exists, t, np.inf)).max(axis=1))


class EnvelopeSearch(NamedTuple):
    """Settings of the search for the cone-sphere of a speed."""

    enough: float = 1.01
    """Largest ratio of a cone-sphere's volume to the lower bound."""
    sharp: float = 1.001
    """Largest ratio of the bound on a surface to a speed attained on it."""
    margin: float = 2e-3
    """Initial margin around the points found [largest radius]; halved while the volume is too large."""
    digits: int = 5
    """Significant digits of start radius, spread and reach, rounded up."""
    point: float = 1e-6
    """Size of the initial volume [l_arm]."""
    most_cells: int = 500_000
    octant: float = math.pi / 4


SEARCH = EnvelopeSearch()


class Unreached(ValueError):
    """No air is known to reach the speed; `bound` holds the largest speed."""

    def __init__(self, bound: SpeedBound) -> None:
        super().__init__(bound)
        self.bound = bound


class EnvelopeShape(NamedTuple):
    """A cone-sphere: first radius, growth per length, length [l_arm]."""

    a: float
    g: float
    l: float

    @classmethod
    def of(cls, module: Module) -> EnvelopeShape:
        """Return a module's envelope against target regions."""
        envelope, l_arm = module.region_envelope, module.arm_length
        return cls(envelope.start_radius / l_arm, envelope.growth / envelope.length, envelope.length / l_arm)

    def excess(self, z: Array, r: Array) -> Array:
        """Return the growth of the balls' radii that would contain points; negative inside."""
        t = np.clip(z + self.g / math.sqrt(max(1 - self.g**2, 1e-12)) * r, 0.0, self.l)
        return np.hypot(r, z - t) - (self.a + self.g * t)


def enclose(module: Module, density: float, thrust: float, speed: float) -> SpeedEnvelope:
    """Return a cone-sphere, within a percent of the minimum volume, around all air that reaches a speed.

    Args:
        module: a single module.
        density: rho [kg/m^3].
        thrust: T [N].
        speed: the speed to enclose [m/s].

    Raises:
        Unreached: no air reaches the speed.
        ArithmeticError: the limit on cells is reached before the enclosure is proven.
    """
    air = _module_jets(module, density, thrust)
    radius = air.ended
    while bound_beyond(air, np.zeros(3), radius) >= speed:
        radius *= 2
    fastest = bound_speed(air, RoundBody(ball(np.zeros(3), radius)), limit=speed)
    if fastest.at_least < speed:
        raise Unreached(fastest)
    phi, point = _half_range(module), EnvelopeShape(SEARCH.point, 0.0, SEARCH.point)
    points = _faster_outside(air, phi, point, radius, speed, math.inf)
    if not len(points):
        raise ArithmeticError(f"air reaches {speed} m/s only within {SEARCH.point} arm lengths of the centre")
    margin = SEARCH.margin
    while True:
        smallest = smallest_cone_sphere(*points.T)
        clearance = margin * (smallest.a + smallest.g * smallest.l)
        l_arm, a = module.arm_length, at_most((smallest.a + clearance) * module.arm_length, SEARCH.digits)
        spread = min(at_most(2 * math.degrees(math.atan(smallest.g)), SEARCH.digits), 90.0)
        reach = at_most(a + smallest.l * l_arm * (1 + math.tan(math.radians(spread) / 2)), SEARCH.digits)
        flow = Airflow(start_radius=a, spread_angle_deg=spread, reach=reach, jet=module.airflow.jet)
        shape = EnvelopeShape.of(module.model_copy(update={"airflow": flow}))
        if volume(*shape) > SEARCH.enough * smallest.least_volume:
            margin /= 2
            continue
        outside = _faster_outside(air, phi, shape, radius, speed, clearance)
        if not len(outside):
            return SpeedEnvelope(
                start_radius_m=a,
                spread_angle_deg=spread,
                reach_m=reach,
                volume_m3=float(volume(*shape)) * l_arm**3,
                least_volume_m3=smallest.least_volume * l_arm**3,
            )
        points = np.concatenate([points, outside])
        if len(points) > 4:
            from scipy.spatial import ConvexHull  # slow to load, and few commands need an envelope

            mirrored = np.concatenate([points, points * [1, -1]])
            points = points[np.unique(ConvexHull(mirrored, qhull_options="QJ").vertices % len(points))]


def envelope_air(module: Module, density: float, thrust: float) -> EnvelopeAir:
    """Return upper bounds on the speeds on a module's own envelope, at most SEARCH.sharp times too high.

    Args:
        module: a single module.
        density: rho [kg/m^3].
        thrust: T [N].
    """
    air, (a, g, l), phi = _module_jets(module, density, thrust), EnvelopeShape.of(module), _half_range(module)
    cos, tilt, b = math.sqrt(1 - g * g), math.asin(g), a + g * l

    def side(length: float) -> float:
        """Return the largest speed on the side within a length from its lower end."""
        return _fastest(air, phi, lambda s: (l - g * b - cos * s, b * cos - g * s), length)

    level = a / cos if a * g <= l * (1 - g * g) else math.sqrt(b * b - l * l)
    merged, span = MODEL.merged_at * float(air.diameters.max()), module.rotor_table.span
    return EnvelopeAir(
        side_m_s=side(l * cos),
        side_merged_m_s=side((l - g * b - merged) / cos) if merged < l - g * b else None,
        end_m_s=_fastest(
            air, phi, lambda s: (l - b * np.sin(tilt - s / b), b * np.cos(tilt - s / b)), b * (math.pi / 2 + tilt)
        ),
        rotor_plane_m_s=_fastest(air, phi, lambda s: (0.0 * s, level + s), max(span - level, 0.0)),
    )


def _module_jets(module: Module, density: float, thrust: float) -> Jets:
    rotors = module.rotor_table
    inputs = np.full((1, rotors.count), thrust / (rotors.gains.sum() * module.thrust_coefficient))
    return jets(module, density, np.zeros((1, 3)), np.eye(3)[None], rotors.positions[None], inputs)


def _half_range(module: Module) -> float:
    """Return half the range of phi."""
    return SEARCH.octant / 2 if module.rotor_table.is_x else math.pi


def _faster_outside(
    air: Jets, half_range: float, shape: EnvelopeShape, radius: float, speed: float, cell_size: float
) -> Array:
    """Return points (z, r), (m, 2), outside a cone-sphere that reach a speed; if empty, it is proven that none do.

    Args:
        air: the jets of one module.
        half_range: half the range of phi.
        shape: the cone-sphere.
        radius: distance from the origin beyond which no air reaches the speed.
        speed: the speed [m/s].
        cell_size: cell size below which the search ends if any points are known.
    """
    h, points = radius / 2, [np.zeros((0, 2))]
    cells = np.array([[-h, h], [h, h], *[[half_range] * 2] * 2])
    while cells.size:
        cells = cells[:, shape.excess(*cells[:2]) > -math.sqrt(2) * h]
        z, r, phi, half_angle = cells
        arc = (r + h) * half_angle
        bounds, is_turned = _bounds(air, z, r, phi, math.sqrt(2) * h, arc)
        unsettled, split = bounds >= speed, is_turned & (arc > h)
        cells, split = cells[:, unsettled], split[unsettled]
        fast = (_speeds(air, *cells[:3]) >= speed) & (shape.excess(*cells[:2]) > 0)
        points.append(cells[:2, fast].T)
        if h < cell_size and any(len(batch) for batch in points):
            break
        if cells.shape[1] > SEARCH.most_cells:
            raise ArithmeticError(f"{cells.shape[1]:,} cells are not enough to prove an enclosure of {speed} m/s")
        (z, r, *angles), split, h = cells[:, ~fast], split[~fast], h / 2
        z, r = np.concatenate([z - h, z - h, z + h, z + h]), np.concatenate([r - h, r + h, r - h, r + h])
        cells = np.array(_split_angles(np.tile(split, 4), z, r, *(np.tile(angle, 4) for angle in angles)))
    return np.concatenate(points)


def _fastest(air: Jets, half_range: float, curve: Callable[[Array], tuple[Array, Array]], length: float) -> float:
    """Return a bound on the speed on a surface of revolution, at most SEARCH.sharp times a speed on it.

    Args:
        air: the jets of one module.
        half_range: half the range of phi.
        curve: maps the distance along the profile curve to (z, r).
        length: length of the curve.
    """
    h, fastest, pruned = length / 2, 0.0, 0.0
    s, phi, half_angle = np.array([h]), np.array([half_range]), np.array([half_range])
    while len(s):
        z, r = curve(s)
        arc = (r + h) * half_angle
        bounds, is_turned = _bounds(air, z, r, phi, h, arc)
        fastest = max(fastest, float(_speeds(air, z, r, phi).max()))
        enough = SEARCH.sharp * fastest
        pruned = max(pruned, float(bounds[bounds <= enough].max(initial=0.0)))
        unsettled, h = bounds > enough, h / 2
        s, phi, half_angle, split = (np.tile(x[unsettled], 2) for x in (s, phi, half_angle, is_turned & (arc > h)))
        s[: len(s) // 2] -= h
        s[len(s) // 2 :] += h
        s, phi, half_angle = _split_angles(split, s, phi, half_angle)
    return pruned


def _split_angles(which: Array, *cells: Array) -> list[Array]:
    """Return cells, arrays that end with the angle and its half-range, with the cells `which` split in two."""
    *coordinates, phi, half_angle = cells
    half_angle = np.where(which, half_angle / 2, half_angle)
    split = [
        np.concatenate([x, x[which]]) for x in (*coordinates, np.where(which, phi - half_angle, phi), half_angle)
    ]
    split[-2][len(phi) :] = phi[which] + half_angle[which]
    return split


def _bounds(air: Jets, z: Array, r: Array, phi: Array, radius: float, arc: Array) -> tuple[Array, Flags]:
    """Return bounds in cells of a radius about (z, r) and an arc, and where the arc raises them."""
    points = _points(z, r, phi)
    turned, still = (speeds(air, points, radius, turn)[:, 0] * (1 + BOUND.rounding) for turn in (arc, 0.0))
    return turned, turned > still


def _speeds(air: Jets, z: Array, r: Array, phi: Array) -> Array:
    """Return the larger of the speeds at a cell's angle and at the rotor's, shape (m,)."""
    return np.maximum(*(speeds(air, _points(z, r, angle))[:, 0] for angle in (phi, 0.0 * phi)))


def _points(z: Array, r: Array, phi: Array) -> Array:
    return np.stack([r * np.cos(phi + SEARCH.octant), r * np.sin(phi + SEARCH.octant), -z], axis=1)
