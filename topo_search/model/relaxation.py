"""A limit of a task whose change alone gives a topology a design, as far as it was tried."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import Number, Value

STARTS = 4
"""Most starts of each solve with a relaxed limit."""


class Relaxation(Value):
    """One limit, relaxed by the least share that gave a design with a clear audit; no proof that less would not."""

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

    tightens: Annotated[bool, Field(exclude_if=lambda given: not given)] = False
    """Whether the limit is tightened, so that the design is one of the task as it is."""

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
    untried: Annotated[tuple[str, ...], Field(exclude_if=lambda given: not given)] = ()
    """Limits of which nothing is known, as the solver or the audit failed, each with the reason."""
    topologies: Annotated[tuple[str, ...], Field(exclude_if=lambda given: not given)] = ()
    """Keys of the trees; none in an older file."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to relax first, what else helps or does not, and what could not be tried, a sentence each."""
        starts = min(self.starts, STARTS)
        solved = f"from {starts} start{'s' * (starts > 1)}"
        told = []
        if self.relaxations:
            first, *others = self.relaxations
            verb, end = "relax", "a smaller change may be enough"
            if first.tightens:
                verb, end = "try", "the design is one of the task as it is"
            told.append(f"{verb} first: {first.words}; solved again {solved}, its audit is clear; {end}")
            told += [f"or {other.words}" for other in others]
        elif self.in_vain:
            of = f" of {' or '.join(self.topologies)}" if self.topologies else ""
            tried = "; ".join(self.in_vain)
            told.append(
                f"no single limit, relaxed alone, led to a design{of} with a clear audit {solved} ({tried})"
            )
        if self.untried:
            told.append(f"could not be tried, so nothing is known: {'; '.join(self.untried)}")
        return tuple(told)
