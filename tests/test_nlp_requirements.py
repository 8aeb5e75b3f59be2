"""Every requirement is stated once: its smooth form, exact value and compiled rows agree, for every feature."""

import casadi as ca
import numpy as np
import pytest
from nlp_cases import DISTINCT, FEATURES, push, random_point, random_tree
from suites import few

from nlp.reduced import reason_against
from nlp.reduced.arrays import rows
from nlp.requirements import clearances

SHARP = 1e8


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT[::2]))
def test_the_smooth_form_has_the_sign_of_the_exact_value(name):
    """Away from contact: at a sharpness at which the log-sum-exp is the least of its candidates."""
    rng = np.random.default_rng(0)
    task = push(3, **FEATURES[name])
    topology = random_tree(3, rng, aligned=True)
    samples = [random_point(task, topology, rng).vectors for _ in range(8)]
    told = 0
    for requirement in clearances(task, topology):
        for part, formula in enumerate(requirement.formulas):
            y = [ca.SX.sym("y", 3) for _ in formula.local_vectors]
            smooth = ca.Function("smooth", y, [formula.smooth(y, ca.SX(SHARP))])
            for vectors in samples:
                for subject, gaps in zip(requirement.subjects, requirement.gaps(vectors), strict=True):
                    values = smooth.call(
                        [np.ravel(vector.at(vectors, subject)) for vector in formula.local_vectors]
                    )
                    if abs(gaps[part]) > 0.01:
                        assert np.sign(np.array(values[0]).min()) == np.sign(gaps[part]), requirement.name(
                            *subject[:2], part
                        )
                        told += 1
    assert told > 20


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
