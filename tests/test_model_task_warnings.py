"""Which tasks are warned about, and which are not."""

import copy
import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from older import older_task
from pydantic import BaseModel
from wording import says

from topo_search.model import BadInput, Task
from topo_search.model.task_file import examples, read_task
from topo_search.model.value import _models_in
from topo_search.report.task_warnings import USUAL, USUAL_AT_TARGET, task_warnings

# Modules as they are sold: a nano quadrotor, and one that lifts itself and 15 kg.
NANO = {
    "mass": 0.027,
    "arm_length": 0.0397,
    "connector_distance": 0.06,
    "thrust_coefficient": 2.88e-8,
    "torque_coefficient": 1.72e-10,
    "max_thrust": 0.149,
    "body": {
        "rotor_radius": 0.0235,
        "rotor_height": 0.004,
        "arm_width": 0.006,
        "hub": [0.03, 0.03, 0.02],
        "inertia": [1.4e-5, 1.4e-5, 2.17e-5],
    },
}
HEAVY = {
    "mass": 9.5,
    "arm_length": 0.45,
    "connector_distance": 0.65,
    "thrust_coefficient": 1.53e-4,
    "torque_coefficient": 4.6e-6,
    "max_thrust": 60.0,
    "body": {"rotor_radius": 0.23, "hub": [0.25, 0.25, 0.12], "inertia": [0.25, 0.25, 0.4]},
}
PER_RPM = (2 * math.pi / 60) ** 2
GRAMS_FORCE = 1000 / 9.81
HOVER = {"com": {"force": [0.0, 0.0, 1.0]}}
PUSH_WHILE_HOVERING = {"end_effector": {"force": [0.2, 0.0, 0.0]}, "contact": "push", **HOVER}


def found(**fields: Any) -> dict[str, str]:
    """The warnings of a task with no other reason for warnings, by field."""
    task = {"name": "odd", "modules": 3, "load_cases": [PUSH_WHILE_HOVERING, HOVER], **fields}
    return {one.path: one.words for one in task_warnings(older_task(task))}


def test_nothing_is_odd_about_a_plain_task() -> None:
    assert found() == {}


ODD = {
    "survives-a-rotor": {"load_cases[0].contact"},
    "five-inch": {"module.torque_to_thrust"},  # published, and more drag than measured propellers have
    "h-modquad": {"module.thrust_coefficient"},  # in its source thrusts are inputs
    "h-modquad-twelve": {"module.thrust_coefficient", "load_cases"},  # its wrenches are no flight
}


def test_the_shipped_tasks_are_odd_only_where_the_paper_pushes_with_half_the_weight() -> None:
    for name in examples():
        warnings = {one.path for one in task_warnings(read_task(name))}
        pushes = {"load_cases[0]", "load_cases[1]"} if name.startswith("push") else set()
        papers = name.startswith(("push", "ten-wrenches"))
        others = {"module.torque_coefficient"} if papers else ODD.get(name, set())
        assert warnings == pushes | others, name


def test_rotors_that_nobody_builds() -> None:
    (told,) = found(module={"torque_coefficient": 1.06e-8}).values()
    assert says(told, "figure of merit of rotors of 0.05 m radius is 0.165", "k_tau / k_f = 0.0274 m")
    assert found(module={"torque_coefficient": 3.1e-9}) == {}
    larger = found(module={"body": {"rotor_radius": 0.065}})  # C_T = 4 pi^2 3.87e-7 / (1.2 0.13^4)
    assert "C_T of rotors of 0.065 m radius is 0.0446" in larger["module.thrust_coefficient"]
    fast = found(module={"max_thrust_to_weight": 12.0})
    assert "at full thrust tips of rotors of 0.05 m radius move at 214 m/s" in fast["module.thrust_coefficient"]


def test_a_rotor_better_than_ideal_is_refused_in_a_task_file_alone() -> None:
    with pytest.raises(BadInput, match=r"module.torque_coefficient: must give a figure of merit of at most 1"):
        read_task("push", ("module.torque_coefficient=1.7e-9",))
    assert read_task("push", ("module.torque_coefficient=1.8e-9",)).module.figure_of_merit(1.2) < 1
    per_krpm = (2e3 * math.pi / 60) ** 2
    settings = (f"module.thrust_coefficient={3.87e-7 * per_krpm}", f"module.torque_coefficient={3.1e-9 * per_krpm}")
    for given in (settings, settings[:1], (settings[0], "module.torque_to_thrust=0.008")):
        with pytest.raises(BadInput, match=r"module.thrust_coefficient: .*is it in N s\^2/rad\^2"):
            read_task("wall-push", given)


@pytest.mark.parametrize(
    ("case", "warned"),
    [
        ({"end_effector": {"force": [0.5, 0.0, 0.5]}}, True),
        ({"end_effector": {"force": [0.0, 0.0, 0.3]}, "com": {"force": [0.0, 0.0, 0.6]}}, True),
        # pressing down while hovering: the target carries a part of the weight
        ({"end_effector": {"force": [0.0, 0.0, -0.3]}, "com": {"force": [0.0, 0.0, 1.0]}}, False),
        ({"units": "SI", "com": {"force": [1.0, 0.0, 7.53]}}, True),
        ({"units": "SI", "carries_weight": True, "end_effector": {"force": [1.0, 0.0, -2.0]}}, False),
    ],
)
def test_a_load_case_that_does_not_carry_the_weight(case: dict[str, Any], warned: bool) -> None:
    words = found(load_cases=[HOVER, case]).get("load_cases[1]", "")
    assert says(words, "less than the weight, 7.534 N of 3 modules", "gravity", "carries_weight = true") is warned


WALL = {"kind": "allowed", "planes": [{"normal": [1.0, 0.2, 0.0], "offset": 0.1}], "solid": True}


@pytest.mark.parametrize(
    ("fields", "is_open"),
    [
        ({}, True),
        ({"exposure": [WALL]}, False),
        ({"exposure": [WALL | {"solid": False}]}, True),
        ({"exposure": [WALL | {"planes": [{"normal": [-1.0, 0.0, 0.0]}]}]}, False),  # a plug
        ({"exposure": [WALL | {"planes": [{"normal": [0.0, 0.0, -1.0]}]}]}, True),  # a floor along the force
        ({"exposure": [{"kind": "local", "radius": 0.1, "solid": True}]}, True),  # the rod reaches in from anywhere
        ({"exposure": [{"kind": "exterior", "half_angle_deg": 60.0, "solid": True}]}, True),
        ({"end_effector": {"rod": "none"}}, False),
    ],
)
def test_a_force_at_the_tip_without_an_object_leaves_the_side_of_the_tool_open(
    fields: dict[str, Any], is_open: bool
) -> None:
    push = {"carries_weight": True, "end_effector": {"force": [0.2, 0.0, 0.0]}}
    assert ("load_cases[0].contact" in found(load_cases=[push, HOVER], **fields)) is is_open


def test_with_a_range_of_sizes_the_largest_platform_counts() -> None:
    case = {"units": "SI", "com": {"force": [1.0, 0.0, 8.0]}}
    assert found(load_cases=[HOVER, case]) == {}
    assert list(found(load_cases=[HOVER, case], modules=[3, 4])) == ["load_cases[1]"]


def test_a_task_in_which_nothing_hovers() -> None:
    assert "none is plain hover" in found(load_cases=[PUSH_WHILE_HOVERING])["load_cases"]
    tilted = {"com": {"force": [0.0, 0.0, 1.0], "torque": [0.1, 0.0, 0.0]}}
    assert "load_cases" in found(load_cases=[tilted])
    si = {"units": "SI", "com": {"force": [0.0, 0.0, 0.768 * 9.81]}}
    assert found(load_cases=[si]) == {}
    assert found(load_cases=[{"carries_weight": True}], modules=[2, 5]) == {}


@pytest.mark.parametrize(
    ("fields", "path", "said"),
    [
        ({"gravity": 1.62}, "gravity", "1.62 m/s^2 is not that of the Earth's surface"),
        ({"module": {"max_thrust_to_weight": 1.05}}, "module.max_thrust_to_weight", "produce at most 7.417 N"),
        ({"module": {"body": {"rotor_radius": 0.08}}}, "module.body.rotor_radius", "rotors of a module overlap"),
        ({"module": {"connector_distance": 0.12}}, "module.connector_distance", "rotors reach 0.121 m out"),
        (
            {"end_effector": {"position": [0.2, 0.0, 0.1], "stand_off": 0.3}},
            "end_effector.stand_off",
            "0.3 m is more than the 0.2236 m from the centre of mass",
        ),
        (
            {"exposure": [{"kind": "directional", "segments": [[1.0, 0.0, 0.0], [0.0, 0.0, -800.0]]}]},
            "exposure[0].segments",
            "800 m is 1540 times",
        ),
        ({"load_cases": [{"com": {}}, HOVER]}, "load_cases[0]", "asks for no force and no torque"),
        ({"load_cases": [HOVER, PUSH_WHILE_HOVERING, HOVER]}, "load_cases[2]", "is the same as load_cases[0]"),
        ({"load_cases": [HOVER, {**PUSH_WHILE_HOVERING, "weight": 1e4}]}, "load_cases", "by a factor of 1e+04"),
        ({"module": {"arm_length": 0.135}}, "module.body", "hinges turn by at most 47.4 deg"),
        (
            {"module": {"body": {"rotor_radius": 0.09}}},
            "module.body",
            "no hinge angle is known to keep rotors clear",
        ),
        ({"search": {"margin": 0.0}}, "search.margin", "too close to zero"),
    ],
)
def test_values_that_are_seldom_meant(fields: dict[str, Any], path: str, said: str) -> None:
    assert said in found(**fields)[path]


def scale(module: dict[str, Any], factors: dict[str, float]) -> dict[str, Any]:
    """The module with fields in another unit."""
    changed: dict[str, Any] = copy.deepcopy(module)
    for path, factor in factors.items():
        *tables, name = path.split(".")
        table = changed[tables[0]] if tables else changed
        value = table[name]
        table[name] = [factor * one for one in value] if isinstance(value, list) else factor * value
    return changed


@pytest.mark.parametrize("module", [NANO, HEAVY], ids=["nano", "heavy"])
@pytest.mark.parametrize(
    ("factors", "path"),
    [
        ({"mass": 1000}, "module.mass"),
        ({"max_thrust": GRAMS_FORCE}, "module.max_thrust"),
        ({"thrust_coefficient": PER_RPM}, "module.thrust_coefficient"),
        ({"torque_coefficient": PER_RPM}, "module.torque_coefficient"),
        ({"arm_length": 100}, "module.arm_length"),
        ({"arm_length": 100, "connector_distance": 100, "body.rotor_radius": 100}, "module.arm_length"),
        ({"body.rotor_radius": 10}, "module.body.rotor_radius"),
        ({"body.inertia": 1000}, "module.body.inertia[0]"),
    ],
)
def test_a_slip_of_units_is_told_of_any_module(module, factors, path):
    assert found(module=module) == {}
    assert path in found(module=scale(module, factors))


def test_a_value_is_not_blamed_for_the_slip_of_another() -> None:
    assert set(found(module=scale(NANO, {"mass": 1000}))) == {"module.mass", "module.max_thrust"}
    assert set(found(module=scale(NANO, {"max_thrust": GRAMS_FORCE}))) == {"module.max_thrust"}
    assert set(found(module=scale(NANO, {"torque_coefficient": PER_RPM}))) == {"module.torque_coefficient"}


@pytest.mark.parametrize(
    ("fields", "path", "said"),
    [
        ({"module": {"mass": 0.716, "max_thrust": 612.0}}, "module.max_thrust", "349 times its weight"),
        ({"module": {"max_thrust_to_weight": 250.0}}, "module.max_thrust_to_weight", "is it a ratio"),
        ({"module": {"airflow": {"spread_angle_deg": 0.1745}}}, "module.airflow.spread_angle_deg", "(10 deg"),
        ({"end_effector": {"rod_linear_density": 45.0}}, "end_effector.rod_linear_density", "5.73e+05 kg/m^3"),
    ],
)
def test_a_slip_of_units_is_told_with_its_reason(fields: dict[str, Any], path: str, said: str | None) -> None:
    warnings = found(**fields)
    assert said in warnings[path] if said else path not in warnings


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"exposure": [{"kind": "directional", "radius": 15.0, "segments": [[1, 0, 0]]}]}, "exposure[0].radius"),
        ({"end_effector": {"largest_reach": 20.0}}, "end_effector.largest_reach"),
    ],
)
def test_centimetres_are_told_whatever_the_number_of_modules(fields: dict[str, Any], path: str) -> None:
    """What is a hundred times as long as was meant; nobody is warned about what was meant."""
    for n in (1, 3, 100):
        assert "lengths are in metres" in found(**fields, modules=n)[path]


COMPUTED = {"module.body.frame_excess", "exposure.mesh_excess", "module.torque_to_thrust"}


def units(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, str]]:
    """Yield the fields of a task that have a length or an angle, and its unit."""
    for name, field in model.model_fields.items():
        at = f"{path}.{name}" if path else name
        if unit := re.search(r"\[(m|deg)\]", field.description or ""):
            yield at, unit[1]
        for part in _models_in(field.annotation):
            yield from units(part, at)


def test_every_length_and_angle_has_usual_values() -> None:
    """`module.arm_length` is what others are compared with."""
    lengths = {*USUAL, *USUAL_AT_TARGET, *COMPUTED, "module.arm_length"}
    all_units = [(path.replace("module_types", "module"), unit) for path, unit in units(Task)]
    assert {path for path, unit in all_units if unit == "m"} <= lengths
    assert all(path.endswith("_deg") for path, unit in units(Task) if unit == "deg")


PANE = {"kind": "allowed", "planes": [{"normal": [1, 0, 0]}], "speed": 1.0}


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"module": {"bracket": {"bolt_circle": 0.24}}}, "module.bracket.bolt_circle"),
        ({"module": {"bracket": {"thickness": 4.0}}}, "module.bracket.thickness"),
        ({"search": {"body_clearance": 300.0}}, "search.body_clearance"),
        ({"flight": {"angular_acceleration": [0.0, 630.0, 0.0]}}, "flight.angular_acceleration"),
        ({"goals": {"stand_off": [0.1, 200.0]}}, "goals.stand_off"),
        ({"search": {"hinge_angles_deg": [0.0, 0.52, 1.05]}}, "search.hinge_angles_deg"),
        (
            {"exposure": [{**PANE, "planes": [{"normal": [2, 0, 0], "offset": 200.0}]}]},
            "exposure[0].planes[0].offset",
        ),
    ],
)
def test_a_slip_of_units_is_told_of_any_length_and_angle(fields: dict[str, Any], path: str) -> None:
    assert path in found(**fields)


def test_the_farthest_corner_of_a_region_counts() -> None:
    corners = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 30.0]]
    assert "30 m is" in found(exposure=[{"kind": "local", "vertices": corners}])["exposure[0].vertices"]


@pytest.mark.parametrize("n", [1, 3, 100])
def test_lengths_of_the_platforms_size_are_not_odd(n: int) -> None:
    exposure = [
        {"kind": "local", "radius": 0.3},
        {"kind": "directional", "segments": [[4.0, 0.0, 0.0]]},
        {"kind": "directional", "along": "end_effector", "length": 4.0},
    ]
    assert found(exposure=exposure, end_effector={"stand_off": 1.0}, modules=n) == {}


@pytest.mark.parametrize(("edge", "warned"), [(0.3, False), (0.314, False), (0.316, True), (0.42, True)])
def test_frames_that_reach_past_their_connectors(edge: float, warned: bool) -> None:
    """The audit lets them touch up to 7.5 mm past."""
    start = f"hub and arms reach {edge / 2:.3g} m out, past the connector at 0.15 m"
    for hub in ([edge, 0.02, 0.02], [0.02, edge, 0.02]):
        given = {"name": "odd", "modules": 3, "load_cases": [HOVER], "module": {"body": {"hub": hub}}}
        assert any(one.words.startswith(start) for one in task_warnings(older_task(given))) is warned
