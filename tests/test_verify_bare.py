"""Geometries without inputs: the audit judges them with inputs of its own, and says so."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import invoke

import verify
from topo_search import Design, Geometry, audit, read_design, read_json, read_task, to_json
from topo_search.model import Status
from topo_search.model.files import to_geometry
from topo_search.model.proven import TOLERANCE
from verify.kinematics import objective

DESIGNS = Path(__file__).parent / "designs"
HOVER = {
    "task": {"name": "mine", "modules": 2, "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}]},
    "topology": [[-1, -1, -1], [0, 0, 2]],
    "root_orientation_rad": [0.0, 0.0, 0.0],
    "hinge_angles_rad": [0.0],
    "end_effector_m": [0.15, 0.0, 0.3],
}


def bare(name: str) -> tuple[Design, Geometry]:
    data = json.loads((DESIGNS / f"{name}.json").read_text())
    design = Design.model_validate(data)
    del data["rotor_speeds_squared"], data["objective"]
    return design, to_geometry(data, name)


@pytest.mark.parametrize("name", ["push-a70010", "survives-a-rotor", "wall-press", "window-cleaning"])
def test_a_design_without_its_inputs_gets_them_back(name: str) -> None:
    design, geometry = bare(name)
    completed = verify.complete(geometry)
    assert completed.objective == pytest.approx(objective(design), rel=TOLERANCE)
    np.testing.assert_allclose(completed.inputs, design.inputs, atol=TOLERANCE * design.task.max_input)


def test_its_audit_is_that_of_the_design_but_for_a_remark() -> None:
    design, geometry = bare("wall-push-without-reserves")
    whole, of_bare = audit(design), audit(geometry)
    assert of_bare.pairs == whole.pairs
    assert of_bare.verdict == whole.verdict == Status.CLEAR
    assert whole.inputs_words is None
    assert of_bare.inputs_words is not None
    assert f"J = {design.objective:.6g}" in of_bare.inputs_words
    assert of_bare.inputs_words in of_bare._repr_html_()


def test_inputs_for_a_wrench_that_rotors_cannot_produce_miss_it() -> None:
    weak = {**HOVER, "task": {**HOVER["task"], "load_cases": [{"com": {"force": [1.0, 0.0, 1.0]}}]}}
    found = audit(to_geometry(weak, "weak"))
    assert found.verdict == Status.VIOLATED
    assert "load case 0, force" in [row.name for row in found.residuals if row.status is Status.VIOLATED]


def test_modules_side_by_side_carry_their_weight_with_equal_inputs() -> None:
    completed = verify.complete(to_geometry(HOVER, "hover"))
    task = completed.task
    u = task.force_unit(2) / 8 / task.module.thrust_coefficient
    # the tip is above the middle, so that it moves the centre of mass along z alone
    np.testing.assert_allclose(completed.inputs, u, rtol=1e-9)


def test_a_rod_that_the_task_counts_is_counted() -> None:
    task = read_task("wall-push", ("end_effector.rod_mass=included",)).resolve(3)
    fields = {"topology": [(-1, -1, -1), (0, 0, 2), (0, 1, 3)], "hinge_angles_rad": (0.5, -0.5)}
    completed = verify.complete(
        Geometry.model_validate(
            {"task": task, "root_orientation_rad": (0, 0, 0), "end_effector_m": (-0.3, 0, 0.05), **fields}
        )
    )
    rod = completed.task.end_effector.counted_rod
    assert (rod.module, rod.port) == (completed.mount.module, completed.mount.port)
    (mass,) = [row for row in audit(completed).residuals if row.name == "mass of the end-effector's rod"]
    assert mass.status is Status.CLEAR
    assert mass.derived == pytest.approx(rod.mass)


def test_absurd_numbers_get_no_inputs() -> None:
    assert not verify.complete(to_geometry({**HOVER, "end_effector_m": [1e200, 0.0, 0.0]}, "far")).inputs.any()


def test_commands_read_a_geometry(in_process, tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(HOVER))
    result = invoke("audit", file, status=1)  # its envelopes overlap
    assert "the design gives no inputs" in result.output
    assert json.loads(invoke("audit", file, "--json", status=1).stdout)["inputs_computed"] is True
    invoke("report", file, "--out", tmp_path / "mine.html")
    assert "the design gives no inputs" in (tmp_path / "mine.html").read_text()
    (tmp_path / "whole.json").write_text(to_json(read_design(file)))
    assert audit(read_json(Design, tmp_path / "whole.json")).inputs_computed
