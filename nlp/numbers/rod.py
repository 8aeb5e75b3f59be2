"""The rod that a design counts, with the mass that follows from its length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlp.numbers.point import Point, fixed_end_effector
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.corners import CorneredTask, to_corners
from topo_search.model.layout import PORT_DIRECTIONS
from topo_search.model.module import CountedRod

Connector = tuple[int, int]
"""Module and port."""
SETTLED = 1e-12
"""Shift of the end-effector by a change of the rod's mass that no longer matters [l_arm]."""
PASSES = 50
"""Largest number of changes; each is less than the last by the rod's share of the mass."""


def weigh_rod(point: Point, connector: Connector | None = None) -> Point:
    """Return the point of the same angles whose task counts the rod as long as it is there.

    An end-effector that the task fixes from the COM stays there. Inputs are left as they are.

    Args:
        point: a point of a task with some corners, or none.
        connector: where the rod starts; None: where the task's does, without one nothing changes.
    """
    rod = point.task.end_effector.counted_rod
    if connector is None and rod is not None:
        connector = rod.module, rod.port
    for _ in range(PASSES):
        if connector is not None:
            length = float(np.linalg.norm(rod_path(point, connector)))
            mass = point.task.end_effector.rod_linear_density * length
            weighed = CountedRod(module=connector[0], port=connector[1], mass=mass)
            point = replace(point, task=with_rod(point.task, weighed))
        if point.task.end_effector.fixed_position is None:
            break
        p_E = fixed_end_effector(point.task, point.topology, point.root, point.alpha)
        moved, point = float(np.linalg.norm(p_E - point.p_E)), replace(point, p_E=p_E)
        if moved <= SETTLED * point.task.module.arm_length:
            break
    return point


def connectors(task: ResolvedTask, topology: Topology) -> tuple[Connector, ...]:
    """Return where a rod may start: one that counts where it does, any other at every free connector."""
    rod = task.end_effector.counted_rod
    return topology.free_connectors if rod is None else ((rod.module, rod.port),)


def rod_path(point: Point, connector: Connector) -> Array:
    """Return the way of a rod from its connector to the end-effector, shape (3,) [m]."""
    (R, p), (i, port) = point.poses, connector
    return np.asarray(point.p_E - p[i] - point.task.module.connector_distance * R[i] @ PORT_DIRECTIONS[port])


def with_rod(task: ResolvedTask, rod: CountedRod | None) -> ResolvedTask:
    """Return a task with a rod that counts, or None, and with the same corners."""
    weighed = task.declared.with_rod(rod)
    if not isinstance(task, CorneredTask):
        return weighed
    whole = to_corners(weighed)
    assert isinstance(whole, CorneredTask)
    labels = {corner.label for corner in task.corners}
    return whole.with_corners(c for c, corner in enumerate(whole.corners) if corner.label in labels)
