"""Air speeds of a design at its tip, through its rotors, and by certified bounds over whole regions.

Speeds are the sum of all modules'. A cube about the region is cut into eight again and again. In the ball around a
cube every module's speed is bounded (`verify.air.jets`). A cube outside the region is dropped, and one whose bound
is under `enough` times the largest speed that was found at a point of the region; what is dropped is remembered. So
the result is at least every speed in the region, and at most `enough` times one of them unless cubes run out.
Points alone prove nothing.

Of a region without end all that is farther than D is dropped where the jets' decay bounds it.

A rotor loses 0.05 of its thrust per m/s of wake along its axis: 0.04 to 0.06 s/m were measured of two quadrotors
one above the other (arXiv 2507.09463). Averages over a disc are of degree 5 (Abramowitz and Stegun, 25.4.61).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from topo_search.model import Design, Residual, Status
from topo_search.model.audit import AirSpeeds, CaseAir, RegionAir, RotorAir
from topo_search.model.exposure import Exposure
from verify.air.jets import MODEL, Jets, jets, speeds, wakes
from verify.bodies import Array, Cone, ConeSphere, ball, nearest_on_axis
from verify.certificate import Solid
from verify.hulls import Hull
from verify.meshes import LARGEST_COORDINATE
from verify.requirements import Scene
from verify.residuals import clamp, residual


class SpeedSearch(NamedTuple):
    """The branch and bound on the air speed over a region."""

    enough: float = 1.02
    """Bound over the largest speed found at which a cube needs no more cutting."""
    most_cubes: int = 300_000
    """Cubes of one region, of one module; with more modules fewer."""
    chunk: int = 50_000
    """Cubes times modules that are evaluated at once."""
    rounding: float = 1e-9
    """Relative excess of a bound over what rounding may take from it."""
    inside: float = 1e-12
    """Relative distance of points from the surface of their region, inside it."""
    pulls: int = 6
    """Number of projections onto faces that bring a point near a polytope."""
    steep: float = 0.95
    """Cosine of the angle to a jet's axis within which its far field is bounded by its speed on the axis."""
    not_less: float = 1e-6
    """Least speed that matters [m/s]."""


SEARCH = SpeedSearch()


class SpeedBound(NamedTuple):
    """The air over a region [m/s]."""

    at_least: float
    """Speed at `point`, the largest that was found."""
    at_most: float
    """Proven: no point of the region has more."""
    point: Array
    """Shape (3,) [l_arm]."""


def bound_speed(
    air: Jets, region: Solid | Cone | Hull, *, limit: float = math.inf, within: ConeSphere | None = None
) -> SpeedBound:
    """Return the air over a region.

    Args:
        air: the modules.
        region: a capsule, a polytope, or all that is outside a cone [l_arm].
        limit: speed that is allowed; a bound below it is near enough, however near the largest speed is [m/s].
        within: a ball, outside which the region does not count.
    """
    speed, best, dropped = 0.0, np.full(3, np.nan), 0.0
    cubes, half = _first_cubes(air, region) if within is None else (within.o[None], within.r)
    if within is None and isinstance(region, Cone):
        dropped = bound_beyond(air, region.apex, half) * (1 + SEARCH.rounding)
    left = SEARCH.most_cubes / len(air.centres)
    while len(cubes):
        cubes = cubes[_reaches(region, cubes, math.sqrt(3) * half)]
        if within is not None:
            cubes = cubes[_reaches(Solid(within), cubes, math.sqrt(3) * half)]
        bounds = np.zeros(len(cubes))
        for chunk in np.array_split(
            np.arange(len(cubes)), math.ceil(len(cubes) * len(air.centres) / SEARCH.chunk) or 1
        ):
            points = _points_in(region, cubes[chunk])
            if within is not None:
                points = points[np.linalg.norm(points - within.o, axis=1) < within.r]
            sums = speeds(air, points).sum(axis=1)
            if (most := float(sums.max(initial=-1.0))) >= speed:
                speed, best = most, points[int(np.argmax(sums))]
            bounds[chunk] = speeds(air, cubes[chunk], math.sqrt(3) * half).sum(axis=1) * (1 + SEARCH.rounding)
        left -= len(cubes)
        enough = limit if speed <= limit < SEARCH.enough * speed else max(SEARCH.enough * speed, SEARCH.not_less)
        settled = (bounds <= enough) | (left < 0)
        dropped = max(dropped, float(bounds[settled].max(initial=0.0)))
        half /= 2
        eighths = half * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # their centres from the cube's
        cubes = (cubes[~settled][:, None] + eighths).reshape(-1, 3)
    return SpeedBound(speed, max(dropped, speed * (1 + SEARCH.rounding)), best)


def _first_cubes(air: Jets, region: Solid | Cone | Hull) -> tuple[Array, float]:
    """Return a cube around what of the region is near enough to matter: its centre, (1, 3), and half edge."""
    if isinstance(region, Cone):
        return region.apex[None], _reach(air, region)
    if isinstance(region, Hull):
        low, high = region.mesh.vertices.min(axis=0), region.mesh.vertices.max(axis=0)
    else:
        endpoints, r = np.stack([region.body.o, region.body.o + region.body.d]), region.body.r + region.body.dr
        low, high = endpoints.min(axis=0) - r, endpoints.max(axis=0) + r
    return ((low + high) / 2)[None], float((high - low).max()) / 2


def _reach(air: Jets, region: Cone) -> float:
    """Return a distance from the apex beyond which no speed is more than one that is found nearer by."""
    distance = (
        4 * float(np.linalg.norm(air.centres - region.apex, axis=1).max()) + 4 * MODEL.merged_at * MODEL.diameter
    )
    grid = region.apex + distance * np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    points = _points_in(region, np.concatenate([grid, air.centres, air.rotors.reshape(-1, 3)]))
    fastest = max(float(speeds(air, points).sum(axis=1).max()), SEARCH.not_less)
    while bound_beyond(air, region.apex, distance) > fastest:
        distance *= 2
    return distance


def bound_beyond(air: Jets, x: Array, distance: float) -> float:
    """Return a bound of the sum of speeds wherever that is farther from x than a distance.

    Such a point is at least D away from a module. Either it is deeper than `steep` D, or it is at least
    sqrt(1 - `steep`^2) D beside the axis, where speeds are below U_c (a r^2 / r_half^2)^-2, which grows with depth.
    The slipstreams of single rotors have ended.
    """
    D = distance - np.linalg.norm(air.centres - x, axis=1)
    if D.min() < 2 * (MODEL.merged_at * MODEL.diameter + 1 + 2 * air.radius):
        return math.inf
    s = SEARCH.steep * D / MODEL.diameter + air.origin
    steep = air.decay * air.merged / s
    beside = math.sqrt(1 - SEARCH.steep**2) * D / (air.half_width * s * MODEL.diameter)
    flat = steep / ((math.sqrt(2) - 1) * beside**2) ** 2
    from_disc = D - 1 - air.radius
    inflow = air.induced.sum(axis=1) / (1 + math.sqrt(2) * from_disc / air.radius) ** 2
    return float(np.maximum(np.maximum(steep, flat), inflow).sum())


def _reaches(region: Solid | Cone | Hull, x: Array, h: float) -> Array:
    """Return which balls of radius h about x, (m, 3), may meet the region; those that do not are not in it."""
    slack = h + SEARCH.rounding * (h + float(np.abs(x).max(initial=0.0)))
    if isinstance(region, Cone):
        return np.asarray(region.s(x) <= slack)
    if isinstance(region, Hull):
        return np.asarray((x @ region.normals.T - region.offsets).max(axis=1) <= slack)
    return np.asarray(region.body.depth(x) >= -slack)


def _points_in(region: Solid | Cone | Hull, x: Array) -> Array:
    """Return points of the region near points x, (m, 3): x itself where that is in it."""
    if isinstance(region, Cone):
        depth = np.maximum(region.s(x) + SEARCH.inside * (1 + np.abs(x - region.apex).max(axis=1)), 0.0)
        return np.asarray(x - depth[:, None] * region.inward_normal(x))
    if isinstance(region, Hull):
        for _ in range(SEARCH.pulls):
            beyond = x @ region.normals.T - region.offsets
            face = np.argmax(beyond, axis=1)
            x = x - np.maximum(beyond[np.arange(len(x)), face], 0.0)[:, None] * region.normals[face]
        away = x - region.centre
        rate = away @ region.normals.T
        room = region.offsets - region.normals @ region.centre
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(rate > 0, room / rate, np.inf).min(axis=1)
        return np.asarray(region.centre + np.minimum(share, 1.0)[:, None] * (1 - SEARCH.inside) * away)
    body = region.body
    eta = nearest_on_axis(body.o - x, np.broadcast_to(body.d, x.shape), body.dr)
    nearest, radius = body.o + eta[:, None] * body.d, body.r + eta * body.dr
    away = x - nearest
    share = radius / np.maximum(np.linalg.norm(away, axis=1), radius) * (1 - SEARCH.inside)
    return np.asarray(nearest + share[:, None] * away)


DISC = math.sqrt(2 / 3) * np.array([(0.0, 0.0), *((np.cos(a), np.sin(a)) for a in np.arange(6) * math.pi / 3)])
"""Points of the unit disc, shape (7, 2)."""


def air(scene: Scene) -> AirSpeeds | None:
    """Return the air of a design in every load case; None if its numbers are too large to compute with."""
    if not (
        np.isfinite(scene.design.inputs).all() and np.abs([*scene.centres, scene.p_E]).max() < LARGEST_COORDINATE
    ):
        return None
    return AirSpeeds(cases=tuple(_case(name, scene, blown) for name, blown in case_jets(scene)))


def case_jets(scene: Scene) -> Iterator[tuple[str, Jets]]:
    """Yield every load case's name and its jets, in the coordinates of the scene."""
    task, platform = scene.design.task, scene.platform
    rotors = scene.centres[:, None] + (platform.rotors - platform.o[:, None]) / scene.l_arm
    inputs = scene.design.inputs.reshape(-1, len(scene.centres), 4)
    for name, u in zip(task.case_labels, inputs, strict=True):
        yield name, jets(task.module, task.air_density, scene.centres, scene.R, rotors, u)


def speed_residuals(design: Design, measured: AirSpeeds | None) -> Iterator[Residual]:
    """Yield the air over every region whose speed is limited, in every load case: how far its bound is above."""
    for number, exposure in enumerate(design.task.exposure):
        if exposure.speed is None:
            continue
        for k, label in enumerate(design.task.case_labels):
            region = None if measured is None else measured.cases[k].regions[number]
            status = Status(region.status) if region is not None and region.status else Status.UNDECIDED
            at_most = math.inf if region is None else region.speed_at_most_m_s
            excess = 0.0 if status is Status.CLEAR else at_most - exposure.speed
            name, limits = f"air over exposure {number} ({exposure.kind}), {label}", {"derived": at_most}
            limits |= {"tolerance": 0.0, "claim": exposure.speed}
            yield residual(name, excess, "m/s", exposure.speed, status=status, **limits)


def _case(name: str, scene: Scene, blown: Jets) -> CaseAir:
    at_tip = speeds(blown, scene.p_E[None])[0]
    return CaseAir(
        name=name,
        tip_m_s=clamp(float(at_tip.sum())),
        tip_estimate_m_s=clamp(float(np.linalg.norm(at_tip))),
        regions=tuple(_region(number, one, scene, blown) for number, one in enumerate(scene.design.task.exposure)),
        rotors=tuple(_rotors(blown)),
    )


def _region(number: int, exposure: Exposure, scene: Scene, blown: Jets) -> RegionAir:
    limit, within = exposure.speed, exposure.speed_reach
    near = None if within is None else ball(scene.p_E, within / scene.l_arm)
    bounds = [
        bound_speed(blown, region, limit=math.inf if limit is None else limit, within=near)
        for _, region in scene.regions(exposure)
    ]
    largest = max(bounds, key=lambda bound: bound.at_least, default=SpeedBound(0.0, 0.0, scene.p_E))
    at_most = max((bound.at_most for bound in bounds), default=math.inf)
    status: Literal["clear", "undecided", "violated"] | None = None
    if limit is not None:
        status = "clear" if at_most <= limit else "violated" if largest.at_least > limit else "undecided"
    return RegionAir(
        name=f"exposure {number} ({exposure.kind})",
        speed_m_s=clamp(largest.at_least),
        speed_at_most_m_s=clamp(at_most),
        estimate_m_s=clamp(float(np.linalg.norm(speeds(blown, largest.point[None])))) if largest.at_least else 0.0,
        limit_m_s=limit,
        status=status,
    )


def _rotors(blown: Jets) -> list[RotorAir]:
    """Return what other modules' wakes do to every rotor."""
    rows = []
    for module, (R, discs) in enumerate(zip(blown.poses, blown.rotors, strict=True)):
        others = blown.drop(module)
        points = discs[:, None] + blown.radius * DISC @ R[:, :2].T
        weights = np.array([2.0, *[1.0] * 6]) / 8  # of the disc's points in its average
        through = weights @ wakes(others, points.reshape(-1, 3)).reshape(4, len(DISC), len(others.centres))
        along = np.maximum(through @ (others.axes @ R[:, 2]), 0.0)
        rows += [
            RotorAir(
                module=module, rotor=q, ingested_m_s=clamp(float(sum_)), thrust_loss=min(1.0, 0.05 * float(axial))
            )
            for q, (sum_, axial) in enumerate(zip(through.sum(axis=1), along, strict=True))
        ]
    return rows
