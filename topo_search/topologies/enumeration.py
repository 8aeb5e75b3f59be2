"""Every tree of one size in ascending order of its text, in bounded memory.

A key's root digit comes first, then the codes at its ports; codes are prefix-free, so texts ascend when the codes
do, port by port. With the root at a centroid no port carries more than half of the modules: each tree is a
combination of short codes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import itemgetter

from topo_search.topologies.codes import codes
from topo_search.topologies.rooted import Rooted
from topo_search.topologies.symmetry import Connectors, Root


def rooted_at(root: Root, n: int, connectors: Connectors, masks: Iterable[int]) -> Iterator[Rooted]:
    """Yield the rooted trees of n modules in ascending order of their texts.

    With the free root: those with the root at a centroid, so that a tree with two centroids comes twice.

    Args:
        root: `free`, or `paper`.
        n: number of modules.
        connectors: of which family.
        masks: which ports of the root may carry a child (bits 0..3), in ascending order.
    """
    most = n - 1 if root == "paper" else n // 2
    for mask in masks:
        ports = mask.bit_count()
        # a free port's code is the empty one behind the row's end
        at_four = itemgetter(
            *((mask & (1 << port) - 1).bit_count() if mask >> port & 1 else ports for port in range(4))
        )
        for at_ports in _rows(ports, n - 1, most, connectors):
            yield at_four((*at_ports, ""))


def _rows(ports: int, modules: int, most: int, connectors: Connectors) -> Iterator[tuple[str, ...]]:
    """Yield the rows of `ports` codes of at most `most` modules each and `modules` in all, in ascending order."""
    if not ports <= modules <= ports * most:
        return
    if ports == 0:
        yield ()
        return
    if ports == 1:
        yield from zip(codes(modules, modules, connectors))
        return
    least = max(1, modules - (ports - 1) * most)
    for code in codes(least, min(most, modules - ports + 1), connectors):
        for row in _rows(ports - 1, modules - len(code), most, connectors):
            yield (code, *row)
