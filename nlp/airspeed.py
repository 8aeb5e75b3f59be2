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
of the parts is the root of the sum of their squares, which is no less.
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
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.layout import ROTOR_DIRECTIONS
from topo_search.model.shape import Capsule, Cone, Polytope, Shape

AIMED_AT = 0.997
"""Share of a limit that rows state: what is faster between their points is within the limit."""
ALLOWED = 0.998
"""Share of a limit up to which a design meets it: the audit's bound over the whole region is still under it."""
ALONG_AXIS = np.concatenate([[0.0], np.geomspace(0.1, 60.0, 30)])
"""Depths at which a search for the fastest air begins [l_arm]."""
STEPS = 0.5 ** np.arange(1, 16)
"""Steps of that search [l_arm]."""
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
    induced = _induced_speeds(task, point.u)
    for number, asked in limited:
        shapes = [shape.at(point.p_E - point.p_COM) for shape in asked.shapes]
        for case in range(len(task.declared.load_cases)):

            def air(x: Array, u: Array = induced[case]) -> Array:
                return np.asarray(_speeds(task, R, p, rotors, u, x).sum(axis=-1))

            found, points = [], set[SpeedPoint]()
            for shape in shapes:
                inside = partial(_pull_inside, shape, l_arm, asked.speed_reach)
                for i, at in enumerate(begins):
                    begin = inside(at.reshape(-1, 3))
                    if len(begin):
                        found.append(_climb(inside, air, begin[int(np.argmax(air(begin)))]))
                        if isinstance(shape, Capsule):
                            on_path = _nearest_of_path(shape, found[-1][None] * l_arm)[0] / l_arm
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
        """State them as expressions of the task's unknowns, those of its corners included."""
        n, K, unit, module = topology.n, len(task.load_cases), Units.of(task), task.module
        first = n + 2 + (3 if task.end_effector.fixed_position is None else 0)
        self.x = ca.SX.sym("x", first + 4 * n * K)
        """The unknowns of `nlp.problem.Variables` as one column."""
        placed = poses(topology, self.x[:3], self.x[3 : n + 2], module.connector_distance / unit.length)
        tip, _ = tip_and_com(task, topology, placed, self.x[n + 2 : n + 5])
        air, rows = _symbolic_speed(task), []
        for point in points:
            limit, total = task.exposure[point.exposure].speed or math.inf, ca.SX(0)
            x = tip + ca.DM(point.from_tip)
            if point.module >= 0:
                pose = placed[point.module]
                towards = pose.p + pose.z * ca.dot(x - pose.p, pose.z) - x
                x += towards * point.radius / _soft_max(ca.sqrt(ca.sumsqr(towards) + 1e-12), point.radius)
            for i, pose in enumerate(placed):
                u = self.x[first + 4 * (n * point.case + i) : first + 4 * (n * point.case + i + 1)]
                total += air(pose.R.T @ (x - pose.p), u)
            rows.append(AIMED_AT - total / limit)
        self.g = ca.vertcat(*rows)
        """The rows, each at least zero."""
        self.bounds = np.zeros(len(rows)), np.full(len(rows), math.inf)
        """Least and largest value of each."""


@lru_cache(maxsize=8)
def _symbolic_speed(task: ResolvedTask) -> ca.Function:
    """Return a module's speed as a function of a point in its frame [l_arm] and its inputs [u_hover]."""
    away, u = ca.SX.sym("away", 3), ca.SX.sym("u", 4)
    v = [_induced_speeds(task, (u[q] + 1e-6) * Units.of(task).input) for q in range(4)]
    by_rotor = [(away[0] - x) ** 2 + (away[1] - y) ** 2 for x, y, _ in ROTOR_DIRECTIONS]
    parts = _parts(task, v, -away[2], away[0] ** 2 + away[1] ** 2, by_rotor, ROUNDED)
    return ca.Function("air", [away, u], [ca.sqrt(sum(part * part for part in parts))])


def _induced_speeds(task: ResolvedTask, u: Any) -> Any:
    """Return v_q of squared rotor speeds [rad^2/s^2]."""
    disc = math.pi * task.module.body.rotor_radius**2
    return (task.module.thrust_coefficient / (2 * task.air_density * disc) * u) ** 0.5


def _speeds(task: ResolvedTask, R: Array, p: Array, rotors: Array, induced: Array, x: Array) -> Array:
    """Return every module's speed at points, shape (m, n) [m/s]."""
    away = x[:, None] - p
    depth = -np.einsum("mix,ix->mi", away, R[:, :, 2])
    on_axis = away + depth[..., None] * R[:, :, 2]
    from_rotors = on_axis[:, :, None] - (rotors - p[:, None])
    by_rotor = list(np.moveaxis(np.sum(from_rotors**2, axis=-1), -1, 0))
    parts = _parts(task, list(induced.T), depth, np.sum(on_axis**2, axis=-1), by_rotor, EXACT)
    return np.asarray(np.max(np.broadcast_arrays(*parts), axis=0))


def _parts(
    task: ResolvedTask,
    v: list[Any],
    z: Any,
    beside: Any,
    by_rotor: list[Any],
    bends: Bends,
) -> list[Any]:
    """Return the speeds of a module's parts at a point, of numbers or of symbols.

    Args:
        task: the task.
        v: v_q.
        z: depth of the point.
        beside: r^2.
        by_rotor: r_q^2.
        bends: exact ones for numbers, rounded ones for symbols.
    """
    clip, larger, begin = bends
    jet, R = task.module.airflow.jet, task.module.body.rotor_radius / task.module.arm_length
    s = z / 2
    from_origin = larger(s, 2.5) + jet.origin
    U_H = (sum(each * each for each in v) / 4) ** 0.5
    profile = 1 + (math.sqrt(2) - 1) * beside / (2 * jet.half_width * from_origin) ** 2
    far = clip(s / 2.5) * jet.decay * U_H / from_origin / profile**2
    below = 5 * clip(z / 5)
    g = 1 + below / (R * R + below * below) ** 0.5
    fade = clip((2.5 - s) / 1.5) * begin(z)
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


def _soft_max(a: ca.SX, b: float) -> ca.SX:
    return (a + b + ca.sqrt((a - b) ** 2 + SOFTNESS**2)) / 2


EXACT = Bends(partial(np.clip, a_min=0.0, a_max=1.0), np.maximum, lambda z: np.where(z >= 0, 1.0, 0.0))
ROUNDED = Bends(_soft_clip, _soft_max, lambda z: _soft_clip(1 + z / SOFTNESS))


def _climb(inside: Callable[[Array], Array], air: Callable[[Array], Array], x: Array) -> Array:
    """Return where a search for faster air among neighbours ends, in a region."""
    around = np.array(sorted(product((-1.0, 0.0, 1.0), repeat=3), key=lambda step: np.linalg.norm(step)))
    for step in STEPS:
        for _ in range(4):
            tried = inside(x + step * around)
            best = tried[int(np.argmax(air(tried)))]
            if np.array_equal(best, x):
                break
            x = best
    return x


def _pull_inside(shape: Shape, l_arm: float, within: float | None, x: Array) -> Array:
    """Return points of a region near points, (m, 3), from p'_E [l_arm]; none that stay farther than `within`."""
    x = _nearest(shape, x * l_arm)
    if within is None:
        return x / l_arm
    for _ in range(PULLS):
        x = _nearest(shape, x * np.minimum(1.0, within / np.maximum(np.linalg.norm(x, axis=1), within))[:, None])
    return np.asarray(x[np.linalg.norm(x, axis=1) <= within * (1 + 1e-6)] / l_arm)


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
