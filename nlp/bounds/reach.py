"""End-effectors that no free connector can be near enough to, whatever the tree and its hinges.

| symbol | meaning | unit |
|---|---|---|
| L | largest reach of the rod | m |
| d | what every module's centre keeps from p_E at least | m |
| B | centre of mass of modules and joints; a fixed end-effector is at m_t / (m_t - m_E) p_E from it | |
| q | its least distance from the centroid of the modules' centres, from which joints shift B a little | m |

A connector is l_c from a centre: no nearer to p_E than d - l_c. A centre is (1/n) sum_j 2 l_c d_ij <= (n - 1) l_c
from the centroid at most, so a connector is no nearer to a fixed p_E than q - n l_c.
"""

from __future__ import annotations

import math

from nlp.bounds.refutation import Refutation, bodies_mass, modules, off_centre
from topo_search.model import ResolvedTask
from topo_search.model.exposure import Local
from topo_search.model.proven import excess_texts, lower_text
from topo_search.model.tolerances import TOLERANCE


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
