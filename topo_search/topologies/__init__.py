"""Trees of modules: enumerated, counted and drawn, each design once."""

from topo_search.topologies.candidates import (
    Candidate,
    OwnTopology,
    candidate_key,
    candidate_of,
    candidates,
    count,
    draws,
    own_candidates,
    own_topology,
    quotient_of,
    sample,
)
from topo_search.topologies.rooted import Connectors, Quotient, Root, Symmetry
from topo_search.topologies.task_symmetry import Resolution, improper_isometry, resolve_symmetry
