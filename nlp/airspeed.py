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

Over a region counts the sum of all modules' speeds. A program has it at points of the region where air is fastest,
taken in as a solve leaves them too fast; there the largest of the parts is their 8-norm, which is no less. Points
of a ball move with a module, or the platform would turn away from them at no cost; others are fixed from the
end-effector.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from nlp import names
from nlp.numbers.point import Point
from nlp.requirements.exposure import hull_of
from topo_search.model import ResolvedTask
from topo_search.model.arrays import Array
from topo_search.model.layout import ROTOR_DIRECTIONS
from topo_search.model.shape import Capsule, Cone, Polytope, Shape

AIMED_AT = 0.997
"""Share of a limit that rows state: what is faster between their points is within the limit."""
ALLOWED = 0.998
"""Share of a limit up to which a design meets it: the audit's bound over the whole region is still under it."""


class AirSearch(NamedTuple):
    """The search for the fastest air over a region."""

    depths: Array = np.concatenate([[0.0], np.geomspace(0.1, 60.0, 30)])
    """Depths at which a search for the fastest air begins [l_arm]."""
    steps: Array = np.asarray(0.5 ** np.arange(1, 16))
    """Steps of that search [l_arm]."""
    pulls: int = 30
    """Number of projections, in turns, that bring a point into a region and a ball."""


SEARCH = AirSearch()


class SpeedPoint(NamedTuple):
    """A point of a region that a program states, in a load case."""

    case: int
    exposure: int
    from_tip: tuple[float, float, float]
    """From p'_E [l_arm]."""
    module: int = -1
    """Instead of that point: one of a ball around it that moves with this module."""
    radius: float = 0.0
    """Radius of the ball [l_arm]."""
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Direction of the point from there: along the shortest way to the module's axis, across both, along it."""


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
    from nlp.numbers.jets import jet_of, total_speeds  # compiled code, which other commands need not load

    (R, p), tip = point.poses, point.p_E / l_arm
    p = p / l_arm - tip
    rotors = p[:, None] + np.einsum("iab,qb->iqa", R, ROTOR_DIRECTIONS)
    origins = np.concatenate([p[:, None], rotors], axis=1)
    begins = origins[:, :, None] - SEARCH.depths[:, None] * R[:, None, None, :, 2]
    jet = jet_of(task.module, task.air_density, task.gravity)
    induced = jet.induced * np.sqrt(point.u / task.module.hover_input(task.gravity))
    for number, asked in limited:
        shapes = [shape.at(point.p_E - point.p_COM) for shape in asked.shapes]
        for case in range(len(task.declared.load_cases)):
            air = partial(total_speeds, jet, R, p, induced[case])
            found, points = dict[SpeedPoint, Array](), set[SpeedPoint]()
            for shape in shapes:
                inside = partial(_pull_inside, shape, l_arm, asked.speed_reach)
                tops = _climb(inside, air, begins.reshape(len(p), -1, 3))
                if isinstance(shape, Capsule):
                    radius = shape.radius / l_arm
                    for i, on_path in enumerate(_nearest_of_path(shape, tops * l_arm) / l_arm):
                        points.add(_point(case, number, on_path, i, radius))
                        direction = _direction(on_path, radius, R[i, :, 2], p[i], tops[i])
                        moving = () if direction is None else (i, radius, direction)
                        found[_point(case, number, tops[i] if direction is None else on_path, *moving)] = tops[i]
                else:
                    found |= {_point(case, number, x): x for x in tops if np.isfinite(x).all()}
            if not found:
                continue
            sums = air(np.array(list(found.values())))
            points.update(point for point, sum_ in zip(found, sums, strict=True) if sum_ > 0.9 * sums.max())
            yield Fastest(case, number, asked.speed or math.inf, float(sums.max()), tuple(sorted(points)))


def _point(case: int, exposure: int, from_tip: Array, *of_ball: Any) -> SpeedPoint:
    """Return a point in as many digits as tell it from others."""
    x, y, z = from_tip.round(6).tolist()
    return SpeedPoint(case, exposure, (x, y, z), *of_ball)


def _direction(centre: Array, radius: float, z: Array, p: Array, x: Array) -> tuple[float, ...] | None:
    """Return `SpeedPoint.direction` of a point of a ball; None where the module's axis is as near as that."""
    w = p + z * ((centre - p) @ z) - centre
    length = np.linalg.norm(w)
    if length <= radius:
        return None
    frame = np.array([w / length, np.cross(z, w) / length, z])
    return tuple((frame @ (x - centre) / radius).round(6).tolist())


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
    for step in SEARCH.steps:
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
    for _ in range(SEARCH.pulls):
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
