"""Flat lattices as candidates of a search."""

from topo_search.engine.strategy import Candidates
from topo_search.topologies.lattices import Lattices


class LatticeCandidates(Lattices, Candidates):
    """The flat lattices for a task."""
