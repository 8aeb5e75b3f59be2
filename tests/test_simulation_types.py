"""Flights of platforms whose modules differ: what the controller knows is what MuJoCo has, rotor by rotor."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from export_cases import exported_inertia, inertia_about_com, mass_matrix
from test_verify_types import BATTERY, QUAD, as_types, assert_alike, by_hand, mixed_design, typed_task

from topo_search.model import Design, Geometry, Topology
from topo_search.model.files import read_json
from topo_search.simulation.campaign import fly_all, hardest_rotor, plan, static_failures
from topo_search.simulation.fly import Options
from topo_search.simulation.plant import ModelErrors, Plant, nominal
from topo_search.simulation.scenarios import Scenario
from verify import complete
from verify.kinematics import has_rotor

EXAMPLES = Path(__file__).parent.parent / "topo_search/examples/best"


@pytest.mark.parametrize("seed", range(2))
def test_mass_inertia_and_wrenches_of_every_type_are_those_of_mujoco(seed: int) -> None:
    design = mixed_design(seed, module={"joint_mass": 0.03}, end_effector={"mass": 0.1})
    known, plant, expected = nominal(design), Plant(design, ModelErrors()), by_hand(design)
    plant.place(known.com, np.array([1.0, 0.0, 0.0, 0.0]))
    data, model, is_rotor = plant.data, plant.model, has_rotor(design.task)
    M = mass_matrix(model, data)
    assert model.nu == is_rotor.sum() == len(known.largest_thrust) == 2 * 4 + 2 * 3
    assert M[0, 0] == pytest.approx(known.mass, rel=1e-12) == pytest.approx(2 * 0.24 + 0.5 + 0.6 + 0.12 + 0.1)
    turning = exported_inertia(design) - inertia_about_com(design)  # that of points, which the design neglects
    np.testing.assert_allclose(M[3:, 3:], expected["J"] + turning, atol=1e-9)
    k_f = [m.thrust_coefficient for m in design.task.modules_of_nodes for _ in range(m.rotor_table.count)]
    T = k_f * design.inputs[0][is_rotor]
    np.testing.assert_allclose(known.B @ T, expected["wrenches"][0], atol=1e-9)
    data.ctrl[:] = data.act[:] = T
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, expected["wrenches"][0], atol=1e-9)
    np.testing.assert_allclose(known.largest_thrust, k_f * design.task.input_limits[is_rotor])


def test_no_rotor_of_a_battery_dies() -> None:
    """A battery between two quadrotors, which hovers level."""
    tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0)), types=(1, 0, 0))
    task = typed_task([QUAD, BATTERY], load_cases=[{"com": {"force": [0.0, 0.0, 1.0]}}])
    place = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (0.0, 0.0)}
    design = complete(Geometry(task=task, topology=tree, end_effector_m=(0.0, 0.0, 0.5), **place))
    known = nominal(design)
    assert static_failures(known, None).of == 8
    names = set()
    for rotor in range(8):
        dies = plan(design, rotor, rotor_out=True)[-1]
        assert isinstance(dies, Scenario)
        assert dies.dead == rotor
        names.add(dies.name)
    assert names == {f"rotor {q} of module {i} dies" for i in (1, 2) for q in range(4)}
    assert hardest_rotor(known) in range(8)
    flown = fly_all(design, Options(), only=("hover",)).flown[0][1]
    assert np.array(flown.shares).shape[1] == 8
    mean = np.array(flown.shares)[-100:].mean()
    assert mean == pytest.approx(known.weight / known.largest_thrust.sum(), rel=0.05)


def test_equal_types_fly_as_one_type() -> None:
    design = read_json(Design, EXAMPLES / "survives-a-rotor-3.json")
    typed = as_types(design)
    found, expected = (
        fly_all(x, Options(), only=("hover", "rotor")).result.model_dump(mode="json") for x in (typed, design)
    )
    assert len(expected["scenarios"]) == 2
    assert_alike({**found, "design": None}, {**expected, "design": None})
