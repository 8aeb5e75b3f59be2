"""Values in and out of files: TOML for tasks, JSON for results. Writing and reading again changes nothing."""

from __future__ import annotations

import json
import os
import tempfile
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import tomli_w
from pydantic import BaseModel, ValidationError

from topo_search.model.bad_input import BadInput, Fault, faults_of
from topo_search.model.task import Task

Model = TypeVar("Model", bound=BaseModel)


def validate(model: type[Model], data: Any, source: str) -> Model:
    """Return `data` as a model; BadInput names every fault, `source` first."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise BadInput(source, faults_of(error, model)) from None


def read_task(path: str | Path, settings: tuple[str, ...] = ()) -> Task:
    """Return the task of a TOML file or of a shipped example, with `FIELD=VALUE` settings applied.

    Raises:
        BadInput: one fault for each thing that is wrong.
    """
    name = str(path)
    if name in examples():
        text = (resources.files("topo_search") / "examples" / f"{name}.toml").read_text(encoding="utf-8")
    else:
        text = _read_text(Path(path), hint=f"no such file, nor a shipped example ({', '.join(examples())})")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(name, [Fault("", f"is not a TOML file: {error}")]) from None
    for setting in settings:
        _apply(data, setting)
    return validate(Task, data, name)


def examples() -> list[str]:
    """Return the names of the shipped tasks."""
    folder = resources.files("topo_search") / "examples"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read_json(model: type[Model], path: str | Path) -> Model:
    """Return the value that a JSON file holds; BadInput names every fault."""
    text = _read_text(Path(path), hint="no such file")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(str(path), [Fault("", f"is not a JSON file, or only a part of one: {error}")]) from None
    return validate(model, data, str(path))


def to_toml(task: Task) -> str:
    """Return a task as the text of a TOML file: what was given, defaults left unwritten."""
    return tomli_w.dumps(task.model_dump(mode="json", exclude_unset=True, exclude_none=True))


def to_json(value: BaseModel) -> str:
    """Return a value as the text of a JSON file."""
    return json.dumps(value.model_dump(mode="json"), indent=1, allow_nan=False) + "\n"


def write_atomically(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old one or the whole new one, whatever happens in between."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        Path(partial).chmod(0o644)
        Path(partial).replace(path)
    except BaseException:
        Path(partial).unlink(missing_ok=True)
        raise


def _read_text(path: Path, *, hint: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(str(path), [Fault("", hint)]) from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(str(path), [Fault("", f"cannot be read: {error}")]) from None


def _apply(data: dict[str, Any], setting: str) -> None:
    """Set one field of a task's data, `search.margin=1e-3` or `load_cases.0.weight=2`."""
    field, equals, text = setting.partition("=")
    if not equals or not field.strip():
        raise BadInput("--set", [Fault("", f"must be FIELD=VALUE, but got {setting!r}")])
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *parents, last = field.strip().split(".")
    place: Any = data
    for name in parents:
        place = _entry(place, name, setting)
    if isinstance(place, list):
        _entry(place, last, setting)
        place[int(last)] = value
    elif isinstance(place, dict):
        place[last] = value
    else:
        raise BadInput("--set", [Fault(field, f"is not inside a table, in {setting!r}")])


def _entry(place: Any, name: str, setting: str) -> Any:
    if isinstance(place, dict):
        return place.setdefault(name, {})
    if isinstance(place, list) and name.isdigit() and int(name) < len(place):
        return place[int(name)]
    raise BadInput("--set", [Fault(name, f"is no entry of the task, in {setting!r}")])
