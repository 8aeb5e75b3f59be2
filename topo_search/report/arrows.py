"""The wrenches of a load case as arrows: forces straight, torques as a part of a ring around their axis.

| symbol | meaning | shape | unit |
|---|---|---|---|
| f, tau | force and torque, in the axes of the task | (3,) | N, N m |
| S | length of the arrow of the largest force; a ring's radius is a part of it | | m |
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import trimesh
from trimesh import Trimesh

from topo_search.export import palette
from topo_search.export.meshes import join, pose_matrix
from topo_search.export.poses import Poses, rotation_to
from topo_search.model import Design, LoadCase
from topo_search.model.arrays import Array
from topo_search.report.task_facts import vector as vector_text
from topo_search.report.traces import MATT, drawn_mesh
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
CARRIED = 0.999
"""Share of the weight from which a load case carries it: what it exerts at the end-effector is pushed against."""
TURN = math.radians(300)
"""How much of the ring is drawn."""


class Arrows(NamedTuple):
    """A load case as it is drawn."""

    name: str
    told: str
    """Forces and torques in figures."""
    traces: tuple[Any, ...]
    ends: tuple[tuple[str, list[float]], ...]
    """Label and place [m] of each arrow."""


def arrows(design: Design, at: Poses) -> Iterator[Arrows]:
    """Yield every load case as arrows."""
    largest = {
        name: max(
            float(np.linalg.norm(getattr(w, name))) for case in design.task.load_cases for w in _wrenches(case)
        )
        for name in ("force", "torque")
    }
    S = SHARE * reach(design, at)
    for k, case in enumerate(design.task.load_cases):
        meshes, ends, words = [], [], []
        for wrench, place, where in zip(
            _wrenches(case), (at.end_effector, at.p_com), ("end-effector", "centre of mass"), strict=True
        ):
            f, tau = np.array(wrench.force), np.array(wrench.torque)
            for vector, unit, name in ((f, "N", "force"), (tau, "N m", "torque")):
                size = float(np.linalg.norm(vector))
                if not size:
                    continue
                share = max(LEAST, size / largest[name])
                mesh, end = (straight_arrow if name == "force" else ring)(place, vector / size, S * share, S)
                text = f"{figures(size, 3)} {unit}"
                meshes.append(mesh)
                ends.append((text, end.round(5).tolist()))
                words.append(f"{name} {text}, along {vector_text((vector / size).tolist())}, at the {where}")
        trace = (
            [drawn_mesh(f"load case {k}", join(meshes), palette.WRENCH, "case", lighting=MATT)] if meshes else []
        )
        name = design.task.case_labels[k]
        yield Arrows(name, "; ".join(words) or "nothing", (*trace, *_contact(design, case, at, S)), tuple(ends))


def _contact(design: Design, case: LoadCase, at: Poses, longest: float) -> Iterator[Any]:
    """Yield the contact plane of a push while it hovers: a disc at the end-effector, across the force."""
    f = np.array(case.at_end_effector.force)
    weight = design.task.force_unit(design.topology.n)
    if not f.any() or case.at_com.force[2] < CARRIED * weight:
        return
    disc = trimesh.creation.cylinder(radius=CONTACT * longest, height=0.002, sections=48)
    disc.apply_transform(pose_matrix(rotation_to(f / np.linalg.norm(f)), at.end_effector))
    yield drawn_mesh("contact plane", disc, palette.CONTACT, "contact", opacity=0.5)


def metres_per_newton(design: Design, at: Poses) -> float:
    """Return the scale of the arrows of forces; without any force that of the platform's weight [m/N]."""
    return SHARE * reach(design, at) / (_largest(design, "force") or design.task.force_unit(design.topology.n))


def reach(design: Design, at: Poses) -> float:
    """Return the largest distance of a rotor or the end-effector from the centre of mass [m]."""
    places = np.vstack([at.p, at.end_effector])
    return float(np.linalg.norm(places - at.p_com, axis=1).max()) + design.task.module.arm_length


def straight_arrow(start: Array, direction: Array, length: float, longest: float) -> tuple[Trimesh, Array]:
    """Return an arrow and its point, (3,) [m].

    Args:
        start: where it begins, (3,) [m].
        direction: unit vector, (3,).
        length: of it [m].
        longest: length of the longest arrow, which sets the thickness of all [m].
    """
    thick = THICK * longest
    head = min(5 * thick, length / 2)
    shaft = trimesh.creation.cylinder(radius=thick, height=length - head, sections=10)
    shaft.apply_translation((0, 0, (length - head) / 2))
    cone = trimesh.creation.cone(radius=2.4 * thick, height=head, sections=10)
    cone.apply_translation((0, 0, length - head))
    mesh = join([shaft, cone]).apply_transform(pose_matrix(rotation_to(direction), start))
    return mesh, start + length * direction


def ring(centre: Array, axis: Array, length: float, longest: float) -> tuple[Trimesh, Array]:
    """Return an arrow that turns about an axis by the right-hand rule, and a place beside it."""
    thick, r = THICK * longest, RING * length
    angles = np.linspace(0.0, TURN, 25)
    path = r * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    steps = [
        trimesh.creation.cylinder(radius=thick, segment=[one, other], sections=8)
        for one, other in itertools.pairwise(path)
    ]
    forward = np.array([-math.sin(TURN), math.cos(TURN), 0.0])
    head = trimesh.creation.cone(radius=2.4 * thick, height=5 * thick, sections=10)
    head.apply_transform(pose_matrix(rotation_to(forward), path[-1]))
    mesh = join([*steps, head]).apply_transform(pose_matrix(rotation_to(axis), centre))
    return mesh, centre + rotation_to(axis) @ path[0]


def _largest(design: Design, name: str) -> float:
    """Return the largest force or torque of all load cases."""
    cases = design.task.load_cases
    return max(float(np.linalg.norm(getattr(wrench, name))) for case in cases for wrench in _wrenches(case))


def _wrenches(case: LoadCase) -> tuple[Any, Any]:
    return case.at_end_effector, case.at_com
