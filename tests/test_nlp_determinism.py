"""One seed, one answer: within a process, in another one, and however the starts are cut into pieces."""

import subprocess
import sys

import numpy as np
import pytest
from nlp_cases import push

from nlp import solve
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.files import to_json

KEY = "a11410"
TREE = Topology.from_key(KEY)

SOLVE = f"""
from nlp import solve
from topo_search.model import Topology
from topo_search.model.files import to_json
from topo_search.model.task_file import read_task
design = solve(read_task("push").resolve(5), Topology.from_key("{KEY}"), starts=range(3), seed=4)
print(to_json(design.model_copy(update={{"solver": None}})), end="")
"""


def timeless(result):
    """The result without how long it took."""
    if isinstance(result, Infeasible):
        return result.model_copy(update={"solver": result.solver.model_copy(update={"seconds": 0.0})})
    return result.model_copy(update={"solver": {**result.solver, "seconds": 0.0}})


def test_another_process_gives_the_same_design_to_the_last_bit():
    here = solve(push(), TREE, starts=range(3), seed=4).model_copy(update={"solver": None})
    there = subprocess.run([sys.executable, "-c", SOLVE], capture_output=True, text=True, check=True)
    assert there.stdout == to_json(here)


@pytest.mark.parametrize("name", ["feasible", "infeasible"])
def test_pieces_of_the_starts_have_the_best_of_all(name):
    task = push() if name == "feasible" else push(search={"body_clearance": 0.42})
    whole, first, second = (solve(task, TREE, starts=s, seed=1) for s in (range(8), range(4), range(4, 8)))
    if name == "feasible":
        assert all(isinstance(part, Design) for part in (whole, first, second))
        best = min(first, second, key=lambda part: (part.objective, part.solver["start"]))
        record, of_parts = whole.solver, [first.solver, second.solver]
        assert whole.objective == pytest.approx(best.objective, rel=1e-7)
        assert record["starts"] == sum(part["starts"] for part in of_parts)
    else:
        assert all(isinstance(part, Infeasible) for part in (whole, first, second))
        assert whole.solver.start in (first.solver.start, second.solver.start)
        best = first if whole.solver.start < 4 else second
        assert (whole.worst_constraint, whole.violation) == (best.worst_constraint, best.violation)


def test_a_start_does_not_depend_on_the_ones_before_it():
    alone = solve(push(), TREE, starts=range(2, 3), seed=1)
    backwards = solve(push(), TREE, starts=range(2, 1, -1), seed=1)
    assert to_json(timeless(alone)) == to_json(timeless(backwards))
    together = [solve(push(), TREE, starts=range(s, s + 1), seed=1) for s in range(3)]
    assert to_json(timeless(together[2])) == to_json(timeless(alone))


def test_starts_are_inside_their_bounds():
    for fields in ({}, {"search": {"root": "paper"}}):
        task = push(**fields)
        for s in range(20):
            start = draw(task, TREE, generator(task, TREE, s, 0))
            u_max = task.module.max_input(task.gravity)
            assert 0.0 < start.u.min() <= start.u.max() < u_max
            assert np.abs(start.alpha).max() < np.pi / 2
            if fields:
                assert start.root[0] == 0.0
                assert np.abs(start.root).max() <= np.pi / 2
