"""Sections of the audit: what features add to it, in the order of `verify.features`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from topo_search.model import Assembly, Residual
from verify.certificate import Certificate
from verify.contacts import AnyCheck
from verify.requirements import Scene


class Findings(NamedTuple):
    """What the audit of a design has found so far."""

    scene: Scene
    sheet: Assembly
    checks: Sequence[AnyCheck]
    """Checks of all clearances, also of those that do not count."""
    certificates: Sequence[Certificate]
    """Certificates of the checks."""
    figures: dict[str, Any]
    """Results of earlier sections, by field of `Audit`."""


class Section(NamedTuple):
    """Field of `Audit` that a feature adds, and rows among its residuals; either may be missing."""

    field: str = ""
    find: Callable[[Findings], Any] | None = None
    """Returns the value of the field."""
    residuals: Callable[[Findings], Iterable[Residual]] = lambda found: ()
    """Returns the rows; the field of the same section is among the findings."""
