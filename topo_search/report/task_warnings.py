"""Warnings of `topo-search check`: values of a task that are allowed but probably unintended.

Many come from wrong units: grams for kilograms or newtons, millimetres, rpm, radians. Each value is compared with
others that the same slip would not change: lengths with the arm, the mass with the rotor area, coefficients with
the rotor radius. A value is not checked against one that is itself suspicious.

| symbol | meaning | unit |
|---|---|---|
| l_arm, r | arm length; radius of a rotor, l_arm / 2 by default | m |
| m, m_E | masses of a module and of the end-effector | kg |
| k_f, k_tau | thrust and drag torque of a rotor over its squared speed | N s^2, N m s^2 |
| C_T | 4 pi^2 k_f / (rho (2 r)^4), thrust coefficient of a propeller | |
| m g / (4 pi r^2) | disc loading in hover | N/m^2 |

Small propellers at rest have C_T between 0.05 and 0.2 (Brandt and Selig, AIAA 2011-1255). Per rpm^2, k_f is 91
times smaller, so a range wide enough for every propeller detects that unit. Disc loadings of multirotors are 20 to
300 N/m^2. Figures of merit of small rotors are 0.35 to 0.8; `read_task` refuses values above 1, which are
impossible.

| symbol | meaning | unit |
|---|---|---|
| F_z, m_t g | upward force of a load case; weight of the platform | N |
"""

import math
import re
import warnings
from collections import defaultdict
from collections.abc import Iterator
from itertools import chain, starmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from topo_search.limits import quantity
from topo_search.model import Module, Task, task_file
from topo_search.model.body import OUTWARDS, Body
from topo_search.model.folds import folds_text
from topo_search.model.load_case import LoadCase, objects
from topo_search.model.placement import blocks
from topo_search.model.proven import excess_texts, upper_text
from topo_search.model.room import LARGE, bracket_obstacle, frame_reach, packed_width, rotor_reach
from topo_search.model.value import Value, show


class TaskWarning(NamedTuple):
    """Allowed but suspicious value of a task."""

    path: str
    """Path of the field, e.g. `load_cases[2]`."""
    words: str
    """Reason for the warning, and what may be intended."""

    def __str__(self) -> str:
        """Return `path: words`."""
        return f"{self.path}: {self.words}"


class SuspiciousTask(UserWarning):
    """A value of a task is allowed but probably unintended; see `check`."""


_SHOWN = defaultdict[str, dict[Any, Any]](dict)
"""Registry of `warnings` for each task, by its name: a task just read is not warned about again."""


def read_task(path: str | Path, settings: tuple[str, ...] = ()) -> Task:
    """Return the task of a TOML file or of a shipped example; Python warns about its suspicious values.

    Paths of meshes are relative to the file's folder; in a shipped example, to the current one.

    Args:
        path: file, or name of a shipped example.
        settings: changes to the file's fields, `FIELD=VALUE`, applied in order.

    Raises:
        BadInput: one fault per broken rule, or the figure of merit of the rotors is above 1.

    Example:
        >>> from topo_search import read_task
        >>> read_task("wall-push", ("modules=[3, 4]",)).modules
        (3, 4)
    """
    task = task_file.read_task(path, settings)
    warn(task)
    return task


def warn(task: Task) -> None:
    """Give the warnings about a task as Python warnings of class `SuspiciousTask`."""
    for warning in task_warnings(task):
        warnings.warn_explicit(str(warning), SuspiciousTask, task.name, 0, registry=_SHOWN[task.name])


UNIT_IN_DOUBT = "is the unit right?"
Doubts = Iterator[tuple[str, str]]
"""Fields, and what is suspicious about each."""


def doubts(task: Task) -> Doubts:
    """Yield the fields of a task whose unit may be wrong, with the reason."""
    for step in (_module_size(task.module), _arm_lengths(task), chain(_mass(task), _thrust_coefficient(task))):
        suspicious = tuple(step)
        yield from suspicious
        if suspicious:
            break
    else:
        suspicious = (*_by_mass(task), *_torque_coefficient(task.module))
        yield from suspicious or _rotor(task)
    yield from _angles(task)
    yield from _accessories(task)


def _usual(path: str, value: float, low: float, high: float, unit: str, basis: str = "") -> Doubts:
    if not low <= value <= high:
        usual = f"{low:.3g} to {high:.3g} {unit}{basis}"
        yield path, f"{value:g} {unit} is outside {usual}: {UNIT_IN_DOUBT}"


def _module_size(module: Module) -> Doubts:
    yield from _usual("module.mass", module.mass, 0.01, 50.0, "kg")
    yield from _usual("module.arm_length", module.arm_length, 0.01, 2.0, "m")
    yield from _usual("module.connector_distance", module.connector_distance, 0.01, 3.0, "m")


USUAL = {
    "module.connector_distance": (0.2, 5.0),
    **dict.fromkeys(("module.body.rotor_radius", "module.rotors.radius"), (0.15, 1.0)),
    "module.body.hub": (0.005, 4.0),
    "module.bracket.bolt_circle": (0.02, 1.0),
    "module.bracket.bolt_diameter": (0.004, 0.5),
    "end_effector.rod_radius": (0.001, 0.5),
    "end_effector.rod_deflection": (0.0, 1.0),
    "goals.clearance": (0.0, 0.4),
    **dict.fromkeys(("module.body.rotor_height", "module.body.arm_width"), (0.001, 1.0)),
    **dict.fromkeys(("module.body.frame.vertices", "module.rotors.position"), (0.0, 5.0)),
    **dict.fromkeys(("module.airflow.start_radius", "module.airflow.regions.start_radius"), (0.1, 10.0)),
    **dict.fromkeys(("module.airflow.reach", "module.airflow.regions.reach"), (0.5, 200.0)),
    **dict.fromkeys(("module.bracket.thickness", "module.bracket.wall"), (0.002, 0.5)),
    **dict.fromkeys(("tolerances.position", "tolerances.envelope", "flight.com_error"), (0.0, 0.2)),
    **dict.fromkeys(("search.margin", "search.centre_margin"), (0.0, 0.2)),
    **dict.fromkeys(("search.separation", "search.body_clearance"), (0.2, 20.0)),
}
"""Usual lengths by field, without its indices [l_arm]."""
LONG_PATH = 20.0
USUAL_AT_TARGET = {
    **dict.fromkeys((f"end_effector.{name}" for name in ("position", "stand_off", "largest_reach")), LARGE),
    **dict.fromkeys(
        (f"exposure.{name}" for name in ("radius", "box", "vertices", "pieces", "planes.offset")), LARGE
    ),
    **dict.fromkeys(
        (f"exposure.{name}" for name in ("segments", "polylines", "length", "speed_within")), LONG_PATH
    ),
    "goals.stand_off": LARGE,
}
"""Largest usual lengths at the target by field, without its indices [widths of the modules packed in a square]."""


def _sizes(value: Any, path: str = "") -> Iterator[tuple[str, str, float]]:
    """Yield path, path without indices and largest absolute value of the fields with numbers other than zero.

    Types of module are left out: `_types` takes each as the module.
    """
    if isinstance(value, Value):
        for name, part in value:
            if name != "module_types":
                yield from _sizes(part, f"{path}.{name}" if path else name)
    elif isinstance(value, tuple) and value and isinstance(value[0], Value):
        for k, part in enumerate(value):
            yield from _sizes(part, f"{path}[{k}]")
    elif size := _largest(value):
        yield path, re.sub(r"\[\d+\]", "", path), size


def _largest(value: Any) -> float:
    if isinstance(value, tuple):
        return max(map(_largest, value), default=0.0)
    return abs(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0


def _arm_lengths(task: Task) -> Doubts:
    """Yield lengths that do not fit the arm length."""
    arm = task.module.arm_length
    for path, field, size in _sizes(task):
        if field in USUAL:
            low, high = USUAL[field]
            yield from _usual(path, size, low * arm, high * arm, "m", f", usual with arms of {arm:g} m")


def _radius(module: Module) -> float:
    is_default = module.body.rotor_radius == Body().rotor_radius
    return module.arm_length / 2 if is_default else module.body.rotor_radius


def _mass(task: Task) -> Doubts:
    r = _radius(task.module)
    usual = 3.0, 1000.0  # disc loading in hover [N/m^2]
    low, high = (loading * task.module.rotor_table.count * math.pi * r**2 / task.gravity for loading in usual)
    yield from _usual("module.mass", task.module.mass, low, high, "kg", f", usual with rotors of {r:g} m radius")


def _thrust_coefficient(task: Task) -> Doubts:
    module, r = task.module, _radius(task.module)
    low, high = 0.01, 1.0  # usual C_T: from a fifth of the smallest measured one to five times the largest
    air_density = 1.225  # at sea level [kg/m^3]
    C_T = 4 * math.pi**2 * module.thrust_coefficient / (air_density * (2 * r) ** 4)
    if module.thrust_coefficient != Module().thrust_coefficient and not low <= C_T <= high:
        speed = math.sqrt(module.max_input(task.gravity))
        yield (
            "module.thrust_coefficient",
            f"full thrust then needs {speed:.3g} rad/s ({speed * 30 / math.pi:.3g} rpm); with rotors of {r:g} m "
            f"radius, C_T = {C_T:.2g} is outside {low:g} to {high:g}: is it in N s^2/rad^2, not per rpm^2?",
        )


def _torque_field(module: Module) -> str:
    return "module.torque_to_thrust" if module.torque_to_thrust else "module.torque_coefficient"


def _torque_coefficient(module: Module) -> Doubts:
    drag = module.torque_coefficient / module.thrust_coefficient
    if not 0.01 * module.arm_length <= drag <= module.arm_length:
        unit = "m" if module.torque_to_thrust else "N m s^2/rad^2"
        than = "more than" if drag > module.arm_length else "less than a hundredth of"
        words = f"k_tau / k_f = {drag:.3g} m is {than} the arm, {module.arm_length:g} m: is it in {unit}?"
        yield _torque_field(module), words


def _rotor(task: Task) -> Doubts:
    """Yield what is implausible for a rotor of that size at rest."""
    module, r = task.module, task.module.body.rotor_radius
    rotors = f"of rotors of {r:g} m radius"
    if not 0.35 <= (merit := module.figure_of_merit(task.air_density)) <= 0.8:
        drag = module.torque_coefficient / module.thrust_coefficient
        yield (
            _torque_field(module),
            f"the figure of merit {rotors} is {merit:.3g}, usual are 0.35 to 0.8: with k_tau / k_f = {drag:.3g} m "
            f"they take {'less' if merit > 0.8 else 'more'} power than any that are built",
        )
    if not 0.05 <= (C_T := module.propeller_coefficient(task.air_density)) <= 0.2:
        yield "module.thrust_coefficient", f"C_T {rotors} is {C_T:.3g}, usual are 0.05 to 0.2"
    if not 0.5 <= module.jet_momentum <= 2:
        yield (
            "module.airflow.jet",
            f"the jet carries {module.jet_momentum:.3g} of the thrust as momentum {rotors}, which should be near "
            "1: its constants were measured on other modules",
        )
    sound = 340.0  # at 15 degrees Celsius [m/s]
    if (speed := module.tip_speed(module.max_input(task.gravity))) > 0.6 * sound:
        words = f"at full thrust tips {rotors} move at {speed:.3g} m/s, more than 0.6 times the speed of sound"
        yield "module.thrust_coefficient", words


def _by_mass(task: Task) -> Doubts:
    """Yield thrusts, masses and inertia that do not fit the module's mass."""
    module, tip, n = task.module, task.end_effector, task.sizes[-1]
    much = 20.0  # thrust over weight; racing quadrotors reach 15
    if (ratio := module.max_thrust_to_weight) > much:
        name, hint = ("max_thrust_to_weight", "is it a ratio, not a thrust or per cent?")
        if module.max_thrust is not None:
            name, hint = "max_thrust", "is it of one rotor in N, and the mass in kg?"
        words = f"the thrust of a module is {ratio:.3g} times its weight, more than the usual {much:g}: {hint}"
        yield f"module.{name}", words
    if tip.mass > (mass := task.modules_mass(n)):
        modules = "the module" if n == 1 else f"all {n} modules"
        yield "end_effector.mass", f"{tip.mass:g} kg is more than {modules}, {mass:g} kg: is it in kg?"
    # tungsten, denser than any usual material, has 19,300 kg/m^3
    if (density := tip.rod_linear_density / (math.pi * tip.rod_radius**2)) > 20_000.0:
        yield (
            "end_effector.rod_linear_density",
            f"{tip.rod_linear_density:g} kg/m of {tip.rod_radius:g} m radius is {density:.3g} kg/m^3, denser than "
            "tungsten: is it in kg/m?",
        )
    usual = 0.1, 3.0  # radius of gyration [l_arm]; a ring of rotors has 1
    least, most = (module.mass * (share * module.arm_length) ** 2 for share in usual)
    basis = f", usual of {module.mass:g} kg with arms of {module.arm_length:g} m"
    for k, moment in enumerate(module.body.inertia or ()):
        yield from _usual(f"module.body.inertia[{k}]", moment, least, most, "kg m^2", basis)


def _accessories(task: Task) -> Doubts:
    """Yield implausible properties of rod, battery, joints and tolerances."""
    module, tip, arm = task.module, task.end_effector, task.module.arm_length
    weight = task.force_unit(task.sizes[-1])
    yield from _usual("end_effector.rod_modulus", tip.rod_modulus, 1e8, 1e12, "Pa")
    yield from _battery(module)
    for name, largest, unit in (("joint_force", 100 * weight, "N"), ("joint_moment", 100 * weight * arm, "N m")):
        if (rated := getattr(module, name)) is not None:
            yield from _usual(f"module.{name}", rated, 0.0, largest, unit, " by the platform's weight")


def _battery(module: Module) -> Doubts:
    if module.battery_Wh is not None:  # cells have up to 0.3 kW h/kg
        yield from _usual("module.battery_Wh", module.battery_Wh, 0.0, 500 * module.mass, "W h", " by its mass")


def _angles(task: Task) -> Doubts:
    for path, field, angle in _sizes(task):
        # smaller ones may be radians: a right angle is 1.571; errors of hinges are of the order of 1 mm at 1.1 m
        least = 0.05 if field.endswith("hinge_angle_deg") else 1.6
        if field.endswith("_deg") and angle < least:
            small = f"{angle:g} deg is small ({math.degrees(angle):.3g} deg if it were in radians)"
            yield path, f"{small}: is it in degrees?"
    fastest = max(task.flight.angular_acceleration)
    yield from _usual("flight.angular_acceleration", fastest, 0.0, 300.0, "rad/s^2")


def task_warnings(task: Task) -> tuple[TaskWarning, ...]:
    """Return the warnings about a task, in the order of the task file."""
    n = task.sizes[-1]
    modules = chain(_module(task.module), _types(task), _bracket(task))
    parts = chain(_gravity(task), doubts(task), modules, _lengths(task, n))
    requirements = chain(
        _frame(task.module), _meshes(task), _thrust(task, n), _load_cases(task, n), _tool_side(task), _search(task)
    )
    return tuple(starmap(TaskWarning, chain(parts, requirements)))


def _gravity(task: Task) -> Doubts:
    if not 9.76 <= task.gravity <= 9.84:  # from the equator to the poles
        yield "gravity", f"{task.gravity:g} m/s^2 is not that of the Earth's surface"


def _types(task: Task) -> Doubts:
    """Yield what is suspicious about types of module, and not already about what they leave out."""

    def of_module(task: Task) -> set[tuple[str, str]]:
        module = task.module
        parts = (_module_size(module), _battery(module), _module(module), _frame(module), _angles(task))
        return {*chain(*parts, doubts(task) if module.rotor_table.count else _arm_lengths(task))}

    known = of_module(task)
    for k, kind in enumerate(task.module_types):
        found = of_module(task.model_copy(update={"module": kind, "module_types": (), "modules": kind.count}))
        for path, words in sorted(found - known):
            if path.startswith("module."):
                yield path.replace("module", f"module_types[{k}]", 1), words


def _module(module: Module) -> Doubts:
    """Yield signs of parts that cannot be built as given."""
    body = module.body
    centres = module.rotor_table.positions
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)[~np.eye(len(centres), dtype=bool)]
    if 2 * body.rotor_radius > module.arm_length * apart.min(initial=np.inf):
        yield "module.body.rotor_radius", "adjacent rotors of a module overlap"
    least = rotor_reach(module) + body.rotor_radius
    if module.connector_distance < least:
        yield (
            "module.connector_distance",
            f"rotors reach {least:.3g} m out, beyond the connector at {module.connector_distance:g} m: those of "
            "two modules that are bolted together flat overlap",
        )
    if (reach := frame_reach(module)) > (1 + OUTWARDS) * module.connector_distance:
        yield (
            "module.body",
            f"hub and arms reach {reach:.3g} m out, past the connector at {module.connector_distance:g} m: those "
            "of two modules that are bolted together may overlap, and the search does not prevent that",
        )


def _bracket(task: Task) -> Doubts:
    """Yield a bracket that fits at no hinge angle, at a module of any type."""
    if (sizes := task.module.bracket) is None:
        return
    obstacles = (bracket_obstacle(kind.model_copy(update={"bracket": sizes})) for kind in task.types)
    for obstacle in dict.fromkeys(filter(None, obstacles)):
        yield (
            "module.bracket",
            f"does not fit between the modules at any hinge angle: its flanges, {2 * sizes.half_width:.3g} m wide "
            f"and {sizes.set_back:.3g} m from the connector, reach {obstacle} of their own module: make it "
            "smaller, or connector_distance larger",
        )


def _lengths(task: Task, n: int) -> Doubts:
    """Yield lengths at the target that may be in centimetres or millimetres."""
    width = packed_width(task.longest_connector, n)
    for path, field, length in _sizes(task):
        if length > USUAL_AT_TARGET.get(field, math.inf) * width:
            yield (
                path,
                f"{length:g} m is {length / width:.0f} times the width of {n} modules in a square, "
                f"{width:.3g} m: lengths are in metres",
            )


def _frame(module: Module) -> Doubts:
    """Yield a frame that is larger than its mesh."""
    if beyond := module.body.frame_excess:
        words = f"reaches up to {upper_text(beyond, 3)} m beyond its mesh, because pieces are convex"
        yield "module.body.frame", words


def _meshes(task: Task) -> Doubts:
    """Yield regions that are larger than their mesh."""
    for e, exposure in enumerate(task.exposure):
        for piece, excess in exposure.mesh_excesses():
            yield (
                f"exposure[{e}]" if piece is None else f"exposure[{e}].pieces[{piece}]",
                f"reaches up to {upper_text(excess, 3)} m beyond its mesh, because pieces are convex and have "
                "few corners: cut the mesh into closed convex bodies that share no edge to come closer",
            )


def _thrust(task: Task, n: int) -> Doubts:
    thrust, weight = largest_thrust(task, n), task.force_unit(n)
    if thrust < weight:
        load, total = excess_texts(weight, thrust)
        units = ": are thrusts in N and masses in kg?" if 2 * thrust < weight else ""
        limit = "module.max_thrust_to_weight" if task.module.max_thrust is None else "module.max_thrust"
        yield (
            limit if task.search.peak_input == 1 else "search.peak_input",
            f"all rotors together produce at most {total} N, but {_platform(n)} weigh {load} N{units}",
        )


def _load_cases(task: Task, n: int) -> Doubts:
    if task.load_cases == "ten-wrenches":
        return
    weight = task.force_unit(n)
    unnamed_cases = [case.model_copy(update={"name": None}) for case in task.load_cases]
    cases = [case.to_si(weight, task.torque_unit(n)) for case in unnamed_cases]
    for k, case in enumerate(cases):
        path, upwards = f"load_cases[{k}]", case.at_com.force[2] + case.at_end_effector.force[2]
        if case.largest == 0:
            yield path, "asks for no force and no torque: every design meets that with its rotors off"
        elif max(case.at_com.force[2], upwards) < weight * (1 - 1e-9):  # up to rounding
            yield (
                path,
                f"its upward force of {upwards:.4g} N is less than the weight, {weight:.4g} N of {_platform(n)}; "
                "gravity is included only if you ask for it: to exert it while hovering, set "
                "carries_weight = true",
            )
        if (first := cases.index(case)) < k:
            yield path, f"is the same as load_cases[{first}]"
    if not any(_hovers(case, weight) for case in cases):
        yield "load_cases", "none is plain hover (only carries_weight = true): a design need not be able to hover"
    weights = [case.weight for case in cases if case.weight]
    if max(weights) > 1000 * min(weights):  # effort then counts for the heavier load case alone
        yield "load_cases", f"weights differ by a factor of {max(weights) / min(weights):.3g}: {show(weights)}"


def _tool_side(task: Task) -> Doubts:
    """Yield load cases that leave open from which side the tool comes to exert their force."""
    tip = task.end_effector
    if task.load_cases == "ten-wrenches" or tip.rod == "none" or tip.axis is not None:
        return
    regions = (*task.exposure, *objects(task.load_cases))
    for k, case in enumerate(task.load_cases):
        f = np.array(case.at_end_effector.force)
        if f.any() and not blocks(regions, f) and not blocks(regions, -f):
            yield (
                f"load_cases[{k}].contact",
                "from which side the tool comes is open, so its rod may pull where you mean it to push: if it "
                'pushes against an object, set contact = "push"; or give its direction by end_effector.axis',
            )


def _search(task: Task) -> Doubts:
    position, stand_off = task.end_effector.fixed_position, task.end_effector.stand_off
    if position is not None and math.hypot(*position) < stand_off:
        yield (
            "end_effector.stand_off",
            f"{stand_off:g} m is more than the {math.hypot(*position):.4g} m from the centre of mass to "
            "`end_effector.position`: the modules would have to surround the end-effector",
        )
    margin = task.search.margin
    folds = task.folds(margin)
    if not folds:
        yield "module.body", "no hinge angle is known to keep rotors clear of a bolted neighbour and its airflow"
    elif folds != ((-math.pi / 2, math.pi / 2),):
        turns = f"hinges turn by {folds_text(folds, ' deg')}"
        yield "module.body", f"{turns}: rotors reach a bolted neighbour or its airflow"
        angles = task.search.hinge_set_deg or ()
        unusable = [a for a in angles if not any(low <= math.radians(a) <= high for low, high in folds)]
        if unusable:
            examples = ", ".join(f"{angle:g}" for angle in unusable[:4]) + (", ..." if len(unusable) > 4 else "")
            yield (
                "search.hinge_angles_deg" if task.search.hinge_angles_deg else "search.hinge_step_deg",
                f"{len(unusable)} of {len(angles)} angles, {examples} deg, are beyond what hinges turn by, and "
                "never used",
            )
    if margin == 0:
        yield "search.margin", "with 0, clearances may be too close to zero for the audit to prove them"
    elif margin > 0.01:
        yield "search.margin", f"{margin:g} m beyond every clearance that the task asks for costs control effort"


def _platform(n: int) -> str:
    return f"{quantity(n, 'module')} and the end-effector"


def largest_thrust(task: Task, n: int) -> float:
    """Return the total thrust of all rotors of n modules that point in the same direction [N]."""
    counts: list[tuple[Module, int]] = [(kind, kind.count) for kind in task.module_types]
    peak, g = task.search.peak_input, task.gravity
    return sum(
        count * kind.rotor_table.count * kind.thrust_coefficient * (peak * kind.max_input(g))
        for kind, count in counts or [(task.module, n)]
    )


def _hovers(case: LoadCase, weight: float) -> bool:
    """True if a load case only carries the weight."""
    wrench = case.at_com
    others = (*case.at_end_effector.force, *case.at_end_effector.torque, *wrench.force[:2], *wrench.torque)
    return not any(others) and math.isclose(wrench.force[2], weight)
