"""How soon each sampler of `run --strategy optuna` finds good trees.

    python tests/benchmarks/strategies.py replay runs/push-8 --seeds 20 [--rounds 8 64 256]
    python tests/benchmarks/strategies.py solve push --modules 12 --solves 200 --seeds 3 [--set FIELD=VALUE ...]

`replay` looks up what the samplers propose in the table of an exhaustive run (`candidates.csv`), each tree from all
its starts and without designs carried over from other trees, and counts the trees until one within 0.1 % of the
best is found, with the CPU time of the proposals; it gives up after `--solves`, if that is given. `solve` says what
the samplers lead to with so many solves, from few starts first and with designs carried over, as the search does
it. A candidate that is proven impossible takes no solve.
`--rounds`: how many proposals may be unsolved at a time.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple, Protocol

import nlp
from topo_search.engine import Candidates, Proposal, Tried, merge, record_of, scaled_violation
from topo_search.engine.proposals import OptunaSearch
from topo_search.model import Design, Infeasible, ResolvedTask, Task
from topo_search.model.files import read_task
from topo_search.study import DEFAULT_ROUND

SAMPLERS = ("random", "moves", "nsga2", "tpe")
WITHIN = 1e-3
"""A tree within this relative distance of the best counts as found."""


class Reached(NamedTuple):
    """What a candidate reached."""

    status: str
    objective: float
    """J [rad^4/s^4]; infinite without a design."""
    violation: float
    """In the task's own units."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=["replay", "solve"])
    parser.add_argument("example", help="of `replay` a run's folder")
    parser.add_argument("--modules", type=int, default=12)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--solves", type=int, help="most of them; of `replay` as many as there are, else 200")
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS)
    parser.add_argument("--rounds", type=int, nargs="+", default=[DEFAULT_ROUND])
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    ways = [Way(sampler, size) for sampler in arguments.samplers for size in arguments.rounds]
    if arguments.part == "replay":
        replay(Path(arguments.example), ways, arguments.seeds, arguments.solves or math.inf)
    else:
        task = read_task(arguments.example, (f"modules={arguments.modules}", *arguments.settings))
        solve(task, arguments.modules, ways, arguments.seeds, arguments.solves or 200)


class Way(NamedTuple):
    """How candidates are proposed."""

    sampler: str
    round_size: int

    def __str__(self) -> str:
        return self.sampler if self.round_size == DEFAULT_ROUND else f"{self.sampler}, {self.round_size} at a time"


def reached_by(outcome: Design | Infeasible, task: ResolvedTask) -> Reached:
    """Return what an outcome is worth."""
    if isinstance(outcome, Design):
        return Reached("feasible", outcome.objective, 0.0)
    return Reached(outcome.status, math.inf, scaled_violation(outcome.violation, outcome.unit, task))


class Table(NamedTuple):
    """What every candidate of a task reaches."""

    task: ResolvedTask
    reached: dict[str, Reached]

    @property
    def best(self) -> float:
        """The least J of all [rad^4/s^4]."""
        return min(reached.objective for reached in self.reached.values())


def read_table(run: Path) -> Table:
    """Return what the candidates of an exhaustive run of one size reached."""
    stated = read_task(str(run / "task.toml"))
    task = stated.resolve(max(stated.sizes))
    reached: dict[str, Reached] = {}
    with (run / "candidates.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            missed = scaled_violation(float(row["violation"] or math.inf), row["unit"], task)
            reached[row["key"]] = Reached(row["status"], float(row["objective"] or math.inf), missed)
    return Table(task, reached)


class Source(Protocol):
    """Where a proposal's score comes from."""

    tried: dict[str, int]
    """Solves of each candidate so far."""
    least: float
    """The least J so far [rad^4/s^4]."""

    def __call__(self, proposal: Proposal) -> Tried:
        """Return what became of a candidate."""


class LookedUp:
    """Scores from a table, without designs carried over; all starts of a tree count as one solve."""

    def __init__(self, table: Table) -> None:
        self.tried, self.least, self._reached = dict[str, int](), math.inf, table.reached

    def __call__(self, proposal: Proposal) -> Tried:
        """Return what a candidate reaches."""
        key = proposal.candidate.key
        reached = self._reached[key]
        self.tried[key] = int(reached.status != "impossible")
        self.least = min(self.least, reached.objective)
        return score(key, proposal.starts, reached)


class Solved:
    """Scores from solves, with designs carried over from other trees."""

    def __init__(self, task: ResolvedTask, seed: int) -> None:
        self.task, self.seed, self.tried, self.least = task, seed, dict[str, int](), math.inf
        self._outcomes: dict[str, Design | Infeasible] = {}
        self._starts: dict[str, int] = {}

    def __call__(self, proposal: Proposal) -> Tried:
        """Solve a candidate from the starts that it lacks."""
        key = proposal.candidate.key
        first = self._starts.get(key, 0)
        sources = [self._outcomes[key] for key in proposal.warm_starts]
        near = [source for source in sources if isinstance(source, Design)]
        starts = range(first + len(near), proposal.starts)
        outcome = nlp.solve(self.task, proposal.candidate.topology, starts=starts, seed=self.seed, near=near)
        record = record_of(outcome)
        self._starts[key] = proposal.starts
        self.tried[key] = self.tried.get(key, 0) + (0 if record is None else record.starts)
        known = self._outcomes.get(key)
        self._outcomes[key] = outcome if known is None else merge(known, outcome, self.task)
        reached = reached_by(self._outcomes[key], self.task)
        self.least = min(self.least, reached.objective)
        return score(key, proposal.starts, reached)


def replay(path: Path, ways: Sequence[Way], seeds: int, most: float) -> None:
    """Print how many trees are solved until one within 0.1 % of the best of a table is found."""
    table = read_table(path)
    space, enough = Candidates(table.task, "task"), table.best * (1 + WITHIN)

    def ends(source: Source) -> bool:
        return source.least <= enough or sum(source.tried.values()) >= most

    good = sum(reached.objective <= enough for reached in table.reached.values())
    solved = sum(reached.status != "impossible" for reached in table.reached.values())
    print(
        f"{table.task.name}, n = {table.task.n}: {len(table.reached):,} candidates, {good} within 0.1 % of the best"
    )
    print(f"{solved:,} are solved by an exhaustive search, the others are proven impossible; {seeds} seeds")
    print("| sampler | trees solved: median | in 4 of 5 seeds at most | seeds that miss it | a proposal, CPU ms |")
    print("|---|---|---|---|---|")
    for way in ways:
        solves, proposals, began = [], 0, time.process_time()
        for seed in range(seeds):
            scores = LookedUp(table)
            explore(space, way, 1, seed, scores, ends)
            solves.append(float(sum(scores.tried.values())) if scores.least <= enough else math.inf)
            proposals += len(scores.tried)
            print(f"{way}, seed {seed}: {solves[-1]:.0f} trees", file=sys.stderr, flush=True)
        each = 1e3 * (time.process_time() - began) / proposals
        solves.sort()
        line = f"{median(solves):.0f} | {solves[math.ceil(0.8 * seeds) - 1]:.0f} | {solves.count(math.inf)}"
        print(f"| {way} | {line} | {each:.1f} |", flush=True)


def solve(task: Task, n: int, ways: Sequence[Way], seeds: int, budget: int) -> None:
    """Print the best that the samplers find with equal numbers of solves."""
    resolved, starts = task.resolve(n), nlp.default_starts(task)
    bound = nlp.lower_bound(resolved)
    print(f"{task.name}, n = {n}, best J / bound after {budget} solves")
    print(f"| sampler | {' | '.join(f'seed {seed}' for seed in range(seeds))} |")
    print(f"|---|{'---|' * seeds}")
    for way in ways:
        found = (best_of(resolved, way, starts, seed, budget) / bound for seed in range(seeds))
        print(f"| {way} | {' | '.join(f'{value:.4f}' for value in found)} |", flush=True)


def best_of(task: ResolvedTask, way: Way, starts: int, seed: int, budget: int) -> float:
    """Return the best J that a sampler finds with so many solves."""
    least = math.inf

    def ends(source: Source) -> bool:
        nonlocal least
        solves = sum(source.tried.values())
        least = source.least if solves <= budget else least
        return solves >= budget

    explore(Candidates(task, "task"), way, starts, seed, Solved(task, seed), ends)
    return least


def score(key: str, starts: int, reached: Reached) -> Tried:
    """Return what a strategy is told."""
    if reached.status == "feasible":
        return Tried(key, starts, reached.status, reached.objective, None)
    return Tried(key, starts, reached.status, None, reached.violation)


def explore(
    space: Candidates, way: Way, starts: int, seed: int, source: Source, ends: Callable[[Source], bool]
) -> None:
    """Follow a sampler's proposals, and look after each whether it was enough."""
    trials = space.count() - 1  # where all are proposed all get all starts in the end, whatever the sampler
    search = OptunaSearch(
        space, sampler=way.sampler, trials=trials, round_size=way.round_size, starts=starts, seed=seed
    )
    results = deque[Tried]()
    for proposal in search.propose(lambda _: results.popleft()):
        if proposal is not None:
            results.append(source(proposal))
            if ends(source):
                return


if __name__ == "__main__":
    main()
