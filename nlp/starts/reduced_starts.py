"""Random starts of the reduced search: hinges splayed, thrust along the mean force, the end-effector outside.

Same as `nlp.starts.random_starts` for small platforms, but compiled and without inputs. A start is a function of
(task, topology, start index, seed) alone.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlp.numbers import kinematics
from nlp.numbers.geometry import largest_turn, signs
from nlp.numbers.kinematics import Tree, chain
from nlp.reduced.arrays import ReducedProblem
from nlp.starts.random_starts import DRAWING, entropy, is_aimed, mean_force, upstream_of
from topo_search.compiled_code import njit, refresh
from topo_search.model import Array, ResolvedTask, Topology

LEAST_OFFSET, LARGEST_OFFSET = 1.0, 10.0
"""Range of the end-effector's distance from the modules' centroid, beyond its stand-off [l_arm]."""
ANYWHERE, UPSTREAM, CONE = range(3)
"""Initial directions of the end-effector: any, any but downstream, or upstream with some scatter."""


class StartData(NamedTuple):
    """Data of a task and a topology for random starts."""

    splay: Array
    """Largest hinge angles, with sign, shape (n-1,) [rad]."""
    force: Array
    """Direction of the mean force."""
    upstream: Array
    """Direction in which no airflow goes."""
    side: int
    """ANYWHERE, UPSTREAM or CONE."""
    stand_off: float
    """[l_arm]."""
    bounded: bool
    """True if the root's angles are bounded or given."""


def start_data(task: ResolvedTask, topology: Topology) -> StartData:
    """Return the data for random starts."""
    force = mean_force(task)
    return StartData(
        signs(topology) * min(DRAWING.largest_splay, largest_turn(task)),
        force / np.linalg.norm(force),
        upstream_of(task),
        CONE if is_aimed(task) else UPSTREAM if task.exposure else ANYWHERE,
        task.end_effector.stand_off / task.module.arm_length,
        bool(task.search.root_ranges),
    )


def draw_starts(
    task: ResolvedTask,
    topology: Topology,
    problem: ReducedProblem,
    starts: Iterable[int],
    seed: str,
    *,
    random_signs: bool = False,
) -> Array:
    """Return the unknowns of random starts, shape (starts, N).

    With `random_signs` hinges turn either way, up to their limits.
    """
    key = entropy(task, topology, seed)
    data = start_data(task, topology)
    if random_signs:
        data = data._replace(splay=np.full(topology.n - 1, largest_turn(task)))
    lower = -1.0 if random_signs else 0.0
    random = [
        (*rng.uniform(lower, 1.0, topology.n), *rng.normal(size=3), rng.uniform(LEAST_OFFSET, LARGEST_OFFSET))
        for rng in (np.random.default_rng((key, start)) for start in starts)
    ]
    numbers = np.array(random).reshape(-1, topology.n + 4)
    return place_starts(problem.tree, problem.rotors.l_c, problem.lower, problem.upper, data, numbers)


@njit(cache=True)
def place_starts(tree: Tree, l_c: Array, lower: Array, upper: Array, data: StartData, random: Array) -> Array:
    """Return the unknowns of a start for each row of random numbers."""
    x = np.empty((len(random), len(lower)))
    for k in range(len(random)):
        _place_start(tree, l_c, lower, upper, data, random[k], x[k])
    return x


@njit(cache=True, inner=True)
def _place_start(
    tree: Tree, l_c: Array, lower: Array, upper: Array, data: StartData, random: Array, x: Array
) -> None:
    """Compute the unknowns of a start from random numbers: for yaw and hinges, and for the end-effector."""
    n = len(tree.parent)
    direction = random[n : n + 3]
    x[:] = 0.0
    for i in range(1, n):
        x[i + 2] = min(max(data.splay[i - 1] * random[i], lower[i + 2]), upper[i + 2])
    R_i, _, _, _ = chain(x, tree.parent, tree.port, tree.kappa, l_c)
    lift, force = np.zeros(3), data.force
    for i in range(n):
        lift += R_i[i, :, 2]
    yaw = 0.0 if data.bounded else 2 * math.pi * random[0] - math.pi
    R = _rotation_about(force, yaw) @ _rotation_between(lift, force)
    x[0] = math.atan2(-R[0, 1], R[1, 1])
    x[1] = math.atan2(R[2, 1], math.hypot(R[0, 1], R[1, 1]))
    c, s = math.cos(x[0]), math.sin(x[0])
    x[2] = math.atan2(c * R[0, 2] + s * R[1, 2], c * R[0, 0] + s * R[1, 0])
    for l in range(3):
        x[l] = min(max(x[l], lower[l]), upper[l])
    if len(x) == n + 2:
        return
    _, p, _, _ = chain(x, tree.parent, tree.port, tree.kappa, l_c)
    d = direction.copy()
    if data.side == CONE:
        d = data.upstream + DRAWING.cone_spread * direction
    elif data.side == UPSTREAM and np.sum(direction * data.upstream) < 0:
        d = -direction
    d *= (random[n + 3] + data.stand_off) / math.sqrt(np.sum(d * d))
    for k in range(3):
        x[n + 2 + k] = np.mean(p[:, k]) + d[k]


@njit(cache=True, inner=True)
def _rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit axis."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: Array = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K)
    return R


@njit(cache=True, inner=True)
def _rotation_between(a: Array, b: Array) -> Array:
    """Return the smallest rotation from the direction of a to the unit vector b."""
    length = math.sqrt(np.sum(a * a))
    if length < 1e-9:
        return np.eye(3)
    axis, cosine = np.cross(a, b) / length, np.sum(a * b) / length
    sine = math.sqrt(np.sum(axis * axis))
    if sine < 1e-12:
        if cosine > 0.0:
            return np.eye(3)
        across = np.cross(b, np.eye(3)[np.argmin(np.abs(b))])
        return _rotation_about(across / math.sqrt(np.sum(across * across)), math.pi)
    return _rotation_about(axis / sine, math.atan2(sine, cosine))


refresh(place_starts, Path(__file__).parent, Path(kinematics.__file__).parent)
