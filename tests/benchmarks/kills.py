"""Runs that are killed at random times, and runs on disks that fill up: each is resumed to the undisturbed answer.

    PYTHONPATH=tests python tests/benchmarks/kills.py [--kills N] [--disks N] [--seed S]

A full disk is a small tmpfs, so `--disks` needs the right to mount. Prints the number of runs by how they ended;
fails if an answer differs, a recorded solve is repeated or lost, or a message is not one line that says what to do.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

from processes import ranking

RUN = (sys.executable, "-m", "topo_search", "run", "push", "--set", "modules=3", "--starts", "4", "--out")


def solves(folder: Path) -> list[tuple[str, int, float]]:
    """Return key, number of starts and time of each recorded solve, in order."""
    if not (folder / "ledger.sqlite").exists():
        return []
    with closing(sqlite3.connect(folder / "ledger.sqlite")) as database:
        return database.execute("SELECT key, asked, at FROM solves ORDER BY number").fetchall()


def finish(folder: Path, recorded: list[tuple[str, int, float]], expected: list[list[str]]) -> None:
    """Resume a run to its end, and compare it with the undisturbed one."""
    ended = subprocess.run([*RUN, str(folder)], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    compare(folder, recorded, expected)


def compare(folder: Path, recorded: list[tuple[str, int, float]], expected: list[list[str]]) -> None:
    """Make sure that a finished run lost and repeated nothing that was recorded."""
    found = solves(folder)
    assert found[: len(recorded)] == recorded
    assert len({(key, asked) for key, asked, _ in found}) == len(found)
    assert ranking(folder) == expected
    assert (folder / "report.html").exists()


def kill(
    folder: Path, count: int, seconds: float, generator: random.Random, expected: list[list[str]]
) -> Counter[str]:
    """Kill runs at random times until `count` are killed; a run that ends before is compared, and begun anew."""
    ends, recorded = Counter[str](), list[tuple[str, int, float]]()
    while ends["killed"] < count:
        with subprocess.Popen([*RUN, str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as run:
            try:
                run.wait(generator.uniform(0.2, 1.1) * seconds)
            except subprocess.TimeoutExpired:
                run.kill()
                ends["killed"] += 1
        if run.returncode == 0:
            compare(folder, recorded, expected)
            ends["complete"] += 1
            shutil.rmtree(folder)
        else:
            assert run.returncode == -9, run.returncode
            found = solves(folder)
            assert found[: len(recorded)] == recorded
            ends["killed with results"] += bool(found)
        recorded = solves(folder)
    finish(folder, recorded, expected)
    ends["complete"] += 1
    return ends


def fill(folder: Path, count: int, size: int, generator: random.Random, expected: list[list[str]]) -> Counter[str]:
    """Run on disks of random sizes up to `size` kB; then make room, and resume."""
    ends = Counter[str]()
    folder.mkdir()
    for _ in range(count):
        room = round(size ** generator.uniform(0.25, 1.0))
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={room}k", "tmpfs", str(folder)], check=True)
        try:
            ended = subprocess.run([*RUN, str(folder / "run")], capture_output=True, text=True)
            assert ended.returncode in (0, 2, 74), (room, ended.stderr)
            message = ended.stderr.strip().rpartition("\n")[2]
            assert ended.returncode == 0 or "Traceback" not in ended.stderr, (room, ended.stderr)
            assert ended.returncode == 0 or "run the same command to continue" in message or "--out" in message, (
                message
            )
            subprocess.run(["mount", "-o", "remount,size=64m", str(folder)], check=True)
            recorded = solves(folder / "run")  # SQLite needs room even to read
            ends[f"status {ended.returncode}{', with results' * bool(recorded)}"] += 1
            finish(folder / "run", recorded, expected)
        finally:
            subprocess.run(["umount", str(folder)], check=True)
    return ends


def main() -> None:
    """Run undisturbed, then disturb."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--disks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    generator = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as temporary:
        whole = Path(temporary) / "whole"
        began = time.monotonic()
        subprocess.run([*RUN, str(whole)], check=True, capture_output=True)
        seconds, expected = time.monotonic() - began, ranking(whole)
        size = sum(path.stat().st_size for path in whole.rglob("*") if path.is_file()) // 1000
        print(f"undisturbed: {seconds:.1f} s, {size} kB", flush=True)
        print(
            "kills:",
            dict(kill(Path(temporary) / "killed", arguments.kills, seconds, generator, expected)),
            flush=True,
        )
        print(
            "disks:", dict(fill(Path(temporary) / "disk", arguments.disks, size, generator, expected)), flush=True
        )


if __name__ == "__main__":
    main()
