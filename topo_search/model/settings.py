"""Settings of the command line: `FIELD=VALUE` lays a value over one field of a task's data."""

from __future__ import annotations

import re
from typing import Any

from topo_search.limits import KEY_PARTS
from topo_search.model.bad_input import BadInput, Fault, show
from topo_search.model.parsing import NotParsed, toml_data

SETTING = re.compile(r"\s*([A-Za-z_]\w*(?:\.\w+|\[\d+\])*)\s*=(.*)", re.DOTALL)
"""`search.margin=1e-3`, `load_cases.0.weight=2`, or the same with `load_cases[0]`."""

PAPER = (
    "search.root=paper",
    "search.margin=0",
    "search.body_clearance=false",
    "end_effector.rod=none",
    "end_effector.largest_reach=false",
)
"""The paper's literal problem: its root has two angles, no margin, nothing but airflow between frames, no rod."""
NAME = 64
"""Most characters of a name in a field."""


def apply_settings(data: dict[str, Any], settings: tuple[str, ...]) -> None:
    """Set fields of a task's data, in order; whether they exist and fit is for the task to say.

    Raises:
        BadInput: one fault for each setting that is none, or that leads into something without fields.
    """
    faults = [fault for setting in settings if (fault := _apply(data, setting))]
    if faults:
        raise BadInput("--set", faults)


def field_of(setting: str) -> tuple[str, ...]:
    """Return the names that lead to the field of a setting; none of what is no setting."""
    match = SETTING.fullmatch(setting)
    return () if match is None else tuple(re.findall(r"\w+", match[1]))


def _apply(data: dict[str, Any], setting: str) -> Fault | None:
    match = SETTING.fullmatch(setting)
    if match is None:
        return Fault("", f"must be FIELD=VALUE, but got {show(setting)}")
    names = [*field_of(setting)]
    if len(names) > KEY_PARTS:
        return Fault("", f"must have at most {KEY_PARTS} names in a field, but got {show(match[1])}")
    if max(map(len, names)) > NAME:
        return Fault("", f"must have names of at most {NAME} characters in a field, but got {show(match[1])}")
    try:
        value = _value(match[2])
    except NotParsed as error:
        return Fault(match[1], str(error))
    return _lay(data, names, value, above="")


def _lay(place: Any, names: list[str], value: Any, *, above: str) -> Fault | None:
    """Go down the names from `place`, which is the field `above`, and lay the value at their end."""
    name, *rest = names
    path = f"{above}.{name}" if above else name
    key: str | int = name
    if isinstance(place, list):
        if not re.fullmatch("[0-9]+", name) or int(name) >= len(place):
            return Fault(path, f"must be an index under {len(place)}, but got {name}")
        key = int(name)
    elif not isinstance(place, dict):
        return Fault(path, f"`{above}` must be a table or a list to have fields, but got {show(place)}")
    if not rest:
        place[key] = value
        return None
    if isinstance(place, dict):
        place.setdefault(name, {})
    return _lay(place[key], rest, value, above=path)


def _value(text: str) -> Any:
    """Read a value as TOML writes it; what is none is a text.

    Raises:
        NotParsed: it has brackets within brackets, or a key, beyond all use.
    """
    try:
        read = toml_data(f"value = {text}")
    except NotParsed as error:
        if error.beyond:
            raise
        return text.strip()
    return read["value"] if len(read) == 1 else text.strip()
