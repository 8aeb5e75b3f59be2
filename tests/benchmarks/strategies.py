"""How soon each sampler of `run --strategy optuna` finds good trees.

    python tests/benchmarks/strategies.py table push --modules 7 --starts 8 --out push-7.csv
    python tests/benchmarks/strategies.py table runs/push-8 --out push-8.csv
    python tests/benchmarks/strategies.py replay push-7.csv --seeds 20
    python tests/benchmarks/strategies.py find push-7.csv --seeds 20 --samplers moves --solves 500
    python tests/benchmarks/strategies.py solve push --modules 12 --solves 200 --seeds 3 [--set FIELD=VALUE ...]

`table` solves every candidate from every start, or reads what they reached from the folder of an exhaustive run,
whose ledger does not keep by how much a start failed that others of its tree did better than. `replay` looks up
in it what the samplers propose, without designs carried over from other trees, and counts the solves until a tree
within 0.1 % of the best of the table is found; it gives up after `--solves`, if that is given. Every seed takes the
starts of each tree in an order of its own: few of them may lead to what a tree can reach. `find` counts them too,
and gives up after `--solves`, but solves what is proposed, with designs carried over as the search does it. `solve`
says what the samplers lead to with so many solves. A candidate that is proven impossible takes no solve.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from statistics import median
from typing import NamedTuple, Protocol

import nlp
from topo_search.engine import Proposal, Scored, Space, merge, record_of, scaled_violation
from topo_search.engine.proposals import optuna_study
from topo_search.model import Design, Infeasible, ResolvedTask
from topo_search.model.files import read_task
from topo_search.study import DEFAULT_ROUND, RunFolder

SAMPLERS = ("moves", "tpe", "nsga2", "random")
WITHIN = 1e-3
"""A tree within this relative distance of the best counts as found."""
COLUMNS = ("example", "modules", "key", "start", "status", "objective", "violation")
ALL_STARTS = 24
"""Most starts of a candidate that is solved."""


class Reached(NamedTuple):
    """What one start reached."""

    status: str
    objective: float
    """J [rad^4/s^4]; infinite without a design."""
    violation: float
    """In the task's own units."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=["table", "replay", "find", "solve"])
    parser.add_argument("example", help="of `replay` and `find`: the table; of `table` also a run's folder")
    parser.add_argument("--modules", type=int, default=7)
    parser.add_argument("--starts", type=int, default=8, help="starts of each candidate of a table")
    parser.add_argument("--out", type=Path, help="the table")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--solves", type=int, help="most of them; of `replay` as many as there are, else 200")
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS)
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    if arguments.part == "table" and Path(arguments.example).is_dir():
        extract_table(Path(arguments.example), arguments.out)
    elif arguments.part == "table":
        write_table(arguments.example, arguments.modules, arguments.starts, arguments.out)
    elif arguments.part == "replay":
        replay(Path(arguments.example), arguments.samplers, arguments.seeds, arguments.solves or math.inf)
    elif arguments.part == "find":
        find(Path(arguments.example), arguments.samplers, arguments.seeds, arguments.solves or 200)
    else:
        task = read_task(arguments.example, (f"modules={arguments.modules}", *arguments.settings))
        solve(task.resolve(arguments.modules), arguments.samplers, arguments.seeds, arguments.solves or 200)


def write_table(example: str, n: int, starts: int, out: Path) -> None:
    """Solve every candidate from every start."""
    task = read_task(example, (f"modules={n}",)).resolve(n)
    with out.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for candidate in Space(task, "task").candidates():
            for start in range(starts):
                outcome = nlp.solve(task, candidate.topology, starts=range(start, start + 1), seed=0)
                reached = reached_by(outcome, task)
                writer.writerow([example, n, candidate.key, start, *reached])


def extract_table(run: Path, out: Path) -> None:
    """Write what the starts of an exhaustive run reached."""
    with RunFolder.load(run) as folder, out.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        context, *_ = folder.request.contexts(folder.request.task.sizes[0])
        task = context.task
        for candidate in Space(task, "task").candidates():
            outcome = folder.ledger.result(context, candidate.key)
            record = record_of(outcome)
            closest = reached_by(outcome, task)
            feasible = [Reached("feasible", J, 0.0) for J in (() if record is None else record.objectives)]
            missed = 1 if record is None else record.starts - len(feasible)
            failed = Reached("infeasible", math.inf, math.inf) if feasible else closest
            for start, reached in enumerate([*feasible, *(missed * [failed])]):
                writer.writerow([task.name, task.n, candidate.key, start, *reached])


def reached_by(outcome: Design | Infeasible, task: ResolvedTask) -> Reached:
    """Return what an outcome is worth."""
    if isinstance(outcome, Design):
        return Reached("feasible", outcome.objective, 0.0)
    return Reached(outcome.status, math.inf, scaled_violation(outcome.violation, outcome.unit, task))


class Table(NamedTuple):
    """What every start of every candidate of a task reaches."""

    example: str
    n: int
    reached: dict[str, list[Reached]]

    @property
    def space(self) -> Space:
        """The candidates."""
        return Space(read_task(self.example, (f"modules={self.n}",)).resolve(self.n), "task")

    @property
    def best(self) -> float:
        """The least J of all [rad^4/s^4]."""
        return min(reached.objective for found in self.reached.values() for reached in found)

    @property
    def starts(self) -> int:
        """Starts of each candidate."""
        return max(map(len, self.reached.values()))


def read_table(path: Path) -> Table:
    """Return a table from its file."""
    reached: dict[str, list[Reached]] = {}
    with path.open(newline="") as stream:
        for row in csv.DictReader(stream):
            found = Reached(row["status"], float(row["objective"]), float(row["violation"]))
            reached.setdefault(row["key"], []).append(found)
    return Table(row["example"], int(row["modules"]), reached)


def twins_apart(table: Table) -> float:
    """Return by how much, in the median, the best J of two trees differ whose rotors turn in opposite senses."""
    space = table.space
    least = {key: min(reached.objective for reached in every) for key, every in table.reached.items()}
    pairs = {frozenset((one.key, space.twin_of(one.topology).key)) for one in space.candidates()}
    found = [[least[key] for key in pair] for pair in pairs if len(pair) == 2]
    return median([max(both) / min(both) - 1 for both in found if max(both) < math.inf] or [math.nan])


class Source(Protocol):
    """Where a proposal's score comes from."""

    tried: dict[str, int]
    """Solves of each candidate so far."""
    least: float
    """The least J so far [rad^4/s^4]."""

    def __call__(self, proposal: Proposal) -> Scored:
        """Return what became of a candidate."""


class LookedUp:
    """Scores from a table, without designs carried over; the starts of a tree are in an order of the seed's."""

    def __init__(self, table: Table, seed: int) -> None:
        random = Random(seed)
        self.tried, self.least = dict[str, int](), math.inf
        self._reached = {key: random.sample(found, len(found)) for key, found in table.reached.items()}

    def __call__(self, proposal: Proposal) -> Scored:
        """Return what the first starts of a candidate reach."""
        key = proposal.candidate.key
        found = self._reached[key][: proposal.starts]
        self.tried[key] = 0 if found[0].status == "impossible" else len(found)
        reached = min(found, key=lambda one: (one.objective, one.violation))
        self.least = min(self.least, reached.objective)
        return score(key, proposal.starts, reached)


class Solved:
    """Scores from solves, with designs carried over from other trees."""

    def __init__(self, task: ResolvedTask, seed: int) -> None:
        self.task, self.seed, self.tried, self.least = task, seed, dict[str, int](), math.inf
        self._outcomes: dict[str, Design | Infeasible] = {}
        self._starts: dict[str, int] = {}

    def __call__(self, proposal: Proposal) -> Scored:
        """Solve a candidate from the starts that it lacks."""
        key = proposal.candidate.key
        first = self._starts.get(key, 0)
        sources = [self._outcomes[key] for key in proposal.near]
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


def replay(path: Path, samplers: Sequence[str], seeds: int, most: float) -> None:
    """Print how many solves the samplers need on a table."""
    table = read_table(path)
    print_needed(table, table.starts, lambda seed: LookedUp(table, seed), samplers, seeds, most)


def find(path: Path, samplers: Sequence[str], seeds: int, most: int) -> None:
    """Print how many solves the samplers need until they have found what a table says is the best."""
    table = read_table(path)
    print_needed(table, ALL_STARTS, lambda seed: Solved(table.space.task, seed), samplers, seeds, most)


def print_needed(
    table: Table, starts: int, source: Callable[[int], Source], samplers: Sequence[str], seeds: int, most: float
) -> None:
    """Print how many solves the samplers need until a tree within 0.1 % of the best of a table is found."""
    space, best = table.space, table.best

    def found(source: Source) -> bool:
        return source.least <= best * (1 + WITHIN)

    def ends(source: Source) -> bool:
        return found(source) or sum(source.tried.values()) >= most

    good = sum(
        min(reached.objective for reached in every) <= best * (1 + WITHIN) for every in table.reached.values()
    )
    print(f"{table.example}, n = {table.n}: {len(table.reached)} candidates, {good} within 0.1 % of the best")
    print(f"median difference of two that differ in the sense of all rotors alone: {twins_apart(table):.2%}")
    print(
        "| sampler | solves: median | in 4 of 5 seeds at most | seeds that miss it | a third of random's median |"
    )
    print("|---|---|---|---|---|")
    third = math.nan
    for sampler in sorted(samplers, key=lambda sampler: sampler != "random"):
        solves = []
        for seed in range(seeds):
            scores = source(seed)
            explore(space, sampler, starts, seed, scores, ends)
            solves.append(float(sum(scores.tried.values())) if found(scores) else math.inf)
            print(f"{sampler}, seed {seed}: {solves[-1]:.0f} solves", file=sys.stderr, flush=True)
        solves.sort()
        third = median(solves) / 3 if sampler == "random" else third
        soon = (
            "" if math.isnan(third) else f"{sum(number <= third < math.inf for number in solves)} of {seeds} seeds"
        )
        line = f"{median(solves):.0f} | {solves[math.ceil(0.8 * seeds) - 1]:.0f} | {solves.count(math.inf)}"
        print(f"| {sampler} | {line} | {soon} |", flush=True)


def solve(task: ResolvedTask, samplers: Sequence[str], seeds: int, budget: int) -> None:
    """Print the best that the samplers find with equal numbers of solves."""
    bound = nlp.lower_bound(task)
    print(f"{task.name}, n = {task.n}, best J / bound after {budget} solves")
    print(f"| sampler | {' | '.join(f'seed {seed}' for seed in range(seeds))} |")
    print(f"|---|{'---|' * seeds}")
    for sampler in samplers:
        found = (best_of(task, sampler, seed, budget) / bound for seed in range(seeds))
        print(f"| {sampler} | {' | '.join(f'{value:.4f}' for value in found)} |", flush=True)


def best_of(task: ResolvedTask, sampler: str, seed: int, budget: int) -> float:
    """Return the best J that a sampler finds with so many solves."""
    least = math.inf

    def ends(source: Source) -> bool:
        nonlocal least
        solves = sum(source.tried.values())
        least = source.least if solves <= budget else least
        return solves >= budget

    explore(Space(task, "task"), sampler, ALL_STARTS, seed, Solved(task, seed), ends)
    return least


def score(key: str, starts: int, reached: Reached) -> Scored:
    """Return what a strategy is told."""
    if reached.status == "feasible":
        return Scored(key, starts, reached.status, reached.objective, None)
    return Scored(key, starts, reached.status, None, reached.violation)


def explore(
    space: Space, sampler: str, starts: int, seed: int, source: Source, ends: Callable[[Source], bool]
) -> None:
    """Follow a sampler's proposals, and look after each whether it was enough."""
    trials = space.count() - 1  # where all are proposed all get all starts in the end, whatever the sampler
    strategy = optuna_study(
        space, sampler=sampler, trials=trials, round_size=DEFAULT_ROUND, starts=starts, seed=seed
    )
    proposed = next(strategy)
    while True:
        scores = []
        for proposal in proposed:
            scores.append(source(proposal))
            if ends(source):
                return
        try:
            proposed = strategy.send(scores)
        except StopIteration:
            return


if __name__ == "__main__":
    main()
