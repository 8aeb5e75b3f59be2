"""A cell: one topology under one condition. A plan is the list of all cells of an experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from topo_search.experiments.settings import Settings
from topo_search.limits import CELLS
from topo_search.model import BadInput, Fault, ResolvedTask
from topo_search.model.files import read_task
from topo_search.topologies import candidates, count, sample

AIRFLOW_ALONE = "search.body_clearance=false"
"""The paper's clearances: nothing but airflow keeps modules apart."""

IDENTITY = ("variant", "task", "distance_m", "n", "key", "task_seed")
"""The columns of `results.csv` that tell a cell's row from all others."""


@dataclass(frozen=True)
class Variant:
    """One of the problems that an experiment compares."""

    name: str
    overrides: tuple[str, ...] = ()
    """`FIELD=VALUE` settings of the task."""


@dataclass(frozen=True)
class Cell:
    """What one row of the results is about; small, and the same in every process."""

    variant: Variant
    task: str
    """A shipped example."""
    distance_m: float
    """Connector distance [m]."""
    n: int
    key: str
    """The topology."""
    task_seed: int | None
    """Draws the ten wrenches; None for a task whose wrenches are given."""
    starts: int
    seed: int
    time_limit: float
    """CPU seconds after which no further round is begun."""
    first: bool
    """Whether the first design ends it; else the best of all starts counts."""

    @property
    def identity(self) -> dict[str, Any]:
        """What tells its row from all others of an experiment."""
        shared = {name: getattr(self, name) for name in IDENTITY[1:]}
        return {"variant": self.variant.name, **shared}

    @property
    def rounds(self) -> list[range]:
        """The starts, in the portions in which they are solved; those of a portion share what is built."""
        return [range(s, s + 1) for s in range(self.starts)] if self.first else [range(self.starts)]

    def resolve(self, n: int | None = None) -> ResolvedTask:
        """Return the task, for another number of modules if asked; BadInput if its variant does not fit it."""
        settings = [f"modules={n or self.n}", f"module.connector_distance={self.distance_m}"]
        if self.task_seed is not None:
            settings.append(f"task_seed={self.task_seed}")
        return read_task(self.task, (*settings, *self.variant.overrides)).resolve(n or self.n)


def plan(settings: Settings, variants: tuple[Variant, ...], *, first: bool) -> list[Cell]:
    """Return the cells of all combinations, by ascending size.

    As in the paper every topology comes with wrenches of its own (Sec. IV, "for each trial"); it keeps them under
    all conditions, so that these can be compared tree by tree.

    Raises:
        BadInput: there would be more than CELLS.
    """
    cells = []
    require_few(cell_count(settings, lambda _: len(variants)))
    for n in sorted({n for _, sizes in settings.tasks for n in sizes}):
        keys = trees(n, settings.trees(n), settings.seed)
        for number, key in enumerate(keys):
            for name in (name for name, sizes in settings.tasks if n in sizes):
                task = read_task(name)
                task_seed = None if task.task_seed is None else settings.seed + number
                for distance in settings.distances or (task.module.connector_distance,):
                    cells += [
                        Cell(
                            variant=variant,
                            task=name,
                            distance_m=distance,
                            n=n,
                            key=key,
                            task_seed=task_seed,
                            starts=settings.starts,
                            seed=settings.seed,
                            time_limit=settings.time_limit,
                            first=first,
                        )
                        for variant in variants
                    ]
    return cells


def cell_count(settings: Settings, of_a_tree: Callable[[int], int]) -> int:
    """Return the number of cells if each tree of n modules has so many in a task and at a distance."""
    return max(1, len(settings.distances)) * sum(
        min(count(n), settings.trees(n)) * of_a_tree(n) for _, sizes in settings.tasks for n in set(sizes)
    )


def require_few(number: int) -> None:
    """Refuse a plan of more cells than there may be, with BadInput."""
    if number > CELLS:
        rule = f"must have at most {CELLS:,} rows: task, size, tree, distance and variant, but has {number:,}"
        raise BadInput("experiment", [Fault("", rule)])


def trees(n: int, most: int, seed: int) -> list[str]:
    """Return the keys of all topologies of n modules, or of as many different ones, drawn uniformly."""
    if count(n) <= most:
        return [candidate.key for candidate in candidates(n)]
    drawn, draws = dict[str, None](), most
    while len(drawn) < most:
        drawn = dict.fromkeys(topology.key for topology in sample(n, draws, seed))
        draws *= 2
    return list(drawn)[:most]
