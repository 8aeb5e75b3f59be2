"""Cost and result of both methods, start by start; runs in the process of a measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from clock import Clock
from direct import Direct, random_start
from stopwatch import Stopwatch

from nlp.evaluation import correct, violations, worst
from nlp.numbers.point import Point
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search.model import ResolvedTask, Topology
from topo_search.model.task_file import read_task
from topo_search.topologies import sample

Row = dict[str, Any]
Method = Literal["ours", "direct"]
METHODS: tuple[Method, ...] = ("ours", "direct")

COMPILED = 8
"""Number of modules at which the solver uses all of its compiled code."""


@dataclass(frozen=True)
class TaskChoice:
    """A task as given on the command line: small, to be sent to processes."""

    example: str
    n: int
    settings: tuple[str, ...] = ()

    def resolve(self) -> ResolvedTask:
        """Read the task."""
        return read_task(self.example, (f"modules={self.n}", *self.settings)).resolve(self.n)


def attempts(
    method: Method, kind: Method, choice: TaskChoice, keys: list[str], starts: Sequence[int]
) -> Iterator[Row]:
    """Yield an empty row, then one row per solve: the first start of every topology, then the second ones.

    Args:
        method: the method that solves.
        kind: the method that draws the starts.
        choice: the task.
        keys: the topologies. The program of each is built once, before its first solve.
        starts: indices of the starts of each topology.
    """
    if method == "ours":
        load(choice)
    task, watch = choice.resolve(), Stopwatch()
    topologies = [Topology.from_key(key) for key in keys]
    solvers: dict[str, Solver] = {}
    yield {}
    for index in starts:
        for topology in topologies:
            key, clock = topology.key, Clock()
            watch.reset()
            if key not in solvers:
                solvers[key] = _solver(method, task, topology)
            build = clock.lap()
            start = _start(kind, task, topology, index)
            drawn = clock.lap()
            point, iterations = solvers[key](start)
            point = correct(point)
            reason = worst(violations(point))
            solved = clock.lap()
            row: Row = {"key": key, "start": index, "build": build, "draw": drawn, "solve": solved}
            row |= {"evaluation": watch.evaluation, "ipopt": watch.ipopt, "iterations": iterations}
            if reason.met:
                yield {**row, "J": effort(point)}
            else:
                yield {**row, "J": None, "missed": reason.name, "by": reason.amount, "unit": reason.unit}


def load(choice: TaskChoice) -> None:
    """Solve a smaller platform once, to compile or load code before anything is measured."""
    smaller = TaskChoice(choice.example, min(COMPILED, choice.n - 1), choice.settings)
    task, topology = smaller.resolve(), sample(smaller.n, 1, 0)[0]
    AssembledProgram(task, topology).solve(_start("ours", task, topology, 0))


def cost(row: Row) -> float:
    """Return the CPU seconds of an attempt: build, start and solve."""
    return float(row["build"] + row["draw"] + row["solve"])


def effort(point: Point) -> float:
    """Return J."""
    weights = np.array([case.weight for case in point.task.load_cases])
    return float(weights @ np.einsum("kiq,kiq->k", point.u, point.u))


Solver = Callable[[Point], tuple[Point, int]]


def _solver(method: Method, task: ResolvedTask, topology: Topology) -> Solver:
    if method == "direct":
        return Direct(task, topology).solve
    program = AssembledProgram(task, topology)

    def solve(start: Point) -> tuple[Point, int]:
        result = program.solve(start)
        return result.point, result.iterations

    return solve


def _start(kind: Method, task: ResolvedTask, topology: Topology, index: int) -> Point:
    rng = generator(task, topology, index, 0)
    return draw(task, topology, rng) if kind == "ours" else random_start(task, topology, rng)
