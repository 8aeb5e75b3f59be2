"""Task files as users write them: files and shipped examples, `FIELD=VALUE` settings, and the template."""

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any

from topo_search.limits import LIMITS
from topo_search.model.files import load_text, validate
from topo_search.model.module import Module
from topo_search.model.task import Task
from topo_search.model.text import Folder, toml_data
from topo_search.model.value import BadInput, Fault, as_bad_input, nearest, show


def read_task(path: str | Path, settings: tuple[str, ...] = ()) -> Task:
    """Return the task of a TOML file or of a shipped example, with `FIELD=VALUE` settings applied.

    Paths of meshes are relative to the file's folder; in a shipped example, to the current one.

    Args:
        path: file, or name of a shipped example.
        settings: changes to the file's fields, applied in order.

    Raises:
        BadInput: one fault per broken rule, or the figure of merit of the rotors is above 1.

    >>> read_task("push", ("modules=[3, 4]",)).modules
    (3, 4)
    """
    if not isinstance(path, str | os.PathLike):
        rule = f"must be a Task, a file or the name of a shipped example, but got {type(path).__name__}"
        raise BadInput("task", rule)
    name = str(path)
    if name in examples():
        text = (resources.files("topo_search") / "examples" / f"{name}.toml").read_text(encoding="utf-8")
    else:
        hint = f"no such file, nor a shipped example; {nearest(name, examples())}"
        text = load_text(path, most_bytes=LIMITS.task_bytes, if_missing=hint)
    with as_bad_input(name):
        data = toml_data(text)
    apply_settings(data, settings)
    folder = Path() if name in examples() else Path(path).parent
    task = validate(Task, data, name, Folder(folder))
    modules = [("module", task.module), *((f"module_types[{k}]", kind) for k, kind in enumerate(task.module_types))]
    for path, module in modules:
        if faults := list(_impossible_rotors(path, module, task.air_density)):
            raise BadInput(name, faults)
    return task


def _impossible_rotors(path: str, module: Module, density: float) -> Iterator[Fault]:
    """Yield a fault if the figure of merit of a module's rotors is above 1; `path`: its table."""
    rotors, merit = module.rotor_table, module.figure_of_merit(density)
    merits = merit * rotors.gains**1.5 / (abs(rotors.drags) * rotors.sizes)
    if rotors.count and merit > 1:
        field = "torque_to_thrust" if module.torque_to_thrust else "torque_coefficient"
        cause = "has so little drag torque for its thrust"
        if (C_T := module.propeller_coefficient(density)) > 1:  # propellers have 0.05 to 0.2
            field, cause = "thrust_coefficient", f"has C_T = {C_T:.3g}: is it in N s^2/rad^2, not per krpm^2?"
        rule = f"must give a figure of merit of at most 1, but got {merit:.3g}"
        yield Fault(f"{path}.{field}", f"{rule}: no rotor of {module.body.rotor_radius:g} m radius {cause}")
    elif rotors.count and merits[q := int(merits.argmax())] > 1:
        rule = f"must give a figure of merit of at most 1, but got {merits[q]:.3g}"
        yield Fault(f"{path}.rotors[{q}].torque_coefficient", rule)


def examples() -> list[str]:
    """Return the names of the shipped tasks."""
    folder = resources.files("topo_search") / "examples"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def task_template(name: str, *, full: bool = False) -> str:
    """Return a commented task file to start from; `full`: every field with its default and meaning."""
    file = "template.toml" if full else "first_task.toml"
    text = (resources.files("topo_search.model") / file).read_text(encoding="utf-8")
    return text.replace('name = "task"', f'name = "{name}"', 1)


SETTING = re.compile(r"\s*([A-Za-z_]\w*(?:\.\w+|\[\d+\])*)\s*=(.*)", re.DOTALL)
"""`search.margin=1e-3`, `load_cases.0.weight=2`, or the same with `load_cases[0]`."""

PAPER = (
    "search.root=paper",
    "search.margin=0",
    "flight.defaults=false",
    "search.body_clearance=false",
    "end_effector.rod=none",
    "end_effector.largest_reach=false",
    "module.airflow.regions=false",
)
"""Settings for the paper's literal problem: two root angles, no margin, only airflow clearances between modules, no
rod, one airflow envelope."""


def apply_settings(data: dict[str, Any], settings: tuple[str, ...]) -> None:
    """Set fields of a task's data, in order; the task validates them later.

    Raises:
        BadInput: one fault per malformed setting, or setting whose path leads through a value without fields.
    """
    faults = [fault for setting in settings if (fault := _apply(data, setting))]
    if faults:
        raise BadInput("--set", faults)


def field_of(setting: str) -> tuple[str, ...]:
    """Return the path to the field of a setting; empty if the setting is malformed."""
    match = SETTING.fullmatch(setting)
    return () if match is None else tuple(re.findall(r"\w+", match[1]))


def _apply(data: dict[str, Any], setting: str) -> Fault | None:
    match = SETTING.fullmatch(setting)
    if match is None:
        return Fault("", f"must be FIELD=VALUE, but got {show(setting)}")
    return _set(data, [*field_of(setting)], _value(match[2]), above="")


def _set(container: Any, names: list[str], value: Any, *, above: str) -> Fault | None:
    """Set the value at the path `names` below `container`, the field `above`; return the fault if that fails."""
    name, *rest = names
    path = f"{above}.{name}" if above else name
    key: str | int = name
    if isinstance(container, list):
        if not re.fullmatch("[0-9]+", name) or int(name) >= len(container):
            return Fault(path, f"must be an index under {len(container)}, but got {name}")
        key = int(name)
    elif not isinstance(container, dict):
        return Fault(path, f"`{above}` must be a table or a list to have fields, but got {show(container)}")
    if not rest:
        container[key] = value
        return None
    if isinstance(container, dict):
        container.setdefault(name, {})
    return _set(container[key], rest, value, above=path)


def _value(text: str) -> Any:
    """Return the value of a TOML text; invalid TOML is a string."""
    with suppress(ValueError):
        data = toml_data(f"value = {text}")
        if len(data) == 1:
            return data["value"]
    return text.strip()
