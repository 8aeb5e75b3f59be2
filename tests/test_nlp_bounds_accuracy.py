"""The lower bound at any weights, at the accuracy that the audit lets pass, and what undercuts it."""

import numpy as np
import pytest
from nlp_cases import HOVER, push, solved

import nlp.bounds.effort
from nlp import lower_bound, solve
from nlp.bounds import BoundBroken, bound_of
from nlp.bounds.duality import _phi, dual_value
from nlp.bounds.effort import closed_form
from nlp.bounds.refutation import TOLERANCE
from topo_search.model import Design, Topology
from topo_search.topologies import candidates

SIDEWAYS = {"com": {"force": [1.2, 0.0, 1.2]}}
FOUR = [c.topology for c in candidates(4)]


def weighted(heavy, light, n=4):
    return push(n, load_cases=[{**HOVER, "weight": heavy}, {**SIDEWAYS, "weight": light}])


@pytest.mark.parametrize("weight", [1e-300, 1e-17, 1.0, 1e17, 1e300])
def test_phi_is_that_of_the_best_thrust_for_any_weight(weight):
    """Against many thrusts, in numbers that do not cancel: t s - weight s^2."""
    s, t = np.linspace(0.0, 2.5, 2001), np.array([-1.0, 0.0, 1e-9, 0.3, 1.0, 40.0])
    knee = 2 * weight * 2.5
    for scale in (1.0, knee):
        phi = _phi((scale * t)[:, None], np.array([weight]), 2.5)[:, 0]
        best = (s * (scale * t[:, None] - weight * s)).max(axis=1)
        assert np.all(phi >= best * (1 - 1e-12))
        assert np.all(phi <= best * (1 + 1e-3) + 1e-6 * weight)


@pytest.mark.parametrize("light", [1e-15, 1e-12, 1e-9, 1e-6])
def test_a_load_case_that_weighs_nothing_costs_nothing_and_still_needs_its_axes(light):
    """Far apart, the weights make no difference: the bound tends to the heavy case's over axes that serve both."""
    bound, near = lower_bound(weighted(100.0, light)), lower_bound(weighted(100.0, 1e-4))
    assert bound == pytest.approx(near, rel=2e-3)
    assert bound > 1.9 * closed_form(weighted(100.0, light))


@pytest.mark.parametrize("light", [1e-15, 1.0])
def test_trees_of_different_efforts_do_not_both_attain_the_bound(light):
    """With weights 100 and 1e-15 the bound was above both, and hidden: each showed no gap."""
    cases = [{**HOVER, "weight": 100.0}, {"com": {"force": [1.0, 0.0, 1.0]}, "weight": light}]
    found = [solve(push(4, load_cases=cases), tree, starts=range(2), seed=0) for tree in FOUR[:3]]
    designs = [design for design in found if isinstance(design, Design)]
    assert max(d.objective for d in designs) > 1.0001 * min(d.objective for d in designs)
    assert all(d.objective >= lower_bound(d.task) * (1 - 1e-9) for d in designs)


def test_scaling_all_weights_scales_the_bound_to_the_ends_of_what_is_allowed():
    plain = lower_bound(weighted(1.0, 0.5))
    for scale in (1e-14, 1e15):
        assert lower_bound(weighted(scale, 0.5 * scale)) == pytest.approx(scale * plain, rel=1e-9)


def test_the_bound_of_designs_within_the_audits_tolerances_is_a_little_lower():
    """Forces that fall short by the tolerance, each along its own direction, cost as much less."""
    for task in (push(3), weighted(1.0, 1.0), push(1, load_cases=[HOVER])):
        exact, within = lower_bound(task), lower_bound(task, accuracy=TOLERANCE)
        assert exact * (1 - 1e-4) < within < exact * (1 - 1e-7)
    one = push(1, load_cases=[HOVER])
    assert lower_bound(one, accuracy=TOLERANCE) <= lower_bound(one) * (1 - TOLERANCE) ** 2


def test_a_dual_value_is_not_above_a_bound_that_is_attained():
    """All rotors pull straight: whatever multipliers are tried, n thrusts of f cost n f^2."""
    f, rng = np.array([[0.0, 0.0, 1.0]]), np.random.default_rng(0)
    for nu in 10.0 ** rng.uniform(-8, 8, (200, 1, 1)) * rng.normal(size=(200, 1, 3)):
        assert dual_value(nu, f, np.array([1.0]), 2.5) <= 1.0 + 1e-15
    assert dual_value(np.array([[0.0, 0.0, 2.0]]), f, np.array([1.0]), 2.5) <= 1.0


def test_an_effort_under_the_bound_is_an_error_with_both_numbers(monkeypatch):
    task = push(1, load_cases=[HOVER])
    J = lower_bound(task)
    assert bound_of(task, J * (1 - 1e-7)) == J * (1 - 1e-7)
    with pytest.raises(BoundBroken, match=r"internal error: .* effort .* below the lower bound"):
        bound_of(task, J * (1 - 5e-6))
    true = nlp.bounds.effort.closed_form
    J = solved(solve(task, Topology.from_key("a0"), starts=range(1), seed=0)).objective
    monkeypatch.setattr(nlp.bounds.effort, "closed_form", lambda *given: 2 * true(*given))
    with pytest.raises(BoundBroken) as broken:
        solve(task, Topology.from_key("a0"), starts=range(1), seed=0)
    assert f"{J!r}" in str(broken.value)
