"""`fly` and `export --format kit` on platforms of every kind, and what they say of files that are wrong."""

import json

import numpy as np
import pytest
from commands import invoke, refused
from export_cases import OWN_FRAME, random_design
from suites import few

from topo_search.model import Design, Topology
from topo_search.model.files import to_json
from topo_search.simulation.campaign import plan
from topo_search.simulation.scenarios import Scenario
from topo_search.topologies import sample

COMMANDS = (("fly", "--only", "hover"), ("export", "--format", "kit", "--out", "kit"))


@pytest.fixture
def command(tmp_path, monkeypatch):
    """The commands in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda name, *words, **status: invoke(name, "mine.json", *words, **status)


def level(topology: Topology, **task) -> Design:
    """A platform of level modules, which hovers on all of its rotors, with a light tip below its middle."""
    drawn = random_design(topology, 1, {"end_effector": {"mass": 1e-6}, **task})
    flat = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (0.0,) * (topology.n - 1)}
    return drawn.model_copy(update={**flat, "end_effector_m": (0.0, 0.0, -0.2)})


@pytest.mark.parametrize(
    ("n", "connectors", "module", "seed"),  # of trees without two modules in one place
    few(
        [
            (2, "any", {"body": OWN_FRAME}, 3),
            (6, "any", {}, 4),
            (2, "aligned", {}, 3),
            (12, "aligned", {"body": OWN_FRAME}, 3),
        ],
        2,
    ),
)
def test_any_platform_is_flown_and_has_its_matrix_and_brackets(command, tmp_path, n, connectors, module, seed):
    (tree,) = sample(n, 1, seed, connectors=connectors)
    made = level(tree, module=module)
    (tmp_path / "mine.json").write_text(to_json(made))
    flown = command("fly", "--only", "hover", "--json")
    assert flown.exit_code in (0, 1)  # level rotors cannot hold their place, but they are flown
    result = json.loads(flown.stdout)
    assert [one["name"] for one in result["scenarios"]] == ["hover"]
    assert result["rotors"] == 4 * n
    assert result["mass_kg"] >= made.task.total_mass(n)
    command("export", "--format", "allocation", "--out", "matrix.json")
    matrix = np.array(json.loads((tmp_path / "matrix.json").read_text())["thrust_matrix"])
    np.testing.assert_allclose(matrix[:3], np.array([[0.0], [0.0], [1.0]]) @ np.ones((1, 4 * n)), atol=1e-12)
    command("export", "--format", "brackets", "--out", "stl")
    assert [path.name for path in (tmp_path / "stl").glob("bracket_*.stl")] == ["bracket_0.000deg.stl"]
    command("export", "--format", "rotors", "--out", "rotors.csv")
    assert len((tmp_path / "rotors.csv").read_text().splitlines()) == 4 * n + 1


@pytest.mark.parametrize("words", COMMANDS)
@pytest.mark.parametrize(
    ("field", "value"), [("mass", -0.24), ("mass", 0.0), ("inertia", [1e-3, -1e-3, 1e-3]), ("mass", float("nan"))]
)
def test_masses_that_are_none_are_named(command, tmp_path, words, field, value):
    stated = json.loads(to_json(level(Topology.from_key("a0"))))
    stated["task"]["module"][field] = value
    (tmp_path / "mine.json").write_text(json.dumps(stated))
    name, *options = words
    told = refused(name, "mine.json", *options)
    assert f"task.module.{field}" in told or "NaN" in told
    assert {path.name for path in tmp_path.iterdir()} == {"mine.json"}


def test_who_cannot_hover_gets_one_line(command, tmp_path):
    (tmp_path / "mine.json").write_text(to_json(random_design(Topology.from_key("a0"), 1)))
    assert "cannot hover in the attitude of its task" in refused("fly", "mine.json", "--out", "flight")
    assert {path.name for path in tmp_path.iterdir()} == {"mine.json"}


def test_loads_are_flown_the_same_in_weights_and_in_newtons():
    push = {"force": [0.2, 0.0, 0.0], "torque": [0.0, 0.1, 0.0]}
    weights = level(Topology.from_key("a0"), load_cases=[{"end_effector": push, "carries_weight": True}])
    W, unit = weights.task.force_unit(1), weights.task.torque_unit(1)
    newtons = {"force": [0.2 * W, 0.0, 0.0], "torque": [0.0, 0.1 * unit, 0.0]}
    case = {"units": "SI", "end_effector": newtons, "carries_weight": True}
    si = level(Topology.from_key("a0"), load_cases=[case])
    one, other = (
        [each for each in plan(made, 0, False) if isinstance(each, Scenario) and each.name.startswith("load")]
        for made in (weights, si)
    )
    assert [each.name for each in one] == [each.name for each in other] == ["load case 0, load at the tip"]
    np.testing.assert_allclose(one[0].exerted, other[0].exerted, rtol=1e-14)
    np.testing.assert_allclose(one[0].exerted[:3], newtons["force"], rtol=1e-14)
