r"""The cone-sphere of a speed: the smallest around all air of a module that is as fast, and speeds on a given one.

The module is level at the origin, its four discs blow alike. Points are (z, r, phi): depth, distance from the axis,
angle from the vertical plane through a rotor. Wakes are fastest at phi = 0, where r is nearest to a rotor's axis;
all air has the symmetry of the four rotors, so phi from 0 to 45 deg is all of it.

A cell is all points within h of (z, r) in both, and within an angle of phi. Its wake is bounded in the ball about
(z, r, 0), its inflow in the ball about (z, r, phi) that holds it (`verify.air.jets`). Cells outside a cone-sphere
are cut until their bound is below the speed, which proves that the cone-sphere encloses it, or until a point is
found that is as fast. Such points are what the cone-sphere of least volume must hold (`verify.air.envelope`): it is
computed, widened a little, and tried, until nothing is found outside. Lengths are in l_arm.

The cone-sphere of least volume around points has a given centre and axis:

| symbol | meaning |
|---|---|
| z, r | depth of a point along the axis, its distance from the axis |
| a, l, g | first ball's radius, length of the axis, growth of the radius per length, 0 <= g <= 1 |

A ball of the family has the centre t and the radius a + g t, 0 <= t <= l. The first one that holds (z, r) has

.. math:: t = \frac{z^2 + r^2 - a^2}{z + a g + \sqrt{(z + a g)^2 - (1 - g^2)(z^2 + r^2 - a^2)}}

and l is the largest such t. It falls with a and g, while the volume grows with a, g and l. So in a box of a and g
no volume is less than that of its lower corner with the length at its upper corner: branch and bound needs no more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from topo_search.model import Module
from topo_search.model.arrays import ROTOR_DIRECTIONS
from topo_search.model.audit import EnvelopeAir, SpeedEnvelope
from topo_search.model.module import Airflow
from topo_search.model.proven import at_most
from verify.air.bound import SEARCH as BOUND
from verify.air.bound import SpeedBound, bound_beyond, bound_speed
from verify.air.jets import MODEL, Jets, inflows, jets, speeds, wakes
from verify.bodies import Array, ball
from verify.certificate import Solid


class LeastSearch(NamedTuple):
    """The search for the cone-sphere of least volume."""

    enough: float = 1.002
    """Volume over its lower bound at which the search ends."""
    shortest: float = 1e-3
    """Least length of the axis [a]."""


LEAST = LeastSearch()


class Least(NamedTuple):
    """A cone-sphere, and what none around the points is smaller than."""

    a: float
    g: float
    l: float
    least_volume: float


def volume(a: Array | float, g: Array | float, l: Array | float) -> Array:
    """Return volumes of cone-spheres: a frustum between the circles where cone and balls touch, and two caps."""
    b = a + g * l
    frustum = (1 - g**2) ** 2 * l * (a * a + a * b + b * b)
    caps = a**3 * (1 - g) ** 2 * (2 + g) + b**3 * (1 + g) ** 2 * (2 - g)
    return np.asarray(math.pi / 3 * (frustum + caps))


def least_cone_sphere(z: Array, r: Array) -> Least:
    """Return one of at most LEAST.enough times the least volume around points, shapes (m,) and (m,)."""
    corners, size = np.zeros((1, 2)), np.array([float(np.hypot(z, r).max()) * (1 + LEAST.shortest), 1.0])
    best, best_volume = np.zeros(3), math.inf
    while True:
        lengths = _length(corners + size, z, r)
        corners, lengths = corners[np.isfinite(lengths)], lengths[np.isfinite(lengths)]
        a, g = (corners + size).T
        held = np.stack([a, g, np.maximum(lengths, LEAST.shortest * a)], axis=1)
        volumes, bounds = volume(a, g, held[:, 2]), volume(corners[:, 0], corners[:, 1], lengths)
        if volumes.min() < best_volume:
            best, best_volume = held[np.argmin(volumes)], float(volumes.min())
        if best_volume <= LEAST.enough * bounds.min():
            return Least(float(best[0]), float(best[1]), float(best[2]), float(bounds.min()))
        quarters = size * np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) / 2
        corners = (corners[bounds < best_volume][:, None] + quarters).reshape(-1, 2)
        size = size / 2


def _length(sizes: Array, z: Array, r: Array) -> Array:
    """Return the least l of cone-spheres with (a, g), (k, 2), around the points; infinite where none is, (k,)."""
    a, g = sizes[:, :1], sizes[:, 1:]
    beyond, deep = z**2 + r**2 - a**2, z + a * g
    root = deep**2 - (1 - g**2) * beyond
    reached = (root >= 0) & (deep > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = beyond / (deep + np.sqrt(np.maximum(root, 0.0)))
    return np.asarray(np.where(beyond <= 0, 0.0, np.where(reached, first, np.inf)).max(axis=1))


class EnvelopeSearch(NamedTuple):
    """The search for the cone-sphere of a speed."""

    enough: float = 1.01
    """Volume of a cone-sphere over what none is smaller than, at most."""
    sharp: float = 1.001
    """Bound of a speed on a surface over a speed that was found there, at most."""
    wider: float = 2e-3
    """Room left around the points that were found [largest radius]; halved where that costs too much."""
    digits: int = 5
    """Significant digits of start radius, spread and reach, rounded up."""
    point: float = 1e-6
    """Least size of a volume [l_arm]."""
    most_cells: int = 500_000
    octant: float = math.pi / 4


SEARCH = EnvelopeSearch()


class Unreached(ValueError):
    """No air is known to be as fast; `bound` is the fastest."""

    def __init__(self, bound: SpeedBound) -> None:
        super().__init__(bound)
        self.bound = bound


class Shape(NamedTuple):
    """A cone-sphere: first radius, growth per length, length [l_arm]."""

    a: float
    g: float
    l: float

    @classmethod
    def of(cls, module: Module) -> Shape:
        """Return that of a module against target regions."""
        given = module.region_envelope
        return cls(
            given.start_radius / module.arm_length, given.growth / given.length, given.length / module.arm_length
        )

    def excess(self, z: Array, r: Array) -> Array:
        """Return by how much the balls must grow to hold points; negative inside."""
        t = np.clip(z + self.g / math.sqrt(max(1 - self.g**2, 1e-12)) * r, 0.0, self.l)
        return np.hypot(r, z - t) - (self.a + self.g * t)


def enclose(module: Module, density: float, thrust: float, speed: float) -> SpeedEnvelope:
    """Return the cone-sphere of least volume, to a percent, around all air of a module at least as fast as a speed.

    Args:
        module: one module alone.
        density: rho [kg/m^3].
        thrust: T [N].
        speed: [m/s].

    Raises:
        Unreached: no air is as fast.
        ArithmeticError: cells run out before the enclosure is proven.
    """
    air = _alone(module, density, thrust)
    near = 2 * (MODEL.merged_at * MODEL.diameter + 1 + 2 * air.radius)
    while bound_beyond(air, np.zeros(3), near) >= speed:
        near *= 2
    top = bound_speed(air, Solid(ball(np.zeros(3), near)), limit=speed)
    if top.at_least < speed:
        raise Unreached(top)
    points, wider = (
        _faster_outside(air, Shape(SEARCH.point, 0.0, SEARCH.point), near, speed, math.inf),
        SEARCH.wider,
    )
    if not len(points):
        raise ArithmeticError(f"air of {speed} m/s is nowhere but within {SEARCH.point} arm lengths of the centre")
    while True:
        least = least_cone_sphere(*points.T)
        room = wider * (least.a + least.g * least.l)
        l_arm, a = module.arm_length, at_most((least.a + room) * module.arm_length, SEARCH.digits)
        spread = min(at_most(2 * math.degrees(math.atan(least.g)), SEARCH.digits), 90.0)
        reach = at_most(a + least.l * l_arm * (1 + math.tan(math.radians(spread) / 2)), SEARCH.digits)
        flow = Airflow(start_radius=a, spread_angle_deg=spread, reach=reach, jet=module.airflow.jet)
        shape = Shape.of(module.model_copy(update={"airflow": flow}))
        if volume(*shape) > SEARCH.enough * least.least_volume:
            wider /= 2
            continue
        faster = _faster_outside(air, shape, near, speed, room)
        if not len(faster):
            return SpeedEnvelope(
                start_radius_m=a,
                spread_angle_deg=spread,
                reach_m=reach,
                volume_m3=float(volume(*shape)) * l_arm**3,
                least_volume_m3=least.least_volume * l_arm**3,
            )
        points = np.concatenate([points, faster])
        if len(points) > 4:
            from scipy.spatial import ConvexHull  # slow to load, and few commands look for an envelope

            both = np.concatenate([points, points * [1, -1]])
            points = points[np.unique(ConvexHull(both, qhull_options="QJ").vertices % len(points))]


def envelope_air(module: Module, density: float, thrust: float) -> EnvelopeAir:
    """Return the largest speeds on a module's own envelope, at most SEARCH.sharp times too high.

    Args:
        module: one module alone.
        density: rho [kg/m^3].
        thrust: T [N].
    """
    air, (a, g, l) = _alone(module, density, thrust), Shape.of(module)
    cos, tilt, b = math.sqrt(1 - g * g), math.asin(g), a + g * l

    def side(length: float) -> float:
        """Return the largest speed on so much of the side, up from its lower end."""
        return _fastest(air, lambda s: (l - g * b - cos * s, b * cos - g * s), length)

    level = a / cos if a * g <= l * (1 - g * g) else math.sqrt(b * b - l * l)
    merged = MODEL.merged_at * MODEL.diameter
    return EnvelopeAir(
        side_m_s=side(l * cos),
        side_merged_m_s=side((l - g * b - merged) / cos) if merged < l - g * b else None,
        end_m_s=_fastest(
            air, lambda s: (l - b * np.sin(tilt - s / b), b * np.cos(tilt - s / b)), b * (math.pi / 2 + tilt)
        ),
        rotor_plane_m_s=_fastest(air, lambda s: (0.0 * s, level + s), max(1.0 - level, 0.0)),
    )


def _alone(module: Module, density: float, thrust: float) -> Jets:
    inputs = np.full((1, 4), thrust / (4 * module.thrust_coefficient))
    return jets(module, density, np.zeros((1, 3)), np.eye(3)[None], ROTOR_DIRECTIONS[None], inputs)


def _faster_outside(air: Jets, shape: Shape, near: float, speed: float, room: float) -> Array:
    """Return points (z, r), (m, 2), outside a cone-sphere where air is as fast; none: proven.

    Args:
        air: one module.
        shape: the cone-sphere.
        near: no air is as fast farther than that from the origin.
        speed: [m/s].
        room: size of cells at which points end the search if there are any.
    """
    h, points = near / 2, [np.zeros((0, 2))]
    cells = np.array([[-h, h], [h, h], *[[SEARCH.octant / 2] * 2] * 2])
    while cells.size:
        cells = cells[:, shape.excess(*cells[:2]) > -math.sqrt(2) * h]
        z, r, phi, turn = cells
        turned = (r + h) * turn
        wake, inflow = _bounds(air, z, r, phi, math.sqrt(2) * h, turned)
        kept, cut = np.maximum(wake, inflow) >= speed, (inflow >= speed) & (turned > h)
        cells, cut = cells[:, kept], cut[kept]
        fast = (_speeds(air, *cells[:3]) >= speed) & (shape.excess(*cells[:2]) > 0)
        points.append(cells[:2, fast].T)
        if h < room and any(len(some) for some in points):
            break
        if cells.shape[1] > SEARCH.most_cells:
            raise ArithmeticError(f"{cells.shape[1]:,} cells are not enough to prove an enclosure of {speed} m/s")
        (z, r, *angles), cut, h = cells[:, ~fast], cut[~fast], h / 2
        z, r = np.concatenate([z - h, z - h, z + h, z + h]), np.concatenate([r - h, r + h, r - h, r + h])
        cells = np.array(_cut_angles(np.tile(cut, 4), z, r, *(np.tile(angle, 4) for angle in angles)))
    return np.concatenate(points)


def _fastest(air: Jets, curve: Callable[[Array], tuple[Array, Array]], length: float) -> float:
    """Return a bound of the speed on a curve turned about the axis, at most SEARCH.sharp times a speed on it.

    Args:
        air: one module.
        curve: (z, r) by the distance along the curve.
        length: of the curve.
    """
    h, fastest, dropped = length / 2, 0.0, 0.0
    s, phi, turn = np.array([h]), np.array([SEARCH.octant / 2]), np.array([SEARCH.octant / 2])
    while len(s):
        z, r = curve(s)
        turned = (r + h) * turn
        wake, inflow = _bounds(air, z, r, phi, h, turned)
        fastest = max(fastest, float(_speeds(air, z, r, phi).max()))
        bounds, enough = np.maximum(wake, inflow), SEARCH.sharp * fastest
        dropped = max(dropped, float(bounds[bounds <= enough].max(initial=0.0)))
        kept, h = bounds > enough, h / 2
        s, phi, turn, cut = (np.tile(x[kept], 2) for x in (s, phi, turn, (inflow > enough) & (turned > h)))
        s[: len(s) // 2] -= h
        s[len(s) // 2 :] += h
        s, phi, turn = _cut_angles(cut, s, phi, turn)
    return dropped


def _cut_angles(which: Array, *cells: Array) -> list[Array]:
    """Return cells, of whose arrays the last two are the angle and how far it spans, with some cut in halves."""
    *others, phi, turn = cells
    turn = np.where(which, turn / 2, turn)
    both = [np.concatenate([x, x[which]]) for x in (*others, np.where(which, phi - turn, phi), turn)]
    both[-2][len(phi) :] = phi[which] + turn[which]
    return both


def _bounds(air: Jets, z: Array, r: Array, phi: Array, wide: float, turned: Array) -> tuple[Array, Array]:
    """Return bounds of wake and inflow in cells that reach so far from (z, r), and so far about the axis."""
    wake = wakes(air, _points(z, r, 0.0 * phi), wide)[:, 0]
    return wake * (1 + BOUND.rounding), inflows(air, _points(z, r, phi), wide + turned)[:, 0] * (1 + BOUND.rounding)


def _speeds(air: Jets, z: Array, r: Array, phi: Array) -> Array:
    """Return the larger speed of a cell's angle and of the rotor's, (m,)."""
    return np.maximum(*(speeds(air, _points(z, r, angle))[:, 0] for angle in (phi, 0.0 * phi)))


def _points(z: Array, r: Array, phi: Array) -> Array:
    return np.stack([r * np.cos(phi + SEARCH.octant), r * np.sin(phi + SEARCH.octant), -z], axis=1)
