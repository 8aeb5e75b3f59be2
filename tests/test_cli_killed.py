"""kill -9 of a real search and of its worker: nothing stays behind, and the resumed run ends as if nothing was."""

import csv
import os
import signal
import subprocess
import sys

from processes import eventually, gone, recorded

COMMAND = [sys.executable, "-m", "topo_search", "run", "push", "--modules", "4", "--starts", "2"]
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


def table(folder):
    with open(folder / "candidates.csv", newline="") as stream:
        return [tuple(row[name] for name in DESCRIBED) for row in csv.DictReader(stream)]


def test_a_killed_search_resumes_to_the_same_answer(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    alone = subprocess.run([*COMMAND, "--workers", "1", "--out", str(whole)], capture_output=True)
    assert alone.returncode == 0

    process = subprocess.Popen(
        [*COMMAND, "--workers", "2", "--out", str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    eventually(lambda: len(recorded(killed)) >= 2 and len(tree_of(process.pid)) > 1)
    family = tree_of(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    eventually(lambda: all(map(gone, family)))
    acknowledged = len(recorded(killed))
    assert 2 <= acknowledged < len(table(whole))

    resumed = subprocess.Popen(
        [*COMMAND, "--workers", "2", "--out", str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    eventually(lambda: len(recorded(killed)) > acknowledged)
    workers = [pid for pid in tree_of(resumed.pid)[1:] if not children_of(pid)]
    os.kill(workers[-1], signal.SIGKILL)
    family = tree_of(resumed.pid)
    assert resumed.wait(timeout=300) == 0
    assert table(killed) == table(whole)
    eventually(lambda: all(map(gone, family)))
