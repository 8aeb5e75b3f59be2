"""Common properties of all values of the model: frozen, compared by content, no unknown fields, finite numbers.

A file with other values is refused: its faults are named field by field, in the reader's words.
"""

from __future__ import annotations

import ast
import difflib
import functools
import inspect
import json
import os
import re
import reprlib
import sys
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from topo_search.limits import LIMITS

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


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Name the source of a text in what is wrong with it: BadInput for a ValueError."""
    try:
        yield
    except ValueError as error:
        raise BadInput(source, str(error)) from None


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

    Pydantic puts the branches of unions in between: `<...>` (see `value.OneOf`), or the `kind` of a table.
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


FIELDS = "\n\nFields:\n"
"""Between what a value is and what its fields are, for `help`."""


Location = str | tuple[str | int, ...]
"""A field, or the names and numbers that lead to it; empty: the value as a whole."""
Broken = Iterator[tuple[Location, str]]
"""Fields and what is wrong with them."""


class Value(BaseModel):
    """A frozen value: equal by content, picklable, read from and written to TOML and JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Tell `help` the fields, with what is said of each, in place of pydantic's signature."""
        docstrings = _field_docstrings(sys.modules[cls.__module__].__file__).get(cls.__qualname__, {})
        for name, text in docstrings.items():
            cls.model_fields[name].description = text
        lines = [f"    {name}: {_words(field)}" for name, field in cls.model_fields.items()]
        if lines:
            cls.__doc__ = inspect.cleandoc(cls.__doc__ or cls.__name__) + FIELDS + "\n".join(lines)
        cls.__pydantic_on_complete__()

    @classmethod
    def __pydantic_on_complete__(cls) -> None:
        """Name the fields in the signature: pydantic writes its own as it builds the class, on its first use."""
        fields = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in cls.model_fields]
        cls.__signature__ = inspect.Signature(fields)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other values of some fields, checked like a new one.

        Raises:
            ValidationError: a field is unknown, or breaks a rule.

        Example:
            >>> from topo_search import read_task
            >>> task = read_task("push", ("modules=3",))
            >>> task.replace(search=task.search.replace(margin=0.01)).search.margin
            0.01
        """
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self).model_validate({**given, **changes})

    def _broken_rules(self) -> Broken:
        """Yield what is wrong between fields: the field to name, and what to say of it (rule and value)."""
        yield from ()

    @model_validator(mode="after")
    def _keep_rules(self) -> Self:
        refuse(*self._broken_rules())
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe the value in a schema by its own words: its fields have theirs."""
        schema = handler(core)
        described = handler.resolve_ref_schema(schema)
        if "description" in described:
            described["description"] = described["description"].split(FIELDS)[0]
        return schema


@functools.cache
def _field_docstrings(file: str | None) -> dict[str, dict[str, str]]:
    """Return the docstrings below the fields of every class of a file: pydantic would read it once a class."""
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
    """Return the description of a field, and its default if it is short."""
    text = " ".join((field.description or "").split())
    if field.is_required():
        return f"{text} (required)".strip()
    default = repr(field.default)
    return f"{text} (default: {default})".strip() if len(default) < 40 else text


def refuse(*broken: tuple[Location, str]) -> None:
    """Refuse a value for each broken rule, as of `Value._broken_rules`, if there are any.

    Raises:
        ValidationError: one error for each broken rule.
    """
    if broken:
        errors = [
            InitErrorDetails(
                type=PydanticCustomError("rule", "{text}", {"text": text}),
                loc=(field,) if isinstance(field, str) else field,
                input=None,
            )
            for field, text in broken
        ]
        raise ValidationError.from_exception_data("Value", errors)


def _branch(value: Any) -> str:
    """Name the branch of a union that a value was plainly meant for: a word means itself, the rest its shape."""
    if isinstance(value, bool):
        return "<true>" if value else "<false>"
    if isinstance(value, int | float):
        return "<number>"
    if isinstance(value, list | tuple):
        return "<list>"
    return f"<{value}>" if isinstance(value, str) else "<table>"


@dataclass(frozen=True)
class OneOf:
    """Chooses the branch of a union of words, a number and a list by what a value is, before looking inside.

    A wrong value is then answered by the one branch that it was meant for, or by the rule if there is none.
    """

    rule: str

    def __get_pydantic_core_schema__(self, union: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return a schema that tells branches apart by `_branch`."""
        branches: dict[Hashable, CoreSchema] = {}
        for branch in get_args(union):
            kind = get_args(branch)[0] if get_origin(branch) is Annotated else branch
            values = get_args(kind) if get_origin(kind) is Literal else [()] if get_origin(kind) is tuple else [0]
            branches |= dict.fromkeys(map(_branch, values), handler.generate_schema(branch))
        return core_schema.tagged_union_schema(
            branches, _branch, custom_error_type="branch", custom_error_message=self.rule
        )


def _not_extreme(value: float) -> float:
    if not 1e-15 <= value <= 1e15:
        raise ValueError("must be between 1e-15 and 1e15")
    return value


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("must be a list of three numbers")
    return value


def at_most(limit: int, what: str = "entries") -> BeforeValidator:
    """Refuse a list of more entries than that, before any of them is looked into."""

    def check_count(value: Any) -> Any:
        if isinstance(value, list | tuple) and len(value) > limit:
            raise ValueError(f"must have at most {limit:,} {what}, but got {len(value):,}")
        return value

    return BeforeValidator(check_count)


def omit_if(value: object) -> Any:
    """Leave a field out of files where it has this value."""
    return Field(exclude_if=lambda given: given == value)


OMIT_EMPTY: Any = Field(exclude_if=lambda given: not given)
"""Leaves a field out of files where it is empty or false."""
Given = TypeVar("Given")
Omitted = Annotated[Given | None, Field(exclude_if=lambda given: given is None)]
"""A field that files leave out where it is None."""

Entries = TypeVar("Entries", bound=tuple[Any, ...])


def _not_empty(entries: Entries) -> Entries:
    if not entries:
        raise ValueError("must have at least one entry")
    return entries


Number = Annotated[float, Field(strict=True)]
"""A finite number; a string or a boolean is none."""
NonNegative = Annotated[float, Field(strict=True, ge=0, le=1e15)]
Positive = Annotated[float, Field(strict=True, gt=0), AfterValidator(_not_extreme)]
"""A physical quantity; the range keeps every number derived from a few of them finite and not zero."""
PositiveOrZero = Annotated[
    float, Field(strict=True, ge=0), AfterValidator(lambda value: value and _not_extreme(value))
]
Angle = Annotated[float, Field(strict=True, ge=0, le=90)]
"""[deg]"""
Index = Annotated[int, Field(strict=True, ge=0, le=LIMITS.largest_integer)]
Count = Annotated[int, Field(strict=True, ge=1, le=LIMITS.modules)]
Flag = Annotated[bool, Field(strict=True)]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_three)]
PositiveVector = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_three)]
NonEmpty = AfterValidator(_not_empty)


def is_zero(vector: Vector) -> bool:
    """True if a vector has no direction."""
    return not any(vector)
