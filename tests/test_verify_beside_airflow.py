"""Rigid parts beside other modules' airflow: measured exactly, proven either way, and never wrong."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from suites import few
from verify_cases import design

from topo_search.model import Status, Topology
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside, parts_of
from verify.bodies import ConeSphere
from verify.certificate import FLOOR, Solid
from verify.compounds import Compound
from verify.convex import box, cylinder
from verify.parts import bounding_box
from verify.requirements import Scene


def random_rotation(rng):
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else -Q


def module(rng, scale):
    """Parts in a module's frame: a hub, four arms and four rotors of random sizes [l_arm]."""
    size = scale * rng.uniform(0.05, 1.0)
    hub = box("hub", scale * rng.normal(size=3) * 0.1, scale * np.diag(rng.uniform(0.01, 0.6, 3)))
    turned = random_rotation(rng)
    arms = [
        box(f"arm {k}", scale * rng.normal(size=3) * 0.5, scale * rng.uniform(0.02, 0.5, 3)[:, None] * turned)
        for k in range(4)
    ]
    places = scale * rng.normal(size=(4, 3))
    up = np.array([0.0, 0.0, 1.0])
    height = scale * 10 ** rng.uniform(-3, 0)
    rotors = [cylinder(f"rotor {k}", place, up, size, height) for k, place in enumerate(places)]
    return (hub, *arms, *rotors)


def two_modules(own, envelope, R, centre):
    """The parts of two modules, the first of which stands anywhere; the other one's envelope is given."""
    body = Compound(own, bounding_box(own), 5)
    return (body.place(R, centre), body.place(np.eye(3), np.zeros(3))), [envelope, envelope]


def oracle(part, body, R, centre):
    """The clearance of a part from a cone-sphere by another way: SciPy's search along the axis."""

    def distance(eta):
        p = R.T @ (body.centre(eta) - centre)
        if part.disc > 0:
            q = p - part.centre
            rho, z = np.hypot(q[0], q[1]), abs(q[2]) - np.ptp(part.vertices[:, 2]) / 2
            return np.hypot(max(rho - part.disc, 0.0), max(z, 0.0)) - body.radius(eta)
        axes = part.half / np.linalg.norm(part.half, axis=1)[:, None]
        q = np.abs(axes @ (p - part.centre)) - np.linalg.norm(part.half, axis=1)
        return np.linalg.norm(np.maximum(q, 0.0)) - body.radius(eta)

    etas = np.linspace(0.0, 1.0, 33)
    values = [distance(eta) for eta in etas]
    k = int(np.argmin(values))
    near = etas[max(k - 1, 0)], etas[min(k + 1, 32)]
    found = minimize_scalar(distance, bounds=near, method="bounded", options={"xatol": 1e-13})
    return min(found.fun, values[0], values[-1], values[k])


def checked(certificate, d):
    """No wrong verdict, and none missing beyond the floor."""
    assert certificate.status != Status.INCONSISTENT
    assert certificate.analytic == pytest.approx(d, abs=1e-9 * (1 + abs(d)))
    if certificate.status == Status.CLEAR:
        assert d > 0
        assert 0 < certificate.lower <= d + 1e-9
        assert certificate.upper >= d - 1e-9
    elif certificate.status == Status.VIOLATED:
        assert d < 0
        assert certificate.upper >= d - 1e-9
    else:
        assert abs(d) <= 1.01 * FLOOR


@pytest.mark.parametrize("scale", few([1.0, 1e-3, 30.0], 1))
def test_verdicts_are_those_of_another_way(scale):
    """Random parts and envelopes, as drawn and moved along the normal to within a hair of touching."""
    rng = np.random.default_rng(7)
    seen = set()
    for k in range(6):
        own, R, centre = module(rng, scale), random_rotation(rng), rng.normal(size=3) * scale
        axis = rng.normal(size=3)
        axis *= scale * 10 ** rng.uniform(-1, 1.5) / np.linalg.norm(axis)
        dr = [0.0, 0.0875, 0.9][k % 3] * float(np.linalg.norm(axis))
        envelope = Solid(ConeSphere(rng.normal(size=3) * scale * 3, axis, scale * 10 ** rng.uniform(-1.5, 0.5), dr))
        rotor = own[5 + k % 4]
        away = R @ rotor.centre + centre - envelope.body.centre(rng.uniform())
        away /= np.linalg.norm(away)
        for wanted in (None, 1e-2, 1e-5, 3e-7, -3e-7, -1e-4):
            moved = centre
            if wanted is not None:  # as far away as it takes for the rotor to be that clear
                low, high = -10.0 * scale, 40.0 * scale + float(np.linalg.norm(axis))
                for _ in range(45):
                    middle = (low + high) / 2
                    less = oracle(rotor, envelope.body, R, centre + middle * away) < wanted
                    low, high = (middle, high) if less else (low, middle)
                moved = centre + high * away
            modules, envelopes = two_modules(own, envelope, R, moved)
            asked = list(beside_airflow(modules, envelopes, counts=True))
            for row, certificate in zip(asked[:5], certify_beside(asked), strict=False):
                least = min(oracle(part.copied[0], envelope.body, R, moved) for part in parts_of(row))
                checked(certificate, least)
                seen.add(certificate.status)
    assert {Status.CLEAR, Status.VIOLATED} <= seen


@pytest.mark.parametrize("hub", [False, True])
def test_beside_slivers_nothing_is_proven(hub):
    """No face of so thin a needle has a direction: beside airflow it is undecided, near as well as far."""
    rng = np.random.default_rng(3)
    own = list(module(rng, 1.0))
    own[0 if hub else 2] = box("needle", np.zeros(3), np.diag([1.0, 1e-10, 1e-10]))
    for away in (0.3, 30.0):
        envelope = Solid(ConeSphere(np.array([0.0, 0.0, away]), np.array([0.0, 0.0, 10.0]), 0.5, 0.5))
        modules, envelopes = two_modules(tuple(own), envelope, np.eye(3), np.zeros(3))
        certificates = certify_beside(list(beside_airflow(modules, envelopes, counts=True)))
        assert {certificate.status for certificate in certificates} == {Status.UNDECIDED}


def test_beyond_the_range_of_proofs_nothing_is_proven():
    rng = np.random.default_rng(4)
    for centre in ([1e7, 0.0, 0.0], [1e200, 0.0, 0.0], [np.inf, 0.0, 0.0], [np.nan, 0.0, 0.0]):
        far = Solid(ConeSphere(np.zeros(3), np.array([0.0, 0.0, -10.0]), 1.0, 0.5)).place(
            np.eye(3), np.array(centre)
        )
        modules, envelopes = two_modules(module(rng, 1.0), far, np.eye(3), np.zeros(3))
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
