"""Types of module in tasks and designs: what is taken over, and what is refused with field, rule and value."""

import re
from pathlib import Path
from typing import Any

import pytest
from test_verify_types import mixed_design

from topo_search.compose.binding import enclose_speed
from topo_search.compose.drawer import kit
from topo_search.model import BadInput, Design, Module, Task
from topo_search.model.files import to_toml, validate
from topo_search.model.task_file import read_task
from topo_search.study import Request
from topo_search.study.proving import refuse_unprovable
from topo_search.study.relaxable_limits import relaxable

QUAD = {"name": "quad", "count": 2}
BATTERY = {"name": "battery", "count": 1, "rotors": []}
ONE_SIDED = [{"position": [0.1, 0.0, 0.0], "spin": 1}]
LEANING = [{"position": [x, 0.0, 0.0], "spin": 1, "axis": [10 * x, 0.0, 1.0]} for x in (0.1, -0.1)]


def task(*types: Any, **fields: Any) -> Task:
    stated = {
        "name": "t",
        "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}],
        "module_types": list(types),
        **fields,
    }
    return validate(Task, stated, "t.toml")


BAD: dict[str, tuple[list[Any], dict[str, Any], str, str]] = {
    "counts": ([QUAD, BATTERY], {"modules": 5}, "modules", "the sum of their counts, 2 + 1 = 3, but got 5"),
    "a range": ([QUAD, BATTERY], {"modules": [3, 5]}, "modules", "2 + 1 = 3, but got [3, 5]"),
    "no count": ([QUAD, {"name": "b"}], {"modules": 3}, "module_types[1].count", "is required, but missing"),
    "count of none": ([{**QUAD, "count": 0}, BATTERY], {}, "module_types[0].count", "at least 1, but got 0"),
    "no name": ([{"count": 2}, BATTERY], {}, "module_types[0].name", "is required, but missing"),
    "thrust without rotors": (
        [QUAD, {**BATTERY, "max_thrust": 3.0}],
        {},
        "module_types[1].max_thrust",
        "must be left out without rotors, but got 3",
    ),
    "an empty name": ([{**QUAD, "name": ""}, BATTERY], {}, "module_types[0].name", 'not be empty, but got ""'),
    "no table": ([QUAD, 3], {"modules": 3}, "module_types[1]", "must be a table of named fields, but got 3"),
    "unknown field": ([QUAD, {**BATTERY, "rotor": []}], {}, "module_types[1].rotor", "did you mean `rotors`?"),
    "no rotors at all": ([BATTERY], {}, "module_types", "must have a type with rotors, but got none"),
    "none in [module]": ([QUAD, BATTERY], {"module": {"rotors": []}}, "module.rotors", "must have at least one"),
    "joints of a type": (
        [QUAD, {**BATTERY, "joint_mass": 0.1}], {}, "module_types[1].joint_mass",
        "must be left out: it is [module]'s for all types, but got 0.1",
    ),
    "inputs of a type": ([{**QUAD, "min_input": 0.1}], {}, "module_types[0].min_input", "but got 0.1"),
    "brackets of a type": (
        [QUAD, {**BATTERY, "bracket": {"wall": 0.002}}], {}, "module_types[1].bracket", 'but got {"bolt_circle"'
    ),
    "one-sided": (
        [QUAD, {**BATTERY, "rotors": ONE_SIDED}], {"search": {"connectors": "any"}}, "search.connectors",
        'onto each other, those of module_types[1], but got "any"',
    ),
    "far rotors": (
        [QUAD, {**BATTERY, "connector_distance": 0.04, "rotors": ONE_SIDED}], {},
        "module_types[1].rotors[0].position", "connector_distance + body.rotor_radius = 0.09 m",
    ),
    "leaning": ([QUAD, {**BATTERY, "rotors": LEANING}], {}, "module_types[1].rotors", "but got 45 deg"),
    "speed of leaning rotors": (
        [{**QUAD, "rotors": [{**x, "axis": [x["position"][0], 0, 1]} for x in LEANING], "airflow": {"speed": 2.0}}],
        {}, "module_types[0].airflow.speed", "unless all rotors blow along the module's axis, but got 2",
    ),
    "speed over a region": (
        [QUAD, {**QUAD, "name": "fast", "thrust_coefficient": 5e-7}],
        {"exposure": [{"kind": "local", "radius": 0.1, "speed": 3.0}]}, "exposure[0]",
        "`speed` must be left out with types of module whose rotors or jets are not those of [module], but got 3",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_no_task_of_types_can_have_is_refused_with_field_rule_and_value(name: str) -> None:
    types, fields, path, words = BAD[name]
    with pytest.raises(BadInput) as caught:
        task(*types, **fields)
    assert [fault.path for fault in caught.value.faults] == [path]
    assert words in caught.value.faults[0].rule


def test_two_types_of_one_name_and_lattices_of_types_are_refused() -> None:
    with pytest.raises(BadInput) as caught:
        task(QUAD, {**BATTERY, "name": "quad"})
    rule = 'must be a name of its own, but got "quad" 2 times'
    assert [str(fault) for fault in caught.value.faults] == [f"module_types[{k}].name: {rule}" for k in (0, 1)]
    with pytest.raises(BadInput, match=r'search\.lattice: must be left out with module_types, but got "flat"'):
        task(QUAD, BATTERY, search={"lattice": "flat"})
    with pytest.raises(BadInput, match="must have at least one entry: only a type of module may have none"):
        task(modules=2, module={"rotors": []})


def test_a_type_takes_over_what_it_leaves_out() -> None:
    module = {"mass": 0.3, "max_thrust_to_weight": 2.0, "body": {"hub": [0.1, 0.1, 0.05]}, "min_input": 0.05}
    mixed = task(QUAD, BATTERY, {"name": "heavy", "count": 3, "mass": 0.6}, module=module)
    assert mixed.modules == 6
    quad, battery, heavy = mixed.module_types
    assert {kind.body.hub for kind in mixed.module_types} == {(0.1, 0.1, 0.05)}
    assert quad.max_input(9.81) == pytest.approx(mixed.module.max_input(9.81))
    assert heavy.max_input(9.81) == pytest.approx(mixed.module.max_input(9.81))  # the same rotors on twice the mass
    assert heavy.max_thrust_to_weight == pytest.approx(1.0)
    assert battery.envelopes == battery.region_envelopes == ()
    assert mixed.total_mass(6) == pytest.approx(
        2 * 0.3 + 0.3 + 3 * 0.6 + mixed.end_effector.mass + 5 * mixed.module.joint_mass
    )
    resolved = mixed.resolve(6)
    assert validate(Task, mixed.model_dump(mode="json"), "t") == mixed
    with pytest.raises(ValueError, match="needs a tree to say which type is where"):
        _ = resolved.modules_of_nodes


def test_a_rotor_better_than_ideal_is_refused_with_its_type(tmp_path: Path) -> None:
    (file := tmp_path / "t.toml").write_text(to_toml(task(QUAD, {**QUAD, "name": "b", "torque_coefficient": 1e-9})))
    with pytest.raises(
        BadInput, match=r"module_types\[1\]\.torque_coefficient: must give a figure of merit"
    ) as found:
        read_task(file)
    assert len(found.value.faults) == 1
    file.write_text(to_toml(task(QUAD, {**BATTERY, "torque_coefficient": 1e-9})))
    assert read_task(file).modules == 3


def test_a_design_names_its_types() -> None:
    design = mixed_design(0)
    data = design.model_dump(mode="json")
    assert sorted(data["types"]) == ["battery", "quad", "quad", "tri", "tri"]
    assert "types_of_nodes" not in data["task"]
    read = Design.model_validate(data)
    assert (read, read.topology.types) == (design, design.topology.types)
    counts = '{"quad": 2, "battery": 1, "tri": 2}'
    for types in ([], ["quad"] * 5, ["quad", "quad", "battery", "tri", "none"]):
        with pytest.raises(BadInput) as caught:
            validate(Design, {**data, "types": types}, "d")
        faults = {fault.path: fault.rule for fault in caught.value.faults}
        assert f"as many modules of each type as the task counts, {counts}, but got [" in faults["types"]
    with pytest.raises(BadInput, match="types must name 5, one for each module, but got 4"):
        validate(Design, {**data, "types": data["types"][1:]}, "d")
    with pytest.raises(
        BadInput, match=re.escape("rotor_speeds_squared[0]: must have one value per rotor, 20, but got 18")
    ):
        validate(Design, {**data, "rotor_speeds_squared": [row[:18] for row in data["rotor_speeds_squared"]]}, "d")


def test_a_limit_of_the_module_is_relaxed_in_all_types() -> None:
    shipped = read_task("battery-module")
    changed = {limit.field: limit.change(shipped, 1.0) for limit in relaxable(shipped, 4)}
    quad, battery = changed["module.max_thrust"].module_types
    assert (quad.max_thrust, battery.max_thrust) == (6.4, None)
    assert changed["module.max_thrust"].resolve(4).total_mass(4) == shipped.resolve(4).total_mass(4)
    assert quad.max_inputs(9.81).tolist() == (2 * shipped.module_types[0].max_inputs(9.81)).tolist()
    assert changed["module.connector_distance"].longest_connector == 2 * shipped.longest_connector


def test_proofs_and_drawers_are_of_one_type(tmp_path: Path) -> None:
    mixed = task(QUAD, BATTERY)
    rule = "must be left out: branch and bound takes modules of one kind, but got 2"
    with pytest.raises(BadInput, match=f"module_types: {rule}"):
        refuse_unprovable(Request(mixed, "t", starts=1, seed=0), "t")
    with pytest.raises(BadInput, match="module_types: must be left out, as one drawer holds modules of one kind"):
        kit([mixed], out=tmp_path / "drawer")


def test_the_air_of_every_type_is_enclosed_at_a_speed() -> None:
    heavy = {"name": "heavy", "count": 1, "mass": 0.48}
    mixed = enclose_speed(task(QUAD, heavy, BATTERY, module={"airflow": {"speed": 4.0}}))
    quad, heavy_kind, battery = (kind.airflow for kind in mixed.module_types)
    assert quad.regions == mixed.module.airflow.regions
    assert heavy_kind.regions.reach > quad.regions.reach  # it needs twice the thrust to hover
    assert battery.regions is battery.speed is quad.speed is None
    assert mixed.resolve(4).module_types[2].region_envelopes == ()
    assert isinstance(mixed.module_types[0], Module)
