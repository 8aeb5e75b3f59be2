"""A root's attitude that the task gives: searched, counted, audited and proven as such."""

import math
from pathlib import Path

import numpy as np
import pytest
from nlp_cases import push
from verify_cases import failing

from nlp import solve
from nlp.starts.random_starts import draw, generator
from topo_search.engine import Candidates
from topo_search.model import BadInput, Design
from topo_search.model.files import read_json
from topo_search.model.task_file import read_task
from topo_search.report.task_facts import facts
from topo_search.study.relaxable_limits import relaxable
from topo_search.topologies import count, resolve_symmetry, sample
from verify import audit

DESIGN = Path(__file__).parent / "designs/push-a70010.json"
LEVEL = "search.root_orientation_deg=[0,0,0]"


@pytest.fixture(scope="module")
def best() -> Design:
    return read_json(Design, DESIGN)


@pytest.mark.parametrize(
    ("settings", "rule"),
    [
        ((LEVEL, "search.root=paper"), 'must be left out with root = "paper", but got [0.0, 0.0, 0.0]'),
        (("search.root_orientation_deg=[0,91,0]",), "alpha_0 within +-90 and alpha_1 within +-180"),
        (("search.root_orientation_deg=[0,0]",), "must be a list of three numbers"),
    ],
)
def test_bad_attitudes_are_refused(settings, rule) -> None:
    with pytest.raises(BadInput) as refused:
        read_task("push", settings)
    (fault,) = refused.value.faults
    assert fault.path == "search.root_orientation_deg"
    assert rule in fault.rule


def test_every_rooted_tree_is_a_candidate_of_its_own() -> None:
    task = read_task("push", (LEVEL,)).resolve(4)
    assert (
        Candidates(task, "task").count() == count(4, symmetry="none", root="paper") == 4 * count(4, symmetry="none")
    )
    assert resolve_symmetry(task).exact
    assert not resolve_symmetry(task, "c2").exact


def test_the_search_keeps_to_the_attitude_and_the_audit_sees_it(best) -> None:
    angles = np.round(np.degrees(best.root_orientation_rad))
    given = best.task.search.replace(root_orientation_deg=tuple(angles.tolist()))
    design = solve(best.task.model_copy(update={"search": given}), best.topology, starts=range(8), seed=0)
    assert isinstance(design, Design)
    assert np.array_equal(design.root_orientation_rad, [math.radians(angle) for angle in angles])
    assert design.objective > best.objective
    assert audit(design).verdict == "clear"
    psi, *others = design.root_orientation_rad
    turned = audit(design.model_copy(update={"root_orientation_rad": (psi + 1e-3, *others)}))
    assert "root orientation, psi" in failing(turned)


def test_words_about_it_say_what_it_is() -> None:
    task = read_task("push", (LEVEL,))
    rows = dict(row for _, group in facts(task.resolve(5)) for row in group)
    assert rows["root module"] == "psi = 0°, alpha_0 = 0°, alpha_1 = 0°"
    (limit,) = (limit for limit in relaxable(task, 5) if limit.limit == "orientation of the root")
    assert limit.field == "search.root_orientation_deg left out"
    assert limit.change(task, 1.0).search.root_orientation_deg is None


def test_starts_of_large_platforms_have_the_attitude() -> None:
    task = push(9, search={"root_orientation_deg": [10.0, 20.0, -30.0]})
    (tree,) = sample(9, 1, seed=0)
    point = draw(task, tree, rng=generator(task, tree, 0, 0))
    assert np.degrees(point.root) == pytest.approx([10.0, 20.0, -30.0])
