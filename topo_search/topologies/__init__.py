"""Candidate trees of modules: enumerated, counted and sampled, each design once."""

from topo_search.topologies.family import Candidate, Family, candidate_of, candidates, count, sample
from topo_search.topologies.rooted import Connectors, Root, Symmetry
from topo_search.topologies.task_symmetry import Resolution, exact_group, improper_isometry, resolve_symmetry
