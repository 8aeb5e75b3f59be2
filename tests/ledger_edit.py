"""Changing a ledger or a file of a run behind its back."""

import sqlite3
from contextlib import closing

from topo_search.study import RunFolder


def altered(folder, *statements):
    """Change a ledger in SQL, as no part of this program does."""
    with closing(sqlite3.connect(folder / "ledger.sqlite")) as database, database:
        for statement in statements:
            database.execute(*statement if isinstance(statement, tuple) else (statement,))


def rewritten(folder, name, content):
    """Change a file of a run, with its digest in the ledger right again afterwards."""
    with RunFolder.load(folder, writes=True) as run:
        run.write_file(name, content if isinstance(content, str) else content.decode())
