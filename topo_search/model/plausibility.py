"""Values of a task that no machine has: grams for kilograms or newtons, millimetres, rpm, radians.

Each value is judged by others that a slip of units would not change with it: lengths by the arm, the mass by the
area of its rotors, coefficients by their radius. What is judged by a doubtful value is not judged.

| symbol | meaning | unit |
|---|---|---|
| l_arm, r | arm; radius of a rotor, half an arm where the task leaves it out | m |
| m, m_E | masses of a module and of the end-effector | kg |
| k_f, k_tau | thrust and drag torque of a rotor over its squared speed | N s^2, N m s^2 |
| C_T | 4 pi^2 k_f / (rho (2 r)^4), thrust coefficient of a propeller | |
| m g / (4 pi r^2) | disc loading in hover | N/m^2 |

Measured small propellers have C_T of 0.05 to 0.2 at rest (Brandt and Selig, AIAA 2011-1255). Per rpm^2, k_f is 91
times smaller, so that ranges with room for every propeller tell the two apart. Disc loadings of multirotors are 20
to 300 N/m^2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain

from topo_search.model.exposure import Exterior
from topo_search.model.module import Body, Module
from topo_search.model.task import Task

AIR_DENSITY = 1.225
"""rho, at sea level [kg/m^3]."""
THRUST_COEFFICIENT = 0.01, 1.0
"""Usual range of C_T: a fifth of the least measured to five times the largest."""
DISC_LOADING = 3.0, 1000.0
"""Usual range in hover [N/m^2]."""
MOST_THRUST = 20.0
"""Largest usual thrust over weight of a module; racing quadrotors reach 15."""
GYRATION = 0.1, 3.0
"""Usual radius of gyration of a module [l_arm]; a ring of four rotors has 1."""
DENSEST = 20_000.0
"""Density of a rod that no usual material has; tungsten's is 19,300 [kg/m^3]."""
LEAST_ANGLE_DEG = 1.6
"""Angles of cones up to here may be radians: a right angle is 1.571."""
LEAST_TOLERANCE_DEG = 0.05
"""Errors of hinges below that are seldom meant: 1 mm at 1.1 m."""

Doubts = Iterator[tuple[str, str]]
"""Fields with what is suspicious about them."""


def doubts(task: Task) -> Doubts:
    """Yield the fields of a task whose unit is doubtful, with the reason."""
    for step in (_absolute(task.module), _lengths(task), chain(_mass(task), _thrust_coefficient(task))):
        found = tuple(step)
        yield from found
        if found:
            break
    else:
        yield from _by_mass(task)
        yield from _torque_coefficient(task.module)
    yield from _angles(task)


def _usual(path: str, value: float, low: float, high: float, unit: str, basis: str = "") -> Doubts:
    if not low <= value <= high:
        usual = f"{low:.3g} to {high:.3g} {unit}{basis}"
        yield path, f"{value:g} {unit} is outside {usual}: is the unit right?"


def _absolute(module: Module) -> Doubts:
    yield from _usual("module.mass", module.mass, 0.01, 50.0, "kg")
    yield from _usual("module.arm_length", module.arm_length, 0.01, 2.0, "m")
    yield from _usual("module.connector_distance", module.connector_distance, 0.01, 3.0, "m")


def _lengths(task: Task) -> Doubts:
    """Yield lengths that do not go with the arm."""
    module, body, arm = task.module, task.module.body, task.module.arm_length
    ranges = (
        ("module.connector_distance", module.connector_distance, 0.2, 5.0),
        ("module.body.rotor_radius", body.rotor_radius, 0.15, 1.0),
        ("module.body.rotor_height", body.rotor_height, 0.001, 1.0),
        ("module.body.arm_width", body.arm_width, 0.001, 1.0),
        *((f"module.body.hub[{k}]", edge, 0.005, 4.0) for k, edge in enumerate(body.hub)),
        ("module.airflow.start_radius", module.start_radius, 0.1, 10.0),
        ("module.airflow.reach", module.reach, 0.5, 200.0),
        ("end_effector.rod_radius", task.end_effector.rod_radius, 0.001, 0.5),
    )
    for path, value, low, high in ranges:
        yield from _usual(path, value, low * arm, high * arm, "m", f", usual with arms of {arm:g} m")


def _radius(module: Module) -> float:
    left_out = module.body.rotor_radius == Body().rotor_radius
    return module.arm_length / 2 if left_out else module.body.rotor_radius


def _mass(task: Task) -> Doubts:
    r = _radius(task.module)
    low, high = (loading * 4 * math.pi * r**2 / task.gravity for loading in DISC_LOADING)
    yield from _usual("module.mass", task.module.mass, low, high, "kg", f", usual with rotors of {r:g} m radius")


def _thrust_coefficient(task: Task) -> Doubts:
    module, r = task.module, _radius(task.module)
    low, high = THRUST_COEFFICIENT
    C_T = 4 * math.pi**2 * module.thrust_coefficient / (AIR_DENSITY * (2 * r) ** 4)
    if module.thrust_coefficient != Module().thrust_coefficient and not low <= C_T <= high:
        speed = math.sqrt(module.max_input(task.gravity))
        yield (
            "module.thrust_coefficient",
            f"full thrust then needs {speed:.3g} rad/s ({speed * 30 / math.pi:.3g} rpm); with rotors of {r:g} m "
            f"radius, C_T = {C_T:.2g} is outside {low:g} to {high:g}: is it in N s^2/rad^2, not per rpm^2?",
        )


def _torque_coefficient(module: Module) -> Doubts:
    drag = module.torque_coefficient / module.thrust_coefficient
    if not 0.01 * module.arm_length <= drag <= module.arm_length:
        name, unit = (
            ("torque_to_thrust", "m") if module.torque_to_thrust else ("torque_coefficient", "N m s^2/rad^2")
        )
        than = "more than" if drag > module.arm_length else "less than a hundredth of"
        yield (
            f"module.{name}",
            f"k_tau / k_f = {drag:.3g} m is {than} the arm, {module.arm_length:g} m: is it in {unit}?",
        )


def _by_mass(task: Task) -> Doubts:
    """Yield thrusts, masses and inertia that do not go with the module's mass."""
    module, tip, n = task.module, task.end_effector, task.sizes[-1]
    if (ratio := module.max_thrust_to_weight) > MOST_THRUST:
        name, hint = ("max_thrust_to_weight", "is it a ratio, not a thrust or per cent?")
        if module.max_thrust is not None:
            name, hint = "max_thrust", "is it of one rotor in N, and the mass in kg?"
        yield (
            f"module.{name}",
            f"the thrust of a module is {ratio:.3g} times its weight, {MOST_THRUST:g} being much: {hint}",
        )
    if tip.mass > n * module.mass:
        modules = "the module" if n == 1 else f"all {n} modules"
        yield "end_effector.mass", f"{tip.mass:g} kg is more than {modules}, {n * module.mass:g} kg: is it in kg?"
    if (density := tip.rod_linear_density / (math.pi * tip.rod_radius**2)) > DENSEST:
        yield (
            "end_effector.rod_linear_density",
            f"{tip.rod_linear_density:g} kg/m of {tip.rod_radius:g} m radius is {density:.3g} kg/m^3, denser than "
            "tungsten: is it in kg/m?",
        )
    least, most = (module.mass * (share * module.arm_length) ** 2 for share in GYRATION)
    basis = f", usual of {module.mass:g} kg with arms of {module.arm_length:g} m"
    for k, moment in enumerate(module.body.inertia or ()):
        yield from _usual(f"module.body.inertia[{k}]", moment, least, most, "kg m^2", basis)


def _angles(task: Task) -> Doubts:
    cones = {f"load_cases[{k}].cone": case.cone for k, case in enumerate(task.cases) if case.cone}
    angles = (
        ("module.airflow.spread_angle_deg", task.module.airflow.spread_angle_deg, LEAST_ANGLE_DEG),
        *((f"{path}.half_angle_deg", cone.half_angle_deg, LEAST_ANGLE_DEG) for path, cone in cones.items()),
        *(
            (f"exposure[{e}].half_angle_deg", asked.half_angle_deg, LEAST_ANGLE_DEG)
            for e, asked in enumerate(task.exposure)
            if isinstance(asked, Exterior)
        ),
        ("tolerances.hinge_angle_deg", task.tolerances.hinge_angle_deg, LEAST_TOLERANCE_DEG),
    )
    for path, angle, least in angles:
        if 0 < angle < least:
            yield (
                path,
                f"{angle:g} deg is small ({math.degrees(angle):.3g} deg, were it in radians): is it in degrees?",
            )
