"""Types of module: a platform of several, each of which differs from `[module]`, the source of all it leaves out.

Joints are the same everywhere: what belongs to them stays with `[module]`. Rotors that a type takes over keep their
largest thrust, whatever its mass. The moments of inertia are taken over only with all that they follow from.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from topo_search.model.kinds import Count
from topo_search.model.module import Module
from topo_search.model.topology import LETTERS
from topo_search.model.value import Broken, every_field, show

if TYPE_CHECKING:
    from topo_search.model.task import Task

OF_THE_PLATFORM = ("joint_mass", "joint_moment", "joint_force", "min_input", "bracket")
"""Fields of `[module]` that are the same for all types."""
WITH_INERTIA = ("mass", "arm_length", "rotors", "body")
"""Fields without which a type has the source's moments of inertia."""
ALTERNATIVES = (("max_thrust", "max_thrust_to_weight"), ("torque_to_thrust", "torque_coefficient"))
"""Fields that state one quantity each: a type that gives either leaves both out of its source."""


class ModuleType(Module):
    """Type of module, a table of `[[module_types]]`: fields that it leaves out are those of `[module]`."""

    name: Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]*$", min_length=1, max_length=30)]
    """Name of the type."""
    count: Count
    """Number of modules of this type."""

    def _broken_rules(self) -> Broken:
        yield from super()._broken_rules()
        if self.max_thrust is not None and not self.rotor_table.count:
            yield "max_thrust", f"must be left out without rotors, but got {self.max_thrust:g}"
        for field in OF_THE_PLATFORM:
            if (value := getattr(self, field)) != type(self).model_fields[field].default:
                rule = "must be left out: it is [module]'s for all types"
                yield field, f"{rule}, but got {show(every_field(value, none=False))}"


def with_sources(types: Any, source: Module, gravity: float) -> Any:
    """Return tables of types with what they leave out filled in from their source.

    Values of a wrong type are left for their own rules to refuse.
    """
    if not isinstance(types, list | tuple):
        return types
    return [_with_source(table, source, gravity) if isinstance(table, dict) else table for table in types]


def _with_source(table: dict[str, Any], source: Module, gravity: float) -> dict[str, Any]:
    flies = table.get("rotors", source.rotors) not in ([], ())
    shared = source.model_dump(exclude_unset=True, exclude=set(OF_THE_PLATFORM))
    if "inertia" in shared.get("body", {}) and any(table.get(name) is not None for name in WITH_INERTIA):
        del shared["body"]["inertia"]
    shared["max_thrust"] = source.max_thrust or source.thrust_coefficient * source.max_input(gravity)
    if table.get("thrust_coefficient") is not None and source.torque_to_thrust is not None:
        shared.pop("torque_coefficient", None)
    shared.pop("max_thrust_to_weight", None)
    for fields in ALTERNATIVES:
        if any(table.get(field) is not None for field in fields) or ("max_thrust" in fields and not flies):
            shared = {name: value for name, value in shared.items() if name not in fields}
    return _merge(shared, table)


def _merge(shared: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Return all entries, those of `own` where both have one; tables are merged."""
    merged = {**shared, **own}
    for name, value in own.items():
        if isinstance(value, dict) and isinstance(shared.get(name), dict):
            merged[name] = _merge(shared[name], value)
    return merged


def broken_types(task: Task) -> Broken:
    """Yield what a task with types of module may not have."""
    types, several = task.module_types, "with module_types"
    if not types:
        return
    if task.modules != (total := sum(kind.count for kind in types)):
        counts = " + ".join(str(kind.count) for kind in types)
        rule = f"must be left out {several}, or the sum of their counts, {counts} = {total}"
        yield "modules", f"{rule}, but got {show(task.modules)}"
    names = Counter(kind.name for kind in types)
    for k, kind in enumerate(types):
        if names[kind.name] > 1:
            yield (
                ("module_types", k, "name"),
                f"must be a name of its own, but got {show(kind.name)} {names[kind.name]} times",
            )
    if len(types) > len(LETTERS):
        yield "module_types", f"must have at most {len(LETTERS)} entries, but got {len(types)}"
    if not any(kind.rotor_table.count for kind in types):
        yield "module_types", "must have a type with rotors, but got none"
    if task.search.lattice is not None:
        yield ("search", "lattice"), f"must be left out {several}, but got {show(task.search.lattice)}"
    if not all(_blows_like(kind, task.module) for kind in types):
        rule = "must be left out with types of module whose rotors or jets are not those of [module]"
        for e, exposure in enumerate(task.exposure):
            if exposure.speed is not None:
                yield ("exposure", e), f"`speed` {rule}, but got {exposure.speed:g}"
        if task.goals.speed:
            yield ("goals", "speed"), f"{rule}, but got {show(task.goals.speed)}"


def _blows_like(kind: Module, module: Module) -> bool:
    """Return whether a type has no rotors, or moves air like [module] at the same inputs."""
    tables, sizes = (kind.rotor_table, module.rotor_table), ("arm_length", "thrust_coefficient")
    return not kind.rotor_table.count or (
        tables[0].is_same_as(tables[1])
        and all(getattr(kind, name) == getattr(module, name) for name in sizes)
        and (kind.body.rotor_radius, kind.airflow.jet) == (module.body.rotor_radius, module.airflow.jet)
    )
