"""Why there is no design: the limits that are named, relaxed as little as is said, do give the tree one."""

import json
import math
from dataclasses import replace

import pytest
import toy_problem
from nlp_cases import BESIDE_A_DECK, GENTLE_PUSH, PUSH, push
from older import older_task
from toy_problem import toy_run
from wording import says

from topo_search.compose import BACKENDS
from topo_search.engine import Failed, Job
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.files import to_json
from topo_search.model.relaxed import STARTS
from topo_search.model.task_file import apply_settings
from topo_search.study import SilentObserver
from topo_search.study.relaxable_limits import RELAXING, relaxable
from topo_search.study.relaxing import relax
from topo_search.study.solving import Tools


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
    return relax(task, trees, Tools(backends, engine, SilentObserver()), starts=starts, seed=0)


class Failing(Counting):
    """Lets the jobs of some tasks fail: those whose JSON has a text, or of all but a task."""

    def __init__(self, fails):
        super().__init__()
        self.fails = fails

    def run(self, function, jobs, **given):
        for job in jobs:
            if self.fails(job):
                yield job, Failed("crash", "the worker process was ended by SIGKILL")
            else:
                yield from super().run(function, [job], **given)


def limit_of(task, relaxation):
    return next(limit for limit in relaxable(task, task.sizes[0]) if limit.limit == relaxation.limit)


def user_task(n=3, **fields):
    """A task as it is written into a file: defaults left out, units of weight."""
    data = {"name": "user", "modules": n, "load_cases": [*PUSH[:2], {"carries_weight": True}]}
    return {**data, **fields}


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
        pytest.param({}, "a31010", None, marks=pytest.mark.slow),
    ],
)
def test_what_is_named_gives_the_tree_a_design_when_it_is_solved_again(fields, key, binds):
    tree = Topology.from_key(key)
    task = push(tree.n, **fields)
    assert isinstance(BACKENDS.solve(Job(task, tree, starts=range(STARTS), seed=0)), Infeasible)
    found = relaxed_limits(task, key)
    assert found.relaxations
    assert binds in (None, *(one.field for one in found.relaxations))
    order = [(not one.tightens, one.share) for one in found.relaxations]
    assert order == sorted(order)
    for one in found.relaxations:
        limit = limit_of(task, one)
        easier = limit.relax(one.share).resolve(tree.n)
        again = BACKENDS.solve(Job(easier, tree, starts=range(STARTS), seed=0))
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
            {"kind": "allowed", "planes": [{"normal": [1, 0, 0]}, {"normal": [0, 0, 1], "offset": -0.2}]},
            {
                "kind": "allowed",
                "planes": [{"normal": [1, 0, 0]}, {"normal": [0, 1, 0], "offset": 0.3}],
                "solid": True,
            },
            {"kind": "exterior", "solid": True},
            {"kind": "local", "radius": 0.02, "solid": True},
        ],
        end_effector={"stand_off": 0.4, "mass": 0.1},
        tolerances={"hinge_angle_deg": 0.3, "position": 0.001},
        search={"peak_input": 0.8, "root": "paper"},
        module={"joint_moment": 2.0},
        flight={
            "tolerances": True,
            "units": "SI",
            "force_reserve": 1.0,
            "torque_reserve": 0.2,
            "tilt_deg": 5.0,
            "com_error": 0.01,
            "angular_acceleration": [4.0, 0.0, 2.0],
            "joint_force": 30.0,
            "joint_moment": "rated",
        },
    )
    limits = {limit.field: limit for limit in relaxable(task, 5)}
    larger = {
        *("module.max_thrust_to_weight", "module.connector_distance", "search.peak_input"),
        *("exposure[2].half_angle_deg", "flight.joint_force", "flight.joint_moment"),
    }
    smaller = {
        *("exposure[0].radius", "exposure[1].radius", "end_effector.stand_off", "end_effector.mass"),
        *("tolerances.hinge_angle_deg", "tolerances.position"),
        *(f"flight.{name}" for name in ("force_reserve", "torque_reserve", "tilt_deg", "com_error")),
    }
    others = {
        *("flight.angular_acceleration", "exposure[3].box", 'search.root = "free"'),
        *("exposure[4].planes[0, 1].offset", "exposure[5].planes[1].offset", "load_cases[0].end_effector.force"),
    }
    assert set(limits) == larger | smaller | others  # walls and objects, which the tip touches, are not among them
    for field, limit in limits.items():
        changed = limit.relax(limit.shares[-1])
        assert type(task).model_validate(changed.model_dump())  # it is a valid task
        if field in larger | smaller:
            assert (limit.value(changed) > limit.value(task)) == (field in larger)
        assert changed != task
    assert limits["flight.joint_moment"].value(task) == 2.0
    assert limits["flight.joint_moment"].relax(0.5).joint_limits == (30.0, 3.0)
    assert limits["flight.angular_acceleration"].relax(0.5).flight.angular_acceleration == (2.0, 0.0, 1.0)
    assert limits["load_cases[0].end_effector.force"].relax(0.5).load_cases[-1] == task.load_cases[-1]  # hover
    room = limits["exposure[5].planes[1].offset"]
    assert [plane.offset for plane in room.relax(0.1).exposure[5].planes] == [
        0.0,
        room.value(room.relax(0.1))[0],
    ]
    (setting,) = limits["exposure[4].planes[0, 1].offset"].settings(0.1)
    assert setting.given == (0.0, -0.2)
    assert setting.words.startswith("exposure[4].planes[0, 1].offset [0, -0.2] to [0.")


@pytest.mark.parametrize(("reach", "last"), [(0.5, 0.4), (0.05, 0.04), (0.01, None)])
def test_no_step_leads_to_a_task_that_is_refused(tmp_path, monkeypatch, reach, last):
    """A plane stays nearer than the distance up to which its speed applies: it moves by less, or not at all."""
    monkeypatch.setenv("TOY_NONE", "*")
    planes = {"kind": "allowed", "planes": [{"normal": [0.0, 0.0, -1.0]}], "speed": 0.5, "geometry": False}
    task = older_task(user_task(exposure=[{**planes, "speed_within": reach}]))
    steps = {limit.limit: limit.shares[-1] for limit in relaxable(task, 3)}
    assert steps["air over exposure 0 (allowed)"] == 1.0
    assert steps.get("exposure 0 (allowed)") == last
    (size,) = toy_run(tmp_path / "run", task=task).sizes
    assert len(size.relaxed.in_vain) == len(steps)


@pytest.mark.parametrize("helps", [True, False])
def test_the_number_of_solves_is_bounded_whatever_comes_of_them(monkeypatch, helps):
    task = push(5)

    def solve(job):
        assert len(job.starts) <= STARTS
        return toy_problem.solve(job)

    monkeypatch.setenv("TOY_NONE", "" if helps else "*")
    engine = Counting()
    backends = replace(toy_problem.BACKENDS, solve=solve)
    found = relaxed_limits(task, "a11210", "a31010", "af0000", backends=backends, engine=engine, starts=100)
    limits = len(relaxable(task, 5))
    assert engine.jobs <= RELAXING.trees * limits * 5
    assert bool(found.relaxations) is helps
    if not helps:
        pairs = math.comb(RELAXING.paired, 2)
        assert engine.jobs == RELAXING.trees * (limits + pairs)  # what does not help at its most: not with less
        assert 0 < found.pairs <= RELAXING.trees * pairs
        assert len(found.in_vain) == limits


@pytest.mark.parametrize(
    ("fields", "change"),
    [
        ({"module": {"max_thrust": 1.4}}, "module.max_thrust"),
        ({"module": {"max_thrust_to_weight": 2.2}}, "module.connector_distance"),
        ({"flight": {"force_reserve": 0.3}}, "flight.force_reserve"),
        ({"load_cases": "ten-wrenches", "task_seed": 3}, "end_effector.largest_reach"),
    ],
)
def test_the_printed_value_in_the_task_file_is_the_task_that_is_tried(fields, change):
    """Also the defaults that follow from it, such as the largest reach of a rod from the connectors."""
    data = user_task(**fields)
    task = older_task(data)
    limit = next(limit for limit in relaxable(task, 3) if limit.field == change)
    for share in (0.07, limit.shares[-1]):
        apply_settings(again := json.loads(json.dumps(data)), (f"{change}={limit.value(limit.relax(share)):.6g}",))
        assert older_task(again).resolve(3) == limit.relax(share).resolve(3)


def toy_relaxed(*, engine=None, **fields):
    task = older_task(user_task(**fields))
    return task, relaxed_limits(task, "a300", backends=toy_problem.BACKENDS, engine=engine, starts=2)


def test_a_failure_is_no_attempt():
    """Where there was no answer, nothing is known: neither that a limit helps, nor that none does."""
    task, found = toy_relaxed(engine=Failing(lambda job: True))
    assert found.relaxations == found.in_vain == ()
    assert len(found.untried) == len(relaxable(task, 3))
    (sentence,) = found.sentences
    assert says(sentence, "could not be tried", "rotor limits", "SIGKILL")
    assert "no single limit" not in sentence


def test_only_what_was_tried_is_said_to_be_in_vain(monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    engine = Failing(lambda job: job[2].task.module.connector_distance > 0.2)
    _, found = toy_relaxed(engine=engine)
    nothing, in_vain, untried = found.sentences
    assert says(nothing, "no single limit", "a300", "2 starts", "nor did any of 5 pairs")
    assert "rotor limits" in in_vain
    assert "connectors" not in in_vain
    assert says(untried, "could not be tried", "longer connectors")


def test_what_is_proven_impossible_when_relaxed_is_not_said_to_be_solved(monkeypatch):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    task, found = toy_relaxed(engine=Failing(lambda job: True))
    assert len(found.in_vain) == len(relaxable(task, 3))
    assert all(text.endswith("(still proven impossible)") for text in found.in_vain)


def test_what_is_proven_impossible_is_said_before_anything_is_solved(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    said = []

    class Noting(SilentObserver):
        def note(self, text):
            said.append((text, (tmp_path / "log").exists()))

    toy_run(tmp_path / "run", modules=(3, 4), observer=Noting())
    assert said == [
        ("3 modules: proven impossible, without a search: three modules cannot lift what is asked", False)
    ]


def test_what_fails_its_audit_is_not_advised(monkeypatch):
    monkeypatch.setenv("TOY_VIOLATED", "a300")
    task, found = toy_relaxed()
    assert found.relaxations == found.untried == ()
    assert len(found.in_vain) == len(relaxable(task, 3))
    assert says(found.sentences[0], "no single limit", "with a clear audit")


def test_what_passes_its_audit_with_a_larger_margin_is_advised_as_a_run_would_find_it(monkeypatch):
    monkeypatch.setenv("TOY_VIOLATED", "a300")
    monkeypatch.setenv("TOY_MARGIN", "1e-3")
    _, found = toy_relaxed()
    assert found.relaxations
    assert says(found.sentences[0], "2 starts", "clear audit")


def test_a_tighter_reach_leads_to_a_design_of_the_task_as_it_is():
    """Rods of metres meet these requirements as well, but no start of four reaches one."""
    task = older_task(BESIDE_A_DECK)
    tighter = next(limit for limit in relaxable(task, 5) if limit.tightens)
    design = BACKENDS.solve(
        Job(tighter.relax(0.8).resolve(5), Topology.from_key("a11210"), starts=range(2), seed=0)
    )
    assert BACKENDS.audit(design).verdict == "clear"
    assert BACKENDS.audit(design.model_copy(update={"task": task.resolve(5)})).verdict == "clear"


def test_a_tighter_reach_is_named_before_what_takes_from_the_task(monkeypatch):
    def solve(job):
        helps = job.task.end_effector.largest_reach < 0.9 or job.task.module.max_thrust_to_weight > 2.5
        monkeypatch.setenv("TOY_NONE", "" if helps else "*")
        return toy_problem.solve(job)

    fields = {"module": {"max_thrust_to_weight": 2.5}, "end_effector": {"largest_reach": 1.0}}
    found = relaxed_limits(
        older_task(user_task(**fields)), "a300", backends=replace(toy_problem.BACKENDS, solve=solve)
    )
    first, second = found.sentences
    assert says(first, "try first", "1 to 0.85 m", "15 % less reach", "the design also satisfies the original task")
    assert says(second, "or module.max_thrust_to_weight 2.5 to 2.525", "1 % more thrust")


def test_pairs_are_tried_where_no_limit_suffices_alone(monkeypatch):
    """With twice the thrust or half the weight at the tip there is none; with some of both there is."""

    def solve(job):
        thrust, mass = job.task.module.max_thrust_to_weight / 2.5, job.task.end_effector.mass / 0.1
        if thrust < 1.2 or mass > 0.75:
            violation = 2.0 - thrust + mass
            return toy_problem.infeasible(job.topology, violation=violation, unit="")
        return toy_problem.solve(job)

    fields = {"module": {"max_thrust_to_weight": 2.5}, "end_effector": {"mass": 0.1}}
    task = older_task(user_task(**fields))
    found = relaxed_limits(task, "a300", backends=replace(toy_problem.BACKENDS, solve=solve))
    (pair,) = found.relaxations
    assert {setting.field: setting.share for setting in (pair, *pair.also)} == {
        "module.max_thrust_to_weight": 0.3,
        "end_effector.mass": 0.3,
    }
    assert pair.not_enough == 0.2
    assert says(found.sentences[0], "relax both first", "2.5 to 3.25", " and ", "0.1 to 0.07 kg")


def test_a_run_whose_candidates_all_fail_claims_nothing(tmp_path):
    answer = toy_run(tmp_path / "run", engine=Failing(lambda job: True))
    (size,) = answer.sizes
    assert says(size.reason, "4 candidates failed", "nothing is known of them")
    assert "no start" not in size.reason
    assert size.relaxed is None


def test_some_failures_are_told_apart_from_starts_that_found_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    failing = Failing(lambda job: getattr(job, "topology", None) == Topology.from_key("a300"))
    (size,) = toy_run(tmp_path / "run", engine=failing).sizes
    assert says(
        size.reason, "no start of 3 candidates", "1 candidate failed", "nothing is known of it", "shortfall"
    )


def test_what_could_not_be_tried_is_tried_again(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    first = toy_run(tmp_path / "run", engine=Failing(lambda job: isinstance(job, tuple)))
    (size,) = first.sizes
    assert size.relaxed.untried
    assert size.relaxed.in_vain == ()
    (size,) = toy_run(tmp_path / "run").sizes
    assert size.relaxed.untried == ()
    assert size.relaxed.in_vain


def test_a_run_without_a_design_keeps_and_tells_what_would_do(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    answer = toy_run(tmp_path / "run")
    (size,) = answer.sizes
    assert size.reason
    assert size.relaxed.relaxations == ()
    assert any("no single limit" in sentence for sentence in size.relaxed.sentences)
    kept = json.loads((tmp_path / "run" / "relaxed" / "n3.json").read_text())
    assert kept["format"] == "topo-search/relaxed"
    assert to_json(size.relaxed) == (tmp_path / "run" / "relaxed" / "n3.json").read_text()
    assert toy_run(tmp_path / "run").sizes == answer.sizes
    monkeypatch.delenv("TOY_NONE")
    more = toy_run(tmp_path / "run", starts=4)
    if more.best is not None:
        assert more.sizes[0].relaxed is None
        assert not (tmp_path / "run" / "relaxed" / "n3.json").exists()
