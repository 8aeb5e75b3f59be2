"""Rigid parts beside other modules' airflow: measured exactly, proven either way, and never wrong."""

import math

import numpy as np
import pytest
from nlp_cases import as_design, push, random_point, random_tree
from verify_airflow_families import module
from verify_cases import design, failing, fan

from nlp import names
from nlp.evaluation import violations
from nlp.numbers.geometry import ranges
from topo_search.model import Status, Topology
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside
from verify.bodies import ConeSphere
from verify.certificate import RoundBody
from verify.compounds import Compound
from verify.convex import box
from verify.parts import bounding_box
from verify.requirements import PlacedAir, Scene


def two_modules(own, envelope, R, centre):
    """The parts of two modules, the first of which stands anywhere; the other one's envelope is given."""
    body = Compound(own, bounding_box(own), 5)
    return (body.place(R, centre), body.place(np.eye(3), np.zeros(3))), [
        PlacedAir(i, None, envelope) for i in (0, 1)
    ]


@pytest.mark.parametrize("hub", [False, True])
def test_beside_slivers_nothing_is_proven(hub):
    """No face of so thin a needle has a direction: beside airflow it is undecided, near as well as far."""
    rng = np.random.default_rng(3)
    own = list(module(1.0, rng))
    own[0 if hub else 2] = box("needle", np.zeros(3), np.diag([1.0, 1e-10, 1e-10]))
    for away in (0.3, 30.0):
        envelope = RoundBody(ConeSphere(np.array([0.0, 0.0, away]), np.array([0.0, 0.0, 10.0]), 0.5, 0.5))
        modules, envelopes = two_modules(tuple(own), envelope, np.eye(3), np.zeros(3))
        certificates = certify_beside(list(beside_airflow(modules, envelopes, counts=True)))
        assert {certificate.status for certificate in certificates} == {Status.UNDECIDED}


def test_a_search_that_ends_early_proves_no_more_than_its_planes(monkeypatch):
    """From the first ball of airflow alone, parts beside the last one seem farther away than they are."""
    rng, claims = np.random.default_rng(5), 0
    envelope = RoundBody(ConeSphere(np.zeros(3), np.array([0.0, 0.0, -10.0]), 1.0, 0.5))
    for _ in range(10):
        centre = np.array([rng.uniform(3.0, 6.0), rng.uniform(-1.0, 1.0), rng.uniform(-9.0, -1.0)])
        checks = list(beside_airflow(*two_modules(module(1.0, rng), envelope, np.eye(3), centre), counts=True))[:5]
        true = certify_beside(checks)
        with monkeypatch.context() as patched:
            patched.setattr("verify.beside_airflow._nearest_eta", lambda part, K: np.zeros(len(K.r)))
            found = certify_beside(checks)
        for is_true, claimed in zip(true, found, strict=True):
            claims += claimed.analytic > is_true.upper + 1e-3
            assert claimed.lower is None or claimed.lower <= is_true.upper + 1e-9
    assert claims > 20


def test_beyond_the_range_of_proofs_nothing_is_proven():
    rng = np.random.default_rng(4)
    for centre in ([1e7, 0.0, 0.0], [1e200, 0.0, 0.0], [np.inf, 0.0, 0.0], [np.nan, 0.0, 0.0]):
        far = RoundBody(ConeSphere(np.zeros(3), np.array([0.0, 0.0, -10.0]), 1.0, 0.5)).place(
            np.eye(3), np.array(centre)
        )
        modules, envelopes = two_modules(module(1.0, rng), far, np.eye(3), np.zeros(3))
        with np.errstate(over="ignore", invalid="ignore"):
            certificates = certify_beside(list(beside_airflow(modules, envelopes, counts=True)))
        assert {certificate.status for certificate in certificates} == {Status.UNDECIDED}


FOUND = (-0.833, 0.5528, -0.0028, 1.1369, 0.1293, -0.0235, -0.0235)
"""Hinge angles of a design of eight modules for ten wrenches that was found when nothing kept rotors out."""


def found_without(task):
    """That design's shape, with inputs of no consequence."""
    stated = {"module": {"connector_distance": 0.22}, **task}
    return design(Topology.from_key("a74404100"), stated, hinges=FOUND, end_effector=(0.0, 0.0, 3.0))


def test_a_rotor_deep_in_another_modules_airflow_is_found_and_counts():
    """All that is compared otherwise is clear: airflow with airflow, centres, rigid parts."""
    rows = audit(found_without({})).pairs
    odd = [pair for pair in rows if pair.status != Status.CLEAR and pair.kind != "rod-airflow"]
    assert {pair.kind for pair in odd} == {"rotor-airflow"}
    assert {(pair.a, pair.b) for pair in odd} == {(3, 4)}
    assert min(pair.analytic_m for pair in odd) < -0.04
    deepest = min(odd, key=lambda pair: pair.analytic_m)
    assert deepest.name == f"rotor {deepest.segment} of module 3 and airflow of module 4"
    counted = {row.counts for row in requirements(found_without({}))}
    assert counted == {True}
    assert {row.counts for row in requirements(found_without({"search": {"body_clearance": False}}))} == {False}


def requirements(given):
    """What of rigid parts is compared with airflow."""
    scene = Scene(given)
    return beside_airflow(scene.modules, scene.envelopes, counts=given.task.body_clearance is not None)


# ---- Airflows that may merge: the audit asks for parts out of other modules' airflow, and for nothing else of it.

SQUARE = Topology(((-1, -1, -1), (0, 0, 2), (0, 1, 3), (1, 1, 3)))
CHAIN = Topology(((-1, -1, -1), (0, 0, 2), (1, 0, 2)))
PARTS = {"search": {"interference": "parts"}}


def in_the_way(result):
    """The modules whose parts are in the airflow of others, with these."""
    return {(p.a, p.b) for p in result.pairs if p.kind == "rotor-airflow" and p.status == Status.VIOLATED}


def test_a_flat_lattice_is_clear_where_airflow_may_merge():
    flat = {"hinges": (0.0, 0.0, 0.0), "end_effector": (0.16, 0.16, 0.6)}
    wide = {"module": {"connector_distance": 0.16}}
    merging, apart = (audit(design(SQUARE, {**wide, **search}, **flat)) for search in (PARTS, {}))
    assert (merging.verdict, apart.verdict) == (Status.CLEAR, Status.VIOLATED)
    assert failing(apart) == {"airflow"}
    assert not any(pair.kind == "airflow" for pair in merging.pairs)
    assert merging.interference is None
    assert apart.interference.colliding_pairs == 4  # not the diagonals
    assert sum(pair.kind == "rotor-airflow" for pair in merging.pairs) == 4 * 3 * 5


@pytest.mark.parametrize(("fold", "expected"), [(math.pi / 2, set()), (-math.pi / 2, {(0, 2), (2, 0)})])
def test_of_two_modules_face_to_face_only_airflow_that_blows_at_the_other_one_is_in_the_way(fold, expected):
    """The last module is upside down above the first one, or below it."""
    task = {"module": {"connector_distance": 0.16}, **PARTS}
    result = audit(design(CHAIN, task, hinges=(-fold, -fold), end_effector=(0.16, 0.5, 0.0)))
    assert in_the_way(result) == expected
    names = {p.name for p in result.pairs if p.status == Status.VIOLATED and p.kind == "rotor-airflow"}
    assert ("hub and arms of module 0 and airflow of module 2" in names) == bool(expected)


@pytest.mark.parametrize("spare", [1e-3, -1e-3])
def test_a_rim_that_grazes_a_neighbours_airflow_is_measured_exactly(spare):
    """Flat, the lower edge of a rim is nearest: rho sqrt(1 - k^2) - k height / 2 - r_air, k = tan(spread / 2).

    rho is its distance from the neighbour's axis.
    """
    k, a = math.tan(math.radians(5.0)), 0.1 / math.sqrt(2)
    rho = math.hypot(0.3 - a, a) - 0.05
    radius = rho * math.sqrt(1 - k * k) - 0.01 * k - spare
    for search in (PARTS, {"search": {"interference": "parts", "body_clearance": False}}):
        task = {"module": {"airflow": {"start_radius": radius}}, **search}
        result = audit(design(CHAIN, task, hinges=(0.0, 0.0), end_effector=(0.3, 0.0, 0.6)))
        least = min((p for p in result.pairs if p.kind == "rotor-airflow"), key=lambda p: p.analytic_m)
        assert least.analytic_m == pytest.approx(spare, abs=1e-9)
        assert result.verdict == (Status.CLEAR if spare > 0 else Status.VIOLATED)


def test_airflow_at_the_rod_and_the_end_effector_counts_as_before():
    below = {**PARTS, "end_effector": {"rod": "straight"}}
    result = audit(fan(below, end_effector=(0.0, 0.0, -0.6)))
    assert {p.kind for p in result.pairs if p.status == Status.VIOLATED} == {"rod-airflow"}
    assert result.verdict == Status.VIOLATED


@pytest.mark.parametrize("seed", range(12))
def test_what_the_solver_keeps_clear_the_audit_finds_clear(seed):
    """Modules not bolted together by balls around their parts, the others by their hinge's range."""
    rng = np.random.default_rng([7, seed])
    module = {"airflow": {"start_radius": float(rng.uniform(0.05, 0.15))}}
    task = push(4, search={"interference": "parts"}, module=module)
    topology = random_tree(4, rng, aligned=True)
    point = random_point(task, topology, rng)
    low, high = (np.array(side) for side in ranges(task, topology))
    point.alpha[:] = rng.uniform(low, high)
    kept = {check.name: -check.amount for check in violations(point)}
    for row in audit(as_design(point)).pairs:
        if row.kind == "rotor-airflow" and (min(row.a, row.b), max(row.a, row.b)) in topology.bolted:
            assert row.status == Status.CLEAR
        elif row.kind == "rotor-airflow":
            assert row.analytic_m > 0 or kept[names.rotor_airflow(row.a, row.b)] < 1e-9
