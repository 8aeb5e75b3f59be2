"""Faults of a file, field by field, in the reader's words."""

from __future__ import annotations

import difflib
import json
import os
import re
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

RULES = {
    "bool_type": "must be true or false",
    "dict_type": "must be a table of named fields",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "int_from_float": "must be a whole number",
    "int_type": "must be a whole number",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be {expected}",
    "model_attributes_type": "must be a table of named fields",
    "model_type": "must be a table of named fields",
    "string_pattern_mismatch": "must be one line of text without control characters",
    "string_too_long": "must have at most {max_length} characters",
    "string_too_short": "must not be empty",
    "string_type": "must be a text",
    "tuple_type": "must be a list",
    "union_tag_invalid": "must be one of {expected_tags}",
    "value_error": "{error}",
}
"""The rule behind each of pydantic's types of error."""


@dataclass(frozen=True)
class Fault:
    """One fault of a file."""

    path: str
    """The field, e.g. `load_cases[2].com.force`; empty for the file as a whole."""
    rule: str
    """Rule that must hold, and the value given."""

    def __str__(self) -> str:
        """Return `path: rule`."""
        return f"{self.path}: {self.rule}" if self.path else self.rule


class BadInput(Exception):
    """A file or an option that cannot be used; carries one message per fault.

    Args:
        source: the file or option.
        faults: what is wrong with it; a text is one rule that it breaks as a whole.
    """

    def __init__(self, source: str, faults: list[Fault] | str) -> None:
        self.source = source
        self.faults = [Fault("", faults)] if isinstance(faults, str) else faults
        super().__init__("\n".join(f"{to_printable(source)}: {fault}" for fault in self.faults))

    def __reduce__(self) -> tuple[Any, ...]:
        return BadInput, (self.source, self.faults)


def faults_of(error: ValidationError, model: type[BaseModel]) -> list[Fault]:
    """Return one fault for each thing that pydantic found wrong; of a file of another format, that alone.

    A file with very many faults gets one that says so.
    """
    if error.error_count() > 1000:  # a file with more faults is of another kind, or is malicious
        return [Fault("", f"must have few enough faults to list, but has {error.error_count():,}")]
    faults = [_fault(detail, model) for detail in error.errors(include_url=False)]
    return [fault for fault in faults if fault.path in ("format", "version")] or faults


def show(value: Any) -> str:
    """Return a value as a file would write it, in at most 80 characters of one line."""
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        text = reprlib.repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = f"a whole number of {value.bit_length():,} bits" if isinstance(value, int) else "what has no text"
    return text if len(text) <= 80 else text[:77] + "..."


def of_file(rule: str, name: Any) -> str:
    """Return a rule with the name of the file that was given; where the rule says what is in it, behind that."""
    return f"{rule} (in {show(name)})" if "but " in rule else f"{rule}, but got {show(name)}"


def to_printable(name: str | os.PathLike[str]) -> str:
    """Return the name of a file as it can be printed: Unicode without control characters and broken bytes."""
    text = re.sub("[\ud800-\udfff]", "\ufffd", os.fspath(name))
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def nearest(unknown: str, valid: list[str]) -> str:
    """Return what to say of an unknown name: the valid one that it resembles, or all of them."""
    word = unknown.lower().replace("-", "_")
    alike = [name for name in valid if name[:1] == word[:1]]
    near = difflib.get_close_matches(word, alike, n=1) or difflib.get_close_matches(word, valid, n=1)
    return f"did you mean `{near[0]}`?" if near else f"valid names are {', '.join(valid)}"


def _fault(detail: Any, model: type[BaseModel]) -> Fault:
    kind, given = detail["type"], detail["input"]
    parts, owner = _walk(detail["loc"], model)
    path = _path(parts)
    if kind == "rule":
        return Fault(path, detail["msg"])
    if kind == "extra_forbidden":
        return Fault(path, f"unknown field; {nearest(str(detail['loc'][-1]), list(owner.model_fields))}")
    if kind in ("missing", "union_tag_not_found"):
        return Fault(path if kind == "missing" else f"{path}.kind", "is required, but missing")
    if kind == "union_tag_invalid":
        path, given = f"{path}.kind", given["kind"]
    # pydantic puts words in single quotes, TOML and JSON in double ones
    context = {k: v.replace("'", '"') if isinstance(v, str) else v for k, v in detail.get("ctx", {}).items()}
    rule = RULES[kind].format_map(context) if kind in RULES else detail["msg"]
    return Fault(path, rule if "but got" in rule else f"{rule}, but got {show(given)}")


def _walk(location: tuple[Any, ...], model: type[BaseModel]) -> tuple[list[Any], type[BaseModel]]:
    """Split pydantic's location into the names and indices of the file, and find the model that owns the last name.

    Pydantic puts the branches of unions in between: `<...>` (see `value.one_of`), or the `kind` of a table.
    """
    parts: list[Any] = []
    owner, inside = model, [model]
    for part in location:
        if isinstance(part, int):
            parts.append(part)
        elif len(inside) > 1:
            inside = [cls for cls in inside if cls.model_fields["kind"].default == part]
        elif not re.fullmatch("<.*>", part, re.DOTALL):
            parts.append(part)
            owner, fields = inside[0], inside[0].model_fields
            inside = list(_models_in(fields[part].annotation)) if part in fields else [owner]
    return parts, owner


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _path(parts: list[Any]) -> str:
    """Write names and indices as `load_cases[2].com.force`; quote a name that TOML would quote."""
    path = ""
    for part in parts:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            name = part if re.fullmatch(r"[A-Za-z0-9_-]{1,80}", part) else show(part)
            path += f".{name}" if path else name
    return path
