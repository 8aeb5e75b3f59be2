"""Parts of an audit: kinds of clearances, and sections, listed in `verify.features`."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from topo_search.model import Mount, Residual
from topo_search.model.clearance import Kind
from topo_search.model.features import Assembly
from verify.certificate import Certificate
from verify.contacts import AnyCheck
from verify.requirements import Scene


class Clearances(NamedTuple):
    """Clearances of the core or of a feature."""

    kinds: tuple[Kind, ...]
    checks: Callable[[Scene, Mount | None], Iterable[AnyCheck]]
    """Yields their checks for a scene and the mount of its rod."""


class Findings(NamedTuple):
    """Results of an audit so far."""

    scene: Scene
    sheet: Assembly
    clearances: Sequence[Clearances]
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
