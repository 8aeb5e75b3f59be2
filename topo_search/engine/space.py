"""Search space of a strategy: the candidates of one size, listed, counted, looked up and drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import Any

from topo_search.model import ResolvedTask, Topology
from topo_search.topologies import (
    Candidate,
    Quotient,
    Symmetry,
    candidate_key,
    candidate_of,
    candidates,
    count,
    quotient_of,
    sample,
)
from topo_search.topologies.symmetry import Root
from topo_search.topologies.tree_moves import with_spins_reversed


@dataclass(frozen=True)
class Space:
    """All candidates for a task."""

    task: ResolvedTask
    """It fixes the number of modules, the connectors and the root."""
    symmetry: Symmetry
    """Symmetry under which trees are one candidate."""
    rooted: bool = False
    """True if trees that differ in their root alone are candidates of their own, though the root is free."""

    @property
    def n(self) -> int:
        """The number of modules."""
        return self.task.n

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return candidates(self.n, **self._family)

    def count(self) -> int:
        """Return the number of candidates, by closed form."""
        return count(self.n, **self._family)

    @property
    def classes(self) -> int:
        """The number of classes of the exact quotient, which the orbits of all candidates add up to."""
        exact: Symmetry = "none" if self.symmetry == "none" or self._root == "paper" else "c2"
        return count(self.n, symmetry=exact, connectors=self.task.search.connectors, root=self._root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that stands for a topology."""
        return candidate_of(topology, **self._family)

    def key_of(self, topology: Topology) -> str:
        """Return the key of the candidate that stands for a topology, sooner than the candidate."""
        return candidate_key(topology, quotient=self._quotient, connectors=self.task.search.connectors)

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate that differs in the sense of all rotors alone, which may be the topology's own.

        Rotor drag torques are small, and so is what its optimum differs by. With the paper's root it stands
        otherwise in the world, and there is only itself; nor is there without symmetry, where half turns are
        candidates of their own.
        """
        turned = self._root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly."""
        return sample(self.n, m, seed, **self._family)

    @property
    def _root(self) -> Root:
        """Kind of root that makes trees differ."""
        return "paper" if self.rooted else self.task.search.root

    @cached_property
    def _quotient(self) -> Quotient:
        """Quotient that makes trees one candidate; kept, as finding a task's symmetries takes as long as a key."""
        return quotient_of(self.n, **self._family)

    @property
    def _family(self) -> dict[str, Any]:
        """Arguments that define which trees are candidates, and which of them are one."""
        search = self.task.search
        return {
            "symmetry": self.symmetry,
            "connectors": search.connectors,
            "root": self._root,
            "task": self.task,
        }


@dataclass(frozen=True)
class Listed(Space):
    """Candidates that somebody listed: each is solved as it stands, and stands for itself."""

    keys: tuple[str, ...] = ()
    """In ascending order, all of trees of this size."""

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return (Candidate(key, 1) for key in self.keys)

    def count(self) -> int:
        """Return the number of candidates."""
        return len(self.keys)

    @property
    def classes(self) -> int:
        """The number of candidates: none stands for another one."""
        return len(self.keys)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that a topology is; ValueError if it was not listed."""
        if topology.key not in self.keys:
            raise ValueError(f"{topology.key} is not one of the {len(self.keys)} given topologies")
        return Candidate(topology.key, 1)

    def key_of(self, topology: Topology) -> str:
        """Return the key of a topology; ValueError as `candidate_of`."""
        return self.candidate_of(topology).key

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the topology's own candidate."""
        return self.candidate_of(topology)

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly."""
        return [Topology.from_key(key) for key in Random(seed).choices(self.keys, k=m)]
