"""Values go into files and come back unchanged."""

import json
import pickle
import re
import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from older import older_task
from report_cases import design
from verify_cases import fan

from topo_search.limits import LIMITS
from topo_search.model import (
    Audit,
    Design,
    EndEffector,
    Infeasible,
    LoadCase,
    Module,
    ResolvedTask,
    Search,
    SolverRecord,
    Task,
    Tolerances,
    Topology,
)
from topo_search.model.airflow import Airflow
from topo_search.model.files import read_json, to_json, to_toml, validate, write_atomically
from topo_search.model.goals import Goals
from topo_search.model.reserves import AskedFlight
from topo_search.model.task_file import examples, read_task
from verify import audit

EXAMPLES = [
    *("battery-module", "camera-module", "crazyflie", "five-inch", "h-modquad", "h-modquad-twelve", "hexarotor"),
    *("push", "push-directional", "push-exterior-60", "push-exterior-90", "push-local", "push-two-paths"),
    *("strongest", "survives-a-rotor", "ten-wrenches", "ten-wrenches-directional", "ten-wrenches-exterior-60"),
    *("ten-wrenches-local", "wall-push", "window-cleaning"),
]


def optional(**fields: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({}, optional=fields)


coordinate = st.floats(-1e6, 1e6)
vector = st.lists(coordinate, min_size=3, max_size=3)
direction = vector.filter(lambda v: np.linalg.norm(v) >= 1e-15)
near = st.floats(-5, 5)
offset = st.lists(near, min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1)
"""Within a hundred lengths of any platform below."""
positive = st.floats(1e-3, 1e3)
size = st.floats(1e-3, 2)
sizes = st.lists(size, min_size=3, max_size=3)
wrench = optional(force=vector, torque=vector)
load_case = st.one_of(
    optional(
        units=st.sampled_from(["weight", "SI"]), weight=positive, com=wrench, carries_weight=st.booleans()
    ).flatmap(lambda case: st.builds(lambda w: {**case, "end_effector": w}, wrench)),
    st.builds(lambda w: {"com": w}, wrench),
)
exposure = st.one_of(
    st.builds(lambda more: {"kind": "local", **more}, optional(radius=positive)),
    st.builds(
        lambda segments, more: {"kind": "directional", "segments": segments, **more},
        st.lists(direction, min_size=1, max_size=3),
        optional(radius=positive),
    ),
    st.builds(lambda x: {"kind": "directional", "along": "end_effector", "length": x}, positive),
    st.builds(
        lambda more: {"kind": "exterior", **more},
        optional(half_angle_deg=st.floats(1e-3, 90), axis=st.just("com") | direction),
    ),
)
module = optional(
    mass=positive,
    connector_distance=st.floats(0.1, 1e3),
    arm_length=st.floats(0.02, 1.0),
    thrust_coefficient=st.floats(1e-9, 1e-3),
    max_thrust_to_weight=positive,
    airflow=optional(start_radius=st.floats(0.01, 0.2), spread_angle_deg=st.floats(0, 90)),
    body=optional(rotor_radius=size, hub=sizes, inertia=st.builds(lambda x: [x, 1.5 * x, 2 * x], positive)),
)
search = st.one_of(
    optional(
        root=st.sampled_from(["free", "paper"]),
        connectors=st.sampled_from(["aligned", "any"]),
        margin=st.floats(0, 1),
        body_clearance=positive | st.just(False),
        peak_input=st.floats(1e-3, 1),
    ),
    st.fixed_dictionaries({"interference": st.just("separation")}, optional={"separation": positive}),
)
count = st.integers(1, 100)
tasks = st.one_of(
    st.fixed_dictionaries({"load_cases": st.lists(load_case, min_size=1, max_size=4)}),
    st.fixed_dictionaries({"load_cases": st.just("ten-wrenches"), "task_seed": st.integers(0, 2**63 - 1)}),
).flatmap(
    lambda cases: st.fixed_dictionaries(
        {
            "name": st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", fullmatch=True),
            "modules": count
            | st.tuples(count, st.integers(0, LIMITS.sizes - 1)).map(lambda size: [size[0], sum(size)]),
            **{name: st.just(value) for name, value in cases.items()},
        },
        optional={
            "gravity": positive,
            "module": module,
            "end_effector": optional(
                mass=st.floats(0, 10),
                position=st.just("free") | offset,
                exclusion=st.booleans(),
                stand_off=st.floats(0, 10),
            ),
            "exposure": st.lists(exposure, max_size=3),
            "search": search,
        },
    )
)


def through_toml(task: Task) -> Task:
    return validate(Task, tomllib.loads(to_toml(task)), "again")


def comes_back(task: Task) -> None:
    assert through_toml(task) == task
    assert older_task(json.loads(to_json(task))) == task
    assert pickle.loads(pickle.dumps(task)) == task


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_comes_back_from_toml_and_json(name: str) -> None:
    task = read_task(name)
    assert task.name == name
    comes_back(task)


def test_a_design_states_every_field_of_its_task() -> None:
    """Its file means the same under other defaults; a file without them has those of its time."""
    made = fan()
    told = json.loads(to_json(made))["task"]
    parts = (told["module"]["airflow"], Airflow), (told["load_cases"][0], LoadCase), (told["goals"], Goals)
    parts += (told["end_effector"], EndEffector), (told["flight"], AskedFlight), (told["module"], Module)
    for fields, model in ((told, ResolvedTask), (told["tolerances"], Tolerances), (told["search"], Search), *parts):
        assert set(fields) == {name for name, info in model.model_fields.items() if not info.exclude}
    assert (told["end_effector"]["rod_mass"], told["module"]["joint_mass"]) == ("ignored", 0.0)
    older = json.loads(made.task.model_dump_json())
    assert "rod_mass" not in older["end_effector"]
    assert Design.model_validate({**json.loads(to_json(made)), "task": older}) == made


def test_a_resolved_task_is_written_without_what_it_does_not_ask_for() -> None:
    """So that its digest is the one of before there was such a thing to ask for."""
    push = read_task("push")
    asked = "hinge|stand_off|peak_input|goals|tolerances|flight|frame|min_input|solid|rod_mass|joint_mass"
    assert not re.search(asked, to_json(push.resolve(5)))
    comes_back(read_task("push", ("goals.peak_input=[0.9, 0.8]", "tolerances.position=1e-3")))


def test_the_shipped_examples_are_those_of_the_design() -> None:
    assert examples() == EXAMPLES


@settings(max_examples=150)
@given(tasks)
def test_a_task_comes_back_from_toml_json_and_pickle(data: dict[str, Any]) -> None:
    comes_back(older_task(data))


@settings(max_examples=150)
@given(tasks)
def test_a_resolved_task_stands_alone(data: dict[str, Any]) -> None:
    task = older_task(data)
    for n in {task.sizes[0], task.sizes[-1]}:
        resolved = task.resolve(n)
        assert resolved.resolve(n) == resolved
        assert ResolvedTask.model_validate(json.loads(to_json(resolved))) == resolved
        assert older_task(json.loads(to_json(resolved))).resolve(n) == resolved
        # only what has no value at all is left open
        written = resolved.model_dump(mode="json")
        assert {key for key, value in written.items() if value is None} == {"task_seed"}
        assert None not in written["search"].values()
        assert None not in written["module"]["airflow"].values()
        assert None not in written["module"]["body"].values()


@pytest.mark.parametrize("key", ["a0", "a10", "af0000", "a110"])
def test_a_design_comes_back_from_its_file(tmp_path: Any, key: str) -> None:
    topology, versions = Topology.from_key(key), {"casadi": "3.7"}
    record = SolverRecord(
        status="Solve_Succeeded",
        iterations=61,
        seconds=0.5,
        versions=versions,
        seed=3,
        start=1,
        starts=2,
        starts_feasible=1,
    )
    made = design(topology, "push-two-paths", solver=record.model_dump(mode="json"))
    path = tmp_path / "deep" / "design.json"
    write_atomically(path, to_json(made))
    again = read_json(Design, path)
    assert again == made
    assert pickle.loads(pickle.dumps(made)) == made
    np.testing.assert_array_equal(again.inputs.ravel(), np.ravel(made.rotor_speeds_squared))
    assert again.inputs.shape == (3, topology.n, 4)
    assert not again.inputs.flags.writeable
    assert SolverRecord.model_validate(again.solver) == record
    assert [entry.name for entry in path.parent.iterdir()] == ["design.json"]


def test_infeasible_and_audit_come_back_from_json() -> None:
    infeasible = Infeasible(
        topology=Topology.from_key("a10"),
        topology_key="a10",
        status="infeasible",
        unit="N m",
        worst_constraint="load case 2, torque",
        violation=0.3,
        message="load case 2 lacks 0.3 N m of torque",
    )
    assert Infeasible.model_validate(json.loads(to_json(infeasible))) == infeasible
    overlapping = audit(fan(hinges=(0.0, 0.0)))
    data = json.loads(to_json(overlapping))
    assert (data["format"], data["version"], data["verdict"]) == ("topo-search/audit", 1, "violated")
    assert Audit.model_validate({**data, "remark": "added by another program"}) == overlapping
    assert json.loads(to_json(Audit.model_validate(data))) == data
