"""What a strategy searches: the candidates of one size, listed, counted, looked up and drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypedDict

from topo_search.model import ResolvedTask, Topology
from topo_search.topologies import Candidate, Symmetry, candidate_of, candidates, count, sample
from topo_search.topologies.symmetry import Connectors, Root
from topo_search.topologies.tree_moves import with_spins_reversed


class _Family(TypedDict):
    """Which trees are candidates, and which of them are one."""

    symmetry: Symmetry
    connectors: Connectors
    root: Root
    task: ResolvedTask


@dataclass(frozen=True)
class Space:
    """All candidates for a task."""

    task: ResolvedTask
    """It fixes the number of modules, the connectors and the root."""
    symmetry: Symmetry
    """Which trees are one candidate."""

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
        search = self.task.search
        exact: Symmetry = "none" if self.symmetry == "none" or search.root == "paper" else "c2"
        return count(self.n, symmetry=exact, connectors=search.connectors, root=search.root)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate that stands for a topology."""
        return candidate_of(topology, **self._family)

    def twin_of(self, topology: Topology) -> Candidate:
        """Return the candidate that differs in the sense of all rotors alone, which may be the topology's own.

        Rotor drag torques are small, and so is what its optimum differs by. With the paper's root it stands
        otherwise in the world, and there is none but itself; nor is there without symmetry, where half turns are
        candidates of their own.
        """
        turned = self.task.search.root != "paper" and self.symmetry != "none"
        return self.candidate_of(with_spins_reversed(topology) if turned else topology)

    def sample(self, m: int, seed: int) -> list[Topology]:
        """Return m candidates, drawn independently and uniformly."""
        return sample(self.n, m, seed, **self._family)

    @property
    def _family(self) -> _Family:
        search = self.task.search
        return {
            "symmetry": self.symmetry,
            "connectors": search.connectors,
            "root": search.root,
            "task": self.task,
        }
