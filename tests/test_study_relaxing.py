"""Why there is no design: the limits that are named, relaxed as little as is said, do give the tree one."""

import json
from dataclasses import replace

import pytest
import toy_problem
from nlp_cases import GENTLE_PUSH, push
from toy_problem import toy_run
from wording import says

from topo_search.compose import BACKENDS
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.files import to_json
from topo_search.model.relaxable import relaxable
from topo_search.model.relaxation import Relaxation, Relaxed
from topo_search.study import Silent
from topo_search.study.relaxing import STARTS, TREES, relax


class Counting(toy_problem.InProcess):
    """Runs jobs here, and counts them."""

    def __init__(self):
        super().__init__(1)
        self.jobs = 0

    def run(self, function, jobs, **given):
        for job, outcome in super().run(function, jobs, **given):
            self.jobs += 1
            yield job, outcome


def relaxed_limits(task, *keys, backends=BACKENDS, engine=None, starts=STARTS):
    trees = [Topology.from_key(key) for key in keys]
    engine = engine or Counting()
    return relax(task, trees, starts=starts, seed=0, backends=backends, engine=engine, observer=Silent())


def limit_of(task, relaxation):
    return next(limit for limit in relaxable(task) if limit.field == relaxation.field)


@pytest.mark.parametrize(
    ("fields", "key", "binds"),
    [
        ({"module": {"max_thrust_to_weight": 1.2}}, "a11210", "module.max_thrust_to_weight"),
        pytest.param(
            {"load_cases": GENTLE_PUSH, "flight": {"joint_moment": 0.141}},
            "a300",
            "flight.joint_moment",
            marks=pytest.mark.slow,
        ),
        ({}, "a31010", None),
    ],
)
def test_what_is_named_gives_the_tree_a_design_when_it_is_solved_again(fields, key, binds):
    tree = Topology.from_key(key)
    task = push(tree.n, **fields)
    assert isinstance(BACKENDS.solve(task, tree, starts=range(STARTS), seed=0), Infeasible)
    found = relaxed_limits(task, key)
    assert found.relaxations
    assert binds in (None, found.relaxations[0].field)
    shares = [one.share for one in found.relaxations]
    assert shares == sorted(shares)
    for one in found.relaxations:
        limit = limit_of(task, one)
        easier = limit.relaxed(one.share)
        again = BACKENDS.solve(easier, tree, starts=range(STARTS), seed=0)
        if not isinstance(again, Design):  # it was found from the design with more of it
            more = next(share for share in limit.shares if share > one.share)
            near = BACKENDS.solve(limit.relaxed(more), tree, starts=range(STARTS), seed=0)
            again = BACKENDS.solve(easier, tree, starts=range(STARTS), seed=0, near=(near,))
        assert isinstance(again, Design)
        assert BACKENDS.audit(again).verdict == "clear"
        assert one.enough == limit.value(easier)


def test_every_limit_of_a_task_is_relaxed_towards_what_is_easier():
    task = push(
        5,
        exposure=[
            {"kind": "local", "radius": 0.2},
            {"kind": "directional", "along": "end_effector", "length": 0.3, "radius": 0.1},
            {"kind": "exterior", "half_angle_deg": 60.0},
            {"kind": "local", "box": [0.1, 0.2, 0.3]},
        ],
        end_effector={"stand_off": 0.4},
        search={"peak_input": 0.8, "root": "paper"},
        module={"joint_moment": 2.0},
        flight={
            "units": "SI",
            "force_reserve": 1.0,
            "torque_reserve": 0.2,
            "joint_force": 30.0,
            "joint_moment": "rated",
        },
    )
    limits = {limit.field: limit for limit in relaxable(task)}
    larger = {
        "module.max_thrust_to_weight",
        "module.connector_distance",
        "search.peak_input",
        "exposure[2].half_angle_deg",
        "flight.joint_force",
        "flight.joint_moment",
    }
    smaller = {
        "exposure[0].radius",
        "exposure[1].radius",
        "end_effector.stand_off",
        "flight.force_reserve",
        "flight.torque_reserve",
    }
    others = {"exposure[3].box", 'search.root = "free"', "load_cases"}
    assert set(limits) == larger | smaller | others
    for field, limit in limits.items():
        changed = limit.relaxed(limit.shares[-1])
        assert type(task).model_validate(changed.model_dump())  # it is a valid task
        if field in larger | smaller:
            assert (limit.value(changed) > limit.value(task)) == (field in larger)
        assert changed != task
    assert limits["flight.joint_moment"].value(task) == 2.0
    assert limits["flight.joint_moment"].relaxed(0.5).joint_limits == (30.0, 3.0)
    assert limits["load_cases"].relaxed(0.5).load_cases[-1] == task.load_cases[-1]  # hover stays


@pytest.mark.parametrize("helps", [True, False])
def test_the_number_of_solves_is_bounded_whatever_comes_of_them(helps):
    task, weak = push(5), push(5, module={"max_thrust_to_weight": 1.05})
    outcome = BACKENDS.solve(task if helps else weak, Topology.from_key("a11210"), starts=range(1), seed=0)
    assert isinstance(outcome, Design if helps else Infeasible)

    def solve(task, topology, *, starts, seed, near=()):
        assert len(starts) <= STARTS
        return outcome

    engine = Counting()
    found = relaxed_limits(
        task, "a11210", "a31010", "af0000", backends=replace(BACKENDS, solve=solve), engine=engine, starts=100
    )
    limits = len(relaxable(task))
    assert engine.jobs <= TREES * limits * 5
    assert bool(found.relaxations) is helps
    if not helps:
        assert engine.jobs == TREES * limits  # what does not help at its most is not tried with less
        assert len(found.in_vain) == limits


def test_no_word_of_proof():
    one = Relaxation(
        topology_key="a300",
        limit="rotor limits",
        change="4 % more thrust",
        field="module.max_thrust_to_weight",
        share=0.04,
        given=2.5,
        enough=2.6,
    )
    first, *_ = Relaxed(modules=3, starts=8, relaxations=(one,), in_vain=()).sentences
    assert says(first, "relax first: rotor limits: 4 % more thrust", "a300", "max_thrust_to_weight: 2.5 -> 2.6")
    assert says(first, "a smaller change may be enough")
    (alone,) = Relaxed(modules=3, starts=8, relaxations=(), in_vain=("rotor limits: 100 % more thrust",)).sentences
    assert "no single limit" in alone


def test_a_run_without_a_design_keeps_and_tells_what_would_do(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    answer = toy_run(tmp_path / "run")
    (size,) = answer.sizes
    assert size.reason
    assert size.relaxed is not None
    assert size.relaxed.relaxations == ()
    assert any("no single limit" in sentence for sentence in size.relaxed.sentences)
    kept = json.loads((tmp_path / "run" / "relaxed" / "n3.json").read_text())
    assert kept["format"] == "topo-search/relaxed"
    assert to_json(size.relaxed) == (tmp_path / "run" / "relaxed" / "n3.json").read_text()
    again = toy_run(tmp_path / "run")
    assert again.sizes == answer.sizes
    monkeypatch.delenv("TOY_NONE")
    more = toy_run(tmp_path / "run", starts=4)
    if more.best is not None:
        assert more.sizes[0].relaxed is None
        assert not (tmp_path / "run" / "relaxed" / "n3.json").exists()
