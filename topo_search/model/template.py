"""A commented task file to start from; what it says of a field is the field's own documentation."""

from __future__ import annotations

import json
import textwrap
import tomllib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from topo_search.model.task import Task

HEAD = """\
# A task for topo-search: what the platform's tool must do, and what its airflow must not reach.
# `topo-search check THIS_FILE` explains it in words; `topo-search run THIS_FILE` searches the best platform for it.
# Axes are those of the task; lengths are in metres, angles in degrees.
# Lines that start with # show defaults, or examples where there is no default. Remove the # to change a value.

name = "{name}"
modules = 5                         # number of modules; [4, 6] asks for 4, 5 and 6
"""

TASK = """
# Every load case is the total wrench of the rotors. Gravity is included only if you ask for it: `carries_weight`
# adds the platform's weight, for any number of modules, to the force at the centre of mass. Forces are in units of
# the platform's weight m_t g and torques in arm_length m_t g, or with units = "SI" in N and N m. The default is
# zero. `weight` is the weight of the case in the control effort; with 0 it must be possible but adds none.

[[load_cases]]                      # push along x with a fifth of the weight while hovering
name = "push"                       # appears wherever the load case is mentioned
carries_weight = true
end_effector = { force = [0.2, 0.0, 0.0], torque = [0.0, 0.0, 0.0] }  # exerted by the platform, at its tool
com = { force = [0.0, 0.0, 0.0] }   # in addition, at the centre of mass: no lever arm
weight = 1.0
# # also required, at no effort: every force within an angle of an axis, instead of the force at the tool
# # cone = { axis = [1.0, 0.0, 0.0], half_angle_deg = 20.0, force = 0.25 }
# # or all wrenches in the convex hull of these and the one at the tool
# # vertices = [{ force = [0.2, 0.1, 0.0] }, { force = [0.2, 0.0, 0.0], torque = [0.1, 0.0, 0.0] }]

[[load_cases]]
name = "hover"
carries_weight = true

# Regions at the target that airflow must not reach: none, one, or several of these.

# [[exposure]]
# kind = "local"                    # a ball around the end-effector
# radius = 0.15
# # instead of the radius, one of these:
# # box = [0.4, 0.4, 0.2]           # edges along x, y and z, centred at the end-effector
# # mesh = "target.stl"             # the hulls of the bodies in an STL or OBJ file beside this one
# # scale = 0.001                   # metres per unit of the mesh
# # offset = [0.0, 0.0, 0.0]        # where the mesh's origin is, from the end-effector

# [[exposure]]
# kind = "directional"              # capsules along paths that start at the end-effector
# radius = 0.15
# segments = [[1.0, 0.0, 0.0]]      # end points, relative to the end-effector
# # instead of segments: bent paths, each a list of points, or one path along the line from the centre of mass:
# # polylines = [[[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, -0.5]]]
# # along = "end_effector"
# # length = 1.0

# [[exposure]]
# kind = "exterior"                 # all airflow stays inside a cone with its apex at the end-effector
# half_angle_deg = 60.0             # up to 90
# axis = "com"                      # towards the centre of mass; or [x, y, z], from the end-effector into the cone

# [[exposure]]
# kind = "allowed"                  # all airflow stays on one side of each plane
# planes = [{ normal = [1.0, 0.0, 0.0], offset = 0.0 }]  # normal . x <= offset, x from the end-effector
# # of every kind of region: the air in it is at most so fast, in every load case, beside the envelopes or alone
# speed = 1.0                       # m/s, by the jet model
# speed_within = 3.0                # m from the end-effector, of `exterior` and `allowed`; default: everywhere
# geometry = true                   # false: envelopes may enter, only the speed is asked for
"""


EXAMPLES: dict[str, dict[str, Any]] = {
    "flight": {"rotor_out_torque": 0.01, "joint_moment": 2.0, "joint_force": 40.0, "tolerances": True},
    "module": {"joint_moment": 4.0, "joint_force": 60.0, "battery_Wh": 12.0},
    "airflow": {"speed": 2.0},
    "search": {"hinge_step_deg": 15.0, "hinge_angles_deg": (0.0, 30.0, 45.0, 60.0, 90.0)},
}
"""Values of fields that have no default."""
ADVISED: dict[str, dict[str, Any]] = {
    "module": {"torque_coefficient": 3.1e-9, "joint_mass": 0.085, "airflow": {"regions": {}}},
    "end_effector": {"rod_mass": "included"},
    "flight": {"at": "both"},
}
"""Fields that a new task states: better than the default, which is that of older tasks."""


def task_template(name: str) -> str:
    """Return the text of a task file with every field, its default and what it means."""
    task = Task.model_validate(tomllib.loads(HEAD.format(name=name) + TASK) | ADVISED)
    filled = task.resolve(5)
    module, k_f = filled.module, filled.module.thrust_coefficient
    derived = {
        "max_thrust": k_f * filled.max_input,
        "torque_to_thrust": module.torque_coefficient / k_f,
        "bracket": module.bracket_sizes,
        "airflow": module.airflow.model_copy(update=EXAMPLES["airflow"]),
    }
    changed = {
        "module": module.model_copy(update=derived | EXAMPLES["module"]),
        "flight": filled.flight.model_copy(update=EXAMPLES["flight"] | ADVISED["flight"]),
        "search": filled.search.model_copy(update=EXAMPLES["search"]),
    }
    filled = filled.model_copy(update=changed)
    explained = {"name", "modules", "load_cases", "exposure", "task_seed"}  # or of a random family
    top = "\n".join(_fields(task, filled, explained))
    tables = "\n".join(_tables(task, filled, ""))
    return f"{HEAD.format(name=name)}{top}\n{TASK}{tables}\n"


def _tables(task: BaseModel, filled: BaseModel, above: str) -> Iterator[str]:
    """Yield the lines of every table below a value."""
    for field in type(filled).model_fields:
        inside = getattr(filled, field)
        if isinstance(inside, BaseModel):
            optional, path = getattr(task, field) is None, f"{above}{field}"
            given = inside if optional else getattr(task, field)
            head = f"# [{path}]" if optional else f"[{path}]"
            yield from ("", head, *_fields(given, inside, set()), *_tables(given, inside, f"{path}."))


def _fields(task: BaseModel, filled: BaseModel, without: set[str]) -> Iterator[str]:
    """Yield a line for every field with a plain value by default, commented out, its meaning beside it."""
    comment_at, width = 36, 112  # column at which the words about a field begin, and that of their end
    for field, known in type(filled).model_fields.items():
        value = getattr(filled, field)
        # designs alone have `grows`
        if field in without | {"grows"} or value is None or isinstance(value, BaseModel):
            continue
        if getattr(task, field) is None and not isinstance(value, bool):
            value = _round(value)
        advised = any(field in table for table in ADVISED.values())
        line = f"{'' if advised else '# '}{field} = {json.dumps(value)}"
        words = textwrap.wrap(known.description or "", width - comment_at)
        if len(line) > comment_at - 2:
            yield line
            line = "#"
        for words_of_line in words:
            yield f"{line:{comment_at}}# {words_of_line}"
            line = "#"


def _round(derived: float | tuple[float, ...]) -> float | list[float]:
    """Return a default that other fields give, in four digits."""
    if isinstance(derived, tuple):
        return [float(f"{x:.4g}") for x in derived]
    return float(f"{derived:.4g}")
