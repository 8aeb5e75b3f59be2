"""Candidates of a search other than all trees: a user's list, flat lattices, and trees with types of module."""

from collections.abc import Iterator, Sequence
from itertools import repeat
from random import Random

from topo_search.engine.strategy import Candidates
from topo_search.model import ResolvedTask, Topology
from topo_search.topologies import Candidate
from topo_search.topologies.features import Lattices, TypedTrees


class ListedCandidates(Candidates):
    """Candidates from a user's list: each is solved with its given root and represents only itself."""

    def __init__(self, task: ResolvedTask, keys: Sequence[str]) -> None:
        """Set the keys of trees of the task's size, in ascending order."""
        super().__init__(task, "none")
        self.keys = keys

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate, in ascending order of keys."""
        return (Candidate(key, 1) for key in self.keys)

    def count(self) -> int:
        """Return the number of candidates."""
        return len(self.keys)

    def candidate_of(self, topology: Topology) -> Candidate:
        """Return the candidate of a topology; ValueError if it is not listed."""
        if topology.key not in self.keys:
            raise ValueError(f"{topology.key} is not one of the {len(self.keys)} listed topologies")
        return Candidate(topology.key, 1)

    def draws(self, seed: int) -> Iterator[Topology]:
        """Yield an endless series of candidates, drawn independently and uniformly."""
        random = Random(seed)
        return (Topology.from_key(random.choices(self.keys)[0]) for _ in repeat(None))


class LatticeCandidates(Lattices, Candidates):
    """The flat lattices for a task."""


class TypedCandidates(Candidates, TypedTrees):
    """The trees for a task with types of module."""
