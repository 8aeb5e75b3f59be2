"""Error of the time left that a run shows: replays recorded runs and prints the median error factor.

    python tests/benchmarks/time_left.py replay                     # the runs in tests/benchmarks/recorded_runs
    python tests/benchmarks/time_left.py record push --modules "[3, 5]"  # adds one

A record holds the events that an observer receives, with their times. Estimates are taken at even intervals after
the first tenth of a run; a factor is the larger of estimate and truth over the smaller.
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

from topo_search.study import Phase, Plan, Row, SilentObserver, TimeLeft
from topo_search.study.progress import WRITING

RECORDED = Path(__file__).parent / "recorded_runs"
FIRST = 0.1
"""Share of a run after which estimates count."""
MOMENTS = 100
"""Number of evenly spaced moments of a run at which estimates are taken."""


class Recorder(SilentObserver):
    """Records the events of a run, with the time since its start [s]."""

    def __init__(self) -> None:
        self.start_time = time.monotonic()
        self.events: list[list[Any]] = []

    def _record(self, kind: str, value: Any) -> None:
        self.events.append([round(time.monotonic() - self.start_time, 3), kind, value])

    def plan(self, plan: Plan) -> None:
        limit = None if math.isinf(plan.time_limit) else plan.time_limit
        self._record("plan", {"phases": [asdict(p) for p in plan.phases], "workers": plan.workers, "limit": limit})

    def phase(self, phase: Phase) -> None:
        self._record("phase", asdict(phase))

    def settled(self, incumbent: Row | None, *, known: bool = False) -> None:
        self._record("settled", known)


def record(command: list[str], name: str) -> Path:
    """Search a task and write the record."""
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
    arguments = parser.parse_args(command)
    task = options.task_of(arguments.task, tuple(arguments.set), paper=False, modules=arguments.modules)
    recorder = Recorder()
    with tempfile.TemporaryDirectory() as folder:
        limits = {"time_limit": arguments.time_limit, "trials": arguments.trials, "starts": arguments.starts}
        choice = {"workers": arguments.workers, "strategy": arguments.strategy}
        search(task, out=folder, observer=recorder, **limits, **choice)
    end = round(time.monotonic() - recorder.start_time, 3)
    RECORDED.mkdir(exist_ok=True)
    path = RECORDED / f"{name}.json"
    path.write_text(json.dumps({"command": command, "end": end, "events": recorder.events}) + "\n")
    return path


def phase_of(value: dict[str, Any]) -> Phase:
    """Return a recorded phase; the present one for writing, which does not depend on the task."""
    return WRITING if value["name"] == WRITING.name else Phase(**value)


def estimates(events: list[list[Any]], end: float) -> Iterator[tuple[float, float]]:
    """Yield time and estimated time left [s] at evenly spaced moments after the first tenth of a run."""
    time_left, pending = TimeLeft(), list(events)
    for number in range(math.ceil(FIRST * MOMENTS), MOMENTS):
        now = number / MOMENTS * end
        while pending and pending[0][0] <= now:
            moment, kind, value = pending.pop(0)
            if kind == "plan":
                phases = tuple(phase_of(phase) for phase in value["phases"])
                time_left.plan(Plan(phases, value["workers"], value["limit"] or math.inf), moment)
            elif kind == "phase":
                time_left.begin(phase_of(value), moment)
            else:
                time_left.step(moment, known=value)
        yield now, time_left(now)


def error_factors(path: Path) -> list[float]:
    """Return the error factors of a record."""
    run = json.loads(path.read_text())
    remaining = [(left, run["end"] - now) for now, left in estimates(run["events"], run["end"])]
    return [max(left, true) / max(min(left, true), 1e-9) for left, true in remaining]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verb", choices=["replay", "record"])
    parser.add_argument("--name", default="mine", help="name of the record")
    arguments, command = parser.parse_known_args()
    if arguments.verb == "record":
        print(record(command, arguments.name))
        return
    all_factors = list[float]()
    for path in sorted(RECORDED.glob("*.json")):
        factors, run = error_factors(path), json.loads(path.read_text())
        all_factors += factors
        end, command_line = run["end"], " ".join(run["command"])
        print(f"{path.stem:20} {end:7.1f} s  median factor {statistics.median(factors):5.2f}  {command_line}")
    print(f"{'all':20} {'':9}  median factor {statistics.median(all_factors):5.2f}")


if __name__ == "__main__":
    main()
