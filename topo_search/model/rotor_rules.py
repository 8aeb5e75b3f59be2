"""Rules about a module's table of rotors."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from topo_search.model.arrays import Array
from topo_search.model.module import PRECISION, Module
from topo_search.model.rotors import MOST_TILT_DEG, UP, RotorTable
from topo_search.model.value import Broken, show

if TYPE_CHECKING:
    from topo_search.model.task import Task

TablePath = tuple[str | int, ...]
"""Table of a module in a task."""
PROJECTIONS, NEAR = 200, 1e-3
"""Number of projections onto each of two discs, and distance at which they count as meeting [radius]."""


def broken_rotors(task: Task) -> Broken:
    """Yield broken rules about tables of rotors, or else what is not known of the air of such rotors."""
    own: tuple[TablePath, Module] = (("module",), task.module)
    types: list[tuple[TablePath, Module]]
    types = [(("module_types", k), kind) for k, kind in enumerate(task.module_types)]
    # types may have taken over the rotors of [module]
    broken = [*_broken_table(*own)] or [fault for kind in types for fault in _broken_table(*kind)]
    placed = types or [own]
    broken += [fault for kind in placed for fault in _broken_connectors(task, *kind)]
    yield from broken or (fault for kind in placed for fault in _broken_air(task, *kind))


def _broken_table(path: TablePath, module: Module) -> Broken:
    """Yield broken rules about the table itself."""
    if not module.rotors:
        return
    table, radii = module.rotor_table, module.rotor_radii
    for q, (rotor, radius) in enumerate(zip(module.rotors, radii.tolist(), strict=True)):
        if (distance := math.hypot(*rotor.position)) > (farthest := module.connector_distance + radius):
            rule = f"must be at most connector_distance + body.rotor_radius = {farthest:.4g} m from the centre"
            text = f"{rule}, but got {show(rotor.position)}, {distance:.4g} m away"
            yield (*path, "rotors", q, "position"), text
    if (pair := discs_meet(table, radii / module.arm_length)) is not None:
        first, second = pair
        apart = math.dist(module.rotors[first].position, module.rotors[second].position)
        sizes = " and ".join(f"{radius:g} m" for radius in dict.fromkeys(radii[[first, second]].tolist()))
        rule = f"must not overlap rotors[{first}]: discs of body.rotor_radius = {sizes}"
        text = f"{rule} need more room, but got centres {apart:.4g} m apart"
        yield (*path, "rotors", second, "position"), text
    axes = [rotor.axis for rotor in module.rotors]
    mean = table.axes.sum(axis=0)
    if table.axes[:, 2].max() <= 0:
        yield (*path, "rotors"), f"at least one axis must point up, along z, but got {show(axes)}"
    elif np.linalg.norm(mean / np.linalg.norm(mean) - UP) > PRECISION:
        along = show([round(x, 4) for x in (mean / np.linalg.norm(mean)).tolist()])
        text = f"the sum of all axes, as unit vectors, must point along z, but points along {along}"
        yield (*path, "rotors"), text
    if module.airflow.speed is not None and not table.is_parallel:
        rule = "must be left out unless all rotors blow along the module's axis"
        yield (*path, "airflow", "speed"), f"{rule}, but got {module.airflow.speed:g}"


def _broken_connectors(task: Task, path: TablePath, module: Module) -> Broken:
    """Yield a choice of connectors that keys cannot tell: they assume that half a turn leaves a module as it is."""
    if task.search.connectors == "any" and not module.rotor_table.has_symmetry(np.diag([-1.0, -1.0, 1.0])):
        rule = 'must be "aligned" with rotors that half a turn of the module does not map onto each other'
        if len(path) > 1:
            rule += f", those of module_types[{path[1]}]"
        yield ("search", "connectors"), f'{rule}, but got "any"'


def _broken_air(task: Task, path: TablePath, module: Module) -> Broken:
    """Yield what is not known of the air of a module's own table of rotors."""
    rotors, tilt_deg = module.rotor_table, math.degrees(module.rotor_table.tilt)
    if rotors.has_own_jets and task.search.interference != "separation":
        rule = f"axes must be within {MOST_TILT_DEG:g} deg of the module's unless search.interference is"
        yield (*path, "rotors"), f'{rule} "separation", which checks no airflow, but got {tilt_deg:.4g} deg'
    elif rotors.has_own_jets and task.search.body_clearance:
        rule = (
            f"must be false for axes more than {MOST_TILT_DEG:g} deg from the module's, whose jets meet neighbours"
        )
        yield ("search", "body_clearance"), f"{rule}, but got {task.search.body_clearance:g}"


def discs_meet(rotors: RotorTable, radii: Array) -> tuple[int, int] | None:
    """Return the numbers of two rotors whose discs, of radii (r,) in l_arm, meet; None without any.

    Alternating projections onto two convex sets converge to their nearest points.
    """
    for first, second in itertools.combinations(range(rotors.count), 2):
        if np.linalg.norm(rotors.positions[first] - rotors.positions[second]) >= radii[first] + radii[second]:
            continue
        x = y = rotors.positions[first]
        for _ in range(PROJECTIONS):
            y = _onto_disc(rotors, second, radii, x)
            x = _onto_disc(rotors, first, radii, y)
        if np.linalg.norm(x - y) <= NEAR * radii[first]:
            return first, second
    return None


def _onto_disc(rotors: RotorTable, q: int, radii: Array, x: Array) -> Array:
    centre, axis = rotors.positions[q], rotors.axes[q]
    across = x - centre - (x - centre) @ axis * axis
    return np.asarray(centre + min(1.0, float(radii[q]) / max(float(np.linalg.norm(across)), 1e-300)) * across)
