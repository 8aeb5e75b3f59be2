"""How soon each sampler of `run --strategy optuna` finds good trees.

    python tests/benchmarks/strategies.py table push --modules 7 --starts 8 --out push-7.csv
    python tests/benchmarks/strategies.py replay push-7.csv --seeds 20
    python tests/benchmarks/strategies.py solve push --modules 12 --solves 200 --seeds 3 [--set FIELD=VALUE ...]

`table` solves every candidate from every start. `replay` looks up in it what the samplers propose, without designs
carried over from parents, and counts the solves until a tree within 0.1 % of the best of the table is found.
`solve` solves what is proposed, with designs carried over as the search does it, until there were so many solves.
A candidate that is proven impossible takes no solve.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import mean, median
from typing import NamedTuple

import nlp
from topo_search.engine import Proposal, Scored, Space, Strategy, merge, record_of, scaled_violation
from topo_search.engine.proposals import optuna_study
from topo_search.model import Design, Infeasible, ResolvedTask
from topo_search.model.files import read_task

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
    parser.add_argument("part", choices=["table", "replay", "solve"])
    parser.add_argument("example", help="of `replay`: the table")
    parser.add_argument("--modules", type=int, default=7)
    parser.add_argument("--starts", type=int, default=8, help="starts of each candidate of a table")
    parser.add_argument("--out", type=Path, help="the table")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--solves", type=int, default=200)
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS)
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings")
    arguments = parser.parse_args()
    if arguments.part == "table":
        write_table(arguments.example, arguments.modules, arguments.starts, arguments.out)
    elif arguments.part == "replay":
        replay(Path(arguments.example), arguments.samplers, arguments.seeds)
    else:
        task = read_task(arguments.example, (f"modules={arguments.modules}", *arguments.settings))
        solve(task.resolve(arguments.modules), arguments.samplers, arguments.seeds, arguments.solves)


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


def reached_by(outcome: Design | Infeasible, task: ResolvedTask) -> Reached:
    """Return what an outcome is worth."""
    if isinstance(outcome, Design):
        return Reached("feasible", outcome.objective, 0.0)
    return Reached(outcome.status, math.inf, scaled_violation(outcome.violation, outcome.unit, task))


def replay(path: Path, samplers: Sequence[str], seeds: int) -> None:
    """Print how many solves the samplers need on a table."""
    table: dict[str, list[Reached]] = {}
    with path.open(newline="") as stream:
        for row in csv.DictReader(stream):
            reached = Reached(row["status"], float(row["objective"]), float(row["violation"]))
            table.setdefault(row["key"], []).append(reached)
    n = int(row["modules"])
    space = Space(read_task(row["example"], (f"modules={n}",)).resolve(n), "task")
    starts = max(map(len, table.values()))
    best = min(reached.objective for found in table.values() for reached in found)
    good = sum(min(reached.objective for reached in found) <= best * (1 + WITHIN) for found in table.values())
    print(f"{row['example']}, n = {n}: {len(table)} candidates, {good} within 0.1 % of the best, {starts} starts")
    print("| sampler | solves: mean | median | most | candidates: mean | no more than a third of random's mean |")
    print("|---|---|---|---|---|---|")
    needed = {
        sampler: [until_found(space, table, best, sampler, seed) for seed in range(seeds)] for sampler in samplers
    }
    third = mean(solves for solves, _ in needed["random"]) / 3 if "random" in needed else math.nan
    for sampler, found in needed.items():
        solves, candidates = zip(*found, strict=True)
        soon = sum(number <= third for number in solves)
        line = f"{mean(solves):.0f} | {median(solves):.0f} | {max(solves)} | {mean(candidates):.0f}"
        print(f"| {sampler} | {line} | {soon} of {seeds} seeds |")


def until_found(
    space: Space, table: dict[str, list[Reached]], best: float, sampler: str, seed: int
) -> tuple[int, int]:
    """Return how many solves and candidates a sampler needs until one is within 0.1 % of the best."""
    starts = max(map(len, table.values()))
    tried: dict[str, int] = {}
    least = math.inf

    def scored(proposal: Proposal) -> Scored:
        nonlocal least
        key = proposal.candidate.key
        found = table[key][: proposal.starts]
        tried[key] = 0 if found[0].status == "impossible" else len(found)
        reached = min(found, key=lambda one: (one.objective, one.violation))
        least = min(least, reached.objective)
        return score(key, proposal.starts, reached)

    strategy = optuna_study(space, sampler=sampler, trials=space.count(), starts=starts, seed=seed)
    follow(strategy, scored, lambda: least <= best * (1 + WITHIN))
    return sum(tried.values()), len(tried)


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
    space = Space(task, "task")
    outcomes: dict[str, Design | Infeasible] = {}
    tried: dict[str, int] = {}
    solves, least = 0, math.inf

    def scored(proposal: Proposal) -> Scored:
        nonlocal solves, least
        key = proposal.candidate.key
        starts = range(tried.get(key, 0), proposal.starts)
        donor = None if starts.start else outcomes.get(proposal.near or "")
        near = [donor] if isinstance(donor, Design) else []
        outcome = nlp.solve(task, proposal.candidate.topology, starts=starts, seed=seed, near=near)
        record = record_of(outcome)
        solves += 0 if record is None else record.starts
        tried[key] = proposal.starts
        outcomes[key] = merge(outcomes[key], outcome, task) if key in outcomes else outcome
        reached = reached_by(outcomes[key], task)
        if solves <= budget:
            least = min(least, reached.objective)
        return score(key, proposal.starts, reached)

    strategy = optuna_study(space, sampler=sampler, trials=space.count(), starts=ALL_STARTS, seed=seed)
    follow(strategy, scored, lambda: solves >= budget)
    return least


def score(key: str, starts: int, reached: Reached) -> Scored:
    """Return what a strategy is told."""
    if reached.status == "feasible":
        return Scored(key, starts, reached.status, reached.objective, None)
    return Scored(key, starts, reached.status, None, reached.violation)


def follow(strategy: Strategy, scored: Callable[[Proposal], Scored], ends: Callable[[], bool]) -> None:
    """Follow a strategy round by round until it ends or enough was found."""
    proposed = next(strategy)
    while not ends():
        scores = [scored(proposal) for proposal in proposed]
        try:
            proposed = strategy.send(scores)
        except StopIteration:
            return
    strategy.close()


if __name__ == "__main__":
    main()
