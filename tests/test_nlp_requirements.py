"""Every requirement is stated once: its smooth form, exact value and compiled rows agree, for every feature."""

import numpy as np
import pytest
from nlp_cases import FEATURES, push, random_point, random_tree

from nlp.reduced import reason_against
from nlp.reduced.arrays import rows
from nlp.requirements import clearances

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


def test_a_round_of_ipopt_does_without_far_subjects():
    task, tree = push(6), random_tree(6, np.random.default_rng(4), aligned=True)
    vectors = random_point(task, tree, np.random.default_rng(5)).vectors
    for requirement in clearances(task, tree):
        kept = requirement.restrict(vectors)
        gaps = requirement.gaps(vectors).min(axis=1)
        np.testing.assert_array_equal(kept.subjects, requirement.subjects[gaps < requirement.near])
