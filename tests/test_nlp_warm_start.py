"""Designs carried over to other topologies: what the trees have in common stands as it stood."""

import math
from dataclasses import replace
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import ROOT, as_design, as_point, best_design, push, random_point, random_tree, solved, trees

from nlp import solve
from nlp.evaluation import violations, worst
from nlp.starts.random_starts import LEAST_INPUT, with_inputs
from nlp.starts.warm_start import common_subtrees, warm_start
from topo_search.model import Infeasible, Topology

ANY_PORT = {"search": {"connectors": "any"}}


def renumbered(topology, random):
    """The same platform from another root, in another order, some modules half turned."""
    graph = topology.graph()
    shift = [2 * random.randrange(2) for _ in range(topology.n)]
    order = [random.randrange(topology.n)]
    joints = [ROOT]
    while len(order) < topology.n:
        h, i = random.choice([(h, i) for h in order for i in graph[h] if i not in order])
        ports = graph.edges[h, i]["ports"]
        joints.append((order.index(h), (ports[h] + shift[h]) % 4, (ports[i] + shift[i]) % 4))
        order.append(i)
    return Topology(tuple(joints))


@settings(max_examples=60, deadline=None)
@given(trees(most=9), st.integers(0, 2**32))
def test_the_same_platform_under_another_root_keeps_every_pose(topology, seed):
    """Half turns of modules, other roots and the signs of hinges that are now entered from the other side."""
    rng = np.random.default_rng(seed)
    task = push(topology.n, **ANY_PORT)
    source = as_design(random_point(task, topology, rng))
    other = renumbered(topology, Random(seed))
    start = warm_start(task, other, source, rng)
    (R, p), (Q, q) = start.poses, as_point(source).poses
    (part,) = common_subtrees(other, topology)
    places = [part[i].module for i in range(other.n)]
    np.testing.assert_allclose(p - start.tip, q[places] - source.end_effector_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(R[:, :, 2], Q[places][:, :, 2], rtol=0, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(trees(most=12), trees(most=12))
def test_common_subtrees_are_disjoint_and_have_their_joints_in_both(one, other):
    parts = common_subtrees(one, other)
    for modules in (
        [i for part in parts for i in part],
        [place.module for part in parts for place in part.values()],
    ):
        assert len(set(modules)) == len(modules)
    assert all(len(part) >= len(smaller) >= 2 for part, smaller in pairwise(parts))
    joints = {((h, a), (i, b)) for h, i, a, b in other.edges()}
    for part in parts:
        inside = [joint for joint in one.edges() if joint[0] in part and joint[1] in part]
        assert len(inside) == len(part) - 1
        for h, i, a, b in inside:
            ends = [(part[m].module, (port + part[m].turns) % 4) for m, port in ((h, a), (i, b))]
            assert tuple(ends) in joints or tuple(ends[::-1]) in joints


def test_a_moved_leaf_leaves_the_others_where_they_are():
    """Module 4 moves from the end of a row to its middle, and the row is numbered from its other end."""
    donor_tree = Topology((ROOT, (0, 0, 2), (1, 0, 2), (2, 0, 2), (3, 0, 2)))
    tree = Topology((ROOT, (0, 2, 0), (1, 2, 0), (2, 2, 0), (1, 1, 3)))
    rng = np.random.default_rng(1)
    source = as_design(random_point(push(), donor_tree, rng))
    start = warm_start(push(), tree, source, rng)
    part, *rest = common_subtrees(tree, donor_tree)
    assert sorted(part) == [0, 1, 2, 3]
    assert not rest
    (_, p), (_, q) = start.poses, as_point(source).poses
    places = [part[i].module for i in range(4)]
    np.testing.assert_allclose(p[:4] - p[0], q[places] - q[places[0]], rtol=0, atol=1e-12)
    kept = [(p[0], q[places[0]]), (p.mean(axis=0), q.mean(axis=0))]
    others = [replace(start, tip=here + source.end_effector_m - there) for here, there in kept]
    assert min(np.abs(start.tip - other.tip).max() for other in others) < 1e-12
    assert (
        worst(violations(start)).rank <= min(worst(violations(with_inputs(other))).rank for other in others) + 1e-9
    )
    u_max = start.task.module.max_input(start.task.gravity)
    assert start.u.min() >= LEAST_INPUT * u_max
    assert start.u.shape == (3, 5, 4)


def test_a_flipped_connector_keeps_the_shape_and_changes_the_spins():
    """A quarter turn of a module at its joint moves no airflow."""
    task = push(3, **ANY_PORT)
    donor_tree, tree = Topology((ROOT, (0, 0, 2), (0, 1, 3))), Topology((ROOT, (0, 0, 1), (0, 1, 3)))
    source = as_design(random_point(task, donor_tree, np.random.default_rng(2)))
    start = warm_start(task, tree, source, np.random.default_rng(3))
    (R, p), (Q, q) = start.poses, as_point(source).poses
    np.testing.assert_allclose(p - start.tip, q - source.end_effector_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(R[:, :, 2], Q[:, :, 2], rtol=0, atol=1e-12)
    assert not np.allclose(R[1], Q[1])


@pytest.mark.parametrize("name", ["paper root", "fixed end-effector", "another size"])
def test_a_start_keeps_to_its_own_task(name):
    fields = {
        "paper root": {"search": {"root": "paper"}},
        "fixed end-effector": {"end_effector": {"position": [0.1, 0.1, 0.3]}},
        "another size": {"module": {"connector_distance": 0.22}},
    }[name]
    task, rng = push(5, **fields), np.random.default_rng(5)
    n = 7 if name == "another size" else 5
    source = as_design(random_point(push(n), random_tree(n, rng, aligned=True), rng))
    start = warm_start(task, random_tree(5, rng, aligned=True), source, rng)
    assert np.abs(start.alpha).max() <= math.pi / 2
    if name == "paper root":
        assert start.root[0] == 0.0
        assert np.abs(start.root).max() <= math.pi / 2
    if name == "fixed end-effector":
        np.testing.assert_allclose(start.tip - start.p_COM, [0.1, 0.1, 0.3], rtol=0, atol=1e-12)


def test_many_modules_stay_where_nothing_overlaps_and_are_disentangled_where_something_does():
    task = push(9, module={"connector_distance": 0.22}, search={"body_clearance": False})
    row, moved = (Topology((ROOT, *((i, 0, 2) for i in range(7)), last)) for last in ((7, 0, 2), (3, 1, 3)))
    bent = as_design(random_point(task, row, np.random.default_rng(0)))
    straight = bent.model_copy(update={"hinge_angles_rad": (0.0,) * 8})  # its modules blow past each other
    for source in (straight, bent):
        start = warm_start(task, moved, source, np.random.default_rng(1))
        airflow = [check.amount for check in violations(start) if check.name.startswith("airflow")]
        assert max(airflow) <= 1e-9
        stays = np.allclose(start.alpha[:7], source.hinge_angles_rad[:7], rtol=0, atol=1e-12)
        assert stays == (source is straight)


def test_a_design_of_another_tree_is_one_more_start_before_the_others():
    task, tree = push(), Topology.from_key("a11410")
    source = best_design(task, Topology.from_key("a11210"), 6)
    alone = solve(task, tree, starts=range(0), seed=1, near=[source])
    starts = solve(task, tree, starts=range(2), seed=1)
    both = solved(solve(task, tree, starts=range(2), seed=1, near=[source]))
    feasible = [part for part in (alone, starts) if not isinstance(part, Infeasible)]
    best = min(feasible, key=lambda design: design.objective)
    assert both.objective == best.objective
    assert both.solver["start"] == best.solver["start"]
    assert (both.solver["starts"], both.solver["starts_feasible"]) == (
        3,
        sum(part.solver["starts_feasible"] for part in feasible),
    )


def test_a_design_carried_to_its_own_tree_leads_back_to_itself():
    """Under a larger margin it starts next to its design, and under its own one it stands there."""
    task, tree = push(), Topology.from_key("a11410")
    source = best_design(task, tree, 6)
    again = solved(solve(task, tree, starts=range(0), seed=0, near=[source]))
    assert again.solver["start"] == -1
    assert again.objective == pytest.approx(source.objective, rel=1e-4)
    wider = solved(solve(push(search={"margin": 1e-3}), tree, starts=range(0), seed=0, near=[source]))
    assert source.objective <= wider.objective <= 1.01 * source.objective
