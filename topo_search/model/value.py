"""What every value of the model has in common: frozen, compared by content, no unknown fields, finite numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Value(BaseModel):
    """A frozen value: equal by content, picklable, read from and written to TOML and JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


Number = Annotated[float, Field(strict=True)]
"""A finite number; a string or a boolean is none."""
Positive = Annotated[float, Field(strict=True, gt=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Vector = tuple[Number, Number, Number]


def is_zero(vector: Vector) -> bool:
    """Whether a vector has no direction."""
    return not any(vector)
