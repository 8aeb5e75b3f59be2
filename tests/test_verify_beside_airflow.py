"""Rigid parts beside other modules' airflow: measured exactly, proven either way, and never wrong."""

import numpy as np
import pytest
from verify_airflow_families import module
from verify_cases import design

from topo_search.model import Status, Topology
from verify import audit
from verify.beside_airflow import beside_airflow, certify_beside
from verify.bodies import ConeSphere
from verify.certificate import Solid
from verify.compounds import Compound
from verify.convex import box
from verify.parts import bounding_box
from verify.requirements import Scene


def two_modules(own, envelope, R, centre):
    """The parts of two modules, the first of which stands anywhere; the other one's envelope is given."""
    body = Compound(own, bounding_box(own), 5)
    return (body.place(R, centre), body.place(np.eye(3), np.zeros(3))), [envelope, envelope]


@pytest.mark.parametrize("hub", [False, True])
def test_beside_slivers_nothing_is_proven(hub):
    """No face of so thin a needle has a direction: beside airflow it is undecided, near as well as far."""
    rng = np.random.default_rng(3)
    own = list(module(1.0, rng))
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
