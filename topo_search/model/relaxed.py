"""Limits of a task that make a topology feasible if relaxed, as in `relaxed.json`."""

from __future__ import annotations

from typing import Annotated, Literal

from topo_search.limits import quantity
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import OMIT_EMPTY, Number, Value

STARTS = 4
"""Largest number of starts per solve with a relaxed limit."""


class Relaxation(Value):
    """Smallest tried relaxation of one limit that gave a design with a clear audit; a smaller one may be enough."""

    topology_key: str
    """Key of the tree that becomes feasible."""
    limit: str
    """Binding limit, in the user's words."""
    change: str
    """Change of the limit, in words."""
    field: str
    """Field of the task."""
    share: Number
    """Change over the current limit."""
    given: Number | None = None
    """Current limit, in the field's unit; None if it is not a single number."""
    enough: Number | None = None
    """Sufficient limit, in the field's unit."""
    unit: str = ""
    """Unit of the field."""
    not_enough: Number | None = None
    """Largest share that was tried without success; None if the smallest one was enough."""
    tightens: Annotated[bool, OMIT_EMPTY] = False
    """True if the limit is tightened, so that the design also satisfies the original task."""

    @property
    def setting(self) -> str:
        """The field, with current and sufficient value if it is a single number."""
        unit = f" {self.unit}" if self.unit else ""
        if self.given is None or self.enough is None:
            return self.field
        enough = upper_text(self.enough) if self.enough > self.given else lower_text(self.enough)  # still enough
        return f"{self.field}: {self.given:.6g} -> {enough}{unit}"

    @property
    def words(self) -> str:
        """Change and setting in one line."""
        return f"{self.limit}: {self.topology_key} becomes feasible with {self.change} ({self.setting})"


class Relaxed(Value):
    """Relaxations tried for the topologies of one size that came closest to a design."""

    format: Literal["topo-search/relaxed"] = "topo-search/relaxed"
    version: Literal[1] = 1
    modules: int
    """Number of modules."""
    starts: int
    """Number of starts per candidate in the run at that time."""
    relaxations: tuple[Relaxation, ...]
    """Successful relaxations, smallest change first."""
    in_vain: tuple[str, ...]
    """Limits whose relaxation did not help, each with the largest change tried."""
    untried: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Limits for which solver or audit failed, each with the reason."""
    topologies: Annotated[tuple[str, ...], OMIT_EMPTY] = ()
    """Keys of the trees; empty in older files."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences of advice: what to relax first, what else helps or does not, what could not be tried."""
        solved = f"from {quantity(min(self.starts, STARTS), 'start')}"
        sentences = []
        if self.relaxations:
            first, *others = self.relaxations
            verb, remark = "relax", "a smaller change may be enough"
            if first.tightens:
                verb, remark = "try", "the design also satisfies the original task"
            sentences.append(f"{verb} first: {first.words}; solved again {solved}, its audit is clear; {remark}")
            sentences += [f"or {other.words}; solved and audited in the same way" for other in others]
        elif self.in_vain:
            trees = f" of {' or '.join(self.topologies)}" if self.topologies else ""
            tried = "; ".join(self.in_vain)
            none = f"no single limit, relaxed on its own, led to a design{trees} with a clear audit"
            sentences.append(f"{none} {solved} ({tried})")
        if self.untried:
            sentences.append(f"could not be tried, so nothing is known: {'; '.join(self.untried)}")
        return tuple(sentences)
