"""Geometry first: hinges are placed where no envelopes overlap."""

import numpy as np
import pytest
from nlp_cases import push, random_tree

from nlp.geometry import poses
from nlp.placing import ENOUGH, place
from topo_search.topologies import sample
from verify.bodies import ConeSphere
from verify.clearance import clearances


def least_clearance(task, topology, alpha):
    """The least clearance of all pairs of envelopes, by the audit's closed form [m]."""
    R, p = poses(topology, np.eye(3), alpha, task.module.connector_distance)
    air = task.module.envelope
    bodies = [
        ConeSphere(p_i, -air.length * R_i[:, 2], air.start_radius, air.growth)
        for R_i, p_i in zip(R, p, strict=True)
    ]
    pairs = [(bodies[i], bodies[j]) for i in range(topology.n) for j in range(i)]
    return float(np.min(clearances(pairs).d))


@pytest.mark.parametrize("number", range(5))
def test_twelve_modules_are_freed_of_overlaps(number):
    task = push(12, module={"connector_distance": 0.22}, search={"body_clearance": False})
    topology = sample(12, 5, seed=3)[number]
    flat = np.zeros(11)
    alpha = place(task, topology, flat, np.random.default_rng(number))
    assert np.all(np.abs(alpha) <= np.pi / 2)
    assert least_clearance(task, topology, alpha) >= ENOUGH * task.module.arm_length - 1e-9


def test_body_clearance_is_kept_between_modules_that_are_not_bolted():
    task = push(8, module={"connector_distance": 0.22})
    topology = sample(8, 1, seed=1)[0]
    alpha = place(task, topology, np.zeros(7), np.random.default_rng(0))
    _, p = poses(topology, np.eye(3), alpha, task.module.connector_distance)
    assert task.body_clearance is not None
    for i in range(8):
        for j in range(i):
            if (j, i) not in topology.bolted:
                assert np.linalg.norm(p[i] - p[j]) >= task.body_clearance


def test_in_the_ablation_only_centres_count():
    """Flat platforms overlap with their airflow but not with their centres: nothing is turned."""
    task = push(4, module={"connector_distance": 0.22}, search={"interference": "separation"})
    topology = sample(4, 1, seed=0)[0]
    alpha = np.full(3, 0.01)
    np.testing.assert_array_equal(place(task, topology, alpha, np.random.default_rng(0)), alpha)


def test_one_seed_one_placing():
    rng = np.random.default_rng(2)
    topology = random_tree(10, rng)
    task = push(10, search={"connectors": "any"})
    first, second = (place(task, topology, np.zeros(9), np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
