"""T(s): who meets it meets it for every smaller s, and the value 0 is asked for as well."""

import itertools

import numpy as np
import pytest
from capability_cases import QUANTITIES, drawn, held, meets, platform_at, produced, task_of
from suites import few

from topo_search.model import Topology
from topo_search.model.maximized import provable_at, task_at

PAIR = Topology(((-1, -1, -1), (0, 0, 2)))


def found(task, rng, count):
    """Random platforms that meet T(0), with what they hold."""
    taken = list[tuple[object, float]]()
    while len(taken) < count:
        platform = platform_at(task, *drawn(task, rng))
        size = held(task, platform)
        if size is not None and 0.0 < size < np.inf:
            taken.append((platform, size))
    return taken


@pytest.mark.parametrize(
    ("quantity", "seed"), few(list(itertools.product(QUANTITIES, range(25))), [(q, 0) for q in QUANTITIES])
)
def test_a_platform_that_meets_a_value_meets_all_below(quantity, seed):
    rng = np.random.default_rng([68, seed, QUANTITIES.index(quantity)])
    task = task_of(quantity, 3, ["horizontal", "all"][seed % 2])
    for platform, size in found(task, rng, 1):
        assert not meets(task, platform, 1.01 * size)
        for share in (0.999, 0.9, 0.7, 0.5, 0.3, 0.1, 0.01):
            assert meets(task, platform, share * size)


def test_a_counterweighted_platform_that_carries_one_mass_but_not_none_is_refused():
    """The torque of a counterweight and 0.3 kg on a long arm are in balance; all else tips the platform over."""
    tip, bare = np.array([5.0, 0.0, 0.0]), task_of("payload", 2, cases="hover")
    level = platform_at(bare, PAIR, np.zeros(4), tip)
    payload = 0.3 * bare.gravity
    torque = level.p_e[0] * payload - level.o[:, 0].mean() * (bare.force_unit(2) + payload)
    case = bare.load_cases[0]
    com = case.at_com.model_copy(update={"torque": (0.0, float(torque), 0.0)})
    task = bare.model_copy(update={"load_cases": (case.model_copy(update={"com": com}),)})
    platform = platform_at(task, PAIR, np.zeros(4), tip)
    masses = (0.0, 0.1, 0.2, 0.3, 0.4)
    carried = [mass for mass in masses if produced(task, platform, task_at(task, mass).load_cases[0])]
    assert carried == [0.3]
    assert not meets(task, platform, 0.3)


def test_directions_of_a_proof_are_points_of_the_ball_or_disc():
    for directions, most in (("horizontal", 0.0), ("all", 1.0)):
        towards = np.array(provable_at(task_of("force_reserve", 3, directions), 1.0).search.towards)
        assert np.allclose(np.linalg.norm(towards, axis=1), 1.0, atol=1e-15)
        assert np.abs(towards[:, 2]).max() == most
        assert np.allclose(towards.sum(axis=0), 0.0, atol=1e-12)
