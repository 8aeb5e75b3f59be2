"""Refutations by lengths: a rod's reach, an end-effector's position, rotors across a hinge.

| symbol | meaning | unit |
|---|---|---|
| L | largest reach of the rod | m |
| d | least distance of every module's centre from p_E | m |
| B | centre of mass of modules and joints; a fixed end-effector is at m_t / (m_t - m_E) p_E from it | |
| q | least distance of p_E from the centroid of the modules' centres; joints shift B slightly from it | m |
| d_ij | joints between the modules i and j | |
| r | radius of the airflow's envelope at the module's centre | m |
| rho | radius of the ball around p_E in a region that airflow stays out of; minus its distance from p_E | m |
| h | distance of p_E from a half-space that airflow stays in; negative inside | m |
| theta | half-angle of a cone with its apex at p_E that airflow stays in | rad |

The ball of radius r around a centre stays out of a region, or inside a cone: d is at least rho + r, h + r or
r / sin(theta).

A connector is l_c from a centre, so at least d - l_c from p_E. A centre is at most (1/n) sum_j 2 l_c d_ij
<= (n - 1) l_c from the centroid, so a connector is at least q - n l_c from a fixed p_E.

The least squared distance of p_E from a centre is at most their mean, |q|^2 + (1 / n^2) sum_{i<j} |p_i - p_j|^2,
and two centres are at most 2 l_c d_ij apart.

The modules of a short path may be too close at every combination of its hinge angles. The box of these angles,
+-pi/2 each plus the audit's tolerance, is halved repeatedly. In a box with half widths h, relative to a fixed
module between i and j, every hinge t between it and j moves the points of j by at most h_t times their distance
from the hinge, and likewise for i. If i and j are too close at the middle by more than the sum of these, the box is
excluded. The path is impossible if no box remains.

| symbol | meaning | shape | unit |
|---|---|---|---|
| turns | quarter turns from port to port at every inner module: 1, 2 (straight on), 3 | | |
| alpha, h | middles and half widths of boxes; all boxes of a round have the same | (m, hinges), (hinges,) | rad |
| R, p, z | frame of a module (x towards the next one), centre, thrust axis | (m,3,3), (m,3) | -, m |
"""

import math
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from nlp.bounds.refutation import Refutation, bodies_mass, centre_offset, size_text
from nlp.numbers.geometry import Swept, clearance, rotation
from topo_search.model import AirflowEnvelope, Array, Indices, ResolvedTask, Topology
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text, upper_text
from topo_search.model.room import rotor_reach
from topo_search.model.shape import NOWHERE, Capsule, Cone, Polytope, Shape, convex_hull


class PathSearch(NamedTuple):
    """Settings of the search of paths."""

    max_modules: int = 5
    """Number of modules of the longest path."""
    max_boxes: int = 4000
    """Largest number of boxes in a round; beyond it nothing is proven for a path."""
    min_width: float = 0.01
    """Half width at which halving ends [rad]."""
    depth: float = 1e-3
    """Least violation of a clearance in every box, far above rounding [l_arm]."""
    length_shares: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0)
    """Shares of an envelope's length that are tried: an overlapping part is enough for a proof, and moves less."""


SEARCH = PathSearch()


Turns = tuple[int, ...]


def refute_path(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Refute a tree with a path whose modules are too close at any hinge angles; without a tree, any pair."""
    if task.module_types:  # a proof is of modules of one type
        return None
    module, air = task.module, task.module.envelope if task.search.interference == "airflow" else None
    # distances required of every design, not the larger ones of the solver
    centre_distance, min_separation = task.body_clearance or 0.0, 2
    if task.search.interference == "separation":
        centre_distance, min_separation = task.separation, 1
    l_c = module.connector_distance
    paths = _paths(topology) if topology is not None else {()} if task.n > 1 else set()
    for turns in sorted(paths, key=lambda turns: (len(turns), turns)):
        depth = SEARCH.depth * module.arm_length
        if _is_crowded(turns, air, centre_distance, min_separation, l_c, depth):
            row_text = f"{len(turns) + 2} modules in a row"
            directions = ", ".join({1: "right", 2: "straight on", 3: "left"}[turn] for turn in turns)
            return Refutation(
                f"clearances of {row_text}",
                depth,
                "m",
                f"{row_text}{directions and f' that go {directions} (or the mirror image)'} come too close to each "
                f"other at any hinge angles: module.connector_distance = {l_c:.15g} m is too short",
            )
    return None


def _paths(topology: Topology) -> set[Turns]:
    """Return the turns of all short paths; a path, its reverse and its mirror images count once."""
    paths = set[Turns]()
    ports = {joint: ends for h, i, a, b in topology.edges() for joint, ends in (((h, i), (a, b)), ((i, h), (b, a)))}
    for i, j in np.argwhere(np.triu(topology.distances < SEARCH.max_modules, 1)).tolist():
        joints = [ports[joint] for joint in pairwise(topology.path(i, j))]
        turns = [(out - entry) % 4 for (_, entry), (out, _) in pairwise(joints)]
        mirror = [(-turn) % 4 for turn in turns]
        paths.add(min(tuple(t) for t in (turns, turns[::-1], mirror, mirror[::-1])))
    return paths


@lru_cache(maxsize=256)
def _is_crowded(
    turns: Turns, air: AirflowEnvelope | None, centre_distance: float, min_separation: int, l_c: float, depth: float
) -> bool:
    """Return whether a path is proven to violate some clearance by `depth` [m] at any hinge angles.

    Centres must be `centre_distance` [m] apart if they are at least `min_separation` joints apart.
    """
    hinges = len(turns) + 1
    pairs = np.array(list(combinations(range(hinges + 1), 2))).T
    is_separated, shares = pairs[1] - pairs[0] >= min_separation, np.array(SEARCH.length_shares)[:, None, None]
    alpha, h = np.zeros((1, hinges)), np.full(hinges, math.pi / 2 + TOLERANCE)
    while len(alpha) <= SEARCH.max_boxes and h.max() > SEARCH.min_width:
        z, p = _poses(turns, alpha, l_c)
        distance = np.linalg.norm(p[pairs[1]] - p[pairs[0]], axis=-1)[is_separated]
        clear = (distance >= centre_distance).all(axis=0)
        if air is not None:
            clear &= (_gaps(z, p, pairs, air.length, air.start_radius, air.growth) >= 0).all(axis=0)
        if clear.any():
            return False
        is_open = (distance + _displacements(pairs, h, l_c)[is_separated] >= centre_distance - depth).all(axis=0)
        if air is not None:
            lengths = [share * air.length for share in SEARCH.length_shares]
            moved = np.array([_displacements(pairs, h, l_c, length) for length in lengths])
            radii, growths = air.start_radius - (moved + depth) / 2, shares * air.growth
            gaps = _gaps(z, p, pairs, shares[..., None] * air.length, radii, growths)
            is_open &= ((radii <= 0) | (gaps >= 0)).all(axis=(0, 1))
        alpha = alpha[is_open]
        if not len(alpha):
            return True
        t = int(np.argmax(h))
        h[t] /= 2
        step = h[t] * np.eye(hinges)[t]
        alpha = np.concatenate([alpha - step, alpha + step])
    return False


def _displacements(pairs: Indices, h: Array, l_c: float, length: float = 0.0) -> Array:
    """Return the largest change of distance of points of two axes in a box, for each pair, shape (pairs, 1) [m].

    Hinge t, between the modules t and t + 1, is l_c from their centres and 2 l_c farther from each further one.
    """

    def displacement(i: int, j: int) -> float:
        middle = (i + j) // 2
        steps = [(t, j - t - 1) for t in range(middle, j)] + [(t, t - i) for t in range(i, middle)]
        return sum(
            float(h[t]) * (math.hypot(l_c, length) if k == 0 else l_c * (1 + 2 * k) + length) for t, k in steps
        )

    return np.array([[displacement(i, j)] for i, j in pairs.T.tolist()])


def _gaps(z: Array, p: Array, pairs: Indices, length: Any, radius: Any, growth: Any) -> Array:
    """Return the clearances of two envelopes with this length and start radius, one row per pair [m]."""
    first, second = (Swept(p[side], -length * z[side], radius, growth) for side in pairs)
    return clearance(first, second)


def _poses(turns: Turns, alpha: Array, l_c: float) -> tuple[Array, Array]:
    """Return z and p of all modules of a path, shape (modules, m, 3); hinges turn about the y axis."""
    c, s, zero, one = np.cos(alpha), np.sin(alpha), np.zeros_like(alpha), np.ones_like(alpha)
    hinge = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(*alpha.shape, 3, 3)
    R, p = [np.broadcast_to(np.eye(3), (len(alpha), 3, 3))], [np.zeros((len(alpha), 3))]
    for t, turn in enumerate((*turns, 2)):
        R_hinge = R[-1] @ hinge[:, t]
        p.append(p[-1] + l_c * (R[-1][:, :, 0] + R_hinge[:, :, 0]))
        R.append(R_hinge @ rotation([0.0, 0.0, 1.0], (turn - 2) * math.pi / 2))
    return np.array(R)[..., 2], np.array(p)


MIN_VIOLATION = 1e-9
"""Least relative violation of a length."""


def refute_reach(task: ResolvedTask) -> Refutation | None:
    """Refute a rod whose reach is too short for any connector."""
    n, module, largest_reach = task.n, task.module, task.largest_reach(task.n)
    if largest_reach is None:
        return None
    farthest, reason = max(_distances(task), default=(0.0, ""))
    tolerance = TOLERANCE * module.arm_length * (2 + task.total_mass(n) / bodies_mass(task))
    if farthest <= largest_reach + tolerance:
        return None
    distance_text, limit_text = excess_texts(farthest, largest_reach)
    return Refutation(
        "reach of the end-effector's rod",
        farthest - largest_reach,
        "m",
        f"end_effector.largest_reach = {limit_text} m is too short for {size_text(task)}: {reason}, so that the "
        f"nearest free connector is {distance_text} m from the end-effector at least",
    )


def _distances(task: ResolvedTask) -> list[tuple[float, str]]:
    """Return lower bounds on the distance of the nearest connector [m], each with its reason."""
    n, l_c, airs = task.n, task.longest_connector, [kind.region_envelopes for kind in task.types]
    distances = []
    if task.exclusion_radius is not None:
        distance = task.exclusion_radius
        distances.append(
            (distance - l_c, f"every module's centre keeps {lower_text(distance)} m from the end-effector")
        )
    for e, exposure in enumerate(task.exposure):
        # envelopes of rotors do not start at the module's centre, and a module without rotors has none
        for shape in exposure.shapes if exposure.geometry and all(len(air) == 1 for air in airs) else ():
            distance = _kept_off(shape, min(air.start_radius for (air,) in airs))
            reason = f"exposure[{e}], {exposure.words}, keeps every module's centre {lower_text(distance)} m off"
            distances.append((distance - l_c, reason))
    if task.end_effector.fixed_position is not None:
        p_E = math.hypot(*task.end_effector.fixed_position)
        q = task.total_mass(n) / bodies_mass(task) * p_E - centre_offset(task)
        distances.append((q - n * l_c, f"end_effector.position is {lower_text(p_E)} m from the centre of mass"))
    return distances


def _kept_off(shape: Shape, r: float) -> float:
    """Return a lower bound on the distance of a module's centre from p_E, for an envelope of radius r there [m]."""
    if isinstance(shape, Cone):
        if shape.half_angle_deg < 90:
            return r / math.sin(math.radians(shape.half_angle_deg)) if shape.apex == NOWHERE else 0.0
        return r + float(np.dot(shape.axis or NOWHERE, shape.apex))
    if isinstance(shape, Polytope):
        inside = float(convex_hull(np.array(shape.corners)).offsets.min())
        return r + inside if inside > 0 else 0.0
    if isinstance(shape, Capsule):
        start, path = np.array(shape.start), np.subtract(shape.end, shape.start)
        share = np.clip(-(start @ path) / (path @ path), 0.0, 1.0) if path.any() else 0.0
        return r + shape.radius - float(np.linalg.norm(start + share * path))
    return 0.0


def refute_stand_off(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Refute a stand-off that some module violates in every shape of the platform.

    Of all trees, a straight chain has the largest sum of squared distances, sum_{i<j} d_ij^2 = n^2 (n^2 - 1) / 12.
    """
    n, position, required = task.n, task.end_effector.fixed_position, task.end_effector.stand_off
    if position is None:
        return None
    squares = n**2 * (n**2 - 1) / 12 if topology is None else np.square(topology.distances).sum() / 2
    share = task.total_mass(n) / bodies_mass(task)
    q = share * math.hypot(*position) + centre_offset(task)
    farthest = math.hypot(q, 2 * task.longest_connector / n * math.sqrt(squares))
    tolerance = TOLERANCE * task.module.arm_length * (1 + share)  # of the distance, and of the position
    if required <= farthest * (1 + MIN_VIOLATION) + tolerance:
        return None
    required_text, distance_text = excess_texts(required, farthest)
    return Refutation(
        "end-effector exclusion",
        required - farthest,
        "m",
        f"end_effector.stand_off = {required_text} m is out of reach of {size_text(task)}: with the end-effector "
        f"fixed {upper_text(math.hypot(*position))} m from the centre of mass, some module centre is within "
        f"{distance_text} m of it in any shape",
    )


def refute_rotors(task: ResolvedTask) -> Refutation | None:
    """Refute two bolted modules whose rotors overlap across the hinge's axis at any angle.

    The axis is l_c from both centres, the rotors of an X extend from `middle` - r to `middle` + r. A rotor can only
    be clear of the opposite one, its mirror image, if it ends before the axis or begins beyond it.
    """
    module = task.module
    if task.module_types:
        return None
    middle, r, l_c = rotor_reach(module), module.body.rotor_radius, module.connector_distance
    overlap = r - abs(middle - l_c)
    if (
        task.n == 1
        or module.rotors is not None
        or task.body_clearance is None
        or overlap <= MIN_VIOLATION * (middle + r)
    ):
        return None
    inner, outer = excess_texts(l_c, middle - r)[1], excess_texts(middle + r, l_c)[0]
    return Refutation(
        "rotors of bolted modules",
        overlap,
        "m",
        "rotors of two modules that are bolted together overlap at any hinge angle: they reach from "
        f"{inner} to {outer} m towards a connector, across the hinge at module.connector_distance = {l_c:.15g} m",
    )
