"""Common properties of all values of the model: frozen, compared by content, no unknown fields, finite numbers."""

from __future__ import annotations

import ast
import functools
import inspect
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

from topo_search.limits import LIMITS

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


def one_of(rule: str) -> Discriminator:
    """Choose among the branches of a union, each with its `Tag`, before looking inside.

    A wrong value is then answered by the one branch that it was meant for, or by `rule` if there is none. Tags:
    `<number>`, `<list>`, `<false>`, or a word in angle brackets.
    """
    return Discriminator(_branch, custom_error_type="branch", custom_error_message=rule)


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
