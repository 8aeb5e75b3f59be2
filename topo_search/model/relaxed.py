"""Limits of a task that make a topology feasible if relaxed, as in `relaxed.json`."""

from typing import Annotated, Literal

from topo_search.limits import quantity
from topo_search.model.kinds import OMIT_EMPTY, Number
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import Value

STARTS = 4
"""Largest number of starts per solve with a relaxed limit."""


Amount = Number | tuple[Number, ...]
"""Value of a limit that is made of a few numbers."""


class Setting(Value):
    """Change of one limit."""

    limit: str
    """The limit, in the user's words."""
    change: str
    """Change of the limit, in words."""
    field: str
    """Field of the task."""
    share: Number
    """Change over the current limit; for room between planes, over the airflow's length."""
    given: Amount | None = None
    """Current limit, in the field's unit; None if it is not made of a few numbers."""
    enough: Amount | None = None
    """Sufficient limit, in the field's unit."""
    unit: str = ""
    """Unit of the field."""

    @property
    def words(self) -> str:
        """The field with current and sufficient value, if there are, and the change."""
        unit, remark = f" {self.unit}" * bool(self.unit), f"({self.limit}: {self.change})"
        if self.given is None or self.enough is None:
            return f"{self.field} {remark}"
        given, enough = (x if isinstance(x, tuple) else (x,) for x in (self.given, self.enough))
        # rounded so that it is still enough
        after = [(upper_text if new > old else lower_text)(new) for old, new in zip(given, enough, strict=True)]
        return f"{self.field} {_list_numbers([f'{x:.6g}' for x in given])} to {_list_numbers(after)}{unit} {remark}"


def _list_numbers(numbers: list[str]) -> str:
    return numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"


class Relaxation(Setting):
    """Smallest tried relaxation that gave a design with a clear audit; a smaller one may be enough."""

    topology_key: str
    """Key of the tree that becomes feasible."""
    not_enough: Number | None = None
    """Largest share that was tried without success; None if the smallest one was enough."""
    tightens: Annotated[bool, OMIT_EMPTY] = False
    """True if the limit is tightened, so that the design also satisfies the original task."""
    also: Annotated[tuple[Setting, ...], OMIT_EMPTY] = ()
    """The second limit of a pair, where no limit suffices alone."""

    @property
    def limits(self) -> str:
        """The limit, or both limits of a pair."""
        return " with ".join(setting.limit for setting in (self, *self.also))

    @property
    def settings(self) -> str:
        """Changes to make, in words."""
        return " and ".join(setting.words for setting in (self, *self.also))


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
    pairs: Annotated[int, OMIT_EMPTY] = 0
    """Number of pairs of limits that did not help."""

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences on the first limit to relax and on others that help, or that none does."""
        solved = f"from {quantity(min(self.starts, STARTS), 'start')}"
        sentences = []
        if self.relaxations:
            first, *others = self.relaxations
            verb, remark = "relax both" if first.also else "relax", "a smaller change may be enough"
            if first.tightens:
                verb, remark = "try", "the design also satisfies the original task"
            design = f"gives {first.topology_key} a design, solved again {solved}, with a clear audit"
            sentences.append(f"{verb} first: {first.settings} {design}; {remark}")
            sentences += [
                f"or {other.settings}, for {other.topology_key}; tried in the same way" for other in others
            ]
        elif self.in_vain:
            trees = f" of {' or '.join(self.topologies)}" if self.topologies else ""
            pairs = (
                f", nor did any of {quantity(self.pairs, 'pair')} of those that came closest" if self.pairs else ""
            )
            none = f"no single limit, relaxed on its own, led to a design{trees} with a clear audit"
            sentences.append(f"{none} {solved}{pairs}")
        return tuple(sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The advice, limits tried in vain where none helps, and limits that could not be tried."""
        in_vain = f"tried in vain: {'; '.join(self.in_vain)}" * bool(self.in_vain and not self.relaxations)
        untried = f"could not be tried, so nothing is known: {'; '.join(self.untried)}" * bool(self.untried)
        return (*self.advice, *filter(None, (in_vain, untried)))
