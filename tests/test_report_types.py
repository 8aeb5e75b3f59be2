"""Pages, pictures and task facts of platforms with types of module."""

from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from export_cases import random_design
from typed_cases import DESIGN, ROTORS

from topo_search.export import palette
from topo_search.export.picture import figure_of
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Task, Topology
from topo_search.report import charts, design_part
from topo_search.report.headline import headline
from topo_search.report.scene import scene, shared_meshes
from topo_search.report.task_facts import facts
from topo_search.report.task_warnings import largest_thrust, task_warnings
from topo_search.report.view import thumbnail, view
from verify.kinematics import has_rotor, platform

NAMES = ["quad", "tri & tilt", "battery"]
PLAIN = random_design(Topology.from_key("a3010"), 7)


def test_each_type_has_its_colour_in_the_legend_and_its_meshes() -> None:
    parts, shared = list(scene(DESIGN, platform(DESIGN))), shared_meshes(DESIGN)
    bodies = {part.name: part for part in parts if part.kind == "modules"}
    assert list(bodies) == NAMES
    assert [list(part.modules) for part in bodies.values()] == [[0, 3], [2], [1]]
    assert len({part.colour for part in bodies.values()}) == 3
    assert {part.mesh for part in parts if isinstance(part.mesh, str)} <= {*shared}
    for kind in ("airflow", "rotors", "axes", "spin"):
        drawn = [i for part in parts if part.kind == kind for i in part.modules]
        assert {*drawn} == {0, 2, 3}, kind  # the battery has none
    counts = [sum(i in part.modules for part in parts if part.kind == "rotors") for i in range(4)]
    assert counts == ROTORS
    hub = np.reshape(shared["modules of 2"]["corners"], (-1, 3))
    assert np.ptp(hub, axis=0) == pytest.approx([0.12, 0.06, 0.05])
    joint = np.reshape(shared["joint 0 of 2"]["corners"], (-1, 3))
    assert 0.11 < joint[:, 0].max() < 0.13


def test_without_types_the_legend_says_modules() -> None:
    bodies = [part for part in scene(PLAIN, platform(PLAIN)) if part.kind == "modules"]
    assert [(part.name, part.colour, part.mesh) for part in bodies] == [("modules", palette.MODULE, "modules")]
    assert 'fill="#ffffff"' in tree_svg(PLAIN)
    assert charts.rotor_inputs(PLAIN)["layout"]["xaxis"]["title"]["text"] == "module (4 rotors each)"


def test_the_view_has_the_rotors_and_jets_of_each_type() -> None:
    shown = view(DESIGN, platform(DESIGN), None)
    assert [[len(of_module) for of_module in case] for case in shown["throttle"]] == [ROTORS]
    assert shown["air"]["of"] == [0, 2, 1, 0]
    assert [len(kind["rotors"]) for kind in shown["air"]["types"]] == [4, 3, 0]
    assert [line.split("\n")[0] for line in shown["modules"]] == [
        *("module 0, quad", "module 1, battery", "module 2, tri & tilt", "module 3, quad")
    ]
    assert thumbnail(DESIGN).count("<polygon") == sum(ROTORS) + 1  # the battery is its hub


def test_inputs_of_absent_rotors_are_in_no_figure() -> None:
    u = DESIGN.inputs[0][has_rotor(DESIGN.task)]
    limits = DESIGN.task.input_limits[has_rotor(DESIGN.task)]
    (trace,) = charts.rotor_inputs(DESIGN)["data"]
    assert trace["y"] == pytest.approx((u / limits).tolist())
    assert trace["text"][4].startswith("module 2, rotor 0")
    (row,) = design_part.loads(DESIGN).rows
    assert row[1].startswith(f"{(u / limits).min():.2f}"[:4])
    (peak,) = [tile for tile in headline(DESIGN, None, None, "") if tile.name == "Peak throttle"]
    assert f"mean {100 * (u / limits).mean():.3g} %" in peak.meaning


def test_the_tree_and_the_picture_name_the_types() -> None:
    svg = ElementTree.fromstring(tree_svg(DESIGN))
    texts = [text.text for text in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert texts[-3:] == NAMES
    squares = [rect.attrib for rect in svg.iter("{http://www.w3.org/2000/svg}rect")]
    fills = [square["fill"] for square in squares if square["width"] == "0.46"]
    legend = [square["fill"] for square in squares if square["width"] == "0.16"]
    assert fills == [legend[0], legend[2], legend[1], legend[0]]
    (found,) = figure_of(DESIGN).legends
    assert [text.get_text() for text in found.get_texts()][:3] == NAMES


def test_the_task_says_what_the_platform_is_made_of() -> None:
    said = {title: dict(rows) for title, rows in facts(DESIGN.task)}
    assert said["platform"]["size"] == "4 modules: 2 quad, 1 tri & tilt, 1 battery"
    assert said["platform"]["mass of a joint"] == "0.05 kg, at its connector"
    assert said["type battery: 1 module"] == {
        "mass m": "0.3 kg",
        "hub": "12 cm × 6 cm × 5 cm",
        "connector distance l_c": "0.11 m",
        "rotors": "none",
    }
    assert said["type tri & tilt: 1 module"]["rotors"].startswith("3, with axes up to 5.71°")
    assert {title for title in said if "envelope" in title} == {
        *("airflow envelope of quad", "airflow envelope of tri & tilt")
    }


def warnings(types: list[dict[str, Any]], **fields: Any) -> dict[str, str]:
    base = {"name": "odd", "load_cases": [{"carries_weight": True}], "flight": {"defaults": False}}
    task = Task.model_validate({**base, **fields, "module_types": types})
    return {one.path: one.words for one in task_warnings(task)}


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ({"mass": 200.0}, "mass"),
        ({"rotors": [], "mass": 200.0}, "mass"),
        ({"rotors": [], "battery_Wh": 54e3, "mass": 0.3}, "battery_Wh"),
        ({"rotors": [], "connector_distance": 0.015, "body": {"hub": [0.1, 0.1, 0.1]}}, "connector_distance"),
        ({"connector_distance": 0.1}, "connector_distance"),
        ({"rotors": [], "connector_distance": 0.04, "body": {"hub": [0.1, 0.1, 0.1]}}, "body"),
    ],
)
def test_what_is_odd_about_a_type_is_told_where_it_is(kind: dict[str, Any], path: str) -> None:
    types = [{"name": "quad", "count": 3}, {"name": "other", "count": 1, **kind}]
    found = warnings(types)
    assert f"module_types[1].{path}" in found
    assert not any(name.startswith("module_types[0]") for name in found)


def test_types_do_not_repeat_what_is_odd_about_the_module() -> None:
    found = warnings([{"name": name, "count": 2} for name in "ab"], module={"body": {"rotor_radius": 0.08}})
    assert "module.body.rotor_radius" in found
    assert not any(name.startswith("module_types") for name in found)


def test_all_rotors_lift_what_types_weigh() -> None:
    types = [
        {"name": "quad", "count": 1, "max_thrust": 1.0},
        {"name": "load", "count": 2, "rotors": [], "mass": 0.4},
    ]
    task = Task.model_validate({"name": "heavy", "load_cases": [{"carries_weight": True}], "module_types": types})
    assert largest_thrust(task, 3) == pytest.approx(4.0)
    assert any("produce at most 4 N" in one.words for one in task_warnings(task))
