"""The ledger's SQLite file: its tables, and the checks of its integrity.

Opening the file checks that its tables are those of this program, and that their rows are unchanged. The texts of
results and audits, nearly all of the file, are checked when they are read: the row of their candidate has their
checksums. The file is created complete, with its run, so an empty file is damaged.

| symbol | meaning |
|---|---|
| row's checksum | CRC-32 of its other values as text; every flipped bit changes it |
| `tallies` | for each table: number of rows, and the sum of their checksums modulo 2^32 |

Checksums detect damage, not malice: a forged ledger has valid checksums. So values are also checked for their
meaning before they become file names or answers.
"""

from __future__ import annotations

import os
import re
import sqlite3
import stat
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from topo_search.model import BadInput
from topo_search.model.value import faults_of

if TYPE_CHECKING:
    from topo_search.model import Design
    from topo_search.study.answer import Answer

KEPT = "all results are kept; run the same command to continue"
"""Note (PEP 678) on the exception that ends a run early, once its results are safe."""
KEY_COLUMNS = {"run": "rowid", "contexts": "context", "candidates": "context, key", "solves": "number"}
"""The tables from which answers are made, with the key columns of each."""
KEY = re.compile(r"[ap][0-9a-f]+")
"""Pattern of a topology's key, which is also used in file names."""
APPLICATION_ID = 0x746F706F
"""`topo`, in the header of the file."""
VERSION = 8
SCHEMA = f"""
BEGIN;
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
CREATE TABLE run (identity TEXT NOT NULL, starts INTEGER NOT NULL, trials INTEGER, checksum INTEGER NOT NULL);
CREATE TABLE contexts (
    context TEXT PRIMARY KEY, modules INTEGER NOT NULL, step INTEGER NOT NULL, margin REAL NOT NULL,
    fixed_by TEXT NOT NULL, lower_bound REAL NOT NULL, proof TEXT, ended_starts INTEGER, ended_trials INTEGER,
    checksum INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE candidates (
    context TEXT NOT NULL, key TEXT NOT NULL, modules INTEGER NOT NULL, orbit INTEGER NOT NULL,
    status TEXT NOT NULL,
    objective REAL, lower_bound REAL, gap REAL, worst_constraint TEXT, violation REAL, unit TEXT,
    starts INTEGER NOT NULL, starts_feasible INTEGER NOT NULL, starts_at_best INTEGER NOT NULL,
    seconds REAL NOT NULL,
    audit TEXT, asked INTEGER NOT NULL, audit_failure TEXT, margin REAL NOT NULL, step INTEGER NOT NULL,
    force_reserve_N REAL, torque_reserve_Nm REAL, rotors_out_hover INTEGER, load_factor REAL, joint_moment_Nm REAL,
    hinge_tolerance_deg REAL, rod_length_m REAL,
    standing INTEGER NOT NULL, result_checksum INTEGER, audit_checksum INTEGER,
    checksum INTEGER NOT NULL, PRIMARY KEY (context, key)
) WITHOUT ROWID;
CREATE TABLE texts (context TEXT NOT NULL, key TEXT NOT NULL, result BLOB, audit BLOB, PRIMARY KEY (context, key));
CREATE TABLE solves (
    number INTEGER PRIMARY KEY, at REAL NOT NULL, context TEXT NOT NULL, key TEXT NOT NULL, asked INTEGER NOT NULL,
    status TEXT NOT NULL, objective REAL, violation REAL, checksum INTEGER NOT NULL
);
CREATE TABLE tallies (name TEXT PRIMARY KEY, rows INTEGER NOT NULL, total INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE files (
    name TEXT PRIMARY KEY, digest BLOB, before BLOB, changing INTEGER NOT NULL, checksum INTEGER NOT NULL
) WITHOUT ROWID;
CREATE INDEX ranking ON candidates (context, objective, key);
INSERT INTO tallies VALUES ('run', 0, 0), ('contexts', 0, 0), ('candidates', 0, 0), ('solves', 0, 0);
COMMIT;
"""
"""`run`: the identity and the latest request. `standing`: whether this row represents its candidate, rather than
one with another margin. `texts`: results and audits in JSON; their checksums are in `candidates`, null without a
text. `solves`: one row per solve, in order of completion, with the candidate's result after `asked` starts;
strategies are replayed from them. `ended_...`: the request for which the strategy last finished. `tallies`: of the
tables with key columns. `files`: the files that the run wrote into its folder (`directory`)."""
ADVICE = "choose another folder with --out, or move it away"
Model = TypeVar("Model", bound=BaseModel)


class LedgerLost(Exception):
    """The ledger, or its folder, was removed, moved, replaced or emptied while a run worked in it."""

    def __init__(self, path: Path, rule: str = "") -> None:
        self.answer: Answer | None = None
        """The run's answer, as far as it can still be read."""
        self.design: Design | None = None
        """The best design, audited if possible: this may be its only copy."""
        rule = rule or (
            "emptied during the run; the run stopped, and later results are only in the output printed here"
        )
        super().__init__(f"{path}: was removed, moved, replaced or {rule}")


def checksum(values: Sequence[Any]) -> int:
    """Return the checksum of a row's values."""
    return zlib.crc32(ascii(tuple(values)).encode("ascii"))


def is_within_folder(name: str) -> bool:
    """Return whether a relative name stays within its folder."""
    return all(part not in ("", "..") for part in name.split("/"))


def seal_changes(database: sqlite3.Connection) -> None:
    """Create triggers of this connection that update a changed row's checksum and its table's tally."""
    database.create_function("seal", -1, lambda *values: checksum(values), deterministic=True)
    for table, key_columns in KEY_COLUMNS.items():
        *names, _ = (name for _, name, *_ in database.execute(f"PRAGMA table_info({table})"))
        seal = f"""
        UPDATE {table} SET checksum = seal({", ".join(f"NEW.{name}" for name in names)})
        WHERE ({key_columns}) = ({", ".join(f"NEW.{name.strip()}" for name in key_columns.split(","))})"""
        tally = f"UPDATE tallies SET rows = rows + %s, total = (total + %s) & 4294967295 WHERE name = '{table}'"
        inserted, deleted = ("1", "NEW.checksum"), ("-1", "-OLD.checksum")
        changed = "0", "NEW.checksum - OLD.checksum"
        database.executescript(f"""
        CREATE TEMP TRIGGER {table}_insert AFTER INSERT ON {table} BEGIN {tally % inserted}; {seal}; END;
        CREATE TEMP TRIGGER {table}_update AFTER UPDATE OF {", ".join(names)} ON {table} BEGIN {seal}; END;
        CREATE TEMP TRIGGER {table}_sealed AFTER UPDATE OF checksum ON {table} BEGIN {tally % changed}; END;
        CREATE TEMP TRIGGER {table}_delete AFTER DELETE ON {table} BEGIN {tally % deleted}; END;
        """)


def fault(database: sqlite3.Connection, table: str) -> str | None:
    """Return what is wrong with a table's rows, if anything; `files` has no tally."""
    types_of = {"TEXT": str, "INTEGER": int, "REAL": float, "BLOB": bytes}
    allowed_types = [
        {types_of[declared]} if not_null or key else {types_of[declared], type(None)}
        for _, _, declared, not_null, _, key in database.execute(f"PRAGMA table_info({table})")
    ]
    valid: set[tuple[type, ...]] = set()
    rows = total = 0
    key_columns = slice(0, KEY_COLUMNS.get(table, "").count(",") + 1)
    key: tuple[Any, ...] = ()
    for values in database.execute(f"SELECT * FROM {table} NOT INDEXED"):
        stored = values[-1]
        if checksum(values[:-1]) != stored:
            return f"a row of its table {table} is not what was written"
        if (types := tuple(map(type, values))) not in valid:
            if not all(kind in allowed for kind, allowed in zip(types, allowed_types, strict=True)):
                return f"a row of its table {table} has a value of the wrong type"
            valid.add(types)
        if table == "files" and not is_within_folder(values[0]):
            return f"its table files has the name {values[0][:40]!r}"
        if table != "run" and not key < (key := values[key_columns]):
            return f"the rows of its table {table} are not in order"
        if table == "candidates" and (len(values[1]) != values[2] + 1 or not KEY.fullmatch(values[1])):
            return f"its table candidates has the key {values[1][:40]!r} for {values[2]} modules"
        rows += 1
        total += stored
    tally = database.execute("SELECT rows, total FROM tallies WHERE name = ?", (table,)).fetchall()
    if table in KEY_COLUMNS and tally != [(rows, total & 0xFFFFFFFF)]:
        return f"its table {table} has {rows} rows, which are not those that were written"
    return None


def blank(identity: str) -> bytes:
    """Return the content of a new ledger file with the identity of its run."""
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as database:
        database.executescript(SCHEMA)
        seal_changes(database)
        database.execute("INSERT INTO run VALUES (?, 0, NULL, 0)", (identity,))
        content = database.serialize()
    # bytes 18 and 19: write-ahead mode (SQLite, Database File Format, sec. 1.3.3)
    return content[:18] + b"\x02\x02" + content[20:]


@contextmanager
def open_database(path: Path, *, read_only: bool) -> Iterator[sqlite3.Connection]:
    """Open a ledger's file; same arguments and errors as `Ledger.open`.

    Damage that is found later raises BadInput too.
    """
    _check_file(path)
    options = "?mode=rw"
    if read_only:  # without a write-ahead log the file can be read on its own, and SQLite creates no files
        has_log = path.with_name(f"{path.name}-wal").exists()
        options = "?mode=ro" if has_log else "?mode=ro&immutable=1"
    with (
        closing(sqlite3.connect(path.absolute().as_uri() + options, isolation_level=None, uri=True)) as database,
        _translated_damage(path),
    ):
        database.execute("PRAGMA trusted_schema = OFF")
        try:
            _check(database, path)
        except UnicodeDecodeError:  # in the name of a column
            raise damage(path, "its tables have names that are not text") from None
        if not read_only:
            _make_durable(database, path)
        yield database


def _make_durable(database: sqlite3.Connection, path: Path) -> None:
    """Make every transaction durable, and seal the rows that it changes."""
    try:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("BEGIN IMMEDIATE")
        database.execute("ROLLBACK")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_READONLY or not os.access(path, os.W_OK):
            raise
        raise damage(path, "its header says that it cannot be written to") from None
    database.execute("PRAGMA synchronous = FULL")
    seal_changes(database)


def _check_file(path: Path) -> None:
    """Refuse unsuitable files before SQLite opens them: it would follow links and play back journals."""
    for file in (path, *(path.with_name(f"{path.name}{suffix}") for suffix in ("-wal", "-shm"))):
        try:
            status = file.lstat()
        except FileNotFoundError:
            continue
        if not stat.S_ISREG(status.st_mode):
            raise refusal(file, "is a symbolic link" if stat.S_ISLNK(status.st_mode) else "is not a regular file")
        if file != path and status.st_nlink > 1:
            raise refusal(file, "has a second name (hard link), and would be written through")
    journal = path.with_name(f"{path.name}-journal")
    if os.path.lexists(journal):
        raise refusal(journal, "is not from this program, which writes no such file")
    if not path.exists():
        raise refusal(path, "is gone")
    if not path.stat().st_size:  # only `stat`: opening and closing the file would drop SQLite's locks
        raise refusal(path, "is damaged (it is empty)")


@contextmanager
def _translated_damage(path: Path) -> Iterator[None]:
    """Turn SQLite's errors for a damaged file into BadInput; other errors, such as a full disk, pass."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        # invalid text raises an OperationalError of Python's module, which has no code of SQLite
        is_text_error = isinstance(error, sqlite3.OperationalError) and not hasattr(error, "sqlite_errorcode")
        if type(error) is not sqlite3.DatabaseError and not is_text_error:
            raise
        raise BadInput(str(path), f"is damaged or not a ledger ({error}); {ADVICE}") from None


def checked_text(path: Path, key: str, text: bytes | None, checksum: int) -> str:
    """Return the text of a candidate's result or audit.

    Raises:
        BadInput: it has changed since it was written, or is missing.
    """
    if text is None or zlib.crc32(text) != checksum:
        raise BadInput(str(path), f"is damaged (its entry {key} has changed since it was written); {ADVICE}")
    return text.decode()


def parse(path: Path, model: type[Model], table: str, text: str, *, strict: bool = True) -> Model:
    """Return the value of a JSON text from a table.

    Raises:
        BadInput: the text is invalid.
    """
    try:
        return model.model_validate_json(text, strict=strict)
    except ValidationError as error:
        raise damage(path, f"its table {table}: {faults_of(error, model)[0]}") from None


def _check(database: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is not a ledger, or was changed, before anything is written to it."""
    application: int = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    if application != APPLICATION_ID:
        raise refusal(path, "is an SQLite file of another program")
    if version != VERSION:
        raise refusal(path, f"has version {version}, but this program reads version {VERSION}")
    database.execute("BEGIN")  # one consistent snapshot, even while a run writes
    _check_schema(database, path)
    # all but `texts`, which have checksums; SQLite before 3.33 checks all tables
    for table in ("sqlite_schema", *KEY_COLUMNS, "tallies", "files"):
        if (report := database.execute(f"PRAGMA integrity_check({table})").fetchone()[0]) != "ok":
            raise damage(path, report)
    for table in (*KEY_COLUMNS, "files"):  # `files`: a changed name would disown a file of the run
        if reason := fault(database, table):
            raise damage(path, reason)
    database.execute("COMMIT")


def _check_schema(database: sqlite3.Connection, path: Path) -> None:
    """Refuse a ledger whose tables are not exactly those of this program."""
    schema = "SELECT type, name, tbl_name, sql FROM sqlite_schema"
    with closing(sqlite3.connect(":memory:")) as pattern:
        pattern.executescript(SCHEMA)
        if differences := set(database.execute(schema)) ^ set(pattern.execute(schema)):
            kind, name, *_ = max(differences, key=str)  # a table before its index
            raise damage(path, f"its {kind} {str(name)[:100]} is not as this program creates it")


def damage(path: Path, what: str) -> BadInput:
    """Return the error for a damaged file, which is left unchanged."""
    return refusal(path, f"is damaged ({what})")


def refusal(path: Path, what: str) -> BadInput:
    """Return the error for a file that is not used, and left unchanged."""
    return BadInput(str(path), f"{what}; it is left unchanged: {ADVICE}")
