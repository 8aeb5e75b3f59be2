"""Severity of overlaps of a platform's airflow envelopes: the three metrics of the paper's ablation (Sec. IV).

Two envelopes can overlap by 2 (r_air + dr_air) at most, the sum of their largest radii; depths are in percent of
that. Envelopes that overlap, directly or through others, form a cluster.
"""

from __future__ import annotations

from collections.abc import Sequence

from topo_search.model import Clearance, Interference, Module, Status


def percent_of_deepest(clearance: float, module: Module) -> float:
    """Return the clearance of two envelopes [m] in percent of the deepest overlap that they can have."""
    return 100.0 * clearance / (2.0 * module.envelope.end_radius)


def interference(pairs: Sequence[Clearance]) -> Interference:
    """Return the metrics of the airflow rows of an audit; an overlap is one that is proven."""
    colliding = [pair for pair in pairs if pair.kind == "airflow" and pair.status == Status.VIOLATED]
    if not colliding:
        return Interference(colliding_pairs=0, deepest_percent=0.0, clusters=())
    import networkx as nx  # slow to load, and few designs need it

    clusters = nx.connected_components(nx.Graph([(pair.a, pair.b) for pair in colliding]))
    return Interference(
        colliding_pairs=len(colliding),
        deepest_percent=max((-pair.percent for pair in colliding if pair.percent is not None), default=0.0),
        clusters=tuple(sorted((tuple(sorted(cluster)) for cluster in clusters), key=lambda c: (-len(c), c))),
    )
