"""The closed form of the clearance, against hand calculation, golden section and supporting planes."""

import math

import numpy as np
import pytest
from verify_cases import FAMILIES, brute_clearance, random_pair, unit

from verify.bodies import AllowedCone, ConeSphere, ball, clearances, cone_clearance


def clearance(A: ConeSphere, B: ConeSphere) -> float:
    return float(clearances([(A, B)]).d[0])


def body(o, d, r, dr=0.0) -> ConeSphere:
    return ConeSphere(np.array(o, dtype=float), np.array(d, dtype=float), r, dr)


@pytest.mark.parametrize(
    ("A", "B", "expected"),
    [
        (ball(np.zeros(3), 1.0), ball(np.array([3.0, 4.0, 0.0]), 1.5), 2.5),
        (ball(np.zeros(3), 1.0), ball(np.zeros(3), 0.5), -1.5),
        # Capsules: parallel side by side, crossing at right angles, end to end.
        (body([0, 0, 0], [0, 0, 4], 1), body([3, 0, 1], [0, 0, 4], 1), 1.0),
        (body([-2, 0, 0], [4, 0, 0], 1), body([0, -2, 5], [0, 4, 0], 0.5), 3.5),
        (body([0, 0, 0], [0, 0, 4], 1), body([0, 0, 9], [0, 0, 4], 1), 3.0),
        # A cone-sphere of half-angle arcsin(3/5) about x; the ball touches it half-way along the slant.
        (body([0, 0, 0], [5, 0, 0], 1, 3), ball(np.array([2.5 - 0.6 * 3.5, 0.8 * 3.5, 0.0]), 1.0), 0.0),
        # Axes that intersect: as deep as the two radii where they do.
        (body([-1, 0, 0], [2, 0, 0], 1), body([0, -1, 0], [0, 2, 0], 0.5), -1.5),
        # Growth as large as length: the far ball holds all the others.
        (body([0, 0, 0], [2, 0, 0], 1, 2), ball(np.array([-3.0, 0.0, 0.0]), 0.5), 1.5),
        (body([0, 0, 0], [2, 0, 0], 1, 2), body([0, 0, 0], [2, 0, 0], 1, 2), -6.0),
    ],
)
def test_by_hand(A, B, expected):
    assert clearance(A, B) == pytest.approx(expected, abs=1e-14)
    assert clearance(B, A) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("family", FAMILIES)
def test_equals_golden_section(family):
    rng = np.random.default_rng(11)
    pairs = [random_pair(family, rng) for _ in range(50)]
    found, slow = clearances(pairs).d, brute_clearance(pairs)
    assert np.abs(found - slow).max() < 2e-9
    assert (found - slow).max() < 1e-13  # golden section can only stop too early


@pytest.mark.parametrize("half_angle_deg", [5.0, 60.0, 90.0])
def test_s_is_the_distance_to_the_surface_inside(half_angle_deg):
    rng = np.random.default_rng(14)
    cone = AllowedCone(rng.normal(size=3), unit(rng), half_angle_deg)
    theta = math.radians(half_angle_deg)
    for _ in range(100):
        x = cone.apex + 3 * unit(rng)
        e = cone.direction_across(x)
        generator = math.cos(theta) * cone.axis + math.sin(theta) * e
        q = x - cone.apex
        distance = float(np.linalg.norm(q - max(0.0, q @ generator) * generator))
        inside = q @ cone.axis > math.cos(theta) * 3
        if inside:
            assert cone.s(x) == pytest.approx(distance, abs=1e-12)
        else:
            assert -distance - 1e-12 <= cone.s(x) <= 1e-12
        assert cone.s(x) == pytest.approx(cone.inward_normal(x) @ q, abs=1e-12)


def test_the_cone_clearance_is_the_least_over_the_whole_body():
    rng = np.random.default_rng(15)
    for _ in range(50):
        cone = AllowedCone(rng.normal(size=3), unit(rng), float(rng.uniform(5, 90)))
        A, _ = random_pair("generic", rng)
        eta = np.linspace(0, 1, 101)
        every_ball = cone.s(A.o + eta[:, None] * A.d) - A.r - eta * A.dr
        d, worst = cone_clearance(A, cone)
        assert d == pytest.approx(every_ball.min(), abs=1e-12)
        assert worst in (0.0, 1.0)
