"""What a user states of a platform beyond the task, by a function of their own: never certified, only evaluated.

A file holds the name, the bounds and what the function came to; the function itself stays with its user.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.value import Number, Value

NOT_CERTIFIED = "stated by the user, not certified"
"""How a reader is told that nothing proves it."""

Line = Annotated[str, Field(max_length=100, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""One line of text."""
Named = Annotated[Line, Field(min_length=1)]
"""One that says something."""


class Versioned(Value):
    """What tells one function of a user from another: its name and, where the user gives one, its version."""

    name: Named
    version: Named | None = None
    """None: nobody can tell whether it is still the same function."""


class Stated(Versioned):
    """A constraint of a user's own, without its expression: `lower <= expression <= upper`."""

    lower: Number | None = None
    """In `unit`; None: none."""
    upper: Number | None = None
    unit: Line = ""
    invariant: Literal["none", "numbering", "mirror"] = "none"
    """What the user says leaves it met or missed as it was (`topo_search.protocols.OwnConstraint`)."""

    @property
    def bounds(self) -> str:
        """Its bounds in words."""
        sides = (
            None if self.lower is None else f"at least {self.lower:g}",
            None if self.upper is None else f"at most {self.upper:g}",
        )
        if self.lower == self.upper:
            return f"equal to {self.lower:g} {self.unit}".rstrip()
        return f"{' and '.join(side for side in sides if side is not None)} {self.unit}".rstrip()


class StatedCheck(Stated):
    """What a constraint of a user's own comes to on a design."""

    status: Literal["met", "missed", "not checked"]
    """`not checked`: whoever audited the design had its name, but not its expression."""
    value: Number | None = None
    """The value that is farthest from its bounds, or the nearest to them if all are met, in `unit`."""
    off_by: Number | None = None
    """By how much that value is beyond its bounds; zero or negative when met, in `unit`."""

    @property
    def words(self) -> str:
        """What it came to, for a reader."""
        if self.value is None:
            return self.status if self.status == "missed" else "not checked: the design does not hold its function"
        return f"{self.status}: {self.value:.6g} {self.unit}".rstrip()
