"""Overlap of envelopes by the three metrics of the paper's ablation (Sec. IV).

Depths are in percent of the deepest possible overlap, 2 (r_air + dr_air), the sum of two envelopes' largest radii.
Envelopes that overlap, directly or through others, form a cluster.
"""

from collections.abc import Sequence

from topo_search.model import Clearance, Interference, Status


def interference(pairs: Sequence[Clearance]) -> Interference:
    """Return the overlap metrics of an audit's airflow pairs; only proven overlaps count."""
    colliding = [pair for pair in pairs if pair.kind == "airflow" and pair.status == Status.VIOLATED]
    if not colliding:
        return Interference(colliding_pairs=0, deepest_percent=0.0, clusters=())
    import networkx as nx  # slow to load, and few designs have overlaps

    clusters = nx.connected_components(nx.Graph([(pair.a, pair.b) for pair in colliding]))
    return Interference(
        colliding_pairs=len(colliding),
        deepest_percent=max((-pair.percent for pair in colliding if pair.percent is not None), default=0.0),
        clusters=tuple(sorted((tuple(sorted(cluster)) for cluster in clusters), key=lambda c: (-len(c), c))),
    )
