"""The limits that a task can tighten: the share of u_max that rotors may use, and the end-effector's stand-off."""

import math

import numpy as np
import pytest
from nlp_cases import HOVER, as_design, best_design, hover, push, random_point, random_tree, solved
from suites import few

from nlp import lower_bound, prove_impossible, solve
from nlp.problem import problem
from topo_search.model import Design, Infeasible, Topology
from verify import audit
from verify.kinematics import platform

ALONE, PAIR, FIVE = (Topology.from_key(key) for key in ("a0", "a10", "a11210"))
ANYWHERE = {"interference": "separation", "separation": 1e-3}
"""The platform need not clear its own airflow."""


def least_distance(design: Design) -> float:
    """From p_E to the nearest module's centre, by the audit's kinematics [m]."""
    found = platform(design)
    return float(np.linalg.norm(found.o - found.p_e, axis=1).min())


# ---- rotor inputs


@pytest.mark.parametrize("over", [0.999, 1.001])
def test_a_yaw_torque_needs_its_share_of_the_largest_input(over):
    """Rotors of one module that yaws while it hovers: F / 4 k_f +- tau / 4 k_tau, the larger of them the peak."""
    case = {"com": {"force": [0, 0, 1], "torque": [0, 0, 0.1]}}
    given = hover(1, load_cases=[case])
    u = given.force_unit(1) / (4 * given.module.thrust_coefficient)
    apart = 0.1 * given.torque_unit(1) / (4 * given.module.torque_coefficient)
    share = over * (u + apart) / given.module.max_input(given.gravity)
    assert 0.5 < share < 0.9
    result = solve(hover(1, load_cases=[case], search={"peak_input": share}), ALONE, starts=range(3), seed=0)
    if over > 1:
        design = solved(result)
        assert design.objective == pytest.approx(2 * (u + apart) ** 2 + 2 * (u - apart) ** 2, rel=1e-8)
        assert audit(design).verdict == "clear"
    else:
        assert isinstance(result, Infeasible)


def test_a_share_is_that_much_less_thrust():
    """Another module whose rotors give less: the same problem, bounds and proofs."""
    share = 0.7
    one, other = push(5, search={"peak_input": share}), push(5, module={"max_thrust_to_weight": share * 2.5})
    assert problem(one, FIVE).upper == pytest.approx(problem(other, FIVE).upper, rel=1e-15)
    assert problem(one, FIVE).lower == problem(other, FIVE).lower
    assert lower_bound(one) == pytest.approx(lower_bound(other), rel=1e-12)
    assert lower_bound(one) >= lower_bound(push(5)) * (1 - 1e-12)
    pulls = [{"com": {"force": [0, 0, 1.2]}}, {"com": {"force": [0, 0, -1.2]}}]
    proofs = [
        prove_impossible(push(5, load_cases=pulls, **fields))
        for fields in ({"search": {"peak_input": share}}, {"module": {"max_thrust_to_weight": share * 2.5}})
    ]
    assert all(proof is not None for proof in proofs)
    assert proofs[0].violation == pytest.approx(proofs[1].violation, rel=1e-9)


# ---- stand-off


def test_a_larger_stand_off_costs_effort_once_it_matters():
    """The optimum without is 0.31 m away; from then on the stand-off is kept with its margin, and no more."""
    efforts = []
    for asked in (0.3, 0.38, 0.4):
        task = push(5, end_effector={"stand_off": asked})
        design = best_design(task, FIVE, 8)
        assert least_distance(design) >= asked
        result = audit(design)
        assert result.verdict == "clear"
        least = min(pair.analytic_m for pair in result.pairs if pair.kind == "exclusion")
        assert least == pytest.approx(least_distance(design) - asked, abs=1e-12)
        if asked > 0.3:
            assert least == pytest.approx(task.search.margin, rel=1e-2)
        efforts.append(design.objective)
    plain = best_design(push(5), FIVE, 8)
    assert least_distance(plain) == pytest.approx(0.309, abs=1e-3)
    assert efforts[0] == pytest.approx(plain.objective, rel=1e-6)
    assert efforts[0] * (1 + 1e-4) < efforts[1] < efforts[2]


@pytest.mark.parametrize("seed", few(range(60), 12))
def test_a_place_at_some_distance_is_never_proven_too_near(seed):
    """Any platform with p_E anywhere; as far from its nearest module as it is, it can be."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    tree = random_tree(n, rng)
    place = {"position": (rng.normal(size=3) * rng.uniform(0.0, 0.5)).tolist(), "exclusion": False}
    point = random_point(hover(n, search=ANYWHERE, end_effector=place), tree, rng)
    asked = {**place, "stand_off": 0.999999 * least_distance(as_design(point))}
    assert prove_impossible(hover(n, search=ANYWHERE, end_effector=asked), tree) is None


@pytest.mark.parametrize(("n", "tree"), [(1, ALONE), (2, PAIR)])
@pytest.mark.parametrize("distance", [0.0, 0.2])
def test_the_proof_of_a_stand_off_is_sharp(n, tree, distance):
    """One module is m_t / m times as far away as the COM, two in a row beside it l_c across that."""
    given = {"position": [0.0, 0.0, distance], "exclusion": False}
    task = hover(n)
    farthest = math.hypot(task.total_mass(n) / (n * task.module.mass) * distance, 0.15 * (n - 1))
    within, beyond = (
        prove_impossible(hover(n, end_effector={**given, "stand_off": over * farthest + least}), tree)
        for over, least in ((1 - 1e-6, 0.0), (1 + 1e-6, 1e-6))
    )
    assert within is None
    assert (beyond.status, beyond.unit, beyond.worst_constraint) == ("impossible", "m", "end-effector exclusion")
    assert beyond.topology is None  # it holds for the size
    assert beyond.message.startswith("end_effector.stand_off = ")


def test_a_compact_tree_is_proven_too_small_before_a_chain():
    """sum of squared distances: 4 of 1 and 6 of 4 joints in a star, n^2 (n^2 - 1) / 12 = 50 in a chain."""
    star, chain = Topology.from_key("af0000"), Topology.from_key("a52020")
    for tree, squares in ((star, 28), (chain, 50)):
        farthest = 0.3 / 5 * math.sqrt(squares)
        for over in (0.999, 1.001):
            place = {"position": "com", "exclusion": False, "stand_off": over * farthest}
            assert (prove_impossible(push(5, load_cases=[HOVER], end_effector=place), tree) is None) == (over < 1)
