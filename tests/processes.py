"""Runs in processes of their own, watched with their ledgers from beside, for tests that kill them."""

import csv
import os
import sqlite3
import subprocess
import sys
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


HERE = Path(__file__).parent


def processes_with(mark):
    """Running processes that were started with a text in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                ended = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
                if not ended and mark.encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except (FileNotFoundError, ProcessLookupError, PermissionError):
                continue
    return found


class Coordinator:
    """A run in a process of its own."""

    def __init__(self, tmp_path, *options, **environment):
        self.options = options or ("--modules", "4")
        self.folder, self.log = tmp_path / "run", tmp_path / "log"
        self.log.touch()
        self.environment = {**os.environ, "TOY_LOG": str(self.log), "PYTHONFAULTHANDLER": "0", **environment}
        paths = [str(HERE), os.environ.get("PYTHONPATH", "")]
        self.environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
        self.process = None

    def start(self):
        command = [sys.executable, str(HERE / "toy_problem.py"), str(self.folder), *self.options]
        self.process = subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        return self.process

    def wait_for(self, rows):
        """Wait for a number of recorded rows, with a time limit for each: other work may slow them."""
        for count in range(len(recorded(self.folder)) + 1, rows + 1):
            eventually(lambda at=count: len(recorded(self.folder)) >= at or self.process.poll() is not None)
        assert self.process.poll() is None, self.process.communicate()

    def finish(self):
        out, err = self.process.communicate(timeout=1800)
        return self.process.returncode, out, err
