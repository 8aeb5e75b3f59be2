"""The ledger of a run: an SQLite file with one row per candidate, from which everything else derives.

A row's key is its context (a digest of the task with its margin, the seed and the library versions) and its
topology's key. Each row is on disk before the next job's result is processed (WAL, synchronous = FULL); after each
write the ledger makes sure that its file still exists. `candidates.csv` shows the same rows.
"""

import hashlib
import json
import math
import sqlite3
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import astuple, dataclass, fields, replace
from itertools import starmap
from pathlib import Path
from typing import Self

from topo_search.engine import Failed, Outcome, Tried
from topo_search.engine.workers import record_of, scaled_violation
from topo_search.model import Audit, Design, Infeasible, Objective, ResolvedTask
from topo_search.model.features import Flight
from topo_search.model.files import to_json
from topo_search.study.directory import RunFiles
from topo_search.study.ledger_file import LedgerLost, checked_text, damage, open_database, parse
from topo_search.study.request import Context, Identity, digest, installed_versions

FLIGHT: dict[str, Callable[[Flight], float | int | None]] = {
    "force_reserve_N": lambda flight: flight.hover.force_reserve_N,
    "torque_reserve_Nm": lambda flight: flight.hover.torque_reserve_Nm,
    "rotors_out_hover": lambda flight: flight.rotors_out_hover.survive,
    "load_factor": lambda flight: flight.load_factor,
    "joint_moment_Nm": lambda flight: flight.joint_moment_Nm,
    "hinge_tolerance_deg": lambda flight: flight.hinge_tolerance_deg,
    "rod_length_m": lambda flight: flight.rod_length_m,
}
"""Columns of figures from an audit that each row stores, and how to read them from the audit."""
NEAR_BEST = 0.01
"""Largest excess of effort over the best, as a share, for a design to count as equally good."""


@dataclass(frozen=True)
class Row:
    """The result of one candidate."""

    key: str
    modules: int
    orbit: int
    """Number of symmetric copies: classes of the exact quotient that the candidate represents."""
    status: str
    """feasible, infeasible, impossible, pruned or failed."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    worst_constraint: str | None = None
    """The most violated constraint; for `failed` the reason."""
    violation: float | None = None
    unit: str | None = None
    starts: int = 0
    starts_feasible: int = 0
    seconds: float = 0.0
    audit: str | None = None
    """The audit's verdict, if there is one."""
    starts_at_best: int = 0
    """Hits: number of starts that reached the best optimum."""
    asked: int = 0
    """Number of starts that are settled: solved, replaced by a warm start, or given up."""
    audit_failure: str | None = None
    """Why the audit gave no verdict."""
    margin: float = 0.0
    """The solver's margin [m]."""
    step: int = 0
    """Index of the margin among the task's `margins`; 0: the task's own."""
    force_reserve_N: float | None = None
    """Force in any direction that can be added at the end-effector in hover [N]; from the audit, like the rest."""
    torque_reserve_Nm: float | None = None
    """Torque about any axis that can be added in hover [N m]."""
    rotors_out_hover: int | None = None
    """Number of rotors whose single failure hover survives."""
    load_factor: float | None = None
    """Smallest load factor of hover and all load cases."""
    joint_moment_Nm: float | None = None
    """Largest moment of all joints and load cases [N m]."""
    hinge_tolerance_deg: float | None = None
    """Error of all hinge angles that provably loses no clearance [deg]."""
    rod_length_m: float | None = None
    value: float | None = None
    """Value of the maximised quantity; None if effort is minimised."""
    value_bound: float | None = None
    """Largest value that any platform of this size can have."""
    reach: float | None = None
    """Value that the candidate was asked to exceed."""

    @property
    def rank(self) -> tuple[float, float, str]:
        """Sort key of designs: largest value first, then lowest effort."""
        return -(self.value or 0.0), math.inf if self.objective is None else self.objective, self.key

    @property
    def feasible(self) -> bool:
        """True if there is a design."""
        return self.status == "feasible"

    @property
    def clear(self) -> bool:
        """True if there is a design and its audit passed."""
        return self.audit == "clear"

    @property
    def audit_ended(self) -> bool:
        """True if there is a verdict, or the audit failed."""
        return self.audit is not None or self.audit_failure is not None


ROW_FIELDS = tuple(field.name for field in fields(Row))


@dataclass(frozen=True)
class SolveEvent:
    """One finished solve."""

    at: float
    """Time at which it finished [s since 1970, UTC]."""
    key: str
    status: str
    """The candidate's status after it."""
    objective: float | None
    """The candidate's best objective after it [rad^4/s^4]."""
    margin: float
    """The solver's margin [m]."""
    value: float | None = None
    """The candidate's best value of the maximised quantity after it."""


def row_of(outcome: Outcome, key: str, modules: int, orbit: int, starts: int, bound: float, of: Objective) -> Row:
    """Return the row of a candidate after its first `starts` starts."""
    lower_bound, value_bound = of.bounds(bound)
    candidate = Row(key, modules, orbit, "failed", lower_bound=lower_bound, value_bound=value_bound, asked=starts)
    if isinstance(outcome, Failed):
        return replace(candidate, worst_constraint=outcome.reason)
    if record := record_of(outcome):
        counts = ("starts", "starts_feasible", "starts_at_best", "seconds")
        candidate = replace(candidate, **{name: getattr(record, name) for name in counts})
    if isinstance(outcome, Infeasible):
        shortfall = ("status", "worst_constraint", "violation", "unit")
        return replace(candidate, **{name: getattr(outcome, name) for name in shortfall})
    gap = of.gap(outcome, bound)
    return replace(candidate, status="feasible", objective=outcome.objective, value=outcome.value, gap=gap)


def best_of(rows: Iterable[Row | None]) -> Row | None:
    """Return the best of a row for each size: of the largest value if one is maximised, then the smallest."""
    return min((row for row in rows if row is not None), key=lambda r: (-(r.value or 0.0), r.modules), default=None)


def flight_of(audit: Audit) -> dict[str, float | int | None]:
    """Return the audit's figures that a row stores, by the names of FLIGHT."""
    flight = audit.flight
    return {name: None if flight is None else read(flight) for name, read in FLIGHT.items()}


def score_of(row: Row, task: ResolvedTask) -> Tried:
    """Return the result of a candidate as its strategy receives it."""
    violation = None if row.violation is None else scaled_violation(row.violation, row.unit or "", task)
    return Tried(row.key, row.asked, row.status, row.objective, violation, row.value)


class _Sql:
    """Parts that queries share."""

    select = f"SELECT {', '.join(ROW_FIELDS)} FROM candidates"
    in_contexts = "context IN (SELECT value FROM json_each(?))"
    ranked = f"WHERE standing AND modules = ? AND {in_contexts}"
    row_key = "context = ? AND key = ?"


class Ledger:
    """The rows of one run folder."""

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        self._database = database
        self.path = path
        self._opened_files = self._file_identities()
        self._contexts = "[]"
        """Names of the contexts that rankings cover: those of one request and its library versions (JSON)."""

    @classmethod
    @contextmanager
    def open(cls, path: Path, *, read_only: bool = False) -> Iterator[Self]:
        """Open a ledger.

        Args:
            path: its file.
            read_only: whether nothing may be written, not even files of SQLite next to it.

        Raises:
            BadInput: the file is damaged, missing, or not a ledger of this version; it is left unchanged.
        """
        with open_database(path, read_only=read_only) as database:
            yield cls(database, path)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Run a transaction, and make sure that it reached the file.

        Raises:
            LedgerLost: the file is gone.
        """
        with self._database:
            self._database.execute("BEGIN IMMEDIATE")
            yield
        self.require()

    def _write(self, query: str, values: tuple[object, ...]) -> None:
        with self._transaction():
            self._database.execute(query, values)

    def require(self) -> None:
        """Make sure that the path still leads to the file that was opened.

        Raises:
            LedgerLost: the file, or the folder, was removed, moved or replaced.
        """
        if self._file_identities() != self._opened_files:
            raise LedgerLost(self.path)

    def _file_identities(self) -> list[tuple[float, ...] | None]:
        paths = self.path, self.path.with_name(f"{self.path.name}-wal")
        return [path.stat()[1:3] if path.exists() else None for path in paths]

    def identity(self) -> Identity:
        """Return the identity of the ledger's run; BadInput if it is unreadable."""
        return parse(self.path, Identity, "run", self._database.execute("SELECT identity FROM run").fetchone()[0])

    def fingerprint(self, *, but: str) -> str:
        """Return a digest of all rows, all files of the run except one, and the installed versions."""
        mark = hashlib.blake2b(repr(installed_versions()).encode(), digest_size=16)
        for table in ("run", "contexts", "candidates", "solves", "files"):
            for row in self._database.execute(f"SELECT * FROM {table} ORDER BY 1, 2"):
                if row[0] != but:
                    mark.update(repr(row).encode())
        return mark.hexdigest()

    def set_request(self, starts: int, trials: int | None) -> None:
        """Record the latest request: starts per candidate, and number of proposals."""
        if self.last_request() != (starts, trials):
            self._write("UPDATE run SET starts = ?, trials = ?", (starts, trials))

    def last_request(self) -> tuple[int, int | None]:
        """Return the latest request: starts per candidate, and number of proposals."""
        starts, trials = self._database.execute("SELECT starts, trials FROM run").fetchone()
        return starts, trials

    def versions(self) -> dict[str, str] | None:
        """Return the library versions of the latest solve; None if the ledger has no context."""
        latest = "contexts LEFT JOIN solves USING (context) ORDER BY number DESC LIMIT 1"
        values = self._database.execute(f"SELECT context, fixed_by FROM {latest}").fetchone()
        if values is None:
            return None
        context, text = values
        with suppress(ValueError):
            if digest(fixed_by := json.loads(text)) == context:
                versions: dict[str, str] = fixed_by["versions"]
                return versions
        raise damage(self.path, f"its entry for context {context} has changed since it was written")

    def bound(self, context: Context) -> tuple[float, Infeasible | None] | None:
        """Return the lower bound and the proof of impossibility of a context; None if the ledger lacks it."""
        query = "SELECT lower_bound, proof FROM contexts WHERE context = ?"
        values = self._database.execute(query, (context.name,)).fetchone()
        if values is None:
            return None
        lower_bound, proof = values
        return lower_bound, None if proof is None else parse(self.path, Infeasible, "contexts", proof)

    def add_context(self, context: Context, lower_bound: float, proof: Infeasible | None) -> None:
        """Record a context with its lower bound and its proof of impossibility, if there is one."""
        values = (context.name, context.task.n, context.step, context.margin, json.dumps(context.fixed_by))
        bounds = lower_bound, None if proof is None else to_json(proof)
        insert = "INSERT OR IGNORE INTO contexts VALUES (?, ?, ?, ?, ?, ?, ?, NULL, NULL)"
        self._write(insert, (*values, *bounds))

    def mark_complete(self, context: Context, starts: int, trials: int | None) -> None:
        """Record that the strategy finished with these numbers of starts and proposals."""
        query = "UPDATE contexts SET ended_starts = ?, ended_trials = ? WHERE context = ?"
        self._write(query, (starts, trials, context.name))

    def is_complete(self, context: Context, starts: int, trials: int | None) -> bool:
        """Return whether the strategy finished with at least these numbers of starts and proposals (None: all)."""
        sufficient = "ended_starts >= ? AND (ended_trials IS NULL OR ended_trials >= ?)"
        query = f"SELECT {sufficient} FROM contexts WHERE context = ?"
        values = self._database.execute(query, (starts, trials, context.name)).fetchone()
        return values is not None and bool(values[0])

    def has_failures(self, context: Context) -> bool:
        """Return whether the last solve of some candidate failed."""
        last = "SELECT status, max(number) FROM solves WHERE context = ? GROUP BY key"  # SQLite: status of that row
        query = f"SELECT count(*) FROM ({last}) WHERE status = 'failed'"
        return bool(self._database.execute(query, (context.name,)).fetchone()[0])

    def count_solved(self, context: Context, starts: int) -> int:
        """Return how many candidates of a context were solved from at least `starts` starts."""
        query = "SELECT count(*) FROM candidates WHERE context = ? AND asked >= ? AND status <> 'failed'"
        number: int = self._database.execute(query, (context.name, starts)).fetchone()[0]
        return number

    def scores(self, context: Context) -> Iterator[Tried]:
        """Yield the candidate's result after each solve that did not fail, in the order in which they finished."""
        query = (
            "SELECT key, asked, status, objective, violation, value FROM solves "
            "WHERE context = ? AND status <> 'failed' ORDER BY number"
        )
        return starmap(Tried, self._database.execute(query, (context.name,)))

    def row(self, context: Context, key: str) -> Row | None:
        """Return one candidate's row in a context."""
        query = f"{_Sql.select} WHERE {_Sql.row_key}"
        return next(starmap(Row, self._database.execute(query, (context.name, key))), None)

    def result(self, context: Context, key: str) -> Design | Infeasible | None:
        """Return one candidate's result so far; None if every solve failed."""
        text = self.result_text(context, key)
        if text is None:
            return None
        model: type[Design] | type[Infeasible] = Design if '"topo-search/design"' in text[:60] else Infeasible
        return parse(self.path, model, "texts", text)

    def audit(self, context: Context, key: str) -> Audit | None:
        """Return the audit of a candidate's design."""
        text = self._text("audit", context, key)
        return None if text is None else parse(self.path, Audit, "texts", text)

    def result_text(self, context: Context, key: str) -> str | None:
        """Return a candidate's result as JSON text."""
        return self._text("result", context, key)

    def texts(self, n: int) -> Iterator[tuple[str, str, str | None]]:
        """Yield key, design and audit (as JSON texts) of every candidate of n modules that has a design."""
        query = (
            "SELECT key, result, result_checksum, texts.audit, audit_checksum "
            f"FROM candidates LEFT JOIN texts USING (context, key) {_Sql.ranked} AND status = 'feasible'"
        )
        rows = self._database.execute(query, (n, self._contexts))
        for key, result, result_checksum, audit, audit_checksum in rows:
            audit_text = None if audit_checksum is None else checked_text(self.path, key, audit, audit_checksum)
            yield key, checked_text(self.path, key, result, result_checksum), audit_text

    def record(
        self, context: Context, rows: Sequence[tuple[Row, Design | Infeasible | None]], *, failed: bool = False
    ) -> None:
        """Write rows of solved candidates and their results in one transaction.

        A candidate is ranked by its last row with a design, or else by its first row. Its audit is kept if `row`
        still has the verdict. `failed`: the latest solve failed; the row holds the result of earlier ones.
        """
        columns = (*ROW_FIELDS, "context", "standing", "result_checksum")
        unrank = f"UPDATE candidates SET standing = 0 WHERE key = ? AND {_Sql.in_contexts}"
        write_row = f"""
        INSERT INTO candidates ({", ".join(columns)}) VALUES ({", ".join("?" * len(columns))})
        ON CONFLICT (context, key) DO UPDATE SET {", ".join(f"{name} = excluded.{name}" for name in columns)},
        audit_checksum = CASE WHEN excluded.audit IS NULL THEN NULL ELSE audit_checksum END
        """
        write_result = """
        INSERT INTO texts (context, key, result) VALUES (?, ?, ?)
        ON CONFLICT (context, key) DO UPDATE SET result = excluded.result, audit = CASE WHEN ? THEN audit END
        """
        with self._transaction():
            for row, result in rows:
                standing = row.feasible or context.step == 0
                values = [getattr(row, name) for name in ROW_FIELDS]
                text = None if result is None else to_json(result).encode()
                if standing:
                    self._database.execute(unrank, (row.key, self._contexts))
                self._database.execute(write_row, (*values, context.name, standing, text and zlib.crc32(text)))
                self._database.execute(write_result, (context.name, row.key, text, row.audit is not None))
                if row.status != "pruned":  # a pruned candidate was not solved
                    score = score_of(row, context.task)
                    score = replace(score, status="failed") if failed else score
                    number = self._database.execute("SELECT coalesce(max(number), 0) + 1 FROM solves").fetchone()[0]
                    event = (number, time.time(), context.name, *astuple(score))
                    self._database.execute("INSERT INTO solves VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", event)

    def record_audit(self, context: Context, key: str, audit: Audit) -> None:
        """Write the audit of a candidate's design."""
        text = to_json(audit).encode()
        row_key = context.name, key
        with self._transaction():
            changes = {"audit": str(audit.verdict), "audit_checksum": zlib.crc32(text), **flight_of(audit)}
            verdict = f"UPDATE candidates SET {', '.join(f'{name} = ?' for name in changes)} WHERE {_Sql.row_key}"
            self._database.execute(verdict, (*changes.values(), *row_key))
            self._database.execute(f"UPDATE texts SET audit = ? WHERE {_Sql.row_key}", (text, *row_key))

    def forget_audit_failures(self, context: Context) -> None:
        """Delete the failures of audits, so that those designs are audited again."""
        failed = "WHERE context = ? AND audit_failure IS NOT NULL"
        self._write(f"UPDATE candidates SET audit_failure = NULL {failed}", (context.name,))

    def record_audit_failure(self, context: Context, key: str, reason: str) -> None:
        """Write why the audit of a candidate's design failed."""
        self._write(f"UPDATE candidates SET audit_failure = ? WHERE {_Sql.row_key}", (reason, context.name, key))

    def files_in(self, folder: Path) -> RunFiles:
        """Return the run's files in its folder."""
        return RunFiles(self._database, folder)

    def ranking_only(self, contexts: Iterable[Context]) -> Self:
        """Return the same ledger, whose rankings cover only the rows of these contexts."""
        ledger = copy(self)
        ledger._contexts = json.dumps([context.name for context in contexts])
        return ledger

    def ranking(self, n: int) -> Iterator[Row]:
        """Yield the row of each candidate of n modules: by objective, then key, those without a design last."""
        query = f"{_Sql.select} {_Sql.ranked} ORDER BY objective IS NULL, value DESC, objective, key"
        return starmap(Row, self._database.execute(query, (n, self._contexts)))

    def best_clear(self, n: int) -> Row | None:
        """Return the best row of n modules whose audit is clear."""
        query = f"{_Sql.select} {_Sql.ranked} AND audit = 'clear' ORDER BY value DESC, objective, key LIMIT 1"
        return next(starmap(Row, self._database.execute(query, (n, self._contexts))), None)

    def solves(self, n: int) -> Iterator[SolveEvent]:
        """Yield the solves of n modules in the order in which they finished."""
        query = (
            "SELECT at, key, status, objective, margin, value FROM solves JOIN contexts USING (context) "
            f"WHERE modules = ? AND {_Sql.in_contexts} "
            "AND status <> 'impossible' ORDER BY number"  # a proof is not a solve
        )
        return starmap(SolveEvent, self._database.execute(query, (n, self._contexts)))

    def best_designs(self, context: Context, first: int, count: int) -> list[Row]:
        """Return `count` designs of a context, ranked by objective and key, starting at index `first`."""
        designs = f"{_Sql.select} WHERE context = ? AND objective IS NOT NULL"
        query = f"{designs} ORDER BY value DESC, objective, key LIMIT ? OFFSET ?"
        return [*starmap(Row, self._database.execute(query, (context.name, count, first)))]

    def _text(self, column: str, context: Context, key: str) -> str | None:
        """Return a candidate's text in a column of `texts`, with its checksum verified."""
        texts = "candidates LEFT JOIN texts USING (context, key)"
        query = f"SELECT texts.{column}, {column}_checksum FROM {texts} WHERE {_Sql.row_key}"
        text, checksum = self._database.execute(query, (context.name, key)).fetchone() or (None, None)
        return None if checksum is None else checked_text(self.path, key, text, checksum)
