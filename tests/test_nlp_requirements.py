"""Every requirement is stated once: its smooth form, exact value and compiled rows agree, for every feature."""

import math

import numpy as np
import pytest
from nlp_cases import FEATURES, push, random_tree

from nlp.reduced import reason_against
from nlp.reduced.arrays import rows
from nlp.requirements import clearances
from nlp.solving import solve
from topo_search.model import Design, Topology
from topo_search.model.task_file import read_task
from topo_search.model.topology import straight_chain
from topo_search.study.request import with_margin
from verify import audit

SHARP = 1e8


@pytest.mark.parametrize("name", FEATURES)
def test_the_reduced_search_expresses_all_that_a_task_can_ask_for(name):
    task = push(4, **FEATURES[name])
    assert len(task.folds(task.search.margin)) == 1
    assert reason_against(task) is None
    topology = random_tree(4, np.random.default_rng(2), aligned=True)
    assert {row.name for row in rows(task, topology)} == {
        name for requirement in clearances(task, topology) for name, *_ in requirement.rows()
    }


def test_statements_of_equal_tasks_share_their_derivatives():
    """Formulas are equal by their numbers: CasADi derives each once a process, whatever the topology."""
    tree = random_tree(4, np.random.default_rng(3), aligned=True)
    for fields in FEATURES.values():
        one, other = (list(clearances(push(4, **fields), tree)) for _ in range(2))
        assert [hash(a.formulas) for a in one] == [hash(b.formulas) for b in other]
        assert all(a.formulas == b.formulas for a, b in zip(one, other, strict=True))


def test_centres_keep_no_more_of_a_larger_margin_than_errors_take():
    chain = straight_chain(4)

    def least(task):
        found = [r for r in clearances(task, chain) if r.equation == 5]
        return {(i, j): r.margin * task.module.arm_length for r in found for i, j in r.subjects.tolist()}

    task = push(4, tolerances={"hinge_angle_deg": 0.3, "position": 1e-3}, flight={"tolerances": True})
    assert list(least(task).values()) == pytest.approx([task.search.margin] * 3)
    larger = least(with_margin(task, 8e-3))
    for (i, j), margin in larger.items():
        hinges, l_c, radius = chain.distances[i, j], task.module.connector_distance, task.centre_distance / 2
        arms = sum(min(2 * m - 1, 2 * (hinges - m) + 1) * l_c + radius for m in range(1, hinges + 1))
        taken = 2e-3 + math.radians(0.3) * arms
        assert margin == pytest.approx(min(8e-3, task.search.margin + taken))
    assert len(set(larger.values())) > 1
    assert list(least(with_margin(task, 3e-3)).values()) == pytest.approx([3e-3] * 3)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["wall-push", "window-cleaning"])
def test_a_larger_margin_for_errors_leaves_a_platform_with_its_rod_room(example):
    task = read_task(example, ("end_effector.rod_mass=included",)).resolve(3)
    found = solve(with_margin(task, 7.7e-3), Topology.from_key("a300"), starts=range(4), seed=0)
    assert isinstance(found, Design)
    assert audit(found).verdict == "clear"
