"""Defaults of a new task: what hovering needs, and the masses of rod and joints.

The design of least effort sits on every limit that its task leaves open. So where a load case carries the weight,
fields that a new task leaves out ask for what a hovering platform needs (`FLYING`): a horizontal force against
gusts, tilt and angular acceleration for the controller, errors of the centre of mass and of assembly, and rotors
that never stop. `flight.defaults = false` asks for none of them, a field of 0 not for its own. Rod and joints have
mass unless the task says otherwise, and the rod of a small module is as thin as its brackets require.

Designs and audits state every field.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from topo_search.model.bracket import Bracket
from topo_search.model.end_effector import EndEffector
from topo_search.model.goals import GOALS
from topo_search.model.joint_mass import tube_room
from topo_search.model.kinds import Number, Vector
from topo_search.model.load_case import LoadCase
from topo_search.model.module import Module
from topo_search.model.proven import lower_text
from topo_search.model.sensitivity import Tolerances
from topo_search.model.value import Value

if TYPE_CHECKING:
    from topo_search.model.audit import Audit
    from topo_search.model.design import Design
    from topo_search.model.task import Task

FLYING: dict[str, Any] = {
    "flight.force_reserve": 0.25,
    "flight.at": "com",
    "flight.directions": "horizontal",
    "flight.tilt_deg": 10.0,
    "flight.angular_acceleration": (11.0, 11.0, 11.0),
    "flight.com_error": 0.01,
    "tolerances.hinge_angle_deg": 0.3,
    "tolerances.position": 0.001,
    "module.min_input": 0.03,
}
"""Defaults of a task that carries the weight, as in the shipped flying tasks; the force reserve in weights."""
POINT = ("flight.at", "flight.directions")
"""Fields that say where the force reserve is asked for: without a stated reserve those of its default."""
MEANING = {
    "flight.force_reserve": ("side force", "weights", 1.0),
    "flight.tilt_deg": ("tilt", "deg", 1.0),
    "flight.angular_acceleration": ("angular acceleration", "rad/s^2", 1.0),
    "flight.com_error": ("offset of the centre of mass", "mm", 1000.0),
    "tolerances.hinge_angle_deg": ("hinge error", "deg", 1.0),
    "tolerances.position": ("position error", "mm", 1000.0),
    "module.min_input": ("least input", "u_max", 1.0),
}
"""Words, shown unit and factor to it of the fields of `FLYING`, except `POINT`."""
DROPPED = "no design holds the defaults of a flying task, so this one was solved without them"
"""Remark on a design that misses some."""
NEARLY = 0.999
"""Share of a default that counts as all of it: audits have tolerances."""
OLDER: dict[str, dict[str, Any]] = {
    "flight": {"tolerances": None, "defaults": False, "at": "tip"},
    "end_effector": {"rod_mass": "ignored"},
    "module": {"joint_mass": 0.0},
}
"""Meaning of fields that the tasks of older designs and runs lack."""


def with_defaults(data: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a new task with its defaults; `flight.defaults` then lists those of `FLYING`.

    Without `modules`, a task with types of module has as many as they count. Fields of a wrong type are left for
    their own rules to refuse.
    """
    types = data.get("module_types")
    if "modules" not in data and isinstance(types, list | tuple) and types:
        counts = [kind.get("count") if isinstance(kind, dict) else getattr(kind, "count", None) for kind in types]
        if all(type(count) is int for count in counts):
            data = {**data, "modules": sum(counts)}
    read = {
        name: _table(data, name) for name in ("module", "end_effector", "search", "flight", "tolerances", "goals")
    }
    tables = {name: table for name, table in read.items() if table is not None}
    if len(tables) < len(read):
        return data
    flight, end_effector, tolerances = (tables[name] for name in ("flight", "end_effector", "tolerances"))
    needs_rod = end_effector.get("rod", "straight") == "straight" and end_effector.get("largest_reach") is not False
    end_effector.setdefault("rod_mass", "included" if needs_rod else "ignored")
    if needs_rod and not {"rod_radius", "rod_linear_density"} & set(end_effector):
        end_effector.update(_thin_rod(tables["module"]))
    asked = flight.get("defaults", True)
    if isinstance(asked, list | tuple):  # filled in before; a field changed since is stated
        for path in asked:
            part, _, field = path.partition(".")
            value = tables.get(part, {}).get(field)
            if path in FLYING and FLYING[path] == (tuple(value) if isinstance(value, list) else value):
                del tables[part][field]
        if not any(tolerances.values()):
            flight.pop("tolerances", None)
    stated = {f"{part}.{field}" for part, table in tables.items() for field in table}
    stated |= {goal.field for name, goal in GOALS.items() if tables["goals"].get(name)}
    maximized = f"flight.{tables['search'].get('maximize')}"
    if maximized == "flight.force_reserve":
        for field in ("at", "directions"):
            flight.setdefault(field, FLYING[f"flight.{field}"])
    stated.add(maximized)
    if "flight.force_reserve" in stated:
        flight.setdefault("at", "both")
        stated.update(POINT)
    if tables["search"].get("interference") == "parts":  # tolerances are not proven for parts
        stated.update(path for path in FLYING if path.startswith("tolerances"))
    filled = [path for path in FLYING if path not in stated] if asked is not False and _hovers(data) else []
    for path in filled:
        part, field = path.split(".")
        tables[part][field] = FLYING[path]
    if filled:
        flight["defaults"] = filled
    if any(tolerances.values()):
        flight.setdefault("tolerances", True)
    return data | {name: table for name, table in tables.items() if table or name in data}


def fallback(task: Task) -> Task:
    """Return a task without the defaults of flying tasks, all that it states kept.

    If it left the force reserve out, and has no goals, the largest one is sought.
    """
    maximized = task.search.maximize
    if "flight.force_reserve" in task.flight.filled and not (maximized or task.goals.names):
        maximized = "force_reserve"
    point = {path.removeprefix("flight."): FLYING[path] for path in POINT if maximized == "force_reserve"}
    for path in task.flight.filled:
        part, field = path.split(".")
        task = task.with_fields(part, **{field: type(getattr(task, part)).model_fields[field].default})
    tolerances = task.flight.tolerances if task.tolerances != Tolerances() else None
    dropped = tuple(path for path in task.flight.filled if path not in POINT)
    task = task.with_fields("search", maximize=maximized)
    return task.with_fields("flight", defaults=False, tolerances=tolerances, dropped=dropped, **point)


def scaled_defaults(task: Task, share: float) -> Task:
    """Return a task with a share of the default side force, tilt and angular acceleration."""
    fields = {
        "force_reserve": share * FLYING["flight.force_reserve"],
        "tilt_deg": share * FLYING["flight.tilt_deg"],
        "angular_acceleration": tuple(share * a for a in FLYING["flight.angular_acceleration"]),
    }
    left_out = {name: x for name, x in fields.items() if f"flight.{name}" in task.flight.filled}
    return task.with_fields("flight", **left_out)


class Missed(Value):
    """Default of flying tasks that no design holds, and what the best design on paper holds of it by itself."""

    field: str
    asked: Number | Vector
    held: Number | Vector

    @property
    def words(self) -> str:
        """Amount held, of the amount asked for."""
        name, unit, factor = MEANING[self.field]
        asked, held = (np.min(value) * factor for value in (self.asked, self.held))
        return f"{name} {lower_text(held, 2)} of {asked:g} {unit}"


def find_missed(design: Design, audit: Audit) -> tuple[Missed, ...]:
    """Return the dropped defaults that a design misses; all of them if it holds each by itself."""
    if audit.flight is None:
        return ()
    hover, task = audit.flight.hover, design.task
    tables = [(kind.rotor_table.count, kind.max_inputs(task.gravity)) for kind in task.modules_of_nodes]
    least = [float(np.min(design.inputs[:, i, :r] / largest)) for i, (r, largest) in enumerate(tables) if r]
    clearances = (pair.analytic_m if pair.lower_m is None else pair.lower_m for pair in audit.pairs)
    held = {
        "flight.force_reserve": (hover.horizontal_reserve_com_N or 0.0) / task.force_unit(task.n),
        "flight.tilt_deg": hover.tilt_deg or 0.0,
        "flight.angular_acceleration": hover.angular_acceleration_rad_s2 or (0.0, 0.0, 0.0),
        "flight.com_error": hover.com_error_m or 0.0,
        "tolerances.hinge_angle_deg": audit.flight.hinge_tolerance_deg or 0.0,
        "tolerances.position": max(0.0, min(clearances, default=0.0)) / 2,  # both bodies of a pair may move
        "module.min_input": max(0.0, min(least)) / task.search.peak_input,
    }
    dropped = [Missed(field=path, asked=FLYING[path], held=held[path]) for path in task.flight.dropped]
    return tuple(x for x in dropped if np.any(np.less(x.held, np.multiply(NEARLY, x.asked)))) or tuple(dropped)


def with_older_defaults(data: Any) -> Any:
    """Return the data of a task in a run or design file, with `OLDER` for fields that it lacks."""
    if not isinstance(data, dict):
        return data
    filled = {
        name: {**fields, **table} for name, fields in OLDER.items() if isinstance(table := data.get(name, {}), dict)
    }
    return {**data, **filled}


def _table(data: dict[str, Any], name: str) -> dict[str, Any] | None:
    """Return the stated fields of a table; None for data of another type."""
    table = data.get(name, {})
    if isinstance(table, Value):
        return {field: getattr(table, field) for field in table.model_fields_set}
    return dict(table) if isinstance(table, dict) else None


def _thin_rod(module: dict[str, Any]) -> dict[str, float]:
    """Return a thinner rod for a module whose brackets have no room for the default one, in steps of 0.5 mm."""
    numbers = [module.get(name, Module.model_fields[name].default) for name in ("connector_distance", "mass")]
    if not all(isinstance(number, int | float) and 0 < number < math.inf for number in numbers):
        return {}
    usual, step = EndEffector(), 0.0005
    radius = step * max(1, math.floor(tube_room(Bracket.of_module(*numbers)) / step))
    if radius >= usual.rod_radius:
        return {}
    share = radius / usual.rod_radius
    return {"rod_radius": radius, "rod_linear_density": round(share**2 * usual.rod_linear_density, 6)}


def _hovers(data: dict[str, Any]) -> bool:
    """True if a load case carries the weight."""
    cases = data.get("load_cases")
    return isinstance(cases, list | tuple) and any(
        case.carries_weight if isinstance(case, LoadCase) else isinstance(case, dict) and case.get("carries_weight")
        for case in cases
    )
