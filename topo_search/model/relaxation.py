"""A limit of a task whose change alone gives a topology a design, as far as it was tried."""

from __future__ import annotations

from typing import Literal

from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import Number, Value


class Relaxation(Value):
    """One limit, relaxed by little enough that a design was just found; that less is not enough is no proof."""

    topology_key: str
    """Of the tree that has a design then."""
    limit: str
    """What binds, in the user's words."""
    change: str
    """What to change it by, in words."""
    field: str
    """Of the task."""
    share: Number
    """The change over the limit as it is."""
    given: Number | None = None
    """The limit as it is, in the field's unit; None where it is no single number."""
    enough: Number | None = None
    """What is enough."""
    unit: str = ""
    not_enough: Number | None = None
    """The largest share that was tried in vain; None if the least that is tried was enough."""

    @property
    def setting(self) -> str:
        """The field, with its values where it is a single number."""
        unit = f" {self.unit}" if self.unit else ""
        if self.given is None or self.enough is None:
            return self.field
        enough = upper_text(self.enough) if self.enough > self.given else lower_text(self.enough)  # no less is
        return f"{self.field}: {self.given:.6g} -> {enough}{unit}"

    @property
    def words(self) -> str:
        """What would do, in a line."""
        return f"{self.limit}: {self.change} would do for {self.topology_key} ({self.setting})"


class Relaxed(Value):
    """What was tried for the topologies of one size that came closest to a design."""

    format: Literal["topo-search/relaxed"] = "topo-search/relaxed"
    version: Literal[1] = 1
    modules: int
    starts: int
    """Starts of each candidate of the run when it was tried."""
    relaxations: tuple[Relaxation, ...]
    """What helped, the least change first."""
    in_vain: tuple[str, ...]
    """Limits none of whose relaxations helped, each with the most that was tried."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to relax first, and what else helps or does not, a sentence each."""
        if not self.relaxations:
            tried = "; ".join(self.in_vain)
            return (f"no single limit, relaxed alone, led to a design ({tried})",) if tried else ()
        first, *others = (one.words for one in self.relaxations)
        told = [f"relax first: {first}; found by solving again; a smaller change may be enough too"]
        told += [f"or {other}" for other in others]
        return tuple(told)
