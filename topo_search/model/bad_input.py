"""What is wrong with a file, field by field, in the reader's words."""

from __future__ import annotations

import difflib
import json
import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError


@dataclass(frozen=True)
class Fault:
    """One fault of a file."""

    path: str
    """The field, e.g. `load_cases[2].com.force`; empty for the file as a whole."""
    rule: str
    """What must hold, and the value given."""

    def __str__(self) -> str:
        """Return `path: rule`."""
        return f"{self.path}: {self.rule}" if self.path else self.rule


class BadInput(Exception):
    """A file or an option that cannot be used; carries one message per fault."""

    def __init__(self, source: str, faults: list[Fault]) -> None:
        self.source = source
        self.faults = faults
        super().__init__("\n".join(f"{source}: {fault}" for fault in faults))

    def __reduce__(self) -> tuple[Any, ...]:
        return BadInput, (self.source, self.faults)


def faults_of(error: ValidationError, model: type[BaseModel]) -> list[Fault]:
    """Return one fault for each thing that pydantic found wrong, in field order, without repeats."""
    return list(dict.fromkeys(_fault(detail, model) for detail in error.errors(include_url=False)))


def _fault(detail: Any, model: type[BaseModel]) -> Fault:
    location = tuple(detail["loc"])
    path, owner = _walk(model, location)
    kind, given = detail["type"], detail["input"]
    if kind == "extra_forbidden":
        unknown = str(location[-1])
        valid = sorted({name for cls in owner for name in cls.model_fields})
        near = difflib.get_close_matches(unknown, valid, n=1, cutoff=0.5)
        hint = f"did you mean `{near[0]}`?" if near else f"valid names are {', '.join(valid)}"
        return Fault(path, f"unknown field; {hint}")
    if kind == "missing":
        return Fault(path, "is required, but missing")
    message = detail["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if kind == "value_error" and ("but got" in message or isinstance(given, (dict, BaseModel))):
        return Fault(path, message)
    return Fault(path, f"{message}, but got {_shown(given)}")


def _shown(value: Any) -> str:
    if isinstance(value, BaseModel):
        value = value.model_dump()
    try:
        text = json.dumps(value)
    except (TypeError, ValueError):
        text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _walk(model: type[BaseModel], location: tuple[Any, ...]) -> tuple[str, list[type[BaseModel]]]:
    """Turn pydantic's location into a path of the file, and find the models that own its last name.

    Pydantic mixes the names of union members into its locations; only field names and indices are in the file.
    """
    path, owner = "", [model]
    for last, part in ((i == len(location) - 1, part) for i, part in enumerate(location)):
        if isinstance(part, int):
            path += f"[{part}]"
        elif any(part in cls.model_fields for cls in owner):
            path += f".{part}" if path else part
            if not last:
                fields = [cls.model_fields[part].annotation for cls in owner if part in cls.model_fields]
                owner = list(dict.fromkeys(cls for annotation in fields for cls in _models_in(annotation))) or owner
        elif last and not _is_union_tag(str(part)):
            path += f".{part}" if path else str(part)
        else:
            named = [cls for cls in owner if _tag(cls) == part]
            owner = named or owner
    return path, owner


def _tag(cls: type[BaseModel]) -> str | None:
    kind = cls.model_fields.get("kind")
    return None if kind is None else str(kind.default)


def _is_union_tag(part: str) -> bool:
    return "[" in part or part in {"int", "float", "str", "bool", "constrained-int", "constrained-float"}


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is not None or isinstance(annotation, types.UnionType | type(Union)):
        for argument in get_args(annotation):
            yield from _models_in(argument)
