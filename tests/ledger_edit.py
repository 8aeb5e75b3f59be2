"""Changing a ledger behind its back: as damage does, or as one who knows its checksums can."""

import sqlite3
from contextlib import closing

from topo_search.study import RunFolder
from topo_search.study.ledger_file import seal_changes


def damaged(folder, *statements):
    """Change a ledger in SQL, as no part of this program does."""
    with closing(sqlite3.connect(folder / "ledger.sqlite", isolation_level=None)) as database:
        for statement in statements:
            database.execute(*statement if isinstance(statement, tuple) else (statement,))


def forged(folder, *statements):
    """Change a ledger in SQL, with all checksums right again afterwards."""
    with closing(sqlite3.connect(folder / "ledger.sqlite", isolation_level=None)) as database:
        forge(database, *statements)


def forge(database, *statements):
    """Change an open ledger likewise."""
    seal_changes(database)
    with database:
        database.execute("BEGIN")
        for statement in statements:
            database.execute(*statement if isinstance(statement, tuple) else (statement,))


def rewritten(folder, name, content):
    """Change a file of a run, with its digest in the ledger right again afterwards."""
    with RunFolder.load(folder, writes=True) as run:
        run.write_file(name, content if isinstance(content, str) else content.decode())
