"""How far off the time left is that a run shows: recorded runs are replayed, and the median factor is printed.

    python tests/benchmarks/time_left.py replay                     # the runs in tests/benchmarks/recorded_runs
    python tests/benchmarks/time_left.py record push --modules "[3, 5]"  # adds one, of this machine

A record holds what an observer is told, with the time of each event. Every event after the first tenth of a run is
asked for its estimate; a factor is the larger of estimate and truth over the smaller.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from topo_search.study import Phase, Plan, Row, Silent, TimeLeft
from topo_search.study.progress import WRITING

RECORDED = Path(__file__).parent / "recorded_runs"
FIRST = 0.1
"""Share of a run after which estimates count."""
MOMENTS = 100
"""Evenly spaced moments of a run at which it is asked."""


class Recorder(Silent):
    """Keeps what a run tells, with the time since it began [s]."""

    def __init__(self) -> None:
        self.began = time.monotonic()
        self.events: list[list[Any]] = []

    def _keep(self, kind: str, value: Any) -> None:
        self.events.append([round(time.monotonic() - self.began, 3), kind, value])

    def plan(self, plan: Plan) -> None:
        limit = None if math.isinf(plan.time_limit) else plan.time_limit
        self._keep("plan", {"phases": [asdict(p) for p in plan.phases], "workers": plan.workers, "limit": limit})

    def phase(self, phase: Phase) -> None:
        self._keep("phase", asdict(phase))

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        self._keep("settled", known)


def record(words: list[str], name: str) -> Path:
    """Search a task, and keep what it told."""
    from topo_search.cli import options
    from topo_search.compose import search

    parser = argparse.ArgumentParser()
    parser.add_argument("task")
    parser.add_argument("--modules")
    parser.add_argument("--starts", type=int)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--strategy", default="exhaustive")
    parser.add_argument("--trials", type=int)
    parser.add_argument("--time-limit", type=float, default=math.inf)
    parser.add_argument("--set", action="append", default=[])
    given = parser.parse_args(words)
    task = options.task_of(given.task, tuple(given.set), paper=False, modules=given.modules)
    recorder = Recorder()
    with tempfile.TemporaryDirectory() as folder:
        asked = {"starts": given.starts, "workers": given.workers, "strategy": given.strategy}
        search(task, out=folder, observer=recorder, time_limit=given.time_limit, trials=given.trials, **asked)
    end = round(time.monotonic() - recorder.began, 3)
    RECORDED.mkdir(exist_ok=True)
    path = RECORDED / f"{name}.json"
    path.write_text(json.dumps({"command": words, "end": end, "events": recorder.events}) + "\n")
    return path


def phase_of(kept: dict[str, Any]) -> Phase:
    """Return a recorded phase; writing as it is expected now, since that depends on no task."""
    return WRITING if kept["name"] == WRITING.name else Phase(**kept)


def estimates(events: list[list[Any]], end: float) -> Iterator[tuple[float, float]]:
    """Yield what was shown at evenly spaced moments after the first tenth of a run: time, and time left [s]."""
    left, due = TimeLeft(), list(events)
    for number in range(math.ceil(FIRST * MOMENTS), MOMENTS):
        now = number / MOMENTS * end
        while due and due[0][0] <= now:
            at, kind, value = due.pop(0)
            if kind == "plan":
                phases = tuple(phase_of(phase) for phase in value["phases"])
                left.plan(Plan(phases, value["workers"], value["limit"] or math.inf), at)
            elif kind == "phase":
                left.begin(phase_of(value), at)
            else:
                left.step(at, known=value)
        yield now, left(now)


def replayed(path: Path) -> list[float]:
    """Return the factors of a record."""
    kept = json.loads(path.read_text())
    remaining = [(left, kept["end"] - at) for at, left in estimates(kept["events"], kept["end"])]
    return [max(left, true) / max(min(left, true), 1e-9) for left, true in remaining]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verb", choices=["replay", "record"])
    parser.add_argument("--name", default="mine", help="of the record")
    given, words = parser.parse_known_args()
    if given.verb == "record":
        print(record(words, given.name))
        return
    every = list[float]()
    for path in sorted(RECORDED.glob("*.json")):
        factors, kept = replayed(path), json.loads(path.read_text())
        every += factors
        end, told = kept["end"], " ".join(kept["command"])
        print(f"{path.stem:20} {end:7.1f} s  median factor {statistics.median(factors):5.2f}  {told}")
    print(f"{'all':20} {'':9}  median factor {statistics.median(every):5.2f}")


if __name__ == "__main__":
    main()
