"""Checksums of the ledger's rows, and of each table as a whole: a row that changed, is gone or was added is found.

| symbol | meaning |
|---|---|
| row's checksum | CRC-32 of its other values as text; every flipped bit changes it |
| `tallies` | of each table: number of rows, and the sum of their checksums modulo 2^32 |

They tell damage, not malice: whoever writes a ledger on purpose writes its checksums too. What is read is checked
for its meaning besides, before it becomes the name of a file or an answer.
"""

from __future__ import annotations

import re
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

PLACES = {"run": "rowid", "contexts": "context", "candidates": "context, key", "solves": "number"}
"""The tables that an answer is made from, and what a row of each is found by."""

KEY = re.compile(r"[ap][0-9a-f]+")
"""What a topology's key looks like: it names files too."""
KINDS = {"TEXT": str, "INTEGER": int, "REAL": float, "BLOB": bytes}


def checksum(values: Sequence[Any]) -> int:
    """Return the checksum of a row's values."""
    return zlib.crc32(ascii(tuple(values)).encode("ascii"))


@contextmanager
def reseal(database: sqlite3.Connection, table: str, where: str, values: Sequence[Any]) -> Iterator[None]:
    """Seal the rows of a table that meet a condition again, after they were changed within the block.

    Args:
        database: the ledger, in a transaction.
        table: one of PLACES.
        where: the condition in SQL.
        values: its parameters.
    """
    old, before = _tally(database, table, where, values)
    yield
    names, place = _columns(database, table), PLACES[table]
    query = f"SELECT {place}, {', '.join(names)} FROM {table} WHERE {where}"
    at = " AND ".join(f"{name.strip()} = ?" for name in place.split(","))
    keys = place.count(",") + 1
    sealed = [(checksum(row[keys:]), *row[:keys]) for row in database.execute(query, values).fetchall()]
    database.executemany(f"UPDATE {table} SET checksum = ? WHERE {at}", sealed)
    new, after = _tally(database, table, where, values)
    database.execute(
        "UPDATE tallies SET rows = rows + ?, total = (total + ?) & 4294967295 WHERE name = ?",
        (new - old, after - before, table),
    )


def fault(database: sqlite3.Connection, table: str) -> str | None:
    """Return what is wrong with a table, if its rows are not those that were written."""
    kinds = _kinds(database, table)
    known: set[tuple[type, ...]] = set()
    rows = total = 0
    place = slice(0, PLACES[table].count(",") + 1)
    before: tuple[Any, ...] = ()
    for values in database.execute(f"SELECT * FROM {table} NOT INDEXED"):
        stored = values[-1]
        if checksum(values[:-1]) != stored:
            return f"a row of its table {table} is not what was written"
        if (types := tuple(map(type, values))) not in known:
            if not all(kind in allowed for kind, allowed in zip(types, kinds, strict=True)):
                return f"a row of its table {table} has a value of another kind"
            known.add(types)
        if table != "run" and not before < (before := values[place]):
            return f"the rows of its table {table} are not in order"
        if table == "candidates" and (len(values[1]) != values[2] + 1 or not KEY.fullmatch(values[1])):
            return f"its table candidates has the key {values[1][:40]!r} for {values[2]} modules"
        rows += 1
        total += stored
    held = database.execute("SELECT rows, total FROM tallies WHERE name = ?", (table,)).fetchall()
    if held != [(rows, total & 0xFFFFFFFF)]:
        return f"its table {table} has {rows} rows, which are not those that were written"
    return None


def seal_fault(database: sqlite3.Connection, table: str) -> str | None:
    """Return what is wrong with a table whose rows have checksums, but which has none as a whole."""
    for values in database.execute(f"SELECT * FROM {table} NOT INDEXED"):
        if checksum(values[:-1]) != values[-1]:
            return f"a row of its table {table} is not what was written"
    return None


def _tally(database: sqlite3.Connection, table: str, where: str, values: Sequence[Any]) -> tuple[int, int]:
    """Return number and sum of the checksums of some rows."""
    query = f"SELECT count(*), coalesce(sum(checksum), 0) FROM {table} WHERE {where}"
    rows, total = database.execute(query, values).fetchone()
    return rows, total


def _columns(database: sqlite3.Connection, table: str) -> list[str]:
    """Return the names of a table's columns but the last, which is the checksum."""
    return [column[1] for column in database.execute(f"PRAGMA table_info({table})")][:-1]


def _kinds(database: sqlite3.Connection, table: str) -> list[set[type]]:
    """Return which types the values of each column may have."""
    kinds: list[set[type]] = []
    for _, _, declared, not_null, _, key in database.execute(f"PRAGMA table_info({table})"):
        kinds.append({KINDS[declared]} if not_null or key else {KINDS[declared], type(None)})
    return kinds
