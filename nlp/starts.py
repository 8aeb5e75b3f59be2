"""Random points to start from: splayed modules, thrust along the mean force, the end-effector outside.

A start is a function of (task, topology, start index, seed) alone, whatever ran before it or beside it.

Parallel neighbours blow into each other, so hinges start splayed: a child's airflow leans away from its parent's.
`tests/benchmarks/starts.py` measures how many more solves that alone makes end feasible. Large platforms need more:
their hinges are placed until no envelopes overlap (`nlp.placing`).
"""

from __future__ import annotations

import hashlib

import numpy as np

from nlp.evaluate import asked_wrenches, wrench_matrix
from nlp.geometry import poses, root_angles, root_rotation, rotation
from nlp.point import Point, fixed_end_effector
from nlp.problem import hinge_limit
from topo_search.model import Exterior, ResolvedTask, Topology
from topo_search.model.arrays import Array

SPLAY = np.array([-1.0, 1.0, 1.0, -1.0])
"""Sign of the hinge angle that turns the airflow of a child on port +x, +y, -x, -y away from its parent's."""
LARGEST_SPLAY = 0.8
"""Largest hinge angle of a start [rad]."""
PLACED_FROM = 8
"""Fewest modules for which hinges are placed free of overlaps first; with fewer, Ipopt sorts them out as well."""
CONE_SPREAD = 0.3
"""Scatter of the end-effector's direction about the axis of an allowed cone."""
LEAST_INPUT, LARGEST_INPUT = 0.05, 0.95
"""Range of the inputs of a start, over their bound: strictly inside, as an interior-point method wants them."""


def generator(task: ResolvedTask, topology: Topology, start: int, seed: int) -> np.random.Generator:
    """Return the random numbers of one start."""
    text = f"{task.model_dump_json()}\n{topology.key}\n{start}\n{seed}"
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))


def draw(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Point:
    """Return a random start."""
    n, l_c = topology.n, task.module.connector_distance
    alpha = splayed(task, topology, rng)
    if n >= PLACED_FROM:
        from nlp.placing import place  # compiled code, which small platforms need not load

        alpha = place(task, topology, alpha, rng)

    R, _ = poses(topology, np.eye(3), alpha, l_c)
    R_root = _towards(R[:, :, 2].sum(axis=0), _mean_force(task))
    if task.search.root == "free":
        R_root = rotation(_unit(_mean_force(task)), rng.uniform(-np.pi, np.pi)) @ R_root
    root = root_of(task, R_root)
    p_E = _end_effector(task, topology, root, alpha, rng)
    return with_inputs(Point(task, topology, root, alpha, p_E, np.empty((len(task.load_cases), n, 4))))


def splayed(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Array:
    """Return random hinge angles at which airflows of neighbours lean away from each other, shape (n-1,)."""
    ports = [a for _, _, a, _ in topology.edges()]
    alpha: Array = SPLAY[ports] * rng.uniform(0.0, min(LARGEST_SPLAY, hinge_limit(task)), topology.n - 1)
    return alpha


def root_of(task: ResolvedTask, R: Array) -> Array:
    """Return the root angles of an orientation, brought inside their bounds if they have any."""
    root = root_angles(R)
    return root if task.search.root == "free" else np.array([0.0, *np.clip(root[1:], -np.pi / 2, np.pi / 2)])


def _end_effector(
    task: ResolvedTask, topology: Topology, root: Array, alpha: Array, rng: np.random.Generator
) -> Array:
    """Return p'_E: anywhere around the platform; upstream of the rotors if the target must not be blown at."""
    direction, distance = rng.normal(size=3), rng.uniform(1.0, 10.0) * task.module.arm_length
    distance += task.end_effector.stand_off
    if task.end_effector.fixed_position is not None:
        return fixed_end_effector(task, topology, root, alpha)
    upstream = _unit(_mean_force(task))
    exteriors = [requirement for requirement in task.exposure if isinstance(requirement, Exterior)]
    for requirement in exteriors:
        if requirement.axis != "com":
            upstream = -_unit(np.asarray(requirement.axis))
    if exteriors:
        direction = upstream + CONE_SPREAD * direction
    elif task.exposure and direction @ upstream < 0:
        direction = -direction
    direction = _unit(direction)
    _, p = poses(topology, root_rotation(root), alpha, task.module.connector_distance)
    result: Array = p.mean(axis=0) + distance * direction
    return result


def with_inputs(point: Point) -> Point:
    """Return the point with the least-norm inputs of every load case, brought inside their bounds."""
    u_max = point.task.max_input
    u = np.linalg.lstsq(wrench_matrix(point), asked_wrenches(point).T, rcond=1e-6)[0].T
    u = np.clip(u, LEAST_INPUT * u_max, LARGEST_INPUT * u_max).reshape(point.u.shape)
    return Point(point.task, point.topology, point.root, point.alpha, point.p_E, u)


def _mean_force(task: ResolvedTask) -> Array:
    """Return the weighted sum of the load cases' forces; upwards if they cancel."""
    force = sum(
        (case.weight * np.add(case.at_end_effector.force, case.at_com.force) for case in task.load_cases),
        start=np.zeros(3),
    )
    result: Array = force if np.linalg.norm(force) > 1e-9 * task.force_unit(task.n) else np.array([0.0, 0.0, 1.0])
    return result


def _towards(a: Array, b: Array) -> Array:
    """Return the least rotation that turns the direction of a into that of b."""
    a, b = _unit(a), _unit(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        across = np.eye(3)[np.argmin(np.abs(a))]
        return np.eye(3) if a @ b > 0 else rotation(_unit(np.cross(a, across)), np.pi)
    return rotation(axis / sine, float(np.arctan2(sine, a @ b)))


def _unit(vector: Array) -> Array:
    result: Array = vector / np.linalg.norm(vector)
    return result
