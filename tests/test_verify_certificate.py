"""Proven verdicts: right in every family, near contact, and when a witness lies."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from suites import few
from verify_cases import FAMILIES, GAPS, SCALES, at_clearance, brute_clearance, nearly_touching, random_pair, unit

import verify.certificate
import verify.cones
from topo_search.model import Status
from verify.bodies import AllowedCone, ConeSphere, NearestOnAxes, ball, clearances, cone_clearance
from verify.certificate import FLOOR, Certificate, RoundBody, certify_pairs
from verify.cones import certify_inside
from verify.meshes import LARGEST_COORDINATE, FclPolytope

AWKWARD = ("generic", "nearly parallel", "growth as large as length", "nested")
"""Families of which the fast suite has examples: those that the others are limits of."""


def hold(certificate: Certificate, d: float) -> None:
    """The verdict is that of an independent value d, and the bounds hold it."""
    assert certificate.status == (Status.CLEAR if d > 0 else Status.VIOLATED), (certificate, d)
    assert d <= certificate.upper + 1e-8
    if d > 0:
        assert 0 < certificate.lower <= d + 1e-8
    else:
        assert certificate.lower is None
        assert certificate.upper < 0


def check_family(family: str, seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = [random_pair(family, rng) for _ in range(count)]
    slow = brute_clearance(pairs)
    certificates = certify_pairs([(RoundBody(A), RoundBody(B)) for A, B in pairs])
    for certificate, d in zip(certificates, slow, strict=True):
        if abs(d) > FLOOR:
            hold(certificate, d)
    near = [at_clearance(*pair, sign * size) for pair in pairs for size in GAPS for sign in (1, -1)]
    for (A, B), d in zip(near, brute_clearance(near), strict=True):
        if abs(d) > FLOOR:
            hold(certify_pairs([(RoundBody(A), RoundBody(B))])[0], d)


@pytest.mark.parametrize("family", few(FAMILIES, AWKWARD))
def test_no_verdict_is_wrong_and_none_is_missing(family):
    check_family(family, seed=21, count=1)


@pytest.mark.parametrize(
    ("family", "scale"), few(product(FAMILIES, SCALES), [("generic", 0.1), ("fat", 0.1), ("nested", 10.0)])
)
def test_bodies_of_any_size_are_judged_right(family, scale):
    pairs = nearly_touching(family, scale, np.random.default_rng(28))
    certificates = certify_pairs([(RoundBody(A), RoundBody(B)) for A, B in pairs])
    for certificate, d in zip(certificates, brute_clearance(pairs), strict=True):
        if abs(d) > FLOOR:
            hold(certificate, d)
        else:
            assert certificate.status in {Status.UNDECIDED, Status.CLEAR if d > 0 else Status.VIOLATED}


@pytest.mark.parametrize("family", few(FAMILIES, AWKWARD))
def test_copies_of_a_body_are_judged_like_the_body(family):
    """FCL then holds one polytope for all of them, turned and moved; a copy may be copied again."""
    rng = np.random.default_rng(31)
    for A, B in nearly_touching(family, 1.0, rng):
        R, S = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
        R, S, p = R * np.linalg.det(R), S * np.linalg.det(S), rng.normal(size=3)
        copies = [RoundBody(ConeSphere((X.o - p) @ R, X.d @ R, X.r, X.dr)).place(R, p) for X in (A, B)]
        once_more = [copy.place(S, -p) for copy in copies]
        (certificate,) = certify_pairs([(RoundBody(A), RoundBody(B))])
        for found in certify_pairs([tuple(copies), tuple(once_more)]):
            assert found.analytic == pytest.approx(certificate.analytic, abs=1e-9)
            if abs(certificate.analytic) > 2 * FLOOR:
                assert found.status == certificate.status
                hold(found, certificate.analytic)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_no_verdict_is_wrong_and_none_is_missing_at_length(family):
    check_family(family, seed=22, count=120)


@pytest.mark.parametrize("family", FAMILIES)
def test_under_the_floor_a_verdict_is_right_or_missing(family):
    rng = np.random.default_rng(23)
    for gap in (0.0, 1e-9, -1e-9, 1e-11, -1e-11):
        A, B = at_clearance(*random_pair(family, rng), gap)
        d = clearances([(A, B)]).d[0]
        (certificate,) = certify_pairs([(RoundBody(A), RoundBody(B))])
        right = Status.CLEAR if d > 0 else Status.VIOLATED
        assert certificate.status in ({right, Status.UNDECIDED} if abs(d) <= FLOOR else {right})
        if abs(d) < 1e-10:
            assert certificate.status == Status.UNDECIDED


def test_far_pairs_need_one_mesh_and_touching_ones_a_turned_one():
    a = ball(np.zeros(3), 1.0)
    far, near = certify_pairs(
        [(RoundBody(a), RoundBody(ball(np.array([x, 0.0, 0.0]), 1.0))) for x in (5.0, 2.0 + 1e-6)]
    )
    assert (far.level, near.level) == (0, 1)
    assert near.lower == pytest.approx(1e-6, abs=1e-9)
    assert near.upper == pytest.approx(1e-6, abs=1e-9)


def test_a_body_beyond_the_range_of_the_proof_is_undecided():
    a = RoundBody(ball(np.zeros(3), 1.0))
    for far in (LARGEST_COORDINATE, 1e150, 1e300):
        with np.errstate(over="ignore", invalid="ignore"):
            (certificate,) = certify_pairs([(a, RoundBody(ball(np.array([far, 0.0, 0.0]), 1.0)))])
        assert certificate.status == Status.UNDECIDED


LIES = {
    "too large": lambda found: found._replace(d=found.d + 0.5),
    "too small": lambda found: found._replace(d=found.d - 0.5),
    "another sign": lambda found: found._replace(d=-found.d),
    "elsewhere": lambda found: found._replace(eta=1 - found.eta, gamma=1 - found.gamma),
    "nothing": lambda found: NearestOnAxes(*(np.full_like(column, np.nan) for column in found)),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_wrong_closed_form_is_never_believed(lie, monkeypatch):
    rng = np.random.default_rng(24)
    pairs = [random_pair("generic", rng) for _ in range(40)]
    slow = brute_clearance(pairs)
    monkeypatch.setattr(verify.certificate, "clearances", lambda given: LIES[lie](clearances(given)))
    with np.errstate(invalid="ignore"):
        found = certify_pairs([(RoundBody(A), RoundBody(B)) for A, B in pairs])
    for certificate, d in zip(found, slow, strict=True):
        if certificate.status == Status.CLEAR:
            assert d > 0
        if certificate.status == Status.VIOLATED:
            assert d < 0
    assert any(certificate.status == Status.INCONSISTENT for certificate in found)
    if lie != "elsewhere":  # a point elsewhere may still prove an overlap
        assert all(certificate.status == Status.INCONSISTENT for certificate in found)


@pytest.mark.parametrize("answer", [True, False])
def test_a_wrong_fcl_is_never_believed(answer, monkeypatch):
    rng = np.random.default_rng(25)
    pairs = [random_pair("generic", rng) for _ in range(40)]
    monkeypatch.setattr(FclPolytope, "overlaps", lambda self, other: answer)
    for certificate, d in zip(
        certify_pairs([(RoundBody(A), RoundBody(B)) for A, B in pairs]), brute_clearance(pairs), strict=True
    ):
        fcl_is_right = (d < 0) == answer
        expected = Status.INCONSISTENT
        if fcl_is_right:
            expected = Status.CLEAR if d > 0 else Status.VIOLATED
        assert certificate.status == expected


def test_a_mesh_that_fails_its_check_proves_nothing(monkeypatch):
    a, b = (RoundBody(ball(np.array([x, 0.0, 0.0]), 1.0)) for x in (0.0, 5.0))
    monkeypatch.setattr(verify.certificate, "encloses", lambda mesh, body: False)
    assert certify_pairs([(a, b)])[0].status == Status.INCONSISTENT


def cone_cases(rng: np.random.Generator) -> SimpleNamespace:
    """A cone and a body on or off its axis, with the direction that moves the body straight into the cone."""
    half_angle = float(rng.choice([1.0, 30.0, 60.0, 89.9, 90.0]))
    cone = AllowedCone(rng.normal(size=3), unit(rng), half_angle)
    L, r = rng.uniform(1, 14), rng.uniform(0.1, 2)
    on_axis = rng.random() < 0.3
    across = np.zeros(3) if on_axis else rng.normal(size=3)
    d = L * (cone.axis if on_axis else unit(rng))
    return SimpleNamespace(cone=cone, body=ConeSphere(cone.apex + across, d, r, L * rng.uniform(0, 0.2)))


def test_bodies_in_cones_are_judged_right_down_to_the_floor():
    rng = np.random.default_rng(26)
    for _ in range(60):
        case = cone_cases(rng)
        for gap in (float(rng.uniform(-3, 3)), 1e-2, -1e-2, 1e-4, -1e-4, 1e-6, -1e-6):
            d, _ = cone_clearance(case.body, case.cone)
            sin, _ = case.cone.sin_cos
            body = case.body.move((gap - d) / sin * case.cone.axis)  # s grows by sin(theta) a step along the axis
            d, _ = cone_clearance(body, case.cone)
            hold(certify_inside(RoundBody(body), case.cone), d)


def test_a_ball_on_the_axis_touches_the_cone_all_the_way_round():
    cone = AllowedCone(np.zeros(3), np.array([0.0, 0.0, 1.0]), 30.0)
    for gap, status in ((1.5e-7, Status.CLEAR), (-1.5e-7, Status.VIOLATED), (0.0, Status.UNDECIDED)):
        body = ball(np.array([0.0, 0.0, 2 * (2.1 + gap)]), 2.1)
        assert certify_inside(RoundBody(body), cone).status == status


def test_behind_the_apex_is_outside():
    cone = AllowedCone(np.zeros(3), np.array([0.0, 0.0, 1.0]), 60.0)
    certificate = certify_inside(RoundBody(ball(np.array([0.0, 0.0, -5.0]), 0.1)), cone)
    assert certificate.status == Status.VIOLATED
    assert certificate.upper == pytest.approx(certificate.analytic)


def test_a_wrong_cone_value_is_never_believed(monkeypatch):
    rng = np.random.default_rng(27)
    for shift in (5.0, -5.0):
        for _ in range(20):
            case = cone_cases(rng)
            d, worst = cone_clearance(case.body, case.cone)
            lie = d + shift, worst
            monkeypatch.setattr(verify.cones, "cone_clearance", lambda *_, lie=lie: lie)
            assert certify_inside(RoundBody(case.body), case.cone).status == Status.INCONSISTENT


# ---- evidence


def test_a_disagreement_is_written_out_with_what_each_side_says(monkeypatch):
    A, B = ConeSphere(np.zeros(3), np.array([0.0, 0.0, -5.0]), 1.0, 0.5), ball(np.array([4.0, 0.0, -1.0]), 0.3)

    def certificate():
        return certify_pairs([(RoundBody(A), RoundBody(B))])[0]

    assert certificate().evidence == ()
    monkeypatch.setattr(FclPolytope, "overlaps", lambda self, other: True)
    first, *levels = certificate().evidence
    assert f"clearance {clearances([(A, B)]).d.tolist()[0]!r} at" in first
    assert len(levels) == 4
    assert all("not confirmed by FCL" in line for line in levels)
    monkeypatch.setattr(verify.certificate, "encloses", lambda mesh, body: False)
    assert "level 1: a mesh fails its own check" in certificate().evidence


@pytest.mark.parametrize("half_angle", [60.0, 90.0])
def test_a_disagreement_about_a_cone_is_written_out(half_angle, monkeypatch):
    cone = AllowedCone(np.zeros(3), np.array([0.0, 0.0, 1.0]), half_angle)
    inside, outside = (RoundBody(ball(np.array([0.0, 0.0, z]), 0.5)) for z in (3.0, -3.0))
    assert certify_inside(inside, cone).evidence == certify_inside(outside, cone).evidence == ()
    with monkeypatch.context() as patch:
        patch.setattr(FclPolytope, "overlaps", lambda self, other: True)
        assert all("not confirmed by FCL" in line for line in certify_inside(inside, cone).evidence[1:])
        assert certify_inside(outside, cone).evidence == ()
    monkeypatch.setattr(verify.cones, "cone_clearance", lambda *_: (-0.25, 1.0))
    assert "clearance -0.25 at" in certify_inside(inside, cone).evidence[0]
