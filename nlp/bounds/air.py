r"""Air speeds that no platform stays below, wherever its modules are: rotors draw air in from all sides.

| symbol | meaning | unit |
|---|---|---|
| F | size of the force of a load case | N |
| T_max | largest thrust of a rotor | N |
| D | largest distance of a rotor's centre from some point of the region | m |
| R, rho | radius of a rotor; density of air | m; kg/m^3 |

A rotor of thrust T alone makes sqrt(T / (2 rho pi R^2)) / (1 + sqrt 2 D / R)^2 at least at the distance D
(`nlp.airspeed`, its third part), a module at least the sum of its rotors', and speeds of modules add up. Thrusts
sum up to F at least, and sqrt(T) >= T / sqrt(T_max). So the speed at the point is at least

.. math:: \frac{F}{\sqrt{T_{max}\, 2 \rho \pi R^2}} \, (1 + \sqrt 2 D / R)^{-2}

Centres are within (n - 1) l_c of their centroid, as in `nlp.bounds.reach`, or within 2 (n - 1) l_c of the module
that carries the rod.
"""

from __future__ import annotations

import math

import numpy as np

from nlp.bounds.effort import least_sizes
from nlp.bounds.refutation import (
    Refutation,
    bodies_mass,
    largest_thrust,
    modules,
    off_centre,
    tolerated_force,
    unseen_thrust,
)
from topo_search.model import ResolvedTask
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text
from topo_search.model.shape import Capsule, Cone, Shape


def windy(task: ResolvedTask) -> Refutation | None:
    """Return why the air over a region is faster than its limit in every design, if it is."""
    from_tip = _farthest_rotor(task)
    if from_tip is None:
        return None
    forces = least_sizes(task)
    k, n, R = int(np.argmax(forces)), task.n, task.module.body.rotor_radius
    most = (largest_thrust(task) + unseen_thrust(task)) / (4 * n)
    force = float(forces[k]) - tolerated_force(task)
    induced = force / math.sqrt(most * 2 * task.air_density * math.pi * R**2)
    for e, exposure in enumerate(task.exposure):
        if exposure.speed is None:
            continue
        distance = from_tip + min(map(_nearest, exposure.shapes))
        least = induced / (1 + math.sqrt(2) * distance / R) ** 2
        if least > exposure.speed:
            shown, limit = excess_texts(least, exposure.speed)
            return Refutation(
                f"air over exposure {e} ({exposure.kind}), {task.case_labels[k]}",
                least - exposure.speed,
                "m/s",
                f"exposure[{e}].speed = {limit} m/s is out of reach of {modules(task)}: all rotors are within "
                f"{lower_text(distance)} m of a point of the region, where the air that they draw in for "
                f"{task.case_labels[k]} alone makes {shown} m/s at least",
            )
    return None


def _farthest_rotor(task: ResolvedTask) -> float | None:
    """Return the largest distance of a rotor's centre from the end-effector [m]; None if it is unlimited."""
    n, module, reach = task.n, task.module, task.largest_reach(task.n)
    position, distances = task.end_effector.fixed_position, list[float]()
    if reach is not None:
        distances.append(reach + (2 * n - 1) * module.connector_distance)
    if position is not None:
        share = task.total_mass(n) / bodies_mass(task)
        q = share * (math.hypot(*position) + TOLERANCE * module.arm_length) + off_centre(task)
        distances.append(q + (n - 1) * module.connector_distance)
    return min(distances) + module.arm_length * (1 + TOLERANCE) if distances else None


def _nearest(shape: Shape) -> float:
    """Return the distance from the end-effector to a point of a region, if not to its nearest one [m]."""
    match shape:
        case Capsule(start=start):
            return math.hypot(*start)
        case Cone(apex=apex):
            return math.hypot(*apex)
        case _:
            return min(math.hypot(*corner) for corner in shape.corners)
