"""Number of solves until each sampler of `run --strategy optuna` finds good trees.

    python tests/benchmarks/strategies.py replay runs/push-8 --seeds 20 [--rounds 8 64 256]
    python tests/benchmarks/strategies.py solve push --modules 12 --solves 200 --seeds 3 [--set FIELD=VALUE ...]

`replay` looks up proposals in the table of an exhaustive run (`candidates.csv`), each tree with all its starts and
without designs carried over from other trees. It counts the trees until one within 0.1 % of the best is found, and
the CPU time of the proposals; it gives up after `--solves`, if given. `solve` prints the best efforts after a
number of solves, from few starts first and with designs carried over, as in a search. A candidate that is proven
impossible takes no solve. `--rounds`: numbers of proposals that may be pending at a time.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple, Protocol

import nlp
from topo_search.engine import Candidates, Proposal, Tried
from topo_search.engine.proposals import OptunaSearch
from topo_search.engine.workers import merge, record_of, scaled_violation
from topo_search.model import Design, Infeasible, ResolvedTask, Task
from topo_search.model.task_file import read_task
from topo_search.study import DEFAULT_ROUND

SAMPLERS = ("random", "moves", "nsga2", "tpe")
WITHIN = 1e-3
"""A tree within this relative distance of the best counts as found."""


class Score(NamedTuple):
    """Result of a candidate."""

    status: str
    objective: float
    """J [rad^4/s^4]; infinite without a design."""
    violation: float
    """Largest violation, scaled by the task."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=["replay", "solve"])
    parser.add_argument("example", help="example; for `replay` the folder of a run")
    parser.add_argument("--modules", type=int, default=12)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--solves", type=int, help="largest number; default: 200, for `replay` unlimited")
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS)
    parser.add_argument("--rounds", type=int, nargs="+", default=[DEFAULT_ROUND])
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    methods = [Method(sampler, size) for sampler in arguments.samplers for size in arguments.rounds]
    if arguments.part == "replay":
        replay(Path(arguments.example), methods, arguments.seeds, arguments.solves or math.inf)
    else:
        task = read_task(arguments.example, (f"modules={arguments.modules}", *arguments.settings))
        solve(task, arguments.modules, methods, arguments.seeds, arguments.solves or 200)


class Method(NamedTuple):
    """A sampler and its number of pending proposals."""

    sampler: str
    round_size: int

    def __str__(self) -> str:
        return self.sampler if self.round_size == DEFAULT_ROUND else f"{self.sampler}, {self.round_size} at a time"


def score_of(outcome: Design | Infeasible, task: ResolvedTask) -> Score:
    """Return the score of an outcome."""
    if isinstance(outcome, Design):
        return Score("feasible", outcome.objective, 0.0)
    return Score(outcome.status, math.inf, scaled_violation(outcome.violation, outcome.unit, task))


class Table(NamedTuple):
    """Scores of all candidates of a task."""

    task: ResolvedTask
    scores: dict[str, Score]

    @property
    def best(self) -> float:
        """Least J of all candidates [rad^4/s^4]."""
        return min(score.objective for score in self.scores.values())


def read_table(run: Path) -> Table:
    """Return the scores of all candidates of an exhaustive run of one size."""
    run_task = read_task(str(run / "task.toml"))
    task = run_task.resolve(max(run_task.sizes))
    scores: dict[str, Score] = {}
    with (run / "candidates.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            violation = scaled_violation(float(row["violation"] or math.inf), row["unit"], task)
            scores[row["key"]] = Score(row["status"], float(row["objective"] or math.inf), violation)
    return Table(task, scores)


class Source(Protocol):
    """A source of scores."""

    tried: dict[str, int]
    """Solves of each candidate so far."""
    least: float
    """Least J so far [rad^4/s^4]."""

    def __call__(self, proposal: Proposal) -> Tried:
        """Return the result of a candidate."""


class TableSource:
    """Scores from a table, without designs carried over; all starts of a tree count as one solve."""

    def __init__(self, table: Table) -> None:
        self.tried, self.least, self._scores = dict[str, int](), math.inf, table.scores

    def __call__(self, proposal: Proposal) -> Tried:
        """Look up a candidate."""
        key = proposal.candidate.key
        score = self._scores[key]
        self.tried[key] = int(score.status != "impossible")
        self.least = min(self.least, score.objective)
        return tried(key, proposal.starts, score)


class SolverSource:
    """Scores from solves, with designs carried over from other trees."""

    def __init__(self, task: ResolvedTask, seed: int) -> None:
        self.task, self.seed, self.tried, self.least = task, seed, dict[str, int](), math.inf
        self._outcomes: dict[str, Design | Infeasible] = {}
        self._starts: dict[str, int] = {}

    def __call__(self, proposal: Proposal) -> Tried:
        """Solve a candidate from its missing starts."""
        key = proposal.candidate.key
        first = self._starts.get(key, 0)
        sources = [self._outcomes[key] for key in proposal.warm_starts]
        near = [source for source in sources if isinstance(source, Design)]
        starts = range(first + len(near), proposal.starts)
        outcome = nlp.solve(self.task, proposal.candidate.topology, starts=starts, seed=self.seed, near=near)
        record = record_of(outcome)
        self._starts[key] = proposal.starts
        self.tried[key] = self.tried.get(key, 0) + (0 if record is None else record.starts)
        previous = self._outcomes.get(key)
        self._outcomes[key] = outcome if previous is None else merge(previous, outcome, self.task)
        score = score_of(self._outcomes[key], self.task)
        self.least = min(self.least, score.objective)
        return tried(key, proposal.starts, score)


def replay(path: Path, methods: Sequence[Method], seeds: int, max_solves: float) -> None:
    """Print the number of trees solved until one within 0.1 % of the best of a table is found."""
    table = read_table(path)
    space, target = Candidates(table.task, "task"), table.best * (1 + WITHIN)

    def is_done(source: Source) -> bool:
        return source.least <= target or sum(source.tried.values()) >= max_solves

    good = sum(score.objective <= target for score in table.scores.values())
    solved = sum(score.status != "impossible" for score in table.scores.values())
    print(
        f"{table.task.name}, n = {table.task.n}: {len(table.scores):,} candidates, {good} within 0.1 % of the best"
    )
    print(f"{solved:,} are solved by an exhaustive search, the others are proven impossible; {seeds} seeds")
    print("| sampler | trees solved: median | in 4 of 5 seeds at most | seeds that miss it | a proposal, CPU ms |")
    print("|---|---|---|---|---|")
    for method in methods:
        solves, proposals, started = [], 0, time.process_time()
        for seed in range(seeds):
            source = TableSource(table)
            explore(space, method, 1, seed, source, is_done)
            solves.append(float(sum(source.tried.values())) if source.least <= target else math.inf)
            proposals += len(source.tried)
            print(f"{method}, seed {seed}: {solves[-1]:.0f} trees", file=sys.stderr, flush=True)
        milliseconds = 1e3 * (time.process_time() - started) / proposals
        solves.sort()
        line = f"{median(solves):.0f} | {solves[math.ceil(0.8 * seeds) - 1]:.0f} | {solves.count(math.inf)}"
        print(f"| {method} | {line} | {milliseconds:.1f} |", flush=True)


def solve(task: Task, n: int, methods: Sequence[Method], seeds: int, budget: int) -> None:
    """Print the best efforts that the samplers find with equal numbers of solves."""
    resolved, starts = task.resolve(n), nlp.default_starts(task)
    bound = nlp.lower_bound(resolved)
    print(f"{task.name}, n = {n}, best J / bound after {budget} solves")
    print(f"| sampler | {' | '.join(f'seed {seed}' for seed in range(seeds))} |")
    print(f"|---|{'---|' * seeds}")
    for method in methods:
        ratios = (best_of(resolved, method, starts, seed, budget) / bound for seed in range(seeds))
        print(f"| {method} | {' | '.join(f'{value:.4f}' for value in ratios)} |", flush=True)


def best_of(task: ResolvedTask, method: Method, starts: int, seed: int, budget: int) -> float:
    """Return the best J that a sampler finds within a number of solves."""
    least = math.inf

    def is_done(source: Source) -> bool:
        nonlocal least
        solves = sum(source.tried.values())
        least = source.least if solves <= budget else least
        return solves >= budget

    explore(Candidates(task, "task"), method, starts, seed, SolverSource(task, seed), is_done)
    return least


def tried(key: str, starts: int, score: Score) -> Tried:
    """Return the result as a strategy receives it."""
    if score.status == "feasible":
        return Tried(key, starts, score.status, score.objective, None)
    return Tried(key, starts, score.status, None, score.violation)


def explore(
    space: Candidates, method: Method, starts: int, seed: int, source: Source, is_done: Callable[[Source], bool]
) -> None:
    """Score a sampler's proposals until `is_done`."""
    trials = space.count() - 1  # if all are proposed, all get all starts in the end, whatever the sampler
    search = OptunaSearch(
        space, sampler=method.sampler, trials=trials, round_size=method.round_size, starts=starts, seed=seed
    )
    while isinstance(proposal := search.ask(), Proposal):
        search.tell(source(proposal))
        if is_done(source):
            return


if __name__ == "__main__":
    main()
