"""Wrenches as arrows, forces straight and torques as a part of a ring around their axis; forces left in hover.

| symbol | meaning | shape | unit |
|---|---|---|---|
| f, tau | force and torque, in the axes of the task | (3,) | N, N m |
| S | length of the arrow of the largest force; a ring's radius is a part of it | | m |

The forces that a platform can add at its end-effector while it hovers are a convex polytope:

| symbol | meaning | shape | unit |
|---|---|---|---|
| u | rotor inputs, module-major, 0 <= u <= u_max | (4 n,) | rad^2/s^2 |
| F, T | forces and torques about the centre of mass of unit inputs | (3, 4 n) | N s^2, N m s^2 |
| f | force added at the end-effector: F u = m_t g e_z + f, T u = p_E x f | (3,) | N |

All in the axes of the task; with F u from the first equation in the second, (T - p_E x F) u = -p_E x m_t g e_z. The
figures are the audit's, which proves them; this module only draws.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh

from topo_search.export import palette
from topo_search.export.allocation import thrust_matrix
from topo_search.export.poses import Poses, largest_wrench, load_wrenches, rotation_to
from topo_search.export.solids import join, pose_matrix
from topo_search.model import Design, LoadCase
from topo_search.model.arrays import Array
from topo_search.report.scene import Part, ring, straight_arrow
from topo_search.report.task_facts import vector as vector_text
from topo_search.report.wording import figures
from verify.flight.programs import Box
from verify.flight.vehicle import force_hull

SHARE = 0.6
"""Length of the longest arrow, over the reach of the platform."""


def arrows(design: Design, at: Poses) -> Iterator[dict[str, Any]]:
    """Yield every load case as arrows: its name, its words, the label and position of each arrow, its parts."""
    S = SHARE * reach(design, at)
    least, thick, radius = 0.15, 0.025, 0.3  # shortest arrow, shaft, torque's ring, over the longest arrow
    largest = {kind: largest_wrench(design, at, kind) for kind in ("force", "torque")}
    for k, wrenches in itertools.groupby(load_wrenches(design, at), key=lambda wrench: wrench[0]):
        meshes, labels, words = [], [], []
        for _, kind, where, point, vector in wrenches:
            size = float(np.linalg.norm(vector))
            if not size:
                continue
            length = S * max(least, size / largest[kind])
            shape, extent = (straight_arrow, length) if kind == "force" else (ring, radius * length)
            mesh, end = shape(point, vector / size, extent, thick * S)
            text = f"{figures(size, 3)} {'N' if kind == 'force' else 'N m'}"
            meshes.append(mesh)
            labels.append((text, end.round(5).tolist()))
            words.append(f"{kind} {text}, along {vector_text((vector / size).tolist())}, at the {where}")
        case = [Part("case", f"load case {k}", palette.WRENCH, join(meshes))] if meshes else []
        yield {
            "name": design.task.case_labels[k],
            "told": "; ".join(words) or "nothing",
            "ends": labels,
            "parts": [*case, *_contact(design, design.task.load_cases[k], at, S)],
        }


def _contact(design: Design, case: LoadCase, at: Poses, longest: float) -> Iterator[Part]:
    """Yield the contact plane of a push while it hovers: a disc at the end-effector, across the force."""
    f = np.array(case.at_end_effector.force)
    weight = design.task.force_unit(design.topology.n)
    if not f.any() or case.at_com.force[2] < 0.999 * weight:  # it hovers only if it carries its weight
        return
    disc = trimesh.creation.cylinder(radius=0.35 * longest, height=0.002, sections=48)
    disc.apply_transform(pose_matrix(rotation_to(f / np.linalg.norm(f)), at.end_effector))
    yield Part("contact", "contact plane", palette.CONTACT, disc, opacity=0.5)


def metres_per_newton(design: Design, at: Poses) -> float:
    """Return the scale of the arrows of forces; without any force that of the platform's weight [m/N]."""
    force = largest_wrench(design, at, "force") or design.task.force_unit(design.topology.n)
    return SHARE * reach(design, at) / force


def reach(design: Design, at: Poses) -> float:
    """Return the largest distance of a rotor or the end-effector from the centre of mass [m]."""
    places = np.vstack([at.p, at.end_effector])
    return float(np.linalg.norm(places - at.p_com, axis=1).max()) + design.task.module.arm_length


def force_polytope(design: Design, at: Poses) -> tuple[Array, Array] | None:
    """Return the polytope's vertices, (m, 3) [N], and triangles, (t, 3) indices of them.

    None where the platform cannot hover, or where all forces lie in a plane.
    """
    module, weight = design.task.module, design.task.force_unit(design.topology.n)
    scale = np.repeat([weight, weight * module.arm_length], 3)[:, None]
    largest = module.max_input(design.task.gravity) * module.thrust_coefficient
    F, T = np.split(largest * thrust_matrix(module, at) / scale, 2)
    x, y, z = at.p_E / module.arm_length
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # lever @ f = p_E x f
    carried, bounds = np.array([0.0, 0.0, 1.0]), Box(np.zeros(F.shape[1]), np.ones(F.shape[1]))
    # of large platforms the hull has thousands of facets; five rounds come within a few percent of its volume
    hull = force_hull(F, T - lever @ F, -lever @ carried, bounds, rounds=5)
    return None if hull is None else (weight * (hull.points - carried), hull.simplices)
