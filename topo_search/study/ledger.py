"""The ledger: one row per candidate in an SQLite file, the truth about a run; `candidates.csv` shows the same rows.

A row's key is its context (a digest of the task with its margin, the seed and the library versions) and its
topology's key. Each row is on the disk before the next job's result is taken up (WAL, synchronous = FULL), with a
checksum (`ledger_file`); and whoever wrote it knows that the file is still there.
"""

from __future__ import annotations

import json
import re
import sqlite3
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import astuple, dataclass, fields, replace
from itertools import starmap
from pathlib import Path
from typing import Self

from topo_search.engine import Failed, Outcome, Tried, record_of, scaled_violation
from topo_search.model import Audit, Design, Flight, Infeasible, ResolvedTask
from topo_search.model.files import to_json
from topo_search.model.proven import lower_text, upper_text
from topo_search.study.directory import Directory, RunFiles, digest_of
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
"""Columns of an audited design: what its audit reports beyond the task."""
AUDITED = ("power_W", "air_tip_m_s", "air_region_m_s", "force_reserve_com_N", "tilt_deg")
"""Columns of an audited design that are read from its audit, not from its row in the ledger."""


@dataclass(frozen=True)
class Row:
    """Result of one candidate."""

    key: str
    modules: int
    orbit: int
    """Number of classes of the exact quotient that the candidate stands for."""
    status: str
    """feasible, infeasible, impossible, pruned or failed."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    worst_constraint: str | None = None
    """The constraint that was missed; for `failed` the reason."""
    violation: float | None = None
    unit: str | None = None
    starts: int = 0
    starts_feasible: int = 0
    seconds: float = 0.0
    audit: str | None = None
    """The verdict, once there is one."""
    starts_at_best: int = 0
    """Number of starts that reached the same optimum as the best."""
    asked: int = 0
    """Number of starts that need no more solving: tried, replaced by a design carried over, or given up."""
    audit_failure: str | None = None
    """Why there is no verdict though an audit was tried."""
    margin: float = 0.0
    """The margin that the solver was asked for [m]."""
    step: int = 0
    """Its place among the `margins` of the task, 0 for the task's own."""
    force_reserve_N: float | None = None
    """Any force of this size can be added at the end-effector in hover [N]; this and what follows of an audit."""
    torque_reserve_Nm: float | None = None
    """Any torque of this size can be added in hover [N m]."""
    rotors_out_hover: int | None = None
    """Number of rotors any one of which may fail in hover."""
    load_factor: float | None = None
    """The least of hover and all load cases."""
    joint_moment_Nm: float | None = None
    """The largest of all joints and load cases [N m]."""
    hinge_tolerance_deg: float | None = None
    """Proven: hinge angles off by as much lose no clearance [deg]."""
    rod_length_m: float | None = None

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
        """True if an audit need not be tried (again)."""
        return self.audit is not None or self.audit_failure is not None


ROW_FIELDS = tuple(field.name for field in fields(Row))
COLUMNS = (
    *(*ROW_FIELDS[: ROW_FIELDS.index("asked")], *FLIGHT, *AUDITED),
    *("proven_bound", "proven_gap", "proof", "proven_problem"),
)
"""The columns of `candidates.csv`: fields of a row before `asked`, then what audits say, last what proofs do."""


@dataclass(frozen=True)
class SolveEvent:
    """One solve, when it ended."""

    at: float
    """Time of its end [s since 1970, UTC]."""
    key: str
    status: str
    """Key of the candidate after it."""
    objective: float | None
    """The candidate's best after it [rad^4/s^4]."""
    margin: float
    """The margin that the solver was asked for [m]."""


def row_of(outcome: Outcome, *, key: str, modules: int, orbit: int, starts: int, lower_bound: float) -> Row:
    """Return the row of a candidate that was solved from its first `starts` starts, or given up."""
    candidate = Row(key=key, modules=modules, orbit=orbit, status="failed", asked=starts, lower_bound=lower_bound)
    if isinstance(outcome, Failed):
        return replace(candidate, worst_constraint=outcome.reason)
    if record := record_of(outcome):
        counts = ("starts", "starts_feasible", "starts_at_best", "seconds")
        candidate = replace(candidate, **{name: getattr(record, name) for name in counts})
    if isinstance(outcome, Infeasible):
        missed = ("status", "worst_constraint", "violation", "unit")
        return replace(candidate, **{name: getattr(outcome, name) for name in missed})
    gap = Design.gap_of(outcome.objective, lower_bound)
    return replace(candidate, status="feasible", objective=outcome.objective, gap=gap)


def proven_cell(name: str, value: object, digits: int = 6) -> object:
    """Return what a table prints of one of an audit's figures, rounded to the side on which it is proven."""
    if not isinstance(value, float):
        return value
    at_most = {"air_tip_m_s", "air_region_m_s", "joint_moment_Nm", "rod_length_m"}  # all others are no less
    at_most |= {"speed", "joint_moment", "peak_input"}  # the goals among them
    return upper_text(value, digits) if name in at_most else lower_text(value, digits)


def flight_of(audit: Audit) -> dict[str, float | int | None]:
    """Return what a row says of its audit's figures of flight, by the names of FLIGHT."""
    flight = audit.flight
    return {name: None if flight is None else read(flight) for name, read in FLIGHT.items()}


def figures_of(audit: Audit) -> dict[str, float | None]:
    """Return what an audit says by the names of AUDITED.

    Power at the rotors' shafts in hover [W]; of all load cases the fastest air at the end-effector and over regions
    [m/s]; in hover any force that can be added at the centre of mass [N], and the tilt that can be held [deg].
    """
    hover, air = None if audit.flight is None else audit.flight.hover, audit.air
    return {
        "power_W": next((case.shaft_W for case in audit.power if hover and case.name == hover.name), None),
        "air_tip_m_s": None if air is None else air.tip_m_s,
        "air_region_m_s": None if air is None else air.region_m_s,
        "force_reserve_com_N": None if hover is None else hover.force_reserve_com_N,
        "tilt_deg": None if hover is None else hover.tilt_deg,
    }


def score(row: Row, task: ResolvedTask) -> Tried:
    """Return what a strategy learns of a candidate."""
    violation = None if row.violation is None else scaled_violation(row.violation, row.unit or "", task)
    return Tried(row.key, row.asked, row.status, row.objective, violation)


def kind_of(constraint: str) -> str:
    """Return the name of a constraint without the numbers of its modules."""
    return re.sub(r"\bmodule \d+", "a module", re.sub(r"\bmodules \d+ and \d+", "two modules", constraint))


class _Sql:
    """Parts of several queries."""

    select = f"SELECT {', '.join(ROW_FIELDS)} FROM candidates"
    ranked = "context IN (SELECT value FROM json_each(?))"
    standing = f"WHERE standing AND modules = ? AND {ranked}"
    row_key = "context = ? AND key = ?"


class Ledger:
    """The rows of one run folder."""

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        self._database = database
        self.path = path
        self._names = [Path(f"{path.absolute()}{end}") for end in ("", "-wal")]
        self._made = self._identities()
        self._ranked = "[]"
        """Names of the contexts that rankings are made of, those of one request and its library versions (JSON)."""

    @classmethod
    @contextmanager
    def open(cls, path: Path, *, read_only: bool = False) -> Iterator[Self]:
        """Open a ledger.

        Args:
            path: its file.
            read_only: whether nothing may be written beside it either.

        Raises:
            BadInput: the file is damaged, gone, or no ledger of this version; it is left unchanged.
        """
        with open_database(path, read_only=read_only) as database:
            yield cls(database, path)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Make a transaction, and be sure that it is in the file.

        Raises:
            LedgerLost: it is not: the file is gone.
        """
        with self._database:
            self._database.execute("BEGIN IMMEDIATE")
            yield
        self.require()

    def _write(self, query: str, values: tuple[object, ...]) -> None:
        with self._transaction():
            self._database.execute(query, values)

    def require(self) -> None:
        """Make sure that what was written is in the file of this name, where the next process will look for it.

        Raises:
            LedgerLost: the file, or the folder, was removed, moved, replaced or emptied.
        """
        if self._identities() != self._made:
            raise LedgerLost(self.path)

    def _identities(self) -> list[tuple[int, int, bool] | None]:
        """Return which files there are, and whether the first has a content."""
        identities: list[tuple[int, int, bool] | None] = []
        for path in self._names:
            try:
                status = path.lstat()
            except OSError:
                identities.append(None)
            else:
                identities.append((status.st_dev, status.st_ino, bool(identities) or status.st_size > 0))
        return identities

    def identity(self) -> Identity:
        """Return the identity of the run that the ledger holds.

        Raises:
            BadInput: it cannot be read, or is gone.
        """
        rows = self._database.execute("SELECT identity FROM run").fetchall()
        if len(rows) != 1:
            raise damage(self.path, f"its table run has {len(rows)} rows in place of one")
        return parse(self.path, Identity, "run", rows[0][0])

    def fingerprint(self, *, but: str) -> str:
        """Return a digest of all rows, of all files of the run but one, and of the versions that read them."""
        tallies = self._database.execute("SELECT * FROM tallies ORDER BY name").fetchall()
        query = "SELECT name, digest FROM files WHERE name <> ? ORDER BY name"
        files = self._database.execute(query, (but,)).fetchall()
        return digest_of(repr((tallies, files, installed_versions())).encode()).hex()

    def ask(self, starts: int, trials: int | None) -> None:
        """Record how many starts of each candidate, and how many proposals, were asked for last."""
        if self.last_request() != (starts, trials):
            self._write("UPDATE run SET starts = ?, trials = ?", (starts, trials))

    def last_request(self) -> tuple[int, int | None]:
        """Return how many starts of each candidate, and how many proposals, were asked for last."""
        starts, trials = self._database.execute("SELECT starts, trials FROM run").fetchone()
        return starts, trials

    def versions(self) -> dict[str, str] | None:
        """Return the versions of the libraries that solved last; None if nothing was begun."""
        latest = "contexts LEFT JOIN solves USING (context) ORDER BY number DESC LIMIT 1"
        values = self._database.execute(f"SELECT context, fixed_by FROM {latest}").fetchone()
        if values is None:
            return None
        context, text = values
        try:
            fixed_by = json.loads(text)
            named = digest(fixed_by)
        except (ValueError, RecursionError):
            fixed_by, named = None, None
        versions = fixed_by.get("versions") if isinstance(fixed_by, dict) and named == context else None
        if not isinstance(versions, dict) or not all(isinstance(value, str) for value in versions.values()):
            raise damage(self.path, f"what it holds of context {context} has changed since it was written")
        return versions

    def bound(self, context: Context) -> tuple[float, Infeasible | None] | None:
        """Return the lower bound and the proof of impossibility of a context, if it was begun."""
        query = "SELECT lower_bound, proof FROM contexts WHERE context = ?"
        values = self._database.execute(query, (context.name,)).fetchone()
        if values is None:
            return None
        lower_bound, proof = values
        return lower_bound, None if proof is None else parse(self.path, Infeasible, "contexts", proof)

    def begin(self, context: Context, lower_bound: float, proof: Infeasible | None) -> None:
        """Record a context."""
        values = (context.name, context.task.n, context.step, context.margin, json.dumps(context.fixed_by))
        bounds = lower_bound, None if proof is None else to_json(proof)
        insert = "INSERT OR IGNORE INTO contexts VALUES (?, ?, ?, ?, ?, ?, ?, NULL, NULL, 0)"
        self._write(insert, (*values, *bounds))

    def end(self, context: Context, starts: int, trials: int | None) -> None:
        """Record that the strategy came to its end with so many starts and proposals."""
        query = "UPDATE contexts SET ended_starts = ?, ended_trials = ? WHERE context = ?"
        self._write(query, (starts, trials, context.name))

    def has_ended(self, context: Context, starts: int, trials: int | None) -> bool:
        """Return whether the strategy came to its end with at least so many starts and proposals (None: all)."""
        enough = "ended_starts >= ? AND (ended_trials IS NULL OR ended_trials >= ?)"
        query = f"SELECT {enough} FROM contexts WHERE context = ?"
        values = self._database.execute(query, (starts, trials, context.name)).fetchone()
        return values is not None and bool(values[0])

    def has_failures(self, context: Context) -> bool:
        """Return whether the last solve of some candidate failed."""
        last = "SELECT status, max(number) FROM solves WHERE context = ? GROUP BY key"  # SQLite: status of that row
        query = f"SELECT count(*) FROM ({last}) WHERE status = 'failed'"
        return bool(self._database.execute(query, (context.name,)).fetchone()[0])

    def count_solved(self, context: Context, starts: int) -> int:
        """Return how many candidates of a context were solved from so many starts."""
        query = "SELECT count(*) FROM candidates WHERE context = ? AND asked >= ? AND status <> 'failed'"
        number: int = self._database.execute(query, (context.name, starts)).fetchone()[0]
        return number

    def scores(self, context: Context) -> Iterator[Tried]:
        """Return what candidates had reached after each solve that did not fail, in the order of their ends."""
        query = (
            "SELECT key, asked, status, objective, violation FROM solves "
            "WHERE context = ? AND status <> 'failed' ORDER BY number"
        )
        return starmap(Tried, self._database.execute(query, (context.name,)))

    def row(self, context: Context, key: str) -> Row | None:
        """Return one candidate's row in a context."""
        query = f"{_Sql.select} WHERE {_Sql.row_key}"
        return next(starmap(Row, self._database.execute(query, (context.name, key))), None)

    def result(self, context: Context, key: str) -> Design | Infeasible | None:
        """Return one candidate's result so far; None if every attempt failed."""
        text = self.design(context, key)
        if text is None:
            return None
        model: type[Design] | type[Infeasible] = Design if '"topo-search/design"' in text[:60] else Infeasible
        return parse(self.path, model, "texts", text, strict=False)

    def audit(self, context: Context, key: str) -> Audit | None:
        """Return the audit of a candidate's design."""
        text = self._text("audit", context, key)
        return None if text is None else parse(self.path, Audit, "texts", text, strict=False)

    def design(self, context: Context, key: str) -> str | None:
        """Return a candidate's result as JSON text."""
        return self._text("result", context, key)

    def texts(self, n: int) -> Iterator[tuple[str, str, str | None]]:
        """Yield key, design and audit (as JSON texts) of every candidate of n modules that has a design."""
        query = (
            "SELECT key, result, result_checksum, texts.audit, audit_checksum "
            f"FROM candidates LEFT JOIN texts USING (context, key) {_Sql.standing} AND status = 'feasible'"
        )
        for key, result, result_checksum, audit, audit_checksum in self._database.execute(query, (n, self._ranked)):
            verdict = None if audit_checksum is None else checked_text(self.path, key, audit, audit_checksum)
            yield key, checked_text(self.path, key, result, result_checksum), verdict

    def record(
        self, context: Context, rows: Sequence[tuple[Row, Design | Infeasible | None]], *, failed: bool = False
    ) -> None:
        """Write rows of candidates that were solved, all or none, with what is known of their designs.

        The last row with a design speaks for its candidate; the first one does when there is none. An audit stays
        if `row` still has its verdict. `failed`: the last solve did, whatever the row has from earlier ones.
        """
        columns = (*ROW_FIELDS, "context", "standing", "result_checksum", "checksum")
        step_down = f"UPDATE candidates SET standing = 0 WHERE key = ? AND {_Sql.ranked}"
        write_row = f"""
        INSERT INTO candidates ({", ".join(columns)}) VALUES ({", ".join("?" * (len(columns) - 1))}, 0)
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
                    self._database.execute(step_down, (row.key, self._ranked))
                self._database.execute(write_row, (*values, context.name, standing, text and zlib.crc32(text)))
                self._database.execute(write_result, (context.name, row.key, text, row.audit is not None))
                if row.status != "pruned":  # for another design may rule it out, or none
                    reached = score(row, context.task)
                    reached = replace(reached, status="failed") if failed else reached
                    number = self._database.execute("SELECT coalesce(max(number), 0) + 1 FROM solves").fetchone()[0]
                    event = (number, time.time(), context.name, *astuple(reached), 0)
                    self._database.execute(f"INSERT INTO solves VALUES ({', '.join('?' * 9)})", event)

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
        """Let designs whose audits failed be audited again."""
        failed = "WHERE context = ? AND audit_failure IS NOT NULL"
        self._write(f"UPDATE candidates SET audit_failure = NULL {failed}", (context.name,))

    def record_audit_failure(self, context: Context, key: str, reason: str) -> None:
        """Write why a candidate's design has no audit."""
        self._write(f"UPDATE candidates SET audit_failure = ? WHERE {_Sql.row_key}", (reason, context.name, key))

    def files_in(self, directory: Directory) -> RunFiles:
        """Return the files that the run wrote into its directory."""
        return RunFiles(self._database, directory)

    def of(self, contexts: Iterable[Context]) -> Self:
        """Return the same ledger with rankings of the rows of these contexts."""
        ledger = copy(self)
        ledger._ranked = json.dumps([context.name for context in contexts])
        return ledger

    def ranking(self, n: int) -> Iterator[Row]:
        """Return the row that stands for each candidate of n modules: by objective, ties by key, then the rest."""
        query = f"{_Sql.select} {_Sql.standing} ORDER BY objective IS NULL, objective, key"
        return starmap(Row, self._database.execute(query, (n, self._ranked)))

    def best_clear(self, n: int) -> Row | None:
        """Return the best row of n modules whose audit is clear."""
        query = f"{_Sql.select} {_Sql.standing} AND audit = 'clear' ORDER BY objective, key LIMIT 1"
        return next(starmap(Row, self._database.execute(query, (n, self._ranked))), None)

    def solves(self, n: int) -> Iterator[SolveEvent]:
        """Return the solves of n modules in the order in which they ended."""
        query = (
            "SELECT at, key, status, objective, margin FROM solves JOIN contexts USING (context) "
            f"WHERE modules = ? AND {_Sql.ranked} "
            "AND status <> 'impossible' ORDER BY number"  # a proof is no solve
        )
        return starmap(SolveEvent, self._database.execute(query, (n, self._ranked)))

    def best_designs(self, context: Context, first: int, count: int) -> list[Row]:
        """Return a context's designs from place `first` on, by objective, ties by key."""
        designs = f"{_Sql.select} WHERE context = ? AND objective IS NOT NULL"
        query = f"{designs} ORDER BY objective, key LIMIT ? OFFSET ?"
        return [*starmap(Row, self._database.execute(query, (context.name, count, first)))]

    def _text(self, column: str, context: Context, key: str) -> str | None:
        """Return what one of the columns of `texts` holds of a candidate."""
        texts = "candidates LEFT JOIN texts USING (context, key)"
        query = f"SELECT texts.{column}, {column}_checksum FROM {texts} WHERE {_Sql.row_key}"
        text, checksum = self._database.execute(query, (context.name, key)).fetchone() or (None, None)
        return None if checksum is None else checked_text(self.path, key, text, checksum)
