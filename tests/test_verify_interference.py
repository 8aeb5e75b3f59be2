"""The paper's three metrics of how severely envelopes overlap, on platforms whose overlaps are known."""

from itertools import combinations

import numpy as np
import pytest
from verify_cases import design, fan

from topo_search.model import Clearance, Topology
from verify import audit
from verify.interference import interference

TWICE_END_RADIUS = 2 * fan().task.module.envelope.end_radius
"""The paper's theoretical maximum of an overlap [m]."""


def rows(pairs, percent=-10.0, status="violated", kind="airflow"):
    numbers = {"lower_m": None, "upper_m": -0.1, "analytic_m": -0.1, "level": 0, "percent": percent}
    return [Clearance(kind=kind, a=a, b=b, status=status, **numbers) for a, b in pairs]


def test_parallel_neighbours_form_one_cluster():
    # Axes 0.3 m apart: the far balls overlap by 2 R - 0.3. The outer two are clear, and in it through the middle.
    found = audit(fan(hinges=(0.0, 0.0)))
    assert found.interference.colliding_pairs == 2
    assert found.interference.clusters == ((0, 1, 2),)
    expected = 100 * (1 - 0.3 / TWICE_END_RADIUS)
    assert found.interference.deepest_percent == pytest.approx(expected, rel=1e-12)
    percents = {(pair.a, pair.b): pair.percent for pair in found.pairs if pair.kind == "airflow"}
    clear = 100 * (0.6 / TWICE_END_RADIUS - 1)
    assert percents == pytest.approx({(0, 1): -expected, (0, 2): -expected, (1, 2): clear})
    assert all(pair.percent is None for pair in found.pairs if pair.kind != "airflow")


def test_groups_that_lean_apart_are_clusters_of_their_own():
    row = Topology(((-1, -1, -1), (0, 0, 2), (1, 0, 2), (2, 0, 2), (3, 0, 2)))
    found = audit(design(row, {}, hinges=(0.0, -1.2, 0.0, 0.0), end_effector=(0.0, 0.0, 1.0))).interference
    assert found.clusters == ((2, 3, 4), (0, 1))
    assert found.colliding_pairs == 3


def test_a_platform_without_overlaps_has_no_cluster():
    found = audit(fan()).interference
    assert (found.colliding_pairs, found.deepest_percent, found.clusters) == (0, 0.0, ())


def test_clusters_are_the_connected_components():
    rng = np.random.default_rng(41)
    for _ in range(50):
        n = int(rng.integers(2, 15))
        pairs = [pair for pair in combinations(range(n), 2) if rng.random() < 1.5 / n]
        reach = np.eye(n, dtype=int)
        for a, b in pairs:
            reach[a, b] = reach[b, a] = 1
        reach = np.linalg.matrix_power(reach, n) > 0
        expected = {tuple(np.flatnonzero(row).tolist()) for row in reach if row.sum() > 1}
        found = interference(rows(pairs))
        assert set(found.clusters) == expected
        assert [len(cluster) for cluster in found.clusters] == sorted(map(len, expected), reverse=True)
        assert found.colliding_pairs == len(pairs)


def test_only_proven_overlaps_of_airflow_count():
    mixed = [
        *rows([(0, 1)], percent=-12.5),
        *rows([(1, 2)], percent=-30.0, status="undecided"),
        *rows([(2, 3)], percent=None, kind="separation"),
    ]
    found = interference(mixed)
    assert (found.colliding_pairs, found.deepest_percent, found.clusters) == (1, 12.5, ((0, 1),))
