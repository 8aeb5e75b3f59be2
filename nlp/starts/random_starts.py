"""Random starts: splayed modules, thrust along the mean force, the end-effector outside.

A start is a function of (task, topology, start index, seed) alone, independent of other starts.

Parallel neighbours blow into each other, so hinges start splayed: a child's airflow leans away from its parent's.
`tests/benchmarks/starts.py` measures the gain in feasible solves. Large platforms need more: their hinges are
untangled (`nlp.starts.untangling`) until no envelopes overlap. If a cone must contain all airflow, they are also
turned so that its apex can be close; the end-effector is placed there, and the platform is yawed to minimum effort.
"""

import hashlib
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nlp.numbers import geometry
from nlp.numbers.point import Point, fixed_end_effector
from nlp.requirements.balances import required_wrenches, running_rotors, wrench_matrix
from topo_search.model import Array, ResolvedTask, Topology
from topo_search.model.shape import Cone


class StartSettings(NamedTuple):
    """Settings of random starts."""

    largest_splay: float = 0.8
    """Largest hinge angle of a start [rad]."""
    untangled_from: int = 8
    """Smallest number of modules that are untangled; Ipopt untangles fewer as well."""
    lifted_from: int = 30
    """Smallest number of modules whose hinges are also turned to align thrusts."""
    min_normal: float = 1e-9
    """Length of the sum of several planes' normals below which no direction leads out of all."""
    cone_spread: float = 0.3
    """Scatter of the end-effector's direction about the rod's axis or that of an allowed cone."""
    turns: int = 24
    """Number of yaw angles about the mean force from which a start with such a cone takes the cheapest."""
    tie: float = 1e-6
    """Relative difference of efforts that is a tie, so that rounding does not choose between symmetric angles."""


DRAWING = StartSettings()


LEAST_INPUT, LARGEST_INPUT = 0.05, 0.95
"""Range of the inputs of a start, relative to their bounds: strictly inside, for the interior-point method."""


def generator(task: ResolvedTask, topology: Topology, start: int, seed: int) -> np.random.Generator:
    """Return the random generator of one start."""
    return np.random.default_rng(entropy(task, topology, f"{start}\n{seed}"))


def entropy(task: ResolvedTask, topology: Topology, seed: str) -> int:
    """Return the seed of a task and topology.

    It ignores limits of the rod, a rod of type "none" and the margin of centres: limits that are not active do not
    change the result.
    """
    ignored = {"largest_reach", "rod_modulus", "rod_deflection", "within_deg"}
    if task.end_effector.rod == "none":
        ignored.add("rod")
    content = task.declared.model_dump_json(exclude={"end_effector": ignored, "search": {"centre_margin"}})
    text = f"{content}\n{topology.key}\n{seed}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big")


def draw(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Point:
    """Return a random start."""
    alpha, cone = splay(task, topology, rng), None
    if topology.n >= DRAWING.untangled_from:
        from nlp.starts.untangling import (  # compiled code, which small platforms need not load
            shorten_lever,
            untangle,
        )

        alpha, cone = untangle(task, topology, alpha, rng), _narrowest_cone(task)
        to_com = cone is not None and cone.axis is None  # else the apex is not in the direction of thrust
        if to_com or topology.n >= DRAWING.lifted_from:
            half_angle = math.radians(cone.half_angle_deg) if cone is not None and to_com else None
            alpha = shorten_lever(task, topology, alpha, half_angle, rng)

    R, _ = geometry.poses(topology, np.eye(3), alpha, task.connector_distances)
    upright, yaw = _rotation_between(R[:, :, 2].sum(axis=0), mean_force(task)), 0.0
    if not task.search.root_ranges:
        yaw = rng.uniform(-np.pi, np.pi)
    origin, no_inputs = np.zeros(3), np.empty((len(task.load_cases), topology.n, task.rotors_per_module))

    def start_at(angle: float) -> Point:
        root = root_of(task, geometry.rotation(_unit(mean_force(task)), angle) @ upright)
        return Point(task, topology, root, alpha, origin, no_inputs)

    if cone is None:
        start = start_at(yaw)
        return with_inputs(replace(start, tip=_end_effector(start, rng)))
    yaws = yaw + 2 * np.pi / DRAWING.turns * np.arange(1 if task.search.root_ranges else DRAWING.turns)
    starts = [_with_least_norm(replace(start, tip=_apex(start, cone))) for start in map(start_at, yaws)]
    cheap = min(start.objective for start in starts) * (1.0 + DRAWING.tie)
    return _clip_inputs(next(start for start in starts if start.objective <= cheap))


def splay(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Array:
    """Return random hinge angles with airflows of neighbours leaning apart, shape (n-1,)."""
    phi = rng.uniform(0.0, min(DRAWING.largest_splay, geometry.largest_turn(task)), topology.n - 1)
    return geometry.nearest_angles(task, topology, geometry.signs(topology) * phi)


def root_of(task: ResolvedTask, R: Array) -> Array:
    """Return the root angles of an orientation, clipped to their bounds if there are any."""
    root, ranges = geometry.root_angles(R), [*task.search.root_ranges.values()]
    return np.clip(root, *np.transpose(ranges)) if ranges else root


def _end_effector(start: Point, rng: np.random.Generator) -> Array:
    """Return p'_E: anywhere around the platform, or with exposure requirements upstream of the rotors."""
    task = start.task
    direction, distance = rng.normal(size=3), rng.uniform(1.0, 10.0) * task.module.arm_length
    distance += task.end_effector.stand_off
    if task.end_effector.fixed_position is not None:
        return fixed_end_effector(task, start.topology, start.root, start.alpha)
    upstream = upstream_of(task)
    if is_aimed(task):
        direction = upstream + DRAWING.cone_spread * direction
    elif task.exposure and direction @ upstream < 0:
        direction = -direction
    return np.asarray(start.poses[1].mean(axis=0) + distance * _unit(direction))


def _apex(start: Point, cone: Cone) -> Array:
    """Return p'_E: upstream of the rotors, just far enough for its cone to contain all airflow."""
    task, p, half_angle = start.task, start.poses[1], math.radians(cone.half_angle_deg)
    centroid, upstream, margin = p.mean(axis=0), _upstream(task, cone), task.search.margin
    airflow = geometry.envelopes([module.region_envelopes for module in task.modules_of_nodes], *start.poses)
    reach = geometry.cone_reach(airflow, centroid, upstream, half_angle) + margin / math.sin(half_angle)
    reach -= float(np.array(cone.apex) @ upstream)
    clear = float(np.max((p - centroid) @ upstream)) + (task.exclusion_radius or 0.0) + margin
    return np.asarray(centroid + max(reach, clear) * upstream)


def cones(task: ResolvedTask) -> list[Cone]:
    """Return the cones and half-spaces that must contain all airflow."""
    regions = (exposure for exposure in task.exposure if exposure.geometry)
    return [shape for exposure in regions for shape in exposure.shapes if isinstance(shape, Cone)]


def is_aimed(task: ResolvedTask) -> bool:
    """True if the end-effector starts in the upstream direction, with some scatter."""
    return task.rod_axis is not None or bool(cones(task))


def _narrowest_cone(task: ResolvedTask) -> Cone | None:
    """Return the narrowest cone that must contain all airflow, if its apex is free."""
    if task.end_effector.fixed_position is not None:
        return None
    return min(cones(task), key=lambda cone: cone.half_angle_deg, default=None)


def upstream_of(task: ResolvedTask) -> Array:
    """Return the rod's axis, or the upstream direction: out of the last region with one, else of the mean force."""
    if task.rod_axis is not None:
        return np.array(task.rod_axis)
    for exposure in reversed(task.exposure):
        axes = [shape.axis for shape in exposure.shapes if isinstance(shape, Cone) and shape.axis is not None]
        if axes and np.linalg.norm(inwards := np.sum(axes, axis=0)) > DRAWING.min_normal:
            return -_unit(inwards)
    return _upstream(task, None)


def _upstream(task: ResolvedTask, cone: Cone | None) -> Array:
    if cone is None or cone.axis is None:
        return _unit(mean_force(task))
    return -_unit(np.asarray(cone.axis))


def with_inputs(point: Point) -> Point:
    """Return the point with the least-norm inputs of every load case, clipped to their bounds."""
    return _clip_inputs(_with_least_norm(point))


def _with_least_norm(point: Point) -> Point:
    u = np.linalg.lstsq(wrench_matrix(point), required_wrenches(point).T, rcond=1e-6)[0]
    return replace(point, u=np.asarray(u.T, dtype=float).reshape(point.u.shape))


def _clip_inputs(point: Point) -> Point:
    """Return the point with its inputs clipped to LEAST_INPUT..LARGEST_INPUT of their bounds."""
    alive = running_rotors(point.task).reshape(point.u.shape)
    low, high = point.task.min_input * alive, point.task.max_input * alive
    smallest, largest = (low + share * (high - low) for share in (LEAST_INPUT, LARGEST_INPUT))
    return replace(point, u=np.clip(point.u, smallest, largest))


def mean_force(task: ResolvedTask) -> Array:
    """Return the weighted sum of the load cases' forces; straight up if they cancel."""
    force = sum(
        (case.weight * np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases),
        start=np.zeros(3),
    )
    cancels = np.linalg.norm(force) <= 1e-9 * task.force_unit(task.n)
    return np.array([0.0, 0.0, 1.0]) if cancels else np.asarray(force)


def _rotation_between(a: Array, b: Array) -> Array:
    """Return the smallest rotation from the direction of a to that of b."""
    a, b = _unit(a), _unit(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        across = np.eye(3)[np.argmin(np.abs(a))]
        return np.eye(3) if a @ b > 0 else geometry.rotation(_unit(np.cross(a, across)), np.pi)
    return geometry.rotation(axis / sine, float(np.arctan2(sine, a @ b)))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
