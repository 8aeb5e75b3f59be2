"""What a run was asked, and what fixes the value of each of its rows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from importlib import metadata
from typing import Any, TypedDict

from topo_search.model import ResolvedTask, Task
from topo_search.topologies import (
    Candidate,
    Connectors,
    Resolution,
    Root,
    Symmetry,
    candidates,
    count,
    resolve_symmetry,
)

LIBRARIES = ("topo-search", "casadi", "numpy", "python-fcl")
"""Distributions whose versions can change a result."""

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

    @cached_property
    def fixed_by(self) -> dict[str, Any]:
        """The content that the name is a digest of."""
        return {"task": self.task.model_dump(mode="json"), "seed": self.seed, "versions": self.versions}

    @cached_property
    def name(self) -> str:
        """Part of the key of its rows, beside the topology's key."""
        return digest(self.fixed_by)

    @property
    def margin(self) -> float:
        """The margin asked of the solver [m]."""
        return self.task.search.margin


class _Family(TypedDict):
    """Which trees are candidates, and which of them are one."""

    symmetry: Symmetry
    connectors: Connectors
    root: Root
    task: ResolvedTask


@dataclass(frozen=True)
class Request:
    """What a run is asked to find; with what force (workers, time) is not part of it."""

    task: Task
    symmetry: Symmetry
    """Which trees are one candidate."""
    starts: int
    seed: int
    versions: dict[str, str] = field(default_factory=installed)
    """Of the libraries that solve; rows that others solved do not count."""

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What one folder can hold one of. More starts extend a run, so they are left out."""
        tasks = [self.task.resolve(n).model_dump(mode="json") for n in self.task.sizes]
        return {"task": digest(tasks), "seed": self.seed, "symmetry": self.symmetry}

    @property
    def folder_name(self) -> str:
        """The name of the default folder, NAME-HASH."""
        return f"{self.task.name}-{digest({**self.identity, 'starts': self.starts})[:8]}"

    def candidates(self, n: int) -> Iterator[Candidate]:
        """Yield every candidate of n modules."""
        return candidates(n, **self._family(n))

    def count(self, n: int) -> int:
        """Return the number of candidates of n modules."""
        return count(n, **self._family(n))

    def quotient(self, n: int) -> Resolution:
        """Return which trees stand for one candidate, whether that is exact, and why."""
        return resolve_symmetry(self.task.resolve(n), self.symmetry)

    def _family(self, n: int) -> _Family:
        search = self.task.search
        return {
            "symmetry": self.symmetry,
            "connectors": search.connectors,
            "root": search.root,
            "task": self.task.resolve(n),
        }

    def contexts(self, n: int) -> list[Context]:
        """Return the contexts of n modules: the task's own margin, then each larger one."""
        task, contexts = self.task.resolve(n), []
        for step in range(LARGER_MARGINS + 1):
            contexts.append(Context(task, step, self.seed, self.versions))
            search = task.search.model_copy(update={"margin": larger_margin(task.search.margin)})
            task = task.model_copy(update={"search": search})
        return contexts


def larger_margin(margin: float) -> float:
    """Return the margin to try after one that an audit did not pass [m]."""
    return 10.0 * margin or 1.0e-4
