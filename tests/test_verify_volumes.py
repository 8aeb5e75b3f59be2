"""Convex target regions in the audit: closed forms, another way to the same number, and proofs that hold."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from verify_cases import design, fan

from topo_search.model import Audit, Status, Topology
from verify import audit
from verify.bodies import ConeSphere, ball
from verify.certificate import RoundBody, certify_pairs
from verify.hulls import approach, hull

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))
BOX = hull(CUBE * [1.0, 2.0, 3.0])


def test_a_ball_beside_a_face_an_edge_and_a_corner() -> None:
    assert approach(ball(np.array([3.0, 0.5, 0.5]), 0.5), BOX).d == pytest.approx(1.5)
    assert approach(ball(np.array([4.0, 6.0, 0.5]), 0.5), BOX).d == pytest.approx(4.5)
    assert approach(ball(np.array([2.0, 4.0, 5.0]), 0.5), BOX).d == pytest.approx(2.5)
    assert approach(ball(np.array([0.9, 0.0, 0.0]), 0.5), BOX).d == -0.5  # the centre is inside


def test_an_axis_that_pierces_a_region_counts_its_largest_radius_in_there() -> None:
    through = ConeSphere(np.array([-4.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0]), 0.1, 1.0)
    assert approach(through, BOX).d == pytest.approx(-0.6)  # it leaves at x = 1, half-way
    aside = ConeSphere(np.array([-4.0, 2.5, 0.0]), np.array([10.0, 0.0, 0.0]), 0.1, 0.0)
    assert approach(aside, BOX).d == pytest.approx(0.4)


@pytest.mark.parametrize("wrong", [0.3, -0.3])
def test_a_wrong_closed_form_is_found_out(monkeypatch: pytest.MonkeyPatch, wrong: float) -> None:
    import verify.certificate as under_test

    true = approach
    monkeypatch.setattr(under_test, "approach", lambda K, Q: true(K, Q)._replace(d=true(K, Q).d + wrong))
    body = ball(np.array([1.0 + 0.5 - wrong / 2, 0.0, 0.0]), 0.5)
    (certificate,) = certify_pairs([(RoundBody(body), BOX)])
    assert certificate.status == Status.INCONSISTENT
    assert f"clearance {certificate.analytic!r}" in certificate.evidence[0]


def test_one_inside_the_other_is_violated() -> None:
    small, large = ball(np.zeros(3), 0.05), ball(np.zeros(3), 20.0)
    for body in (small, large, ConeSphere(np.zeros(3), np.array([0.1, 0.0, 0.0]), 0.2, 0.1)):
        assert certify_pairs([(RoundBody(body), BOX)])[0].status == Status.VIOLATED


def test_corners_that_nearly_coincide_still_make_a_region() -> None:
    nearly = np.concatenate([CUBE, CUBE * [1.0, 1.0, 1.0 + 3e-12]])
    assert len(hull(nearly).mesh.vertices) >= 8  # the same corner twice is still a box


# ---- in the audit of a design


def local_pairs(result: Audit) -> list[Any]:
    return [pair for pair in result.pairs if pair.kind == "local"]


def test_a_box_above_a_platform_is_clear_and_around_it_is_violated() -> None:
    above = audit(fan({"exposure": [{"kind": "local", "box": [0.4, 0.4, 0.2]}]}))
    assert above.verdict == Status.CLEAR
    assert len(local_pairs(above)) == 3
    # The root's start ball, radius 0.1, is right below the box: 0.6 - 0.1 - 0.1 from its centre.
    assert local_pairs(above)[0].analytic_m == pytest.approx(0.4)
    around = audit(fan({"exposure": [{"kind": "local", "box": [0.4, 0.4, 1.3]}]}))
    assert around.verdict == Status.VIOLATED
    assert {(pair.a, pair.b) for pair in local_pairs(around) if pair.status == Status.VIOLATED} == {
        (0, 0),
        (1, 0),
        (2, 0),
    }


@pytest.mark.parametrize("excess", [1e-4, -1e-4])
def test_a_box_that_is_off_by_little_is_caught(excess: float) -> None:
    # Its lower face is where the start ball of the only module ends, plus the excess.
    one = Topology(((-1, -1, -1),))
    half = 0.6 - 0.1 + excess
    box = {"kind": "local", "box": [0.3, 0.3, 2 * half]}
    result = audit(design(one, {"exposure": [box], "end_effector": {"exclusion": False}}, hinges=()))
    (pair,) = local_pairs(result)
    assert pair.analytic_m == pytest.approx(-excess, abs=1e-12)
    assert pair.status == (Status.VIOLATED if excess > 0 else Status.CLEAR)


def test_a_region_is_the_same_as_a_box_or_by_its_corners_in_any_order() -> None:
    half = CUBE * [0.2, 0.15, 0.1]
    shuffled = np.random.default_rng(0).permutation(np.concatenate([half, 0.5 * half]))
    box, points = (
        local_pairs(audit(fan({"exposure": [{"kind": "local", **shape}]})))
        for shape in ({"box": [0.4, 0.3, 0.2]}, {"vertices": shuffled.tolist()})
    )
    for one, other in zip(box, points, strict=True):
        assert one.analytic_m == pytest.approx(other.analytic_m, abs=1e-12)
        assert one.status == other.status


def test_a_region_may_lie_aside_of_the_end_effector() -> None:
    corners = CUBE * 0.05 + [0.0, 0.0, -0.6]  # around the root's centre
    result = audit(fan({"exposure": [{"kind": "local", "vertices": corners.tolist()}]}))
    statuses = {pair.a: pair.status for pair in local_pairs(result)}
    assert statuses[0] == Status.VIOLATED
