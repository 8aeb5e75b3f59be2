"""Untrusted text as data: files of limited size, TOML, JSON, `FIELD=VALUE` settings; and tables as CSV and HTML."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import stat
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, TypeVar

from topo_search.model.value import BadInput, Fault, show


class NotReadable(ValueError):
    """File that is refused; the message names the rule and what was found."""


@dataclass(frozen=True)
class Folder:
    """Validation context that allows a task to name files: the folder that contains them."""

    path: Path


def read_regular(path: str | Path, *, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: file, or a link to one.
        most_bytes: largest size that is read.

    Raises:
        NotReadable: not a regular file, too large, or a pointer of Git LFS.
        FileNotFoundError: there is no such file.
        OSError: the file cannot be opened or read.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise NotReadable(f"must be a regular file, but is {kind}")
    if status.st_size > most_bytes:
        raise NotReadable(f"must have at most {most_bytes:,} bytes, but has {status.st_size:,}")
    content = Path(path).read_bytes()
    if content.startswith(b"version https://git-lfs"):
        raise NotReadable("must be the file itself, but is a pointer of Git LFS: `git lfs pull` fetches the file")
    return content


def decode(content: bytes, encoding: str = "utf-8") -> str:
    """Return the text of a file; NotReadable names the first invalid byte."""
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        i = error.start + len(content) - len(error.object)  # a codec drops the byte order mark
        raise NotReadable(f"must be UTF-8 text, but got the byte {content[i]:#04x} at offset {i}") from None


def read_text(path: str | Path, *, most_bytes: int) -> str:
    """Return the text of a regular file, without a byte order mark; see `read_regular`."""
    return decode(read_regular(path, most_bytes=most_bytes), "utf-8-sig")


def toml_data(text: str) -> dict[str, Any]:
    """Return the data of a TOML text; ValueError if it is invalid."""
    try:
        return tomllib.loads(text)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"is not a TOML file, or only a part of one: {error}") from None


def json_data(text: str) -> Any:
    """Return the data of a JSON text; ValueError if it is invalid, or an object has a name twice."""
    try:
        return json.loads(text, object_pairs_hook=_unique_names)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"is not a JSON file, or only a part of one: {error}") from None


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        ((name, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f"must give every name of an object once, but got {show(name)} twice")
    return table


SETTING = re.compile(r"\s*([A-Za-z_]\w*(?:\.\w+|\[\d+\])*)\s*=(.*)", re.DOTALL)
"""`search.margin=1e-3`, `load_cases.0.weight=2`, or the same with `load_cases[0]`."""

PAPER = (
    "search.root=paper",
    "search.margin=0",
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


Cell = TypeVar("Cell")


def escape_formula(cell: Cell) -> Cell | str:
    """Return a cell in which a string that a spreadsheet would run as a formula is quoted; numbers stay numbers."""
    if not isinstance(cell, str) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def csv_text(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(map(escape_formula, row) for row in rows)
    return text.getvalue()


def heading(text: str) -> str:
    """Return a bold line of HTML."""
    return f"<p><b>{escape(text)}</b></p>"


def paragraph(text: str) -> str:
    """Return a line of HTML."""
    return f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table; None is an empty cell, floats have six digits."""
    lines = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows]
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
