"""kill -9 of a real search and of its worker: nothing stays behind, and the resumed run ends as if nothing was."""

import csv
import os
import signal
import sqlite3
import subprocess
import sys
import time

COMMAND = [sys.executable, "-m", "topo_search", "run", "push", "--modules", "4", "--starts", "6", "--workers", "2"]
DESCRIBED = ("key", "status", "objective", "starts", "starts_feasible")


def children_of(pid):
    tasks = f"/proc/{pid}/task/{pid}/children"
    with open(tasks) as listing:
        return [int(child) for child in listing.read().split()]


def tree_of(pid):
    found = [pid]
    for process in found:
        found += children_of(process)
    return found


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as status:
            return status.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def eventually(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition did not come true"
        time.sleep(0.02)


def kept(folder):
    """The rows that the ledger acknowledges."""
    path = folder / "ledger.sqlite"
    if not path.exists():
        return 0
    database = sqlite3.connect(path)
    try:
        return database.execute("SELECT count(*) FROM candidates").fetchone()[0]
    except sqlite3.OperationalError:  # begun, but still without its tables
        return 0
    finally:
        database.close()


def table(folder):
    with open(folder / "candidates.csv", newline="") as stream:
        return [tuple(row[name] for name in DESCRIBED) for row in csv.DictReader(stream)]


def test_a_killed_search_resumes_to_the_same_answer(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert subprocess.run([*COMMAND, "--out", str(whole)], capture_output=True, check=False).returncode == 0

    process = subprocess.Popen(
        [*COMMAND, "--out", str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    eventually(lambda: kept(killed) >= 2 and len(tree_of(process.pid)) > 1)
    family = tree_of(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    eventually(lambda: not any(map(alive, family)))
    acknowledged = kept(killed)
    assert 2 <= acknowledged < len(table(whole))

    resumed = subprocess.Popen(
        [*COMMAND, "--out", str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    eventually(lambda: kept(killed) > acknowledged)
    workers = [pid for pid in tree_of(resumed.pid)[1:] if not children_of(pid)]
    os.kill(workers[-1], signal.SIGKILL)
    family = tree_of(resumed.pid)
    assert resumed.wait(timeout=300) == 0
    assert table(killed) == table(whole)
    eventually(lambda: not any(map(alive, family)))
