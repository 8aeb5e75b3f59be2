"""Records of a user's own functions, as in files: they hold names, versions and bounds, but not the functions."""

from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.kinds import Number
from topo_search.model.value import Value

Line = Annotated[str, Field(max_length=100, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""One line of text."""
Named = Annotated[Line, Field(min_length=1)]
"""Nonempty line of text."""


class Versioned(Value):
    """Identity of a user's function: its name and its version, if it has one."""

    name: Named
    version: Named | None = None
    """None: the function may have changed."""


class Stated(Versioned):
    """A user's own constraint without its expression: `lower <= expression <= upper`."""

    lower: Number | None = None
    """Lower bound, in `unit`; None: unbounded."""
    upper: Number | None = None
    """Upper bound, in `unit`; None: unbounded."""
    unit: Line = ""
    invariant: Literal["none", "numbering", "mirror"] = "none"
    """Changes that do not affect its result, as claimed by the user (`topo_search.OwnConstraint`)."""

    @property
    def bounds(self) -> str:
        """Bounds in words."""
        sides = [("at least", self.lower), ("at most", self.upper)]
        if self.lower == self.upper:
            sides = [("equal to", self.lower)]
        text = " and ".join(f"{words} {side:g}" for words, side in sides if side is not None)
        return f"{text} {self.unit}".rstrip()


class StatedCheck(Stated):
    """Result of a user's own constraint on a design."""

    status: Literal["met", "missed", "not checked"]
    """`not checked`: the audit had its name, but not its expression."""
    value: Number | None = None
    """Value with the largest violation, or closest to a bound if all are met, in `unit`."""
    off_by: Number | None = None
    """Violation of that value, in `unit`; zero or negative when met."""

    @property
    def words(self) -> str:
        """Result in words."""
        if self.value is None:
            return self.status if self.status == "missed" else "not checked: the design does not hold its function"
        return f"{self.status}: {self.value:.6g} {self.unit}".rstrip()
