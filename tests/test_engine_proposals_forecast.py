"""What trees are compared by, and what is expected of those that were never solved."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from topo_search.engine.proposals.descriptors import descriptors
from topo_search.engine.proposals.forecast import Forecast
from topo_search.model import Topology
from topo_search.topologies import Connectors, candidate_of, sample


@given(st.integers(1, 14), st.integers(0, 10**6), st.sampled_from(["aligned", "any"]))
def test_trees_that_are_one_candidate_are_described_alike(n: int, seed: int, connectors: Connectors) -> None:
    (rooted,) = sample(n, 1, seed, symmetry="none", root="paper", connectors=connectors)
    for symmetry in ("none", "c2", "d2"):
        listed = candidate_of(rooted, symmetry=symmetry, connectors=connectors).topology
        assert descriptors(listed) == pytest.approx(descriptors(rooted))


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("a0", [0, 0, 0, 0, 0, 0, 0, 1]),
        ("a10", [0, 0.25, 0, 0, 2, 0, 0, 2]),
        ("p18", [0, 0.25, 0, 0, 2, 0, 0, 0]),  # spins cancel
        ("af0000", [0.4, 0.4, 0, 0, 4, 0, 1, 5]),
        ("a3400", [0.25, 0.25, 0, 1, 2, 2, 0, 4]),  # a square without its last joint
    ],
)
def test_descriptors_of_trees_that_can_be_looked_at(key: str, expected: list[float]) -> None:
    assert descriptors(Topology.from_key(key)) == pytest.approx(expected)


def test_a_linear_ranking_is_forecast_and_the_unknown_is_given_a_chance() -> None:
    rng = np.random.default_rng(0)
    described = rng.normal(size=(400, 3)) * [1.0, 100.0, 0.0] + [0.0, 5.0, 7.0]
    value = described[:, 0] - described[:, 1] / 50
    places = np.argsort(np.argsort(value[:300]))
    hopes = Forecast(described[:300], places.tolist()).hopes(described[300:])
    assert np.corrcoef(hopes, value[300:])[0, 1] > 0.99
    usual = described[:300].mean(axis=0)
    known, strange = Forecast(described[:300], places.tolist()).hopes(np.array([usual, [*usual[:2], 1000.0]]))
    assert strange < known - 100


def test_one_solved_tree_is_enough() -> None:
    hopes = Forecast(np.ones((1, 4)), [0]).hopes(np.ones((2, 4)))
    assert np.all(np.isfinite(hopes))
    assert hopes[0] == hopes[1]
