r"""Air speed over regions: the jet model in numbers and as rows of a program.

Lengths are in l_arm, s = depth / 2 in distances of opposite rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v_q | speed that disc q induces, sqrt(k_f u_q / (2 rho pi R^2)) | | m/s |
| U_H | root of the mean of the v_q^2 | | m/s |
| s, r | depth below the module, distance from its axis | | 2 l_arm, l_arm |
| z, r_q, d_q | depth in l_arm; distance from rotor q's axis; from its disc | | l_arm |
| D, s_0, b | `module.airflow.jet` | | |

A module's air is the largest of three parts: the merged jets (Bauersfeld et al., arXiv 2403.13321), a disc's own
slipstream (momentum theory, with a shear layer of 0.1 (z + R)), and the flow towards the discs:

.. math::

    U &= \max\Big(\frac{D U_H \min(1, s / 2.5)}{s' + s_0} \big(1 + (\sqrt 2 - 1) \tfrac{r^2}{r_h^2}\big)^{-2},\;
        v_q g\, c_z c_r,\; \sum_q \frac{v_q}{(1 + \sqrt 2 d_q / R)^2}\Big) \\
    s' &= \max(s, 2.5), \quad r_h = 2 b (s' + s_0), \quad g = 1 + z / \sqrt{R^2 + z^2} \\
    c_z &= \min(1, (2.5 - s) / 1.5), \quad c_r = \tfrac12 + (R / \sqrt g - r_q) / (0.2 (z + R)) \in [0, 1]

Over a region counts the sum of all modules' speeds. A program has it at points that are fixed from the
end-effector, those of the region where air is fastest, taken in as a solve leaves them too fast; there the largest
of the parts is their 8-norm, which is no less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from nlp import names
from nlp.numbers.point import Point
from nlp.requirements.regions import hull_of
from nlp.symbols.kinematics import poses
from nlp.symbols.masses import tip_and_com
from topo_search.model import EndEffector, Module, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.layout import ROTOR_DIRECTIONS
from topo_search.model.shape import Capsule, Cone, Indices, Polytope, Shape

MERGED_AT = 2.5
"""Depth at which the jets of a module have merged [2 l_arm]."""
AIMED_AT = 0.997
"""Share of a limit that rows state: what is faster between their points is within the limit."""
ALLOWED = 0.998
"""Share of a limit up to which a design meets it: the audit's bound over the whole region is still under it."""
ALONG_AXIS = np.concatenate([[0.0], np.geomspace(0.1, 60.0, 30)])
"""Depths at which a search for the fastest air begins [l_arm]."""
STEPS = 0.5 ** np.arange(1, 16)
"""Steps of that search [l_arm]."""
NORM = 8
"""Exponent of the norm that is the largest of a module's parts in rows."""
SOFTNESS = 0.02
"""Width over which bends are rounded in rows."""
PULLS = 30
"""Number of projections, in turns, that bring a point into a region and a ball."""


class SpeedPoint(NamedTuple):
    """A point of a region that a program states, in a load case."""

    case: int
    exposure: int
    from_tip: tuple[float, float, float]
    """From p'_E [l_arm]."""
    module: int = -1
    """Instead of that point: the point nearest to this module's axis of a ball around it."""
    radius: float = 0.0
    """Radius of the ball [l_arm]."""


@dataclass(frozen=True)
class Fastest:
    """Fastest air over a region in a load case, and where."""

    case: int
    exposure: int
    limit: float
    """[m/s]"""
    speed: float
    """[m/s]"""
    points: tuple[SpeedPoint, ...]
    """The fastest of each module's neighbourhood."""


def name_of(task: ResolvedTask, at: Fastest) -> str:
    """Name a limit as the audit does."""
    return names.air(at.exposure, task.exposure[at.exposure], task.case_labels[at.case])


def fastest(point: Point) -> Iterator[Fastest]:
    """Yield every region whose speed is limited, in every load case: where the air is fastest there."""
    task, l_arm = point.task, point.task.module.arm_length
    limited = [(number, asked) for number, asked in enumerate(task.exposure) if asked.speed is not None]
    if not limited:
        return
    (R, p), tip = point.poses, point.p_E / l_arm
    p = p / l_arm - tip
    rotors = p[:, None] + np.einsum("iab,qb->iqa", R, ROTOR_DIRECTIONS)
    origins = np.concatenate([p[:, None], rotors], axis=1)
    begins = origins[:, :, None] - ALONG_AXIS[:, None] * R[:, None, None, :, 2]
    induced = _induced_speeds(task.module, task.air_density, point.u)
    for number, asked in limited:
        shapes = [shape.at(point.p_E - point.p_COM) for shape in asked.shapes]
        for case in range(len(task.declared.load_cases)):

            def air(x: Array, u: Array = induced[case]) -> Array:
                return np.asarray(_speeds(task.module, R, p, rotors, u, x).sum(axis=-1))

            found, points = [], set[SpeedPoint]()
            for shape in shapes:
                inside = partial(_pull_inside, shape, l_arm, asked.speed_reach)
                tops = _climb(inside, air, begins.reshape(len(p), -1, 3))
                found += [x for x in tops if np.isfinite(x).all()]
                if isinstance(shape, Capsule):
                    for i, on_path in enumerate(_nearest_of_path(shape, tops * l_arm) / l_arm):
                        points.add(_point(case, number, on_path, i, shape.radius / l_arm))
            if not found:
                continue
            sums = air(np.array(found))
            points.update(_point(case, number, x) for x in np.array(found)[sums > 0.9 * sums.max()])
            yield Fastest(case, number, asked.speed or math.inf, float(sums.max()), tuple(sorted(points)))


def _point(case: int, exposure: int, from_tip: Array, *of_ball: Any) -> SpeedPoint:
    """Return a point in as many digits as tell it from others."""
    x, y, z = from_tip.round(6).tolist()
    return SpeedPoint(case, exposure, (x, y, z), *of_ball)


class SpeedRows:
    """The air at some points of regions as rows of a program."""

    def __init__(self, task: ResolvedTask, topology: Topology, points: tuple[SpeedPoint, ...]) -> None:
        """Find where their derivatives are not zero; a row has the inputs of its own load case alone."""
        n, m = topology.n, len(points)
        geometric, size = n + 2, 4 * n * len(task.load_cases)
        if task.end_effector.fixed_position is None:
            geometric += 3
        size += geometric
        row = _row(task.module, task.air_density, task.gravity, task.end_effector, topology)
        self._functions = [function.map(m) for function in row]
        data = np.zeros((5 + n, m))
        for r, point in enumerate(points):
            data[:3, r], data[3, r] = point.from_tip, point.radius
            data[4, r] = 1 / (task.exposure[point.exposure].speed or math.inf)
            if point.module >= 0:
                data[5 + point.module, r] = 1.0
        self._data = data
        shift = 4 * n * np.array([point.case for point in points])

        def unknowns(of_row: Indices) -> Indices:
            """Return the indices of unknowns in each row, (m, k)."""
            return np.where(of_row < geometric, of_row, of_row + shift[:, None])

        self._columns = unknowns(np.arange(geometric + 4 * n))
        rows = np.repeat(np.arange(m), geometric + 4 * n)
        self._order = np.lexsort((rows, self._columns.ravel()))
        self.jacobian_pattern = ca.Sparsity.triplet(m, size, rows, self._columns.ravel())
        above, below = (unknowns(np.array(side)) for side in row[2].sparsity_out(0).get_triplet())
        self.hessian_pattern = ca.Sparsity.triplet(size, size, above.ravel(), below.ravel())
        self._places = np.array(self.hessian_pattern.get_nz((above + size * below).ravel()), dtype=np.intp)
        self.lower, self.upper = np.zeros(m), np.full(m, math.inf)

    def values(self, variables: Array) -> Array:
        """Return the rows, each to be at least zero."""
        return np.asarray(self._functions[0](variables[self._columns].T, self._data)).ravel()

    def jacobian(self, variables: Array) -> Array:
        """Return the entries of their Jacobian."""
        return np.asarray(self._functions[1](variables[self._columns].T, self._data)).ravel()[self._order]

    def hessian(self, variables: Array, multipliers: Array) -> Array:
        """Return the entries of the Hessian of their sum, times multipliers."""
        each = np.array(self._functions[2](variables[self._columns].T, self._data).nonzeros())
        weights = np.repeat(multipliers, len(each) // len(multipliers))
        return np.asarray(np.bincount(self._places, weights * each, self.hessian_pattern.nnz()), dtype=float)


@lru_cache(maxsize=8)
def _row(
    module: Module, density: float, gravity: float, tip: EndEffector, topology: Topology
) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return a row, its gradient and the upper triangle of its Hessian, of its unknowns and its data.

    Unknowns are the geometric ones of `nlp.problem.Variables`, then the inputs of the row's load case. The data are
    those of a `SpeedPoint`: `from_tip`, `radius`, one over the limit, and for each module 1 if it is `module`.
    """
    n = topology.n
    geometric = n + 2 + (3 if tip.fixed_position is None else 0)
    unknowns, data = ca.SX.sym("x", geometric + 4 * n), ca.SX.sym("data", 5 + n)
    placed = poses(topology, unknowns[:3], unknowns[3 : n + 2], module.connector_distance / module.arm_length)
    p_E, _ = tip_and_com(module, tip, topology, placed, unknowns[n + 2 : n + 5])
    x = p_E + data[:3]
    p = sum(data[5 + i] * pose.p for i, pose in enumerate(placed))
    z = sum(data[5 + i] * pose.z for i, pose in enumerate(placed))
    towards = p + z * ca.dot(x - p, z) - x
    x += towards * data[3] / _soft_max(ca.sqrt(ca.sumsqr(towards) + 1e-12), data[3])
    total = ca.SX(0)
    for i, pose in enumerate(placed):
        away, u = pose.R.T @ (x - pose.p), unknowns[geometric + 4 * i : geometric + 4 * (i + 1)]
        v = [_induced_speeds(module, density, (u[q] + 1e-6) * module.hover_input(gravity)) for q in range(4)]
        by_rotor = [(away[0] - a) ** 2 + (away[1] - b) ** 2 for a, b, _ in ROTOR_DIRECTIONS]
        parts = _parts(module, v, -away[2], away[0] ** 2 + away[1] ** 2, by_rotor, ROUNDED)
        total += sum(part**NORM for part in parts) ** (1 / NORM)
    hessian, gradient = ca.hessian(AIMED_AT - total * data[4], unknowns)
    values = AIMED_AT - total * data[4], ca.densify(gradient.T), ca.triu(hessian)
    first, second, third = (ca.Function("row", [unknowns, data], [value]) for value in values)
    return first, second, third


def _induced_speeds(module: Module, density: float, u: Any) -> Any:
    """Return v_q of squared rotor speeds [rad^2/s^2]."""
    disc = math.pi * module.body.rotor_radius**2
    return (module.thrust_coefficient / (2 * density * disc) * u) ** 0.5


def _speeds(module: Module, R: Array, p: Array, rotors: Array, induced: Array, x: Array) -> Array:
    """Return every module's speed at points, shape (m, n) [m/s]."""
    away = x[:, None] - p
    depth = -np.einsum("mix,ix->mi", away, R[:, :, 2])
    on_axis = away + depth[..., None] * R[:, :, 2]
    from_rotors = on_axis[:, :, None] - (rotors - p[:, None])
    by_rotor = list(np.moveaxis(np.sum(from_rotors**2, axis=-1), -1, 0))
    parts = _parts(module, list(induced.T), depth, np.sum(on_axis**2, axis=-1), by_rotor, EXACT)
    return np.asarray(np.max(np.broadcast_arrays(*parts), axis=0))


def _parts(
    module: Module,
    v: list[Any],
    z: Any,
    beside: Any,
    by_rotor: list[Any],
    bends: Bends,
) -> list[Any]:
    """Return the speeds of a module's parts at a point, of numbers or of symbols.

    Args:
        module: one of the task.
        v: v_q.
        z: depth of the point.
        beside: r^2.
        by_rotor: r_q^2.
        bends: exact ones for numbers, rounded ones for symbols.
    """
    clip, larger, begin = bends
    jet, R = module.airflow.jet, module.body.rotor_radius / module.arm_length
    s = z / 2
    from_origin = larger(s, MERGED_AT) + jet.origin
    U_H = (sum(each * each for each in v) / 4) ** 0.5
    profile = 1 + (math.sqrt(2) - 1) * beside / (2 * jet.half_width * from_origin) ** 2
    far = clip(s / MERGED_AT) * jet.decay * U_H / from_origin / profile**2
    below = 2 * MERGED_AT * clip(z / (2 * MERGED_AT))
    g = 1 + below / (R * R + below * below) ** 0.5
    fade = clip((MERGED_AT - s) / 1.5) * begin(z)
    radii = [(each + 1e-12) ** 0.5 for each in by_rotor]
    near = [
        each * g * fade * clip(0.5 + (R / g**0.5 - r) / (0.2 * (below + R)))
        for each, r in zip(v, radii, strict=True)
    ]
    distances = [(larger(r - R, 0.0) ** 2 + z * z + 1e-12) ** 0.5 for r in radii]
    inflow = sum(each / (1 + math.sqrt(2) * d / R) ** 2 for each, d in zip(v, distances, strict=True))
    return [far, *near, inflow]


class Bends(NamedTuple):
    """Functions with bends."""

    clip: Callable[[Any], Any]
    """A number within [0, 1]."""
    larger: Callable[[Any, float], Any]
    """The larger of two numbers."""
    begin: Callable[[Any], Any]
    """1 below the discs, at positive depths, 0 above."""


def _soft_clip(t: ca.SX) -> ca.SX:
    """Return t within [0, 1], and from 1 on no less than 1."""
    return _soft_step(t) / _soft_step(ca.SX(1))


def _soft_step(t: ca.SX) -> ca.SX:
    step: ca.SX = ca.sqrt(t * t + SOFTNESS**2) - ca.sqrt((t - 1) ** 2 + SOFTNESS**2) + 1
    return step


def _soft_max(a: ca.SX, b: ca.SX | float) -> ca.SX:
    return (a + b + ca.sqrt((a - b) ** 2 + SOFTNESS**2)) / 2


EXACT = Bends(partial(np.clip, a_min=0.0, a_max=1.0), np.maximum, lambda z: np.where(z >= 0, 1.0, 0.0))
ROUNDED = Bends(_soft_clip, _soft_max, lambda z: _soft_clip(1 + z / SOFTNESS))


def _climb(inside: Callable[[Array], Array], air: Callable[[Array], Array], begins: Array) -> Array:
    """Return where searches for faster air among neighbours end, in a region.

    Args:
        inside: pulls points into the region; those that it cannot are no numbers.
        air: the speed at points.
        begins: of each search some points, (k, m, 3), of which the fastest is where it begins.

    Returns:
        Shape (k, 3); no numbers where none of the points comes into the region.
    """

    def fastest_of(tried: Array) -> Array:
        tried = inside(tried.reshape(-1, 3)).reshape(tried.shape)
        speed = np.where(
            np.isnan(tried[..., 0]), -1.0, air(np.nan_to_num(tried).reshape(-1, 3)).reshape(tried.shape[:2])
        )
        return np.asarray(tried[np.arange(len(tried)), speed.argmax(axis=1)])

    around = np.array(sorted(product((-1.0, 0.0, 1.0), repeat=3), key=lambda step: np.linalg.norm(step)))
    x = fastest_of(begins)
    for step in STEPS:
        moving = np.isfinite(x[:, 0])
        for _ in range(4):
            best = fastest_of(x[moving, None] + step * around)
            moving[moving] = changed = (best != x[moving]).any(axis=1)
            x[moving] = best[changed]
            if not moving.any():
                break
    return x


def _pull_inside(shape: Shape, l_arm: float, within: float | None, x: Array) -> Array:
    """Return points of a region near points, (m, 3), from p'_E [l_arm]; no numbers where it is beyond `within`."""
    x = _nearest(shape, x * l_arm)
    if within is None:
        return x / l_arm
    for _ in range(PULLS):
        x = _nearest(shape, x * np.minimum(1.0, within / np.maximum(np.linalg.norm(x, axis=1), within))[:, None])
    reached = np.linalg.norm(x, axis=1, keepdims=True) <= within * (1 + 1e-6)
    return np.where(reached, x / l_arm, np.nan)


def _nearest(shape: Shape, x: Array) -> Array:
    """Return points of a region near points, (m, 3) [m]; those inside stay."""
    match shape:
        case Capsule(radius=radius):
            axis = _nearest_of_path(shape, x)
            away = np.linalg.norm(x - axis, axis=1, keepdims=True)
            return np.asarray(axis + (x - axis) * (radius / np.maximum(away, radius)))
        case Polytope(corners=corners):
            hull = hull_of(corners)
            middle = hull.corners.mean(axis=0)
            room = hull.offsets - hull.normals @ middle
            beyond = np.max((x - middle) @ hull.normals.T / room, axis=1, keepdims=True)
            return np.asarray(middle + (x - middle) / np.maximum(beyond, 1.0))
        case Cone(half_angle_deg=half_angle, axis=axis, apex=apex):
            d, angle = np.array(axis), math.radians(half_angle)
            along = (x - apex) @ d
            beside = x - apex - along[:, None] * d
            r = np.linalg.norm(beside, axis=1)
            depth = np.maximum(along * math.sin(angle) - r * math.cos(angle), 0.0)
            some = np.cross(d, np.eye(3)[np.argmin(np.abs(d))])
            out = np.where(r[:, None] > 0, beside / np.maximum(r, 1e-300)[:, None], some / np.linalg.norm(some))
            return np.asarray(x - depth[:, None] * (math.sin(angle) * d - math.cos(angle) * out))


def _nearest_of_path(capsule: Capsule, x: Array) -> Array:
    """Return the points of a capsule's path nearest to points, (m, 3) [m]."""
    path = np.subtract(capsule.end, capsule.start)
    along = np.clip((x - capsule.start) @ path / max(path @ path, 1e-300), 0.0, 1.0)
    return np.asarray(capsule.start + along[:, None] * path)
