"""Interface for a user's own sampler, which proposes trees.

`search` takes an `OwnSampler` as `sampler=`: a `SamplerFactory` with a name and a version, which makes an Optuna
sampler or a `TopologySampler`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Protocol, runtime_checkable

from topo_search.engine.strategy import Candidates, SamplerFactory, Tried
from topo_search.model import Topology
from topo_search.model.stated import Versioned


@runtime_checkable
class TopologySampler(Protocol):
    """Proposes trees one by one.

    A stopped run is resumed by replaying its proposals: the same arguments must give the same proposal.
    """

    def propose(self, candidates: Candidates, tried: Sequence[Tried], random: Random, /) -> Topology | str:
        """Return a tree to solve, or its key.

        Args:
            candidates: the available trees.
            tried: the known results, in the order of the proposals, one for each solve of a tree.
            random: the only random generator to use.

        A tree that was proposed before is rejected, and the sampler is called again; after 64 rejections in a row a
        tree is drawn uniformly.
        """


@dataclass(frozen=True)
class OwnSampler:
    """Your own sampler, with the name and version that identify its runs."""

    name: str
    make: SamplerFactory
    version: str | None = None
    """Change it when its proposals change. A run with an unversioned sampler is not resumed."""

    def __post_init__(self) -> None:
        """Check name and version; ValueError names the rule and the value."""
        _ = self.stated  # which checks both

    @property
    def stated(self) -> Versioned:
        """The sampler's record in a run's folder."""
        return Versioned(name=self.name, version=self.version)
