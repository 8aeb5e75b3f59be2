"""Lengths that rule out a platform: a rod's reach, an end-effector's place, rotors across a hinge.

| symbol | meaning | unit |
|---|---|---|
| L | largest reach of the rod | m |
| d | what every module's centre keeps from p_E at least | m |
| B | centre of mass of modules and joints; a fixed end-effector is at m_t / (m_t - m_E) p_E from it | |
| q | its least distance from the centroid of the modules' centres, from which joints shift B a little | m |
| d_ij | joints between the modules i and j | |

A connector is l_c from a centre: no nearer to p_E than d - l_c. A centre is (1/n) sum_j 2 l_c d_ij <= (n - 1) l_c
from the centroid at most, so a connector is no nearer to a fixed p_E than q - n l_c.

The least squared distance of p_E from a centre is at most their mean, |q|^2 + (1 / n^2) sum_{i<j} |p_i - p_j|^2,
and two centres are at most 2 l_c d_ij apart.
"""

from __future__ import annotations

import math

from nlp.bounds.refutation import Refutation, bodies_mass, modules, off_centre
from topo_search.model import ResolvedTask, Topology
from topo_search.model.exposure import Local
from topo_search.model.proven import excess_texts, lower_text, upper_text
from topo_search.model.tolerances import TOLERANCE

ROUNDING = 1e-9
"""Share of a length by which it must be missed."""


def out_of_reach(task: ResolvedTask) -> Refutation | None:
    """Return why no connector is within reach of the end-effector, if none can be."""
    n, module, largest = task.n, task.module, task.largest_reach(task.n)
    if largest is None:
        return None
    farthest, why = max(_distances(task), default=(0.0, ""))
    unseen = TOLERANCE * module.arm_length * (2 + task.total_mass(n) / bodies_mass(task))
    if farthest <= largest + unseen:
        return None
    shown, limit = excess_texts(farthest, largest)
    return Refutation(
        "reach of the end-effector's rod",
        farthest - largest,
        "m",
        f"end_effector.largest_reach = {limit} m is too short for {modules(task)}: {why}, so that the "
        f"nearest free connector is {shown} m from the end-effector at least",
    )


def _distances(task: ResolvedTask) -> list[tuple[float, str]]:
    """Return how far the nearest connector is at least [m], each with its reason."""
    n, l_c = task.n, task.module.connector_distance
    found = []
    if task.exclusion_radius is not None:
        apart = task.exclusion_radius
        found.append((apart - l_c, f"every module's centre keeps {lower_text(apart)} m from the end-effector"))
    blown = task.module.region_envelope.start_radius
    for e, asked in enumerate(task.exposure):
        if isinstance(asked, Local) and asked.radius is not None and asked.geometry:
            told = f"exposure[{e}].radius = {lower_text(asked.radius)} m keeps every module's airflow off"
            found.append((asked.radius + blown - l_c, told))
    if task.end_effector.fixed_position is not None:
        p_E = math.hypot(*task.end_effector.fixed_position)
        q = task.total_mass(n) / bodies_mass(task) * p_E - off_centre(task)
        found.append((q - n * l_c, f"end_effector.position is {lower_text(p_E)} m from the centre of mass"))
    return found


def stand_off(task: ResolvedTask, topology: Topology | None = None) -> Refutation | None:
    """Some module is nearer to a fixed end-effector than its stand-off, in every shape of the platform.

    Of all trees a straight chain has the largest sum of squared distances, sum_{i<j} d_ij^2 = n^2 (n^2 - 1) / 12.
    """
    n, position, asked = task.n, task.end_effector.fixed_position, task.end_effector.stand_off
    if position is None:
        return None
    squares = n**2 * (n**2 - 1) / 12 if topology is None else _squared_distances(topology)
    share = task.total_mass(n) / bodies_mass(task)
    q = share * math.hypot(*position) + off_centre(task)
    farthest = math.hypot(q, 2 * task.module.connector_distance / n * math.sqrt(squares))
    unseen = TOLERANCE * task.module.arm_length * (1 + share)  # of the distance, and of the place
    if asked <= farthest * (1 + ROUNDING) + unseen:
        return None
    needed, reached = excess_texts(asked, farthest)
    return Refutation(
        "end-effector exclusion",
        asked - farthest,
        "m",
        f"end_effector.stand_off = {needed} m is out of reach of {modules(task)}: with the end-effector fixed "
        f"{upper_text(math.hypot(*position))} m from the centre of mass, some module centre is within {reached} m "
        "of it in any shape",
    )


def _squared_distances(topology: Topology) -> int:
    """Return sum_{i<j} d_ij^2."""
    import networkx as nx

    lengths: dict[int, dict[int, int]] = dict(nx.all_pairs_shortest_path_length(topology.graph()))
    return sum(d**2 for of_one in lengths.values() for d in of_one.values()) // 2


def rotors_overlap(task: ResolvedTask) -> Refutation | None:
    """Each of two bolted modules has a rotor across their hinge's axis, at one place, at any angle.

    The axis passes l_c from the centres of both, their rotors from l_arm / sqrt 2 - r to l_arm / sqrt 2 + r. Only a
    rotor that ends before the axis, or begins beyond it, can be clear of the other one there.
    """
    module = task.module
    middle, r, l_c = module.arm_length / math.sqrt(2), module.body.rotor_radius, module.connector_distance
    across = r - abs(middle - l_c)
    if task.n == 1 or task.body_clearance is None or across <= ROUNDING * (middle + r):
        return None
    inner, outer = excess_texts(l_c, middle - r)[1], excess_texts(middle + r, l_c)[0]
    return Refutation(
        "rotors of bolted modules",
        across,
        "m",
        "rotors of two modules that are bolted together overlap at any hinge angle: they reach from "
        f"{inner} to {outer} m towards a connector, across the hinge at module.connector_distance = {l_c:.15g} m",
    )
