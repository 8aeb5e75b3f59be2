"""What a run was asked, and what fixes the value of each of its rows."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import metadata
from typing import Any, Literal, get_args

from topo_search.engine import Space
from topo_search.limits import STARTS, TRIALS
from topo_search.model import ResolvedTask, Task
from topo_search.model.goals import Level
from topo_search.model.value import Value
from topo_search.topologies import Resolution, Symmetry, resolve_symmetry

LIBRARIES = ("topo-search", "casadi", "numpy", "python-fcl", "scipy")
"""Distributions whose versions can change a result."""

StrategyName = Literal["exhaustive", "optuna"]
Sampler = Literal["moves", "tpe", "nsga2", "random"]

LARGER_MARGINS = 3
"""How often a design that fails its audit is solved again, each time with ten times the margin."""


def installed() -> dict[str, str]:
    """Return the versions of these libraries that are installed now."""
    return {name: metadata.version(name) for name in LIBRARIES}


def digest(value: Any) -> str:
    """Return a short name of a JSON value that differs whenever the value does."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Context:
    """All that fixes a row but its topology: rows of one context can be compared."""

    task: ResolvedTask
    step: int
    """How often the margin was raised tenfold because an audit was not clear."""
    seed: int
    versions: dict[str, str]
    """Of the libraries."""
    level: Level | None = None
    """Of the goals, if the run has any: what was solved there had other designs to start from."""

    @cached_property
    def fixed_by(self) -> dict[str, Any]:
        """The content that the name is a digest of."""
        fixed_by = {"task": self.task.model_dump(mode="json"), "seed": self.seed, "versions": self.versions}
        return fixed_by if self.level is None else {**fixed_by, "level": self.level._asdict()}

    @cached_property
    def name(self) -> str:
        """Part of the key of its rows, beside the topology's key."""
        return digest(self.fixed_by)

    @property
    def margin(self) -> float:
        """The margin asked of the solver [m]."""
        return self.task.search.margin


class Identity(Value):
    """What one folder can hold one of. More starts and more trials extend a run, so they are left out."""

    task: str
    """A digest."""
    seed: int
    symmetry: Symmetry
    strategy: StrategyName
    prune: bool | None = None
    """Of an exhaustive search."""
    sampler: Sampler | None = None
    """Of any other."""


@dataclass(frozen=True)
class Request:
    """What a run is asked to find; with what force (workers, time) is not part of it."""

    task: Task
    symmetry: Symmetry
    """Which trees are one candidate."""
    starts: int
    """Number of starts of each candidate, at most."""
    seed: int
    strategy: StrategyName = "exhaustive"
    """How candidates are chosen."""
    sampler: Sampler = "moves"
    """What proposes candidates when not all are solved."""
    trials: int | None = None
    """Number of candidates to propose; None: all."""
    prune: bool = False
    """Whether candidates are skipped that the bound proves to be no better than the best."""
    versions: dict[str, str] = field(default_factory=installed)
    """Of the libraries that solve; rows that others solved do not count."""
    level: Level | None = None
    """The level of the goals that `task` holds, if this is one of those of a run with goals."""
    neighbour: Request | None = None
    """The level before, whose designs are carried over."""

    def __post_init__(self) -> None:
        """Refuse what cannot be asked; ValueError names it."""
        for name, number, most in (("starts", self.starts, STARTS), ("trials", self.trials, TRIALS)):
            if number is not None and not 1 <= number <= most:
                raise ValueError(f"`1 <= {name} <= {most:,}` must hold, but got {number:,}")
        for name, value, known in (
            ("strategy", self.strategy, get_args(StrategyName)),
            ("sampler", self.sampler, get_args(Sampler)),
        ):
            if value not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, but got {value!r}")

    @cached_property
    def identity(self) -> Identity:
        """What its folder is known by."""
        tasks = [self.task.resolve(n).model_dump(mode="json") for n in self.task.sizes]
        if self.task.goals.names:
            tasks.append(self.task.goals.model_dump(mode="json"))
        exhaustive = self.strategy == "exhaustive"
        return Identity(
            task=digest(tasks),
            seed=self.seed,
            symmetry=self.symmetry,
            strategy=self.strategy,
            prune=self.prune if exhaustive else None,
            sampler=None if exhaustive else self.sampler,
        )

    @property
    def folder_name(self) -> str:
        """The name of the default folder, NAME-HASH."""
        identity = self.identity.model_dump(exclude_none=True)
        return f"{self.task.name}-{digest({**identity, 'starts': self.starts})[:8]}"

    @cached_property
    def levels(self) -> tuple[Request, ...]:
        """A request for each level of the task's goals, in the order of `Goals.levels`; without goals, this one."""
        goals, requests = self.task.goals, list[Request]()
        if not goals.names:
            return (self,)
        for number, level in enumerate(goals.levels):
            before = goals.neighbour(number)
            neighbour = None if before is None else requests[before]
            requests.append(replace(self, task=self.task.at(level), level=level, neighbour=neighbour))
        return tuple(requests)

    def space(self, n: int) -> Space:
        """Return the candidates of n modules."""
        return Space(self.task.resolve(n), self.symmetry)

    def quotient(self, n: int) -> Resolution:
        """Return which trees stand for one candidate, whether that is exact, and why."""
        return resolve_symmetry(self.task.resolve(n), self.symmetry)

    def contexts(self, n: int) -> list[Context]:
        """Return the contexts of n modules: the task's own margin, then each larger one."""
        task, contexts = self.task.resolve(n), []
        for step in range(LARGER_MARGINS + 1):
            contexts.append(Context(task, step, self.seed, self.versions, self.level))
            search = task.search.model_copy(update={"margin": larger_margin(task.search.margin)})
            task = task.model_copy(update={"search": search})
        return contexts


def larger_margin(margin: float) -> float:
    """Return the margin to try after one that an audit did not pass [m]."""
    return 10.0 * margin or 1.0e-4
