"""Rotors that reach in among the arms of a bolted module: clear folds, against the audit's parts."""

import math
import re

import numpy as np
import pytest
from nlp_cases import as_point, best_design, hover, random_tree
from test_model_room import frame
from verify_cases import design
from wording import says

from nlp import prove_impossible
from nlp.numbers.geometry import FOLD, fold_excess
from nlp.starts.random_starts import draw, generator
from nlp.starts.untangling import untangle
from topo_search.model import Module, Status, Topology
from topo_search.model.room import clear_folds, in_words, nearest_fold
from verify import audit
from verify.compounds import certify_compounds
from verify.requirements import Scene

RIGHT = math.pi / 2
PAIR = Topology.from_key("a20")


def module(l_c, body=None, **fields):
    """Long arms and short connectors."""
    given = {
        "arm_length": 0.3,
        "connector_distance": l_c,
        "airflow": {"start_radius": 0.01, "reach": 1.5},
        **fields,
    }
    return {**given, "body": {"rotor_radius": 0.05, **(body or {})}}


FLAT = module(0.1)
"""Rotors pass each other at any angle."""
FOLDED = module(0.05, {"rotor_height": 0.1, "hub": [0.02, 0.02, 0.02], "arm_width": 0.01})
"""Lying flat each module's rotors are in the other's: some 27 degrees, either way, take them over and under."""


def clearance_of_parts(given, phi, a=0, b=2):
    """The clearance of two bolted modules' parts, frames against frames left out [m]."""
    hinge = phi * FOLD[a]
    told = design(Topology(((-1, -1, -1), (0, a, b))), {"module": given}, hinges=(hinge,))
    (found,) = certify_compounds([Scene(told).modules], [True])
    return found.analytic * Module.model_validate(given).arm_length


def random_module(rng, own_frame):
    """Rotors beyond the hinge, or across it."""
    body = {
        "rotor_radius": rng.uniform(0.02, 0.1),
        "rotor_height": rng.uniform(0.005, 0.1),
        "hub": [*rng.uniform(0.02, 0.3, 2).tolist(), rng.uniform(0.02, 0.2)],
        "arm_width": rng.uniform(0.01, 0.06),
    }
    return module(rng.uniform(0.01, 0.2), body | (frame(rng, rng.uniform(0.05, 0.25)) if own_frame else {}))


@pytest.mark.parametrize("own_frame", [False, True])
def test_no_rotor_touches_anything_at_a_clear_fold(own_frame):
    rng, some, whole = np.random.default_rng(5), 0, 0
    for _ in range(6):
        given, margin = random_module(rng, own_frame), rng.choice([0.0, 1e-4, 5e-3])
        folds = clear_folds(Module.model_validate(given), margin)
        some, whole = some + bool(folds), whole + (folds == ((-RIGHT, RIGHT),))
        for low, high in folds:
            for phi in (low, high, rng.uniform(low, high)):
                a, b = rng.integers(4, size=2).tolist()
                assert clearance_of_parts(given, phi, a, b) >= margin - 1e-9
    assert some > whole > 0  # and some are left with a part of the angles


@pytest.mark.parametrize(
    "given", [FLAT, FOLDED, module(0.05, {"rotor_height": 0.1}), module(0.08, {"rotor_radius": 0.12})]
)
def test_no_angle_is_left_out_that_is_clear_by_two_millimetres(given):
    """The modules are the same from all ports and upside down: what one pair of ports shows, all do."""
    folds = clear_folds(Module.model_validate(given), 1e-4)
    assert folds == tuple((-high, -low) for low, high in reversed(folds))
    for phi in np.linspace(-RIGHT, RIGHT, 13):
        inside = any(low <= phi <= high for low, high in folds)
        gap = clearance_of_parts(given, phi)
        assert inside == (gap > 1e-4) or abs(gap) < 2e-3


def test_folds_are_told_in_degrees_and_kept_to():
    flat, folded = (Module.model_validate(given) for given in (FLAT, FOLDED))
    assert in_words(clear_folds(flat), " deg") == "at most 90 deg"
    assert in_words(clear_folds(folded), " deg") == "26.6 to 90 deg"
    assert says(in_words(((-1.0, 0.5),), " deg"), "-57.2 to 28.6 deg", "positive")
    for low, high in ((0.1, 0.2), (0.30001, 0.30002), (-0.2, 0.31), (-0.44, 0.44)):
        folds = ((-high, -low), (low, high)) if low > 0 else ((low, high),)
        *first, last = (math.radians(float(number)) for number in re.findall(r"-?\d[\d.]*", in_words(folds, "")))
        assert last <= high
        assert [low <= number < last for number in first] == [True] * (low != -high)
    ((_, under), (over, _)) = clear_folds(folded)
    assert nearest_fold(clear_folds(folded), np.array([-0.01, 0.02, 1.0])).tolist() == [under, over, 1.0]


def test_rotors_wholly_beyond_the_hinge_are_no_proof_and_designs_have_them():
    """The proof knew only of rotors that end before the hinge; solved, the parts are clear by 74 mm at least.

    Straight arms would cross the neighbour's beside the connector; a small frame stands in for arms that do not.
    """
    task = hover(2, module=module(0.1, frame(np.random.default_rng(0), 0.05)))
    assert prove_impossible(task) is None
    found = best_design(task, PAIR, 3)
    report = audit(found)
    assert report.verdict == Status.CLEAR
    assert min(pair.analytic_m for pair in report.pairs if pair.kind == "body") > 0.07


@pytest.mark.parametrize("across", [-0.049, 0.0, 0.049])
def test_rotors_across_the_hinge_touch_at_any_angle(across):
    given = module(0.3 / math.sqrt(2) + across)
    proof = prove_impossible(hover(2, module=given))
    assert proof.violation == pytest.approx(0.05 - abs(across))
    assert clear_folds(Module.model_validate(given)) == ()
    assert all(clearance_of_parts(given, phi) < 0 for phi in np.linspace(-RIGHT, RIGHT, 5))


def test_hinges_keep_to_the_side_that_they_start_on():
    """A small frame stands in for arms that do not cross the neighbour's."""
    task = hover(2, module=module(0.05, {"rotor_height": 0.1} | frame(np.random.default_rng(0), 0.02)))
    for number in range(4):
        start = draw(task, PAIR, generator(task, PAIR, number, 0))
        assert np.all(fold_excess(task, PAIR, start.alpha) <= 0)
    found = best_design(task, PAIR, 4)
    assert abs(found.hinge_angles_rad[0]) > 0.12
    assert np.all(fold_excess(task, PAIR, as_point(found).alpha) <= 1e-9)
    assert audit(found).verdict == Status.CLEAR


def test_hinges_are_placed_at_clear_folds():
    task, tree = hover(9, module=FOLDED), random_tree(9, np.random.default_rng(2))
    alpha = untangle(task, tree, np.full(8, 0.3), np.random.default_rng(0))
    assert np.all(fold_excess(task, tree, alpha) <= 0)
