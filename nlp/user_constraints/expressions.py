"""An own constraint as an expression: of a platform of symbols or of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from nlp.symbols.kinematics import Pose, poses
from nlp.symbols.masses import tip_and_com
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.protocols import OwnConstraint, SymbolicPlatform


def scale_of(constraint: OwnConstraint, task: ResolvedTask) -> float:
    """Return what counts as much of an own constraint, in its unit."""
    scales = {
        "m": task.module.arm_length,
        "N": task.force_unit(task.n),
        "N m": task.torque_unit(task.n),
        "rad^2/s^2": task.module.max_input(task.gravity),
    }
    return constraint.scale or scales.get(constraint.unit, 1.0)


def rows(constraint: OwnConstraint, platform: SymbolicPlatform) -> ca.SX:
    """Return the values of a constraint's expression as a column.

    Raises:
        ValueError: it is no expression, or none of the platform alone.
    """
    value = constraint.expression(platform)
    try:
        column = ca.vertcat(*map(ca.vec, map(ca.SX, value if isinstance(value, list | tuple) else [value])))
    except (NotImplementedError, TypeError) as error:
        got = type(value).__name__
        raise ValueError(f"{constraint.name}: must return a casadi.SX, or a list of them, but got {got}") from error
    if not column.numel():
        raise ValueError(f"{constraint.name}: must return one value or more, but got none")
    return column


def symbolic_platform(task: ResolvedTask, topology: Topology, x: ca.SX) -> SymbolicPlatform:
    """Return the platform that the unknowns describe."""
    n, K, unit, module = topology.n, len(task.load_cases), Units.of(task), task.module
    modules: list[Pose] = poses(topology, x[:3], x[3 : n + 2], module.connector_distance / unit.length)
    p_E, p_COM = tip_and_com(module, task.end_effector, topology, modules, x[n + 2 : n + 5])
    first = x.numel() - 4 * n * K
    return SymbolicPlatform(
        task=task.declared,
        topology=topology,
        centres=tuple((pose.p - p_COM) * unit.length for pose in modules),
        orientations=tuple(pose.R for pose in modules),
        end_effector=(p_E - p_COM) * unit.length,
        hinge_angles=x[3 : n + 2],
        inputs=tuple(
            x[first + 4 * n * k : first + 4 * n * (k + 1)] * unit.input
            for k in range(len(task.declared.load_cases))
        ),
    )


def platform_of(
    task: ResolvedTask,
    topology: Topology,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
    hinge_angles: Sequence[float],
    inputs: Sequence[Any],
) -> SymbolicPlatform:
    """Return a platform of numbers in the form that an own constraint takes; shapes as of `check_stated`."""
    return SymbolicPlatform(
        task=task,
        topology=topology,
        centres=tuple(ca.SX(ca.DM(o)) for o in centres),
        orientations=tuple(ca.SX(ca.DM(R)) for R in orientations),
        end_effector=ca.SX(ca.DM(end_effector)),
        hinge_angles=ca.SX(ca.DM(list(hinge_angles)).reshape((topology.n - 1, 1))),
        inputs=tuple(ca.SX(ca.DM(list(u_k))) for u_k in inputs),
    )
