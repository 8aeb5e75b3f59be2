"""Features of the candidates: families other than all trees, and the functions that know them.

The core imports this list and, but for those that its contract in pyproject.toml lets through, no feature.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from topo_search.model import ResolvedTask, Topology
from topo_search.topologies.family import Candidate, Family
from topo_search.topologies.lattices import Lattices
from topo_search.topologies.typed import TypedTrees

__all__ = ["Lattices", "TypedTrees", "candidate_of", "candidates", "count", "family_of", "sample"]


def family_of(n: int, *, counts: Sequence[int] = (), task: ResolvedTask | None = None, **options: Any) -> Family:
    """Return all trees of n modules, of the types of the task or with `counts` modules of each, if there are any.

    Args:
        n: number of modules.
        counts: number of modules of each type.
        task: as for `Family`.
        options: the other arguments of `Family`.
    """
    if counts or (task is not None and task.module_types):
        return TypedTrees(n, counts=counts, task=task, **options)
    return Family(n, task=task, **options)


def candidate_of(topology: Topology, **family: Any) -> Candidate:
    """Return the candidate of a topology among those with its types; `family`: arguments of `family_of`."""
    counts = [topology.types.count(k) for k in range(max(topology.types, default=-1) + 1)]
    return family_of(topology.n, **{"counts": counts, **family}).candidate_of(topology)


def candidates(n: int, **family: Any) -> Iterator[Candidate]:
    """Yield the candidates of n modules in ascending order of keys; `family`: arguments of `family_of`.

    >>> [topology.key for topology in candidates(3)]
    ['a300', 'a500', 'a600', 'aa00']
    >>> [topology.key for topology in candidates(2, counts=(1, 1))]
    ['a10-ab', 'a20-ab']
    """
    return family_of(n, **family).candidates()


def count(n: int, **family: Any) -> int:
    """Return the number of candidates of n modules in closed form; `family`: arguments of `family_of`.

    >>> [count(n) for n in range(1, 7)]
    [1, 2, 4, 14, 49, 216]
    >>> count(5, symmetry="none")
    91
    >>> count(6, counts=(5, 1))
    1224
    """
    return family_of(n, **family).count()


def sample(n: int, m: int, seed: int, **family: Any) -> list[Topology]:
    """Return m candidates of n modules, drawn independently and uniformly; `family`: arguments of `family_of`.

    >>> [topology.key for topology in sample(4, 3, seed=0)]
    ['a5020', 'a3010', 'a7000']
    """
    return family_of(n, **family).sample(m, seed)
