"""What trees are compared by, and what is expected of those that were never solved."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from topo_search.engine.proposals.moves import PATTERNS, REGRESSION, Surrogate, descriptors, part_of
from topo_search.model import Topology
from topo_search.topologies import Connectors, candidate_of, sample


@given(st.integers(1, 14), st.integers(0, 10**6), st.sampled_from(["aligned", "any"]))
def test_trees_that_are_one_candidate_are_described_alike(n: int, seed: int, connectors: Connectors) -> None:
    (rooted,) = sample(n, 1, seed, symmetry="none", root="paper", connectors=connectors)
    for symmetry in ("none", "c2", "d2"):
        listed = candidate_of(rooted, symmetry=symmetry, connectors=connectors).topology
        one, other = descriptors([listed, rooted])
        assert one.tolist() == other.tolist()


@pytest.mark.parametrize(
    ("key", "expected", "paths"),
    [
        ("a0", [0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0], {}),
        ("a10", [0, 0.25, 0, 0, 2, 0, 0, 2, 1 / 2, 0, 0, 0], {}),
        ("p18", [0, 0.25, 0, 0, 2, 0, 0, 0, 1 / 2, 0, 0, 0], {}),  # spins cancel
        ("af0000", [0.4, 0.4, 0, 0, 4, 0, 1, 5, 16 / 5, 0, 0, 0], {"0": 2, "1": 4}),
        # a square without its last joint
        ("a3400", [0.25, 0.25, 0, 1, 2, 2, 0, 4, 10 / 4, 0, 0, 0], {"1": 2, "11": 1}),
        # a corner
        ("a300", [1 / 9, 1 / 3, 0, 0, 2, 1, 0, 3, 4 / 3, 3, 0, 2**0.5 / 27], {"1": 1}),
        # three in a row, and one aside
        (
            "a5100",
            [1 / 8, 3 / 4, 0, 0, 2, 2, 0, 4, 10 / 4, 4, 2, 0.625**0.5 / 4],
            {"0": 1, "1": 1, "01": 1},
        ),
        # the same, the one aside turned by a quarter
        (
            "p5180",
            [1 / 8, 3 / 4, 0, 0, 2, 2, 0, 2, 10 / 4, 4, 2, 0.625**0.5 / 4],
            {"0": 1, "1": 1, "01": 1},
        ),
    ],
)
def test_descriptors_of_trees_that_can_be_looked_at(key: str, expected: list[float], paths: dict[str, int]) -> None:
    counted = [paths.get("".join(map(str, pattern)), 0) for pattern in PATTERNS]
    (described,) = descriptors([Topology.from_key(key)])
    assert described == pytest.approx([*expected, *counted])


@given(st.integers(2, 14), st.integers(0, 10**6), st.data())
def test_a_part_mirrored_at_its_joint_keeps_the_patterns_of_all_paths(
    n: int, seed: int, data: st.DataObject
) -> None:
    (tree,) = sample(n, 1, seed, symmetry="none")
    i = data.draw(st.integers(1, n - 1))
    part = part_of(tree, i)
    across = {port: port if (port - tree.joints[i][2]) % 2 == 0 else (port + 2) % 4 for port in range(4)}
    joints = [
        (h, across[a] if h in part else a, across[b] if child in part else b)
        for child, (h, a, b) in enumerate(tree.joints)
        if child
    ]
    mirrored = Topology((tree.joints[0], *joints))
    one, other = descriptors([mirrored, tree])[:, -len(PATTERNS) :]
    assert one.tolist() == other.tolist()


@pytest.mark.parametrize("bend", [0.0, 3.0])
def test_a_ranking_is_forecast_and_the_unknown_is_given_a_chance(bend: float) -> None:
    """A trend, and what no trend tells: the best have their first number in the middle."""
    rng = np.random.default_rng(0)
    described = rng.normal(size=(400, 3)) * [1.0, 100.0, 0.0] + [0.0, 5.0, 7.0]
    value = described[:, 0] - described[:, 1] / 50 + bend * described[:, 0] ** 2
    solved = described[:300][np.argsort(value[:300])]
    surrogate = Surrogate(solved, range(300))
    ranks = (
        np.argsort(np.argsort(surrogate.lower_confidence_bounds(described[300:]))),
        np.argsort(np.argsort(value[300:])),
    )
    assert np.corrcoef(*ranks)[0, 1] > 0.95
    usual = solved.mean(axis=0)
    known, strange = surrogate.lower_confidence_bounds(np.array([usual, [*usual[:2], 1000.0]]))
    assert strange < known - 100


def test_of_very_many_solved_trees_some_of_all_places_are_looked_at() -> None:
    rng = np.random.default_rng(1)
    described = np.sort(rng.normal(size=(2 * REGRESSION.max_trees + 1, 1)), axis=0)
    bounds = Surrogate(described, range(len(described))).lower_confidence_bounds(np.array([[-2.0], [0.0], [2.0]]))
    assert bounds[0] < bounds[1] - 0.5 < bounds[2] - 1.0


def test_what_falls_short_is_told_from_what_the_others_say() -> None:
    rng = np.random.default_rng(2)
    described = rng.normal(size=(240, 2))
    order = np.argsort(described[:, 0])
    missed = order[3]  # among the best, but it stands last
    ranking = np.array([*order[order != missed], missed])
    bounds = Surrogate(described[ranking], range(240)).leave_one_out_bounds()
    assert np.argsort(bounds).tolist().index(239) < 12
    for place in (10, 100, 239):
        others = np.arange(240) != place
        alone = Surrogate(described[ranking[others]], np.arange(240)[others]).lower_confidence_bounds(
            described[[ranking[place]]]
        )
        assert bounds[place] == pytest.approx(alone[0], abs=0.05)
