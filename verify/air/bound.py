"""Air speeds of a design at its tip and through its rotors, and certified bounds over whole regions.

The speed at a point is the sum of the speeds of all modules. Branch and bound: a cube around the region is split
into eight recursively, and the speed of each module is bounded in the ball around a cube (`verify.air.jets`). A
cube is pruned if it lies outside the region, or if its bound is below `enough` times the largest speed sampled in
the region; the largest pruned bound is kept. So the result is an upper bound on every speed in the region, and at
most `enough` times an attained speed unless the limit on cubes is reached.

In an unbounded region, everything beyond a distance D is pruned by the decay of the jets.

A rotor with the induced speed v_q in a load case loses the share wake_loss V / v_q of its thrust to a wake with the
component V along its axis, at most all of it; a rotor at rest has none to lose. The law is that of Su et al. (arXiv
2207.09645, Eq. 5), linear in V, and its coefficient a field of the module. At a fixed rotor speed blade-element
theory gives K / (K + 4 v_q / (omega R)), with K = sigma a / 4 of solidity and lift slope: 0.37 for K = 0.21 and the
default rotor in hover. Averages over a disc are of degree 5 (Abramowitz and Stegun, 25.4.61).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from topo_search.model import Array, Module, Residual, Status
from topo_search.model.air import AirSpeeds, CaseAir, RegionAir, RotorAir
from topo_search.model.exposure import Exposure
from topo_search.model.rotors import UP
from verify.air.jets import MODEL, Jets, far_field, jets, sink, speeds, wakes
from verify.bodies import AllowedCone, ConeSphere, ball, basis_across, nearest_on_axis
from verify.certificate import RoundBody
from verify.hulls import HullBody
from verify.meshes import LARGEST_COORDINATE
from verify.requirements import Scene
from verify.residuals import clamp, residual
from verify.sections import Findings


class SpeedSearch(NamedTuple):
    """Settings of the branch and bound on the air speed over a region."""

    enough: float = 1.02
    """Ratio of a cube's bound to the largest sampled speed at which it is pruned."""
    most_cubes: int = 300_000
    """Largest number of cubes per region, divided by the number of modules."""
    chunk: int = 50_000
    """Number of cubes times modules evaluated at once."""
    rounding: float = 1e-9
    """Relative margin of a bound for rounding."""
    inside: float = 1e-12
    """Relative inward distance of sample points from the region's surface."""
    projections: int = 6
    """Number of projections onto faces that move a point towards a polytope."""
    slices: int = 64
    """Number of slices of depth in which the far field beyond a distance is bounded."""
    least_speed: float = 1e-6
    """Smallest speed that matters [m/s]."""


SEARCH = SpeedSearch()


class SpeedBound(NamedTuple):
    """Bounds on the largest air speed in a region [m/s]."""

    at_least: float
    """Speed at `point`, the largest sampled."""
    at_most: float
    """Proven upper bound."""
    point: Array
    """Shape (3,) [l_arm]."""


def bound_speed(
    air: Jets,
    region: RoundBody | AllowedCone | HullBody,
    *,
    limit: float = math.inf,
    within: ConeSphere | None = None,
) -> SpeedBound:
    """Return bounds on the largest air speed in a region.

    Args:
        air: the jets of the modules.
        region: a capsule, a polytope, or the outside of a cone [l_arm].
        limit: allowed speed [m/s]; a bound below it needs no refinement.
        within: a ball to which the region is restricted.
    """
    speed, best, pruned = 0.0, np.full(3, np.nan), 0.0
    cubes, half = _first_cubes(air, region) if within is None else (within.o[None], within.r)
    if within is None and isinstance(region, AllowedCone):
        pruned = bound_beyond(air, region.apex, half) * (1 + SEARCH.rounding)
    remaining = SEARCH.most_cubes / len(air.centres)
    while len(cubes):
        cubes = cubes[_may_meet(region, cubes, math.sqrt(3) * half)]
        if within is not None:
            cubes = cubes[_may_meet(RoundBody(within), cubes, math.sqrt(3) * half)]
        bounds = np.zeros(len(cubes))
        for chunk in np.array_split(
            np.arange(len(cubes)), math.ceil(len(cubes) * len(air.centres) / SEARCH.chunk) or 1
        ):
            points = _points_in(region, cubes[chunk])
            if within is not None:
                points = points[np.linalg.norm(points - within.o, axis=1) < within.r]
            sums = speeds(air, points).sum(axis=1)
            if (fastest := float(sums.max(initial=-1.0))) >= speed:
                speed, best = fastest, points[int(np.argmax(sums))]
            bounds[chunk] = speeds(air, cubes[chunk], math.sqrt(3) * half).sum(axis=1) * (1 + SEARCH.rounding)
        remaining -= len(cubes)
        enough = limit if speed <= limit < SEARCH.enough * speed else max(SEARCH.enough * speed, SEARCH.least_speed)
        is_pruned = (bounds <= enough) | (remaining < 0)
        pruned = max(pruned, float(bounds[is_pruned].max(initial=0.0)))
        half /= 2
        offsets = half * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # of the eight smaller cubes
        cubes = (cubes[~is_pruned][:, None] + offsets).reshape(-1, 3)
    return SpeedBound(speed, max(pruned, speed * (1 + SEARCH.rounding)), best)


def _first_cubes(air: Jets, region: RoundBody | AllowedCone | HullBody) -> tuple[Array, float]:
    """Return the centre, (1, 3), and half-edge of a cube around the relevant part of the region."""
    if isinstance(region, AllowedCone):
        return region.apex[None], _relevant_distance(air, region)
    if isinstance(region, HullBody):
        low, high = region.mesh.vertices.min(axis=0), region.mesh.vertices.max(axis=0)
    else:
        endpoints, r = np.stack([region.body.o, region.body.o + region.body.d]), region.body.r + region.body.dr
        low, high = endpoints.min(axis=0) - r, endpoints.max(axis=0) + r
    return ((low + high) / 2)[None], float((high - low).max()) / 2


def _relevant_distance(air: Jets, region: AllowedCone) -> float:
    """Return a distance from the apex beyond which no speed exceeds one sampled within it."""
    distance = 4 * float(np.linalg.norm(air.centres - region.apex, axis=1).max()) + 4 * MODEL.merged_at * float(
        air.diameters.max()
    )
    grid = region.apex + distance * np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    points = _points_in(region, np.concatenate([grid, air.centres, air.rotors.reshape(-1, 3)]))
    fastest = max(float(speeds(air, points).sum(axis=1).max()), SEARCH.least_speed)
    while bound_beyond(air, region.apex, distance) > fastest:
        distance *= 2
    return distance


def bound_beyond(air: Jets, x: Array, distance: float) -> float:
    """Return an upper bound on the sum of speeds at all points farther from x than a distance.

    Such a point is at least D away from where the merged jet of each module, or of each rotor, starts, where the
    slipstreams of single rotors have ended. The far field is bounded in slices of depth, cut at equal angles to the
    jet's axis, and below D by its speed there.
    """
    from_centre = distance - np.linalg.norm(air.centres - x, axis=1)
    if from_centre.min() < air.ended:
        return math.inf
    D = distance - np.linalg.norm(air.merged[0] - x, axis=2)
    angles = np.linspace(math.pi / 2, 0.0, SEARCH.slices + 1)[:, None, None]
    shallow, from_axis = D * np.cos(angles), D * np.append(np.sin(angles[1:]), [[[0.0]]], axis=0)
    far = air.shares * far_field(air, shallow, np.append(shallow[1:], D[None], axis=0), from_axis).max(axis=0)
    k = sink(air, np.maximum(from_centre[:, None] - air.reach - air.radii, 0.0))
    inflow = k * k.sum(axis=1, keepdims=True)
    return float(np.sqrt((air.induced**2 * np.maximum(far, inflow)).sum(axis=1)).sum())


def _may_meet(region: RoundBody | AllowedCone | HullBody, x: Array, h: float) -> Array:
    """Return which balls of radius h about x, (m, 3), may meet the region; the others are proven not to."""
    slack = h + SEARCH.rounding * (h + float(np.abs(x).max(initial=0.0)))
    if isinstance(region, AllowedCone):
        return np.asarray(region.s(x) <= slack)
    if isinstance(region, HullBody):
        return np.asarray((x @ region.normals.T - region.offsets).max(axis=1) <= slack)
    return np.asarray(region.body.depth(x) >= -slack)


def _points_in(region: RoundBody | AllowedCone | HullBody, x: Array) -> Array:
    """Return points of the region near points x, (m, 3); an x inside stays where it is."""
    if isinstance(region, AllowedCone):
        depth = np.maximum(region.s(x) + SEARCH.inside * (1 + np.abs(x - region.apex).max(axis=1)), 0.0)
        return np.asarray(x - depth[:, None] * region.inward_normal(x))
    if isinstance(region, HullBody):
        for _ in range(SEARCH.projections):
            heights = x @ region.normals.T - region.offsets
            face = np.argmax(heights, axis=1)
            x = x - np.maximum(heights[np.arange(len(x)), face], 0.0)[:, None] * region.normals[face]
        from_centre = x - region.centre
        slope = from_centre @ region.normals.T
        margin = region.offsets - region.normals @ region.centre
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(slope > 0, margin / slope, np.inf).min(axis=1)
        return np.asarray(region.centre + np.minimum(share, 1.0)[:, None] * (1 - SEARCH.inside) * from_centre)
    body = region.body
    eta = nearest_on_axis(body.o - x, np.broadcast_to(body.d, x.shape), body.dr)
    nearest, radius = body.o + eta[:, None] * body.d, body.r + eta * body.dr
    from_axis = x - nearest
    share = radius / np.maximum(np.linalg.norm(from_axis, axis=1), radius) * (1 - SEARCH.inside)
    return np.asarray(nearest + share[:, None] * from_axis)


DISC = math.sqrt(2 / 3) * np.array([(0.0, 0.0), *((np.cos(a), np.sin(a)) for a in np.arange(6) * math.pi / 3)])
"""Quadrature points of the unit disc, shape (7, 2)."""


def air(found: Findings) -> AirSpeeds | None:
    """Return the air speeds of a design in every load case; None if its numbers are too large."""
    scene = found.scene
    if not (
        np.isfinite(scene.design.inputs).all() and np.abs([*scene.centres, scene.tip]).max() < LARGEST_COORDINATE
    ):
        return None
    return AirSpeeds(cases=tuple(_case(name, scene, jets) for name, jets in case_jets(scene)))


def case_jets(scene: Scene) -> Iterator[tuple[str, Jets]]:
    """Yield the name and the jets of every load case, in the coordinates of the scene."""
    task, platform = scene.design.task, scene.platform
    rotors = scene.centres[:, None] + (platform.rotors - platform.o[:, None]) / scene.l_arm
    inputs = scene.design.inputs
    for name, u in zip(task.case_labels, inputs, strict=True):
        yield name, jets(task.modules_of_nodes, task.air_density, scene.centres, scene.R, rotors, u, scene.l_arm)


def speed_residuals(found: Findings) -> Iterator[Residual]:
    """Yield the excess of the bound over the limit for every region with a speed limit, in every load case."""
    task, air_speeds = found.scene.design.task, found.figures["air"]
    for number, exposure in enumerate(task.exposure):
        if exposure.speed is None:
            continue
        for k, label in enumerate(task.case_labels):
            region = None if air_speeds is None else air_speeds.cases[k].regions[number]
            status = Status(region.status) if region is not None and region.status else Status.UNDECIDED
            at_most = math.inf if region is None else region.speed_at_most_m_s
            excess = 0.0 if status is Status.CLEAR else at_most - exposure.speed
            name, limits = f"air over exposure {number} ({exposure.kind}), {label}", {"derived": at_most}
            limits |= {"tolerance": 0.0, "claim": exposure.speed}
            yield residual(name, excess, "m/s", exposure.speed, status=status, **limits)


def _case(name: str, scene: Scene, jets: Jets) -> CaseAir:
    at_tip, exposures = speeds(jets, scene.tip[None])[0], scene.design.task.exposure
    return CaseAir(
        name=name,
        tip_m_s=clamp(float(at_tip.sum())),
        tip_estimate_m_s=clamp(float(np.linalg.norm(at_tip))),
        regions=tuple(
            _region(number, exposure, scene, jets)
            for number, exposure in enumerate(exposures)
            if exposure.contact is None
        ),
        rotors=tuple(_rotors(jets, scene.design.task.modules_of_nodes, scene.design.task.air_density)),
    )


def _region(number: int, exposure: Exposure, scene: Scene, jets: Jets) -> RegionAir:
    limit, reach = exposure.speed, exposure.speed_reach
    within = None if reach is None else ball(scene.tip, reach / scene.l_arm)
    bounds = [
        bound_speed(jets, region, limit=math.inf if limit is None else limit, within=within)
        for _, region in scene.regions(exposure)
    ]
    largest = max(bounds, key=lambda bound: bound.at_least, default=SpeedBound(0.0, 0.0, scene.tip))
    at_most = max((bound.at_most for bound in bounds), default=math.inf)
    status: Literal["clear", "undecided", "violated"] | None = None
    if limit is not None:
        status = "clear" if at_most <= limit else "violated" if largest.at_least > limit else "undecided"
    return RegionAir(
        name=f"exposure {number} ({exposure.kind})",
        speed_m_s=clamp(largest.at_least),
        speed_at_most_m_s=clamp(at_most),
        estimate_m_s=clamp(float(np.linalg.norm(speeds(jets, largest.point[None])))) if largest.at_least else 0.0,
        limit_m_s=limit,
        status=status,
    )


def _rotors(jets: Jets, modules: Sequence[Module], density: float) -> Iterator[RotorAir]:
    """Yield the air that every rotor ingests from other modules' wakes, and the thrust it loses."""
    through, along = ingested_wakes(jets)
    for (i, q), v in np.ndenumerate(jets.induced):
        module = modules[i]
        if q >= module.rotor_table.count:
            continue
        loss = min(1.0, module.wake_loss * float(along[i, q]) / float(v)) if v else 0.0
        yield RotorAir(
            module=i,
            rotor=q,
            ingested_m_s=clamp(float(through[i, q])),
            thrust_loss=loss,
            lost_N=clamp(loss * float(2 * density * math.pi * module.rotor_radii[q] ** 2) * float(v) ** 2),
        )


def ingested_wakes(jets: Jets) -> tuple[Array, Array]:
    """Return the average speed of other modules' wakes through discs, and its part along the disc's own flow.

    Both have the shape (n, r) [m/s].
    """
    weights = np.array([2.0, *[1.0] * 6]) / 8  # quadrature weights of DISC
    directions = np.where(jets.shares[..., None] > 0, jets.axes, UP)  # any, of rotors that a type of module lacks
    planes = [np.stack(basis_across(axis)[::-1]) for axis in directions.reshape(-1, 3)]
    shape = jets.induced.shape
    offsets = np.einsum(
        "...q,kp,...qpj->...qkj", jets.radii, DISC, np.reshape(planes, (*directions.shape[:-1], 2, 3))
    )
    through, along = np.zeros(shape), np.zeros(shape)
    of_modules = np.broadcast_to(offsets, (*shape, *offsets.shape[-2:]))
    for i, (R, discs, axes) in enumerate(zip(jets.poses, jets.rotors, jets.rotor_axes, strict=True)):
        points = discs[:, None] + of_modules[i] @ R.T
        flow = wakes(jets.drop(i), points.reshape(-1, 3)).reshape(*points.shape[:2], -1, 3)
        through[i] = np.einsum("k,qkn->q", weights, np.linalg.norm(flow, axis=3))
        along[i] = np.maximum(-np.einsum("k,qkni,qi->q", weights, flow, axes), 0.0)
    return through, along
