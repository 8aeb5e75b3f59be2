"""Features of the engine: candidates other than all trees.

The core imports this list and, but for those that its contract in pyproject.toml lets through, no feature.
"""

from topo_search.engine.listed import LatticeCandidates, ListedCandidates, TypedCandidates

__all__ = ["LatticeCandidates", "ListedCandidates", "TypedCandidates"]
