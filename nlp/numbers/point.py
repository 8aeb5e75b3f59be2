"""A point of the problem in SI units, from which Ipopt starts or which it returns, and the mass of its rod."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from nlp.numbers.geometry import Swept, envelopes, poses, root_rotation
from nlp.numbers.masses import Masses, masses
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, CountedRod, Design, ResolvedTask, Topology
from topo_search.model.corners import CorneredTask, to_corners


@dataclass(frozen=True)
class Point:
    """Values of all variables of one topology, and quantities that follow from them."""

    task: ResolvedTask
    topology: Topology
    root: Array
    """psi, alpha_0, alpha_1, shape (3,) [rad]."""
    alpha: Array
    """Hinge angles, shape (n-1,) [rad]."""
    tip: Array
    """p'_E, shape (3,) [m]."""
    u: Array
    """Squared rotor speeds, shape (K, n, r) [rad^2/s^2]."""

    @classmethod
    def of(cls, design: Design) -> Point:
        """Return the point of a design."""
        arrays = design.root_orientation_rad, design.hinge_angles_rad, design.end_effector_m, design.inputs
        return cls(design.task, design.topology, *map(np.array, arrays))

    @cached_property
    def poses(self) -> tuple[Array, Array]:
        """R (n,3,3) and p (n,3) [m] of all modules."""
        return poses(self.topology, root_rotation(self.root), self.alpha, self.task.connector_distances)

    @cached_property
    def p_COM(self) -> Array:
        """Centre of mass in W [m]."""
        carried = masses(self.task, self.topology)
        on_modules = carried.module * _bodies_moment(self.task, carried, *self.poses)
        return np.asarray(
            (carried.tip_kg * self.tip + on_modules) / (carried.module * carried.bodies + carried.tip_kg)
        )

    @cached_property
    def envelopes(self) -> Swept:
        """Airflow envelopes of all modules."""
        return envelopes([module.envelopes for module in self.task.modules_of_nodes], *self.poses)

    @cached_property
    def vectors(self) -> dict[str, Array]:
        """Vectors of the platform (`nlp.requirements.statement`), with positions in l_arm.

        p, x, y and z of all modules, (n,3) each; p'_E and p_COM, (1,3) each.
        """
        unit, (R, p) = self.task.module.arm_length, self.poses
        axes = {axis: R[:, :, column] for column, axis in enumerate("xyz")}
        return {"p": p / unit, **axes, "p'_E": self.tip[None] / unit, "p_COM": self.p_COM[None] / unit}

    @property
    def objective(self) -> float:
        """J [rad^4/s^4]."""
        weights = np.array([case.weight for case in self.task.load_cases])
        return float(np.sum(weights * np.sum(self.u**2, axis=(1, 2))))

    def pack(self) -> Array:
        """Return the dimensionless vector of `nlp.problem.Variables`."""
        unit = Units.of(self.task)
        tip = self.tip if self.task.end_effector.fixed_position is None else np.empty(0)
        return np.concatenate([self.root, self.alpha, tip / unit.length, self.u.ravel() / unit.input])

    @classmethod
    def unpack(cls, task: ResolvedTask, topology: Topology, x: Array) -> Point:
        """Return the point of a dimensionless vector of `nlp.problem.Variables`."""
        n, K, unit = topology.n, len(task.load_cases), Units.of(task)
        root, alpha = x[:3], x[3 : n + 2]
        u = x[-task.rotor_count * K :].reshape(K, n, -1) * unit.input
        free = task.end_effector.fixed_position is None
        tip = x[n + 2 : n + 5] * unit.length if free else fixed_end_effector(task, topology, root, alpha)
        return cls(task, topology, root.copy(), alpha.copy(), tip, u)


def fixed_end_effector(task: ResolvedTask, topology: Topology, root: Array, alpha: Array) -> Array:
    """Return p'_E [m] for the position from the COM that the task fixes (`nlp.numbers.masses`)."""
    R, p = poses(topology, root_rotation(root), alpha, task.connector_distances)
    p_E = np.asarray(task.end_effector.fixed_position)
    carried = masses(task, topology)
    return np.asarray(_bodies_moment(task, carried, R, p) / carried.bodies + carried.lever * p_E)


def _bodies_moment(task: ResolvedTask, carried: Masses, R: Array, p: Array) -> Array:
    """Return sum_i M_i (p_i + R_i d_i) [m]."""
    centres = p + task.module.arm_length * np.einsum("iab,ib->ia", R[:, :, :2], carried.centres)
    return np.asarray((carried.modules[:, None] * centres).sum(axis=0))


Connector = tuple[int, int]
"""Module and port."""


class RodWeighing(NamedTuple):
    """Settings of the fixed-point iteration for a rod whose mass moves the end-effector."""

    tolerance: float = 1e-12
    """Shift of the end-effector at which the iteration ends [l_arm]."""
    passes: int = 50
    """Largest number of iterations; shifts shrink by the rod's share of the mass."""


WEIGHING = RodWeighing()


def weigh_rod(point: Point, connector: Connector | None = None) -> Point:
    """Return the point with the same angles and inputs, whose task has the mass of the rod at its actual length.

    A fixed end-effector keeps its position from the COM. A rod whose mass the task ignores has none.

    Args:
        point: a point of a task with some corners, or none.
        connector: connector of the rod; None: that of the task's rod with mass, or no rod.
    """
    rod = point.task.end_effector.counted_rod
    if connector is None and rod is not None:
        connector = rod.module, rod.port
    for _ in range(WEIGHING.passes):
        if connector is not None:
            length = float(np.linalg.norm(rod_path(point, connector)))
            carried = point.task.end_effector
            mass = 0.0 if carried.rod_mass == "ignored" else carried.rod_linear_density * length
            weighed = CountedRod(module=connector[0], port=connector[1], mass=mass)
            point = replace(point, task=with_rod(point.task, weighed))
        if point.task.end_effector.fixed_position is None:
            break
        tip = fixed_end_effector(point.task, point.topology, point.root, point.alpha)
        shift, point = float(np.linalg.norm(tip - point.tip)), replace(point, tip=tip)
        if shift <= WEIGHING.tolerance * point.task.module.arm_length:
            break
    return point


def connectors(task: ResolvedTask, topology: Topology) -> tuple[Connector, ...]:
    """Return the connectors where the rod may start: that of a rod with mass, otherwise every free connector."""
    rod = task.end_effector.counted_rod
    return topology.free_connectors if rod is None else ((rod.module, rod.port),)


def rod_path(point: Point, connector: Connector) -> Array:
    """Return the vector of a rod from its connector to the end-effector, shape (3,) [m]."""
    (R, p), (i, port) = point.poses, connector
    return np.asarray(point.tip - p[i] - point.task.connector_distances[i] * R[i] @ PORT_DIRECTIONS[port])


def with_rod(task: ResolvedTask, rod: CountedRod | None) -> ResolvedTask:
    """Return a task with a rod with mass, or without one if None, and with the same corners."""
    weighed = task.declared.with_rod(rod)
    if not isinstance(task, CorneredTask):
        return weighed
    whole = to_corners(weighed)
    assert isinstance(whole, CorneredTask)
    labels = {corner.label for corner in task.corners}
    return whole.with_corners(c for c, corner in enumerate(whole.corners) if corner.label in labels)
