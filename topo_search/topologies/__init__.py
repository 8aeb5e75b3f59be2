"""Candidate trees of modules: enumerated, counted and sampled, each design once."""

from topo_search.topologies.family import Candidate, Family
from topo_search.topologies.features import candidate_of, candidates, count, family_of, sample
from topo_search.topologies.rooted import Connectors, Root, Symmetry
from topo_search.topologies.task_symmetry import Resolution, exact_group, improper_isometry, resolve_symmetry
