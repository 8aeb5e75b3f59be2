"""Kinds of fields: ranges of numbers, vectors, lists and unions, with the rules that refuse a value."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BeforeValidator, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from topo_search.limits import LIMITS


def _branch(value: Any) -> str:
    """Return the branch of a union that a value belongs to: a string names itself, other values their shape."""
    if isinstance(value, bool):
        return "<true>" if value else "<false>"
    if isinstance(value, int | float):
        return "<number>"
    if isinstance(value, list | tuple):
        return "<list>"
    return f"<{value}>" if isinstance(value, str) else "<table>"


@dataclass(frozen=True)
class OneOf:
    """Selects the branch of a union of strings, a number and a list by the type of the value, before validating it.

    The errors of a wrong value are then those of one branch, or `rule` if no branch matches.
    """

    rule: str

    def __get_pydantic_core_schema__(self, union: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return a union schema that selects branches by `_branch`."""
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
    value = value.tolist() if hasattr(value, "tolist") else value  # a row of a list of arrays
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("must be a list of three numbers")
    return value


def at_most(limit: int, what: str = "entries") -> BeforeValidator:
    """Refuse a list with more than `limit` entries before validating any of them."""

    def check_count(value: Any) -> Any:
        if isinstance(value, list | tuple) and len(value) > limit:
            raise ValueError(f"must have at most {limit:,} {what}, but got {len(value):,}")
        return value

    return BeforeValidator(check_count)


def omit_if(value: object) -> Any:
    """Omit a field from files where it has this value."""
    return Field(exclude_if=lambda field: field == value)


OMIT_EMPTY: Any = Field(exclude_if=lambda value: not value)
"""Omits a field from files where it is empty or false."""
Type = TypeVar("Type")
Omitted = Annotated[Type | None, Field(exclude_if=lambda value: value is None)]
"""Field that files omit where it is None."""

Entries = TypeVar("Entries", bound=tuple[Any, ...])


def _not_empty(entries: Entries) -> Entries:
    if not entries:
        raise ValueError("must have at least one entry")
    return entries


Number = Annotated[float, Field(strict=True)]
"""Finite number; strings and booleans are refused."""
NonNegative = Annotated[float, Field(strict=True, ge=0, le=1e15)]
Size = Annotated[float, Field(strict=True, ge=0)]
"""Measured quantity of any size."""
Positive = Annotated[float, Field(strict=True, gt=0), AfterValidator(_not_extreme)]
"""Physical quantity; the range keeps numbers derived from a few of them finite and nonzero."""
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
"""Unlike `min_length`, which counts valid entries only, silent if an entry is wrong."""


def is_zero(vector: Vector) -> bool:
    """True if all components are zero."""
    return not any(vector)
