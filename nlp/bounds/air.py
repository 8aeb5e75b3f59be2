r"""Lower bounds on air speed, wherever the modules are: rotors draw air in from all sides.

| symbol | meaning | unit |
|---|---|---|
| F | size of the force of a load case | N |
| T_max | largest thrust of the rotor of which this is least | N |
| D | largest distance of a rotor's centre from some point of the region | m |
| R, rho | radius of a rotor; density of air | m; kg/m^3 |

A single rotor of thrust T makes at least sqrt(T / (2 rho pi R^2)) / (1 + sqrt 2 D / R)^2 at the distance D
(H_q of `nlp.air.jets`), a module at least the sum over its rotors, and speeds of modules add up. Thrusts
add up to at least F, and sqrt(T) >= T / sqrt(T_max). So the speed at the point is at least

.. math:: \frac{F}{\sqrt{T_{max}\, 2 \rho \pi R^2}} \, (1 + \sqrt 2 D / R)^{-2}

Centres are within (n - 1) l_c of their centroid, as in `nlp.bounds.reach`, or within 2 (n - 1) l_c of the module
that carries the rod.
"""

import math

import numpy as np

from nlp.bounds import refutation
from nlp.bounds.effort import least_force_norms
from topo_search.model import Array, Module, ResolvedTask
from topo_search.model.proven import TOLERANCE, excess_texts, lower_text


def refute_airspeed(task: ResolvedTask) -> refutation.Refutation | None:
    """Refute the task if the air over a region is faster than its limit in every design."""
    rotor_distance = _farthest_rotor(task)
    if rotor_distance is None:
        return None
    forces = least_force_norms(task)
    k, R = int(np.argmax(forces)), np.concatenate([kind.rotor_radii for kind in task.types])
    max_thrusts = np.concatenate([_max_thrusts(task, kind) for kind in task.types])
    force = float(forces[k]) - refutation.tolerated_force(task)
    induced = force / np.sqrt(max_thrusts * 2 * task.air_density * math.pi * R**2)
    for e, region in enumerate(task.exposure):
        if region.speed is None:
            continue
        distance = rotor_distance + min(shape.distance for shape in region.shapes)
        airspeed = float((induced / (1 + math.sqrt(2) * distance / R) ** 2).min())
        if airspeed > region.speed:
            airspeed_text, limit_text = excess_texts(airspeed, region.speed)
            return refutation.Refutation(
                f"air over exposure {e} ({region.kind}), {task.case_labels[k]}",
                airspeed - region.speed,
                "m/s",
                f"exposure[{e}].speed = {limit_text} m/s is out of reach of {refutation.size_text(task)}: "
                f"all rotors are within {lower_text(distance)} m of a point of the region, where the air that they "
                f"draw in for {task.case_labels[k]} alone makes {airspeed_text} m/s at least",
            )
    return None


def _max_thrusts(task: ResolvedTask, module: Module) -> Array:
    """Return the largest thrust of each rotor of a module, shape (r,) [N]."""
    inputs = task.max_input * task.rotor_shares(module) + TOLERANCE * task.module.max_input(task.gravity)
    return np.asarray(module.thrust_coefficient * module.rotor_table.gains * inputs)


def _farthest_rotor(task: ResolvedTask) -> float | None:
    """Return the largest distance of a rotor's centre from the end-effector [m]; None if there is no limit."""
    n, l_c, reach = task.n, task.longest_connector, task.largest_reach(task.n)
    position, distances = task.end_effector.fixed_position, list[float]()
    if reach is not None:
        distances.append(reach + (2 * n - 1) * l_c)
    if position is not None:
        mass_ratio, shift = task.total_mass(n) / refutation.bodies_mass(task), TOLERANCE * task.module.arm_length
        q = mass_ratio * (math.hypot(*position) + shift) + refutation.centre_offset(task)
        distances.append(q + (n - 1) * l_c)
    return min(distances) + refutation.longest_arm(task) * (1 + TOLERANCE) if distances else None
