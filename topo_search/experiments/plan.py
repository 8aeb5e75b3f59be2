"""Plan of an experiment: its settings, and its cells, each one topology under one condition."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Self

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, ResolvedTask
from topo_search.model.files import examples, read_task
from topo_search.model.value import nearest, show
from topo_search.topologies import Family, candidates, count
from topo_search.topologies.rooted import Rooted, key_of, reroot, rooted_of, text_of, turn

AIRFLOW_ALONE = "search.body_clearance=false"
"""The paper's clearances: only airflow keeps modules apart."""
IDENTITY = ("variant", "task", "distance_m", "n", "key", "task_seed")
"""Columns of `results.csv` that identify a cell."""


@dataclass(frozen=True)
class Settings:
    """Conditions and random seed of an experiment."""

    few_above: ClassVar = 40
    """Number of modules above which the second number of `topologies` applies."""

    tasks: tuple[tuple[str, tuple[int, ...]], ...]
    """Shipped examples, each with its numbers of modules."""
    topologies: tuple[int, int]
    """Trees per size, up to `few_above` modules and above; all trees if there are fewer."""
    starts: int
    """Largest number of starts per topology."""
    distances: tuple[float, ...] = ()
    """Connector distances [m]; empty: the distance of each task."""
    seed: int = 0
    """Seed of topologies, wrenches and starts."""
    time_limit: float = 600.0
    """CPU time per cell after which no further start begins, if the first design ends a cell [s]."""

    def __post_init__(self) -> None:
        names = examples()
        faults = [
            Fault("--task", f"must name a shipped example, but got {name[:80]}; {nearest(name[:80], names)}")
            for name, _ in self.tasks
            if name not in names
        ]
        numbers: dict[str, tuple[Sequence[float], float]] = {
            "sizes": ([n for _, sizes in self.tasks for n in sizes], LIMITS.modules),
            "topologies": (self.topologies, LIMITS.trees),
            "starts": ([self.starts], LIMITS.starts),
            "distances": (self.distances, math.inf),
            "time-limit": ([self.time_limit], LIMITS.seconds),
        }
        for option, (values, largest) in numbers.items():
            for value in dict.fromkeys(values):
                positive = 0 < value < math.inf
                if not positive or value > largest:
                    rule = f"must be at most {largest:,}" if positive else "must be positive and finite"
                    text = f"{value:g}" if isinstance(value, float) else show(value)
                    faults.append(Fault(f"--{option}", f"{rule}, but got {text}"))
        largest_seed = LIMITS.largest_integer - LIMITS.trees  # tree k draws its wrenches with seed + k
        if not 0 <= self.seed <= largest_seed:
            faults.append(Fault("--seed", f"must be from 0 to {largest_seed:,}, but got {show(self.seed)}"))
        named = {"task": [name for name, _ in self.tasks], "distances": self.distances}
        faults += [
            Fault(f"--{option}", f"must have no value twice, but got {value} {values.count(value)} times")
            for option, values in named.items()
            for value in dict.fromkeys(values)
            if values.count(value) > 1
        ]
        if faults:
            raise BadInput("experiment", faults)

    def trees(self, n: int) -> int:
        """Return the largest number of trees of n modules."""
        return self.topologies[n > self.few_above]

    def as_json(self) -> dict[str, Any]:
        """Return these settings as a JSON value."""
        value: dict[str, Any] = json.loads(json.dumps({**asdict(self), "tasks": dict(self.tasks)}))
        return value

    def as_options(self) -> str:
        """Return the command-line options for these settings."""
        options = [f"--task {name}:{_join(sizes)}" for name, sizes in self.tasks]
        options += [f"--topologies {_join(self.topologies)}", f"--starts {self.starts}"]
        if self.distances:
            options.append(f"--distances {_join(self.distances)}")
        return " ".join([*options, f"--seed {self.seed}", f"--time-limit {_join((self.time_limit,))}"])

    @classmethod
    def task_of(cls, text: str) -> tuple[str, tuple[int, ...]]:
        """Parse TASK:SIZES, such as `ten-wrenches:10,20`."""
        match = re.fullmatch(r"([^:]+):(\d{1,9}(?:,\d{1,9})*)", text)
        if match is None:
            raise BadInput("experiment", [Fault("--task", f"must be TASK:N,N,..., but got {text[:80]}")])
        return match[1], tuple(int(n) for n in match[2].split(","))

    def override(self, **values: Any) -> Self:
        """Return a copy with the given values, except those that are None."""
        return replace(self, **{name: value for name, value in values.items() if value is not None})


def _join(values: tuple[float, ...]) -> str:
    return ",".join(str(value).removesuffix(".0") for value in values)  # all digits, unlike `:g`


@dataclass(frozen=True)
class Variant:
    """One of the problem variants that an experiment compares."""

    name: str
    overrides: tuple[str, ...] = ()
    """`FIELD=VALUE` changes to the task."""
    every_root: bool = False
    """True if a tree is tried with each of its modules as the root."""


@dataclass(frozen=True)
class Cell:
    """One topology under one condition: a row of the results. Small, to be sent to workers."""

    variant: Variant
    task: str
    """Name of a shipped example."""
    distance_m: float
    """Connector distance [m]."""
    n: int
    key: str
    """Key of the topology."""
    task_seed: int | None
    """Seed of the ten wrenches; None for a task with fixed wrenches."""
    settings: Settings
    first: bool
    """True if the first design ends the cell; otherwise the best of all starts counts."""

    @property
    def identity(self) -> dict[str, Any]:
        """Columns that identify the cell's row in an experiment."""
        return {name: getattr(self, name) for name in IDENTITY} | {"variant": self.variant.name}

    @property
    def rounds(self) -> list[range]:
        """Batches of starts; those of a batch share compiled programs."""
        starts = self.settings.starts
        return [range(s, s + 1) for s in range(starts)] if self.first else [range(starts)]

    def resolve(self) -> ResolvedTask:
        """Return the cell's task; BadInput if the variant does not fit it."""
        settings = [f"modules={self.n}", f"module.connector_distance={self.distance_m}"]
        if self.task_seed is not None:
            settings.append(f"task_seed={self.task_seed}")
        return read_task(self.task, (*settings, *self.variant.overrides)).resolve(self.n)


def plan(settings: Settings, variants: tuple[Variant, ...], *, first: bool) -> list[Cell]:
    """Return the cells of all combinations, by ascending size.

    As in the paper every topology has its own random wrenches (Sec. IV, "for each trial"). They are the same under
    all conditions, so that conditions can be compared tree by tree.

    Raises:
        BadInput: there would be more than LIMITS.cells cells.
    """
    task_sizes = [n for _, sizes in settings.tasks for n in set(sizes)]
    fewest = sum(  # half and quarter turns make some roots equivalent
        min(count(n), settings.trees(n)) * sum(n // 4 if variant.every_root else 1 for variant in variants)
        for n in task_sizes
    )
    require_few(fewest * max(1, len(settings.distances)))
    tasks = {name: read_task(name) for name, _ in settings.tasks}
    seeded = {name for name, task in tasks.items() if task.task_seed is not None}
    cells = [
        Cell(variant, name, distance, n, key, settings.seed + number if name in seeded else None, settings, first)
        for n in sorted(set(task_sizes))
        for number, tree in enumerate(trees(n, settings.trees(n), settings.seed))
        for name, sizes in settings.tasks
        if n in sizes
        for distance in settings.distances or (tasks[name].module.connector_distance,)
        for variant in variants
        for key in (roots(tree) if variant.every_root else [tree])
    ]
    require_few(len(cells))
    return cells


def roots(key: str) -> list[str]:
    """Return the keys of a tree with each of its modules as the root, unturned and after a half turn."""
    trees = rootings(rooted_of(key))
    return sorted({key_of(text_of(turn(tree, quarters))) for tree in trees for quarters in (0, 2)})


def rootings(tree: Rooted, entered: int | None = None) -> list[Rooted]:
    """Return an aligned tree with each of its modules as the root, except those beyond the port `entered`."""
    beyond = (port for port in range(4) if tree[port] and port != entered)
    return [tree, *(rerooted for port in beyond for rerooted in rootings(reroot(tree, port), (port + 2) % 4))]


def require_few(number: int) -> None:
    """Raise BadInput for a plan of more than LIMITS.cells cells."""
    if number > LIMITS.cells:
        rule = (
            f"must have at most {LIMITS.cells:,} rows: task, size, tree, distance and variant, but has {number:,}"
        )
        raise BadInput("experiment", rule)


def trees(n: int, number: int, seed: int) -> list[str]:
    """Return the keys of all topologies of n modules, or of `number` different ones, drawn uniformly."""
    if count(n) <= number:
        return [candidate.key for candidate in candidates(n)]
    keys, drawn = dict[str, None](), Family(n).draws(seed)
    while len(keys) < number:
        keys[next(drawn).key] = None
    return list(keys)
