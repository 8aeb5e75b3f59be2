"""The answer of a run: its designs and proofs, as values, in words, and as data frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from topo_search.model import LEAST_EFFORT, Audit, Design, Objective
from topo_search.model.features import FastAir, Level, Missed, Relaxed, find_missed
from topo_search.model.proven import gap_percent
from topo_search.study import tables
from topo_search.study.ledger import Row, best_of
from topo_search.study.pareto import FrontPoint
from topo_search.topologies import Resolution

if TYPE_CHECKING:
    import pandas as pd


SHOWN = 10
"""Number of best designs in a table."""


@dataclass(frozen=True)
class SizeAnswer:
    """Results for one number of modules."""

    modules: int
    rotors: int
    """Number of rotors of a platform."""
    candidates: int
    """Number of candidates."""
    quotient: str
    """Rule that merges trees into one candidate, and whether it is exact."""
    settled: int
    """Number of candidates solved from at least one start."""
    starts: int
    """Number of starts from which every candidate was solved, except impossible and failed ones; 0 while some
    candidates are not solved."""
    complete: bool
    """True if no start remains to be solved, and no design that may be the best needs an audit."""
    statuses: dict[str, int]
    """Number of candidates by status."""
    feasible: int
    """Number of classes of the exact quotient with a design: the sum of the orbits of feasible candidates. With a
    lossy symmetry each candidate counts once."""
    lower_bound: float
    """Lower bound of the effort for this size [rad^4/s^4]; 0 if a quantity is maximised."""
    best: Row | None
    """The best design with a clear audit."""
    top: tuple[Row, ...]
    """The best designs, regardless of their audit."""
    near_ties: tuple[Row, ...]
    """Designs with a clear audit and an effort within NEAR_BEST of the best: largest force reserve first, then
    largest torque reserve."""
    near_ties_unaudited: int
    """Number of designs within NEAR_BEST of the best without an audit, whose reserves are unknown."""
    remarks: tuple[str, ...]
    """Remarks on designs whose audit was not clear, and on candidates that failed."""
    reason: str | None
    """Why there is no design, if there is none."""
    failure: str | None
    """What keeps the audit of the best design from being clear, if no audit is."""
    covers_size: bool
    """True if the candidates represent all topologies of this size that the task allows, which listed topologies or
    those of a lossy symmetry need not."""
    impossible: bool
    """True if it is proven that no topology of this size can do the task."""
    statement: str | None
    """How good the best design is: the number of candidates, and the proven gap."""
    objective: Objective = LEAST_EFFORT
    """Objective of the search."""
    value_bound: float | None = None
    """Largest value of a maximised quantity that any platform of this size can have."""
    relaxed: Relaxed | None = None
    """Limits that give the closest trees a design when relaxed one at a time; None if they were not examined."""
    proven: str | None = None
    """What branch and bound proves for all candidates, with its scope; None without a proof."""
    proven_gap: float | None = None
    """Largest share by which a design of this size can improve on the best, within the scope of `proven`.

    From branch and bound; None while some trees are open, or if the candidates do not cover the size.
    """
    candidates_gap: float | None = None
    """The same for the candidates alone."""
    proof_resumable: tuple[str, ...] = ()
    """Trees with an incomplete proof that the same `prove` could complete."""
    proof_open: tuple[str, ...] = ()
    """In the answer of `prove`: trees for which less is proven than requested."""

    @property
    def counts(self) -> str:
        """Number of candidates with each status, in words."""
        return ", ".join(f"{number} {status}" for status, number in sorted(self.statuses.items()))

    def gap_of(self, row: Row) -> float | None:
        """Return the largest share by which this size can improve on a design, if known."""
        if self.proven_gap is None or self.best is None or not self.objective.number(row):
            return row.gap
        return self.objective.gap_after(self.proven_gap, self.objective.excess(row, self.best))

    __repr__, _repr_html_ = tables.size_repr, tables.size_html


@dataclass(frozen=True)
class LevelAnswer:
    """Results for one level of the goals."""

    number: int
    level: Level
    sizes: tuple[SizeAnswer, ...]
    """Smallest first."""


@dataclass(frozen=True)
class Answer:
    """The result of a run."""

    folder: Path
    sizes: tuple[SizeAnswer, ...]
    """Results per size, smallest first; with goals, those of the loosest level."""
    levels: tuple[LevelAnswer, ...] = ()
    """Results per level of a run with goals, loosest first."""
    points: tuple[FrontPoint, ...] = ()
    """The front of a run with goals, best first."""
    design: Design | None = None
    """The best design with a clear audit."""
    audit: Audit | None = None
    """The audit of `design`."""

    def __str__(self) -> str:
        """Return the best design, or why there is none, in one line."""
        if self.best is not None:
            gap = "" if self.best.gap is None else f", gap {gap_percent(self.best.gap)}"
            words = f"{self.best.key}, {self.best.modules} modules, {self.objective.words(self.best, 6)}{gap}"
            return f"{words}, audit {self.best.audit}; everything is in {self.folder}"
        if self.exit_status == 1:
            return f"{self.failure}; everything is in {self.folder}"
        reasons = "; ".join(f"{size.modules} modules: {size.reason}" for size in self._all_sizes)
        return f"no design was found: {reasons}; everything is in {self.folder}"

    @property
    def failure(self) -> str:
        """That no design passed its audit, and why the best one of each size did not, in words."""
        failures = [f"{size.top[0].key}: {size.failure}" for size in self._all_sizes if size.failure is not None]
        return "; ".join(["designs were found, but none passed its audit", *failures])

    @property
    def found(self) -> bool:
        """True if there is a design with a clear audit."""
        return self.best is not None

    @property
    def best(self) -> Row | None:
        """The best clear design of the smallest size that has one; with goals, the best of the front.

        If a quantity is maximised, that of its largest value, of equals the smaller.
        """
        if self.levels:
            return self.points[0].row if self.points else None
        return best_of(size.best for size in self.sizes)

    @property
    def shown(self) -> Row | None:
        """The best design, or if none is clear, that of lowest effort of the smallest feasible size."""
        return self.best or next((row for size in self.sizes for row in size.top), None)

    @property
    def objective(self) -> Objective:
        """Objective of the search."""
        return next((size.objective for size in self._all_sizes), LEAST_EFFORT)

    @property
    def level(self) -> int:
        """Number of the best design's level; 0 without goals."""
        return self.points[0].number if self.points else 0

    @property
    def at_level(self) -> Answer:
        """The same answer with the sizes of that level."""
        return replace(self, sizes=self.levels[self.level].sizes) if self.levels else self

    @property
    def smallest(self) -> str:
        """Statement on smaller sizes; empty for a single size, with goals, and if a quantity is maximised."""
        if self.best is None or self.levels or len(self.sizes) == 1 or self.best.value is not None:
            return ""
        fewer = [size for size in self.sizes if size.modules < self.best.modules]
        if not fewer:
            return "the smallest requested size"
        proven = "proven" if all(size.impossible for size in fewer) else "not proven"
        return f"the smallest size with a design ({proven} that fewer, down to {fewer[0].modules}, have none)"

    @property
    def ability(self) -> str | None:
        """Capability of the best design, by its value of the maximised quantity; None if effort is minimised."""
        return None if self.design is None else self.objective.ability(self.design.task)

    @property
    def fragile(self) -> tuple[Missed, ...]:
        """Defaults of flying tasks that `design` misses, as no design holds them; empty if one does."""
        return () if self.design is None or self.audit is None else find_missed(self.design, self.audit)

    @property
    def note(self) -> str | None:
        """The audit's note on the rod of the best design."""
        sheet = None if self.audit is None else self.audit.assembly.end_effector
        return None if sheet is None else sheet.note

    @property
    def clear_rod(self) -> bool:
        """True if a straight rod carries the end-effector of the best design, clear of all parts and airflow."""
        sheet = None if self.audit is None else self.audit.assembly.end_effector
        return sheet is not None and sheet.clear_rod

    @property
    def weakest_point(self) -> str | None:
        """The weakest point of the best design in one line, from its audit."""
        return None if self.audit is None or self.audit.flight is None else self.audit.flight.weakest_point

    @property
    def air(self) -> tuple[str, ...]:
        """The air speeds of the best design, one line each, from its audit."""
        return () if self.audit is None or self.audit.air is None else tuple(self.audit.air.sentences())

    @property
    def fast_air(self) -> tuple[FastAir, ...]:
        """Regions without a limit on air speed where the best design's air is fast, from its audit."""
        return () if self.audit is None or self.audit.air is None else self.audit.air.fast

    @property
    def placement(self) -> tuple[str, ...]:
        """Where the best design's rod pulls, and what solid regions its rotors are near, from its audit."""
        place = None if self.audit is None else self.audit.placement
        return () if place is None else tuple(place.sentences())

    @property
    def tolerances(self) -> str | None:
        """What the task's tolerances leave of the best design's clearances, and whether that is required."""
        return None if self.audit is None else self.audit.tolerances_words

    @property
    def shorter_rod(self) -> str | None:
        """Effort of the best design with a shorter rod, in words."""
        return None if self.design is None else self.design.shorter_rod

    @property
    def candidates(self) -> pd.DataFrame:
        """A row for every candidate, with the columns of `candidates.csv`, best first."""
        return tables.candidates(self.folder)

    @property
    def shortfalls(self) -> pd.DataFrame:
        """A row for every constraint that the starts of a candidate without a design violate.

        A candidate's most frequent constraint is first. `starts` counts the starts that violate it most,
        `violation` is the smallest violation among them, in `unit`; `kind` is the constraint without module
        numbers. A candidate that is proven impossible was not solved and has no row. With goals, the last column is
        the level's number.
        """
        return tables.shortfalls(self.folder)

    @property
    def solves(self) -> pd.DataFrame:
        """A row for every solve, in the order of completion, with the fields of `SolveEvent`.

        With goals, the last column is the level's number.
        """
        return tables.solves(self.folder)

    @property
    def front(self) -> pd.DataFrame:
        """A row for every design of the front, with the columns of `front.csv`; none without goals."""
        return tables.front_table(self.points)

    @property
    def proven(self) -> bool:
        """True if branch and bound has closed all candidates of every size with a best design."""
        sizes = [size for size in self.sizes if size.best is not None]
        return bool(sizes) and all(size.candidates_gap is not None and not size.proof_open for size in sizes)

    @property
    def complete(self) -> bool:
        """True if no start and no audit remains."""
        return all(size.complete for size in self._all_sizes)

    @property
    def _all_sizes(self) -> tuple[SizeAnswer, ...]:
        return tuple(size for level in self.levels for size in level.sizes) or self.sizes

    __repr__, _repr_html_ = tables.answer_repr, tables.answer_html

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 with a clear design, 1 if no audit is clear, 3 without a design."""
        if self.best is not None:
            return 0
        return 1 if any(size.feasible for size in self._all_sizes) else 3


def quotient_remark(quotient: Resolution) -> str:
    """Describe which trees are merged into one candidate, and warn if that is not exact."""
    lossy = "this symmetry is lossy here: merged trees can differ in cost, and only one is solved"
    return quotient.reason if quotient.exact else f"{quotient.reason}; {lossy}"
