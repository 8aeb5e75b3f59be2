"""Watching processes and ledgers from beside, for tests that kill them."""

import csv
import sqlite3
import time
from pathlib import Path

from topo_search.study import COLUMNS


def gone(pid):
    """Whether a process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):  # it may end while the file is open
        return True


def eventually(condition, seconds=120.0):
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition did not come true"
        time.sleep(0.02)


def recorded(folder):
    """The keys that a run's ledger holds."""
    path = folder / "ledger.sqlite"
    if not path.exists():
        return []
    database = sqlite3.connect(path)
    try:
        return [key for (key,) in database.execute("SELECT key FROM candidates")]
    except sqlite3.OperationalError:  # begun, but still without its tables
        return []
    finally:
        database.close()


def table(folder):
    """The rows of a run's table by their keys, in its order."""
    with (folder / "candidates.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len({row["key"] for row in rows}) == len(rows)
    return {row["key"]: row for row in rows}


def ranking(folder):
    """The rows of a run's table, but how long they took."""
    return [[row[name] for name in COLUMNS if name != "seconds"] for row in table(folder).values()]
