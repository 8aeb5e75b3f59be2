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

All in the axes of the task. A linear program gives the vertex that is farthest along a direction. Facets of the
hull of the vertices so far ask for more along their normals, until none lies beyond any: then the hull is the
polytope. The figures are the audit's, which proves them; this module only draws.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import trimesh
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from topo_search.export import palette
from topo_search.export.allocation import thrust_matrix
from topo_search.export.poses import Poses, largest_wrench, load_wrenches, rotation_to
from topo_search.export.solids import join, pose_matrix
from topo_search.model import Design, LoadCase
from topo_search.model.arrays import Array
from topo_search.report.parts import Part, ring, straight_arrow
from topo_search.report.task_facts import vector as vector_text
from topo_search.report.wording import figures

SHARE = 0.6
"""Length of the longest arrow, over the reach of the platform."""
LEAST = 0.15
"""Length of the shortest arrow that is drawn, over that of the longest."""
THICK = 0.025
"""Radius of an arrow's shaft, over the length of the longest."""
RING = 0.3
"""Radius of a torque's ring, over the length of the longest arrow."""
CONTACT = 0.35
"""Radius of the piece of a contact plane that is drawn, over the length of the longest arrow."""


def arrows(design: Design, at: Poses) -> Iterator[dict[str, Any]]:
    """Yield every load case as arrows: its name, its words, the label and position of each arrow, its parts."""
    S = SHARE * reach(design, at)
    largest = {kind: largest_wrench(design, at, kind) for kind in ("force", "torque")}
    for k, wrenches in itertools.groupby(load_wrenches(design, at), key=lambda wrench: wrench[0]):
        meshes, ends, words = [], [], []
        for _, kind, where, point, vector in wrenches:
            size = float(np.linalg.norm(vector))
            if not size:
                continue
            length = S * max(LEAST, size / largest[kind])
            shape, extent = (straight_arrow, length) if kind == "force" else (ring, RING * length)
            mesh, end = shape(point, vector / size, extent, THICK * S)
            text = f"{figures(size, 3)} {'N' if kind == 'force' else 'N m'}"
            meshes.append(mesh)
            ends.append((text, end.round(5).tolist()))
            words.append(f"{kind} {text}, along {vector_text((vector / size).tolist())}, at the {where}")
        case = [Part("case", f"load case {k}", palette.WRENCH, join(meshes))] if meshes else []
        yield {
            "name": design.task.case_labels[k],
            "told": "; ".join(words) or "nothing",
            "ends": ends,
            "parts": [*case, *_contact(design, design.task.load_cases[k], at, S)],
        }


def _contact(design: Design, case: LoadCase, at: Poses, longest: float) -> Iterator[Part]:
    """Yield the contact plane of a push while it hovers: a disc at the end-effector, across the force."""
    f = np.array(case.at_end_effector.force)
    weight = design.task.force_unit(design.topology.n)
    if not f.any() or case.at_com.force[2] < 0.999 * weight:  # it hovers only if it carries its weight
        return
    disc = trimesh.creation.cylinder(radius=CONTACT * longest, height=0.002, sections=48)
    disc.apply_transform(pose_matrix(rotation_to(f / np.linalg.norm(f)), at.end_effector))
    yield Part("contact", "contact plane", palette.CONTACT, disc, opacity=0.5)


def metres_per_newton(design: Design, at: Poses) -> float:
    """Return the scale of the arrows of forces; without any force that of the platform's weight [m/N]."""
    return (
        SHARE
        * reach(design, at)
        / (largest_wrench(design, at, "force") or design.task.force_unit(design.topology.n))
    )


def reach(design: Design, at: Poses) -> float:
    """Return the largest distance of a rotor or the end-effector from the centre of mass [m]."""
    places = np.vstack([at.p, at.end_effector])
    return float(np.linalg.norm(places - at.p_com, axis=1).max()) + design.task.module.arm_length


MOST_PROGRAMS = 200
"""Linear programs that a picture may take; the hull of what they found lies inside the polytope."""
FLAT = 1e-6
"""Least thickness of a polytope that is drawn, over its size; also by how much a vertex lies beyond a facet."""


def force_polytope(design: Design, at: Poses) -> tuple[Array, Array] | None:
    """Return the polytope's vertices, (m, 3) [N], and triangles, (t, 3) indices of them.

    None where the platform cannot hover, or where all forces lie in a plane.
    """
    module = design.task.module
    largest = module.max_input(design.task.gravity) * module.thrust_coefficient
    F, T = np.split(largest * thrust_matrix(module, at), 2)
    weight = design.task.force_unit(design.topology.n)
    x, y, z = at.p_E
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # lever @ f = p_E x f
    scale = np.repeat([weight, weight * design.task.module.arm_length], 3)
    A = np.block([[F, -np.eye(3)], [T, -lever]]) / scale[:, None]
    b = np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]) / scale
    bounds = [(0.0, 1.0)] * F.shape[1] + [(None, None)] * 3

    def farthest(direction: Array) -> Array | None:
        """Return the vertex that is farthest along a direction, (3,) [N]."""
        cost = np.concatenate([np.zeros(F.shape[1]), -direction])
        found = linprog(cost, A_eq=A, b_eq=b, bounds=bounds, method="highs")
        return None if found.x is None else np.asarray(found.x[-3:])

    return _hull(farthest)


def _hull(farthest: Callable[[Array], Array | None]) -> tuple[Array, Array] | None:
    """Return the hull of the vertices that linear programs find, facet by facet."""
    first = [farthest(sign * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]
    points = [point for point in first if point is not None]
    if len(points) < len(first) or (size := float(np.ptp(points, axis=0).max())) == 0:
        return None
    *_, thinnest = np.linalg.svd(np.array(points) - points[0])[2]
    points += [point for sign in (1.0, -1.0) if (point := farthest(sign * thinnest)) is not None]
    if np.linalg.svd(np.array(points) - points[0], compute_uv=False)[2] < FLAT * size:
        return None
    normals: set[tuple[float, ...]] = set()
    while True:
        hull = ConvexHull(np.array(points))
        new = []
        nearest_first = sorted(np.unique(hull.equations.round(9), axis=0).tolist(), key=lambda facet: -facet[3])
        for *normal, offset in nearest_first:
            if tuple(normal) in normals or len(normals) >= MOST_PROGRAMS:
                continue
            normals.add(tuple(normal))
            point = farthest(np.array(normal))
            if point is not None and point @ normal + offset > FLAT * size:
                new.append(point)
        if not new:
            return hull.points, hull.simplices
        points = [*hull.points[hull.vertices], *new]
