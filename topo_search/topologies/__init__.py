"""Trees of modules: enumerated, counted and drawn, each design once."""

from topo_search.topologies.candidates import Candidate, candidate_of, candidates, count, draws, sample
from topo_search.topologies.resolution import Resolution, resolve_symmetry
from topo_search.topologies.symmetry import Connectors, Root, Symmetry
from topo_search.topologies.task_symmetry import improper_isometry

__all__ = [
    "Candidate",
    "Connectors",
    "Resolution",
    "Root",
    "Symmetry",
    "candidate_of",
    "candidates",
    "count",
    "draws",
    "improper_isometry",
    "resolve_symmetry",
    "sample",
]
