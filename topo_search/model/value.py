"""Base class of the data model: frozen, compared by content, no unknown fields, finite numbers.

A file that breaks a rule is refused with one message per fault, which names the field, the rule and the value.
"""

import ast
import difflib
import functools
import inspect
import json
import os
import re
import reprlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

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
"""Rule to show for each of pydantic's error types."""


@dataclass(frozen=True)
class Fault:
    """One fault of an input file."""

    path: str
    """Path of the field, e.g. `load_cases[2].com.force`; empty for the file as a whole."""
    rule: str
    """Rule that must hold, and the offending value."""

    def __str__(self) -> str:
        """Return `path: rule`."""
        return f"{self.path}: {self.rule}" if self.path else self.rule


class BadInput(Exception):
    """Invalid file or option, with one message per fault.

    Args:
        source: file or option.
        faults: its faults; a string is a single rule that it breaks as a whole.
    """

    def __init__(self, source: str, faults: list[Fault] | str) -> None:
        self.source = source
        self.faults = [Fault("", faults)] if isinstance(faults, str) else faults
        super().__init__("\n".join(f"{to_printable(source)}: {fault}" for fault in self.faults))

    def __reduce__(self) -> tuple[Any, ...]:
        return BadInput, (self.source, self.faults)


@contextmanager
def as_bad_input(source: str) -> Iterator[None]:
    """Turn a ValueError into a BadInput that names its source."""
    try:
        yield
    except ValueError as error:
        raise BadInput(source, str(error)) from None


def faults_of(error: ValidationError, model: type[BaseModel]) -> list[Fault]:
    """Return one fault per error of pydantic; a wrong `format` or `version` hides the others.

    More than 1,000 errors become a single fault.
    """
    if error.error_count() > 1000:  # a file of another kind, or a malicious one
        return [Fault("", f"must have at most 1,000 faults, but has {error.error_count():,}")]
    faults = [_fault(detail, model) for detail in error.errors(include_url=False)]
    return [fault for fault in faults if fault.path in ("format", "version")] or faults


def show(value: Any) -> str:
    """Return a value as a file would write it, in one line of at most 80 characters."""
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        text = reprlib.repr(value)
    except ValueError:  # an integer with thousands of digits
        text = f"a whole number of {value.bit_length():,} bits" if isinstance(value, int) else "what has no text"
    return text if len(text) <= 80 else text[:77] + "..."


def to_printable(name: str | os.PathLike[str]) -> str:
    """Return a file name in printable Unicode, without control characters and invalid bytes."""
    text = re.sub("[\ud800-\udfff]", "\ufffd", os.fspath(name))
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def nearest(unknown: str, valid: list[str]) -> str:
    """Return the hint for an unknown name: the valid name that it resembles, or all valid names."""
    word = unknown.lower().replace("-", "_")
    same_initial = [name for name in valid if name[:1] == word[:1]]
    matches = difflib.get_close_matches(word, same_initial, n=1) or difflib.get_close_matches(word, valid, n=1)
    return f"did you mean `{matches[0]}`?" if matches else f"valid names are {', '.join(valid)}"


def _fault(detail: Any, model: type[BaseModel]) -> Fault:
    kind, value = detail["type"], detail["input"]
    parts, owner = _walk(detail["loc"], model)
    path = _path(parts)
    if kind == "rule":
        return Fault(path, detail["msg"])
    if kind == "extra_forbidden":
        name, fields = str(detail["loc"][-1]), list(owner.model_fields)
        hint = nearest(name, fields)
        if owner is not model and name in model.model_fields:
            hint = f"`{name}` is a field of the file, not of this table: move it above the first [table]"
        return Fault(path, f"unknown field; {hint}")
    if kind in ("missing", "union_tag_not_found"):
        return Fault(path if kind == "missing" else f"{path}.kind", "is required, but missing")
    if kind == "union_tag_invalid":
        path, value = f"{path}.kind", value["kind"]
    # pydantic quotes strings with single quotes, TOML and JSON with double ones
    context = {k: v.replace("'", '"') if isinstance(v, str) else v for k, v in detail.get("ctx", {}).items()}
    rule = RULES[kind].format_map(context) if kind in RULES else detail["msg"]
    return Fault(path, rule if "but got" in rule else f"{rule}, but got {show(value)}")


def _walk(location: tuple[Any, ...], model: type[BaseModel]) -> tuple[list[Any], type[BaseModel]]:
    """Return the names and indices of the file in pydantic's location, and the model that owns the last name.

    Pydantic inserts the branches of unions: `<...>` (see `OneOf`), or the `kind` of a table.
    """
    parts: list[Any] = []
    owner, models = model, [model]
    for part in location:
        if isinstance(part, int):
            parts.append(part)
        elif len(models) > 1:
            models = [cls for cls in models if cls.model_fields["kind"].default == part]
        elif not re.fullmatch("<.*>", part, re.DOTALL):
            parts.append(part)
            owner, fields = models[0], models[0].model_fields
            models = list(_models_in(fields[part].annotation)) if part in fields else [owner]
    return parts, owner


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _path(parts: list[Any]) -> str:
    """Return names and indices as `load_cases[2].com.force`; names that TOML would quote are quoted."""
    path = ""
    for part in parts:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            name = part if re.fullmatch(r"[A-Za-z0-9_-]{1,80}", part) else show(part)
            path += f".{name}" if path else name
    return path


FIELDS = "\n\nFields:\n"
"""Separates the description of a class from those of its fields, in `help`."""


Location = str | tuple[str | int, ...]
"""Field, or path of names and indices to it; empty: the value as a whole."""
Broken = Iterator[tuple[Location, str]]
"""Broken rules: location, and rule with the offending value."""


SHORT = reprlib.Repr()
"""Cuts long texts, lists and tables in `repr` of a value."""
SHORT.maxother = SHORT.maxstring = 160


class Value(BaseModel):
    """Frozen value: compared by content, picklable, read from and written to TOML and JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """List the fields and their descriptions in `help`, in place of pydantic's signature."""
        docstrings = _field_docstrings(sys.modules[cls.__module__].__file__).get(cls.__qualname__, {})
        for name, text in docstrings.items():
            cls.model_fields[name].description = text
        lines = [f"    {name}: {_words(field)}" for name, field in cls.model_fields.items()]
        if lines:
            cls.__doc__ = inspect.cleandoc(cls.__doc__ or cls.__name__) + FIELDS + "\n".join(lines)
        cls.__pydantic_on_complete__()

    @classmethod
    def __pydantic_on_complete__(cls) -> None:
        """Replace the signature that pydantic writes when it builds the class, on first use, by the field names."""
        fields = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in cls.model_fields]
        cls.__signature__ = inspect.Signature(fields)

    def __repr__(self) -> str:
        """Return the fields that differ from their defaults, cut to fit in 2,000 characters."""
        given = ((name, value) for name, value in self if value != type(self).model_fields[name].default)
        text = ", ".join(f"{name}={SHORT.repr(value)}" for name, value in given)
        return f"{type(self).__name__}({text[:1900]}{'...' * (len(text) > 1900)})"

    __str__ = __repr__

    def replace(self, **changes: Any) -> Self:
        """Return a validated copy with some fields changed.

        Raises:
            ValidationError: a field is unknown, or breaks a rule.

        Example:
            >>> from topo_search import read_task
            >>> task = read_task("push", ("modules=3",))
            >>> task.replace(search=task.search.replace(margin=0.01)).search.margin
            0.01
        """
        fields = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self).model_validate({**fields, **changes})

    @model_validator(mode="before")
    @classmethod
    def _take_numpy(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        lists = {name: [*map(_plain, value)] for name, value in data.items() if type(value) in (list, tuple)}
        return {name: _plain(value) for name, value in data.items()} | lists

    def _broken_rules(self) -> Broken:
        yield from ()

    @model_validator(mode="after")
    def _keep_rules(self) -> Self:
        refuse(*self._broken_rules())
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe the class in a schema without its fields, which have their own descriptions."""
        schema = handler(core)
        described = handler.resolve_ref_schema(schema)
        if "description" in described:
            described["description"] = described["description"].split(FIELDS)[0]
        return schema


def _plain(value: Any) -> Any:
    """Return a number, an array or a table of NumPy or pandas as plain numbers and lists; others as they are."""
    array = value.to_numpy() if hasattr(value, "to_numpy") else value
    return array.tolist() if hasattr(array, "tolist") else value


@functools.cache
def _field_docstrings(file: str | None) -> dict[str, dict[str, str]]:
    """Return the field docstrings of all classes in a file; pydantic would parse it once per class."""
    if file is None:
        return {}
    return {
        node.name: {
            field.target.id: inspect.cleandoc(text.value.value)
            for field, text in pairwise(node.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        }
        for node in ast.parse(Path(file).read_bytes()).body
        if isinstance(node, ast.ClassDef)
    }


def _words(field: FieldInfo) -> str:
    """Return the description of a field, with its default if that is short."""
    description = " ".join((field.description or "").split())
    if field.is_required():
        return f"{description} (required)".strip()
    default = repr(field.default)
    return f"{description} (default: {default})".strip() if len(default) < 40 else description


def refuse(*broken: tuple[Location, str]) -> None:
    """Raise a ValidationError with one error per broken rule, if there are any."""
    if broken:
        rules = ((field, PydanticCustomError("rule", "{text}", {"text": text})) for field, text in broken)
        paths = (((field,) if isinstance(field, str) else field, rule) for field, rule in rules)
        errors = [InitErrorDetails(type=rule, loc=path, input=None) for path, rule in paths]
        raise ValidationError.from_exception_data("Value", errors)


def every_field(value: Any, *, none: bool = True) -> Any:
    """Return a value as JSON data with the fields that files may omit; `none`: those without a value, too."""
    if isinstance(value, BaseModel):
        fields = (
            (name, getattr(value, name)) for name, info in type(value).model_fields.items() if not info.exclude
        )
        return {name: every_field(field, none=none) for name, field in fields if none or field is not None}
    return [every_field(entry, none=none) for entry in value] if isinstance(value, tuple) else value
