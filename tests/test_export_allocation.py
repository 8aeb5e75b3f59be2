"""What a controller is told of a platform, against MuJoCo and against the audit."""

import csv
import io
from pathlib import Path

import mujoco
import numpy as np
import pytest
from export_cases import (
    OWN_FRAME,
    drawn_trees,
    exported_inertia,
    in_mujoco,
    inertia_about_com,
    mass_matrix,
    random_design,
)
from wording import says

from topo_search.export.allocation import (
    LARGEST_CT,
    WEAK,
    Allocation,
    allocation,
    ct_factor,
    px4_parameters,
    px4_warnings,
    set_points,
)
from topo_search.export.mjcf import mjcf
from topo_search.model import BadInput, Design, Topology
from topo_search.model.files import read_json, to_json
from verify.kinematics import platform, wrench_map

TREES = [*drawn_trees(), Topology.from_key("af" + "0" * 4)]


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: tree.key)
def test_columns_masses_and_inertia_are_those_of_mujoco(tree: Topology) -> None:
    body = {"body": OWN_FRAME} if tree.n == 3 else {}
    design = random_design(tree, 5, {"module": {"joint_mass": 0.03, **body}})
    acts = allocation(design)
    model, data = in_mujoco(mjcf(design))
    k_f, limit = design.task.module.thrust_coefficient, design.task.module.max_input(design.task.gravity)
    for j, rotor in enumerate(acts.rotors):
        assert model.actuator(j).name == rotor.name
        data.ctrl[:] = 0
        data.ctrl[j] = k_f * limit
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator, limit * np.array(acts.matrix)[:, j], atol=1e-9)
        np.testing.assert_allclose(data.site(rotor.name).xpos, rotor.position_m, atol=1e-12)
        np.testing.assert_allclose(data.site(rotor.name).xmat[[2, 5, 8]], rotor.axis, atol=1e-12)
        assert rotor.largest_thrust_N == pytest.approx(model.actuator(j).ctrlrange[1], rel=1e-14)
    M = mass_matrix(model, data)
    assert acts.mass_kg == pytest.approx(M[0, 0], rel=1e-13)
    np.testing.assert_allclose(exported_inertia(design), M[3:, 3:], atol=1e-13)
    np.testing.assert_allclose(acts.inertia_kg_m2, inertia_about_com(design), atol=1e-13)
    np.testing.assert_allclose(acts.com_m, platform(design).p_com, atol=1e-13)
    axes = np.array(acts.principal_axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(
        axes.T @ np.diag(acts.principal_moments_kg_m2) @ axes, acts.inertia_kg_m2, atol=1e-13
    )
    assert list(acts.principal_moments_kg_m2) == sorted(acts.principal_moments_kg_m2)


def test_the_matrix_is_the_audits_and_spins_turn_against_their_drag() -> None:
    design = random_design(Topology.from_key("pa900"), 2)
    acts = allocation(design)
    np.testing.assert_allclose(
        acts.matrix, wrench_map(platform(design), design.task.module), rtol=1e-12, atol=1e-20
    )
    for j, rotor in enumerate(acts.rotors):
        arm = np.cross(rotor.position_m, rotor.axis)
        drag = (np.array(acts.thrust_matrix)[3:, j] - arm) @ rotor.axis
        assert drag == pytest.approx(-rotor.spin * rotor.torque_coefficient / rotor.thrust_coefficient, rel=1e-9)


def test_the_pseudo_inverse_gives_the_least_inputs_of_any_wrench_that_rotors_reach() -> None:
    acts = allocation(random_design(Topology.from_key("a70010"), 2))
    assert acts.rank == 6
    for there, back in ((acts.matrix, acts.pseudo_inverse), (acts.thrust_matrix, acts.thrust_pseudo_inverse)):
        np.testing.assert_allclose(np.array(there) @ np.array(back), np.eye(6), atol=1e-9)
        through = np.array(back) @ np.array(there)
        np.testing.assert_allclose(through, through.T, atol=1e-9)
    single = allocation(random_design(Topology.from_key("a0"), 1))
    assert single.rank == 4
    B = np.array(single.matrix)
    np.testing.assert_allclose(B @ np.array(single.pseudo_inverse) @ B, B, atol=1e-15)


def test_files_read_back() -> None:
    acts = allocation(random_design(Topology.from_key("a10"), 4))
    assert Allocation.model_validate_json(to_json(acts)) == acts
    head, *rows = csv.reader(io.StringIO(acts.csv()))
    assert head == ["component", *(rotor.name for rotor in acts.rotors)]
    np.testing.assert_array_equal([[float(x) for x in row[1:]] for row in rows], acts.matrix)
    table = list(csv.DictReader(io.StringIO(acts.rotor_csv())))
    assert [(int(row["module"]), int(row["rotor"])) for row in table] == [(j // 4, j % 4) for j in range(8)]
    assert [float(row["axis_z"]) for row in table] == [rotor.axis[2] for rotor in acts.rotors]


# ---- PX4's parameters: its matrix built from them, as its source does, is that of the platform.

FRD = np.diag([1.0, -1.0, -1.0])


def read(text: str) -> dict[str, float]:
    """Read a parameter file as QGroundControl does: five columns, the type as MAVLink numbers it."""
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    assert all(row[:2] == ["1", "1"] and len(row) == 5 for row in rows)
    assert all(row[4] == ("6" if row[2] in ("CA_AIRFRAME", "CA_METHOD", "CA_ROTOR_COUNT") else "9") for row in rows)
    return {row[2]: float(row[3]) for row in rows}


def effectiveness(parameters: dict[str, float]) -> np.ndarray:
    """The matrix of PX4, torque first, in its body axes."""
    columns = []
    for i in range(int(parameters["CA_ROTOR_COUNT"])):
        p, a = (np.array([parameters[f"CA_ROTOR{i}_{kind}{axis}"] for axis in "XYZ"]) for kind in "PA")
        a = a / np.linalg.norm(a)
        ct, km = parameters[f"CA_ROTOR{i}_CT"], parameters[f"CA_ROTOR{i}_KM"]
        columns.append(np.concatenate([ct * np.cross(p, a) - ct * km * a, ct * a]))
    return np.array(columns).T


@pytest.mark.parametrize("key", ["a0", "a10", "a300", "p290"])
def test_the_matrix_is_rebuilt_from_the_parameters(key: str) -> None:
    acts = allocation(random_design(Topology.from_key(key), 7))
    parameters = read(px4_parameters(acts))
    assert parameters["CA_AIRFRAME"] == 0  # 7 stops motors below 2 % in flight
    assert parameters["CA_METHOD"] == (0 if acts.rank == 6 else 1)
    assert len(parameters) == 3 + ("MPC_THR_HOVER" in parameters) + 8 * len(acts.rotors)
    B = effectiveness(parameters) / ct_factor(acts)
    thrusts = np.array(acts.thrust_matrix) * acts.rotors[0].largest_thrust_N
    np.testing.assert_allclose(FRD @ B[3:], thrusts[:3], atol=1e-7)
    np.testing.assert_allclose(FRD @ B[:3], thrusts[3:], atol=1e-7)


def test_a_level_module_is_the_quad_x_of_px4() -> None:
    """PX4's `4001_quad_x`: counter-clockwise front right and rear left (KM > 0), the others clockwise."""
    design = random_design(Topology.from_key("a0"), 0, {"end_effector": {"mass": 0.0}})
    level = design.model_copy(update={"root_orientation_rad": (0.0, 0.0, 0.0)})
    parameters = read(px4_parameters(allocation(level)))
    turns = {}
    for i in range(4):
        assert parameters[f"CA_ROTOR{i}_AZ"] == -1
        x, y = parameters[f"CA_ROTOR{i}_PX"], parameters[f"CA_ROTOR{i}_PY"]
        turns["front" if x > 0 else "rear", "right" if y > 0 else "left"] = parameters[f"CA_ROTOR{i}_KM"] > 0
    assert turns["front", "right"] == turns["rear", "left"]
    assert turns["front", "left"] == turns["rear", "right"]
    assert turns["front", "right"] is True


def test_thirteen_rotors_and_numbers_out_of_range_are_refused_by_name() -> None:
    four = allocation(random_design(Topology.from_key("a3020"), 7))
    with pytest.raises(BadInput, match=r"at most 12 rotors, but the platform has 16; use allocation.json"):
        px4_parameters(four)
    drags = random_design(Topology.from_key("a0"), 7, {"module": {"torque_coefficient": 1e-6}})
    with pytest.raises(BadInput, match=r"CA_ROTOR3_KM: must be between -1 and 1"):
        px4_parameters(allocation(drags))


@pytest.mark.parametrize(("mass", "ratio"), [(0.01, 2.0), (0.035, 2.5), (0.24, 2.5), (1.2, 1000.0)])
def test_thrust_coefficients_are_scaled_until_px4_counts_every_direction(mass: float, ratio: float) -> None:
    module = {"mass": mass, "max_thrust_to_weight": ratio}
    level = random_design(Topology.from_key("a0"), 7, {"module": module, "end_effector": {"mass": 0.0}})
    acts = allocation(level.model_copy(update={"root_orientation_rad": (0.0, 0.0, 0.0)}))
    G, factor = effectiveness(read(px4_parameters(acts))), ct_factor(acts)
    assert np.all(np.abs(G[[0, 1, 2, 5]]).max(axis=1) > WEAK)
    assert np.abs(G[5]).max() == pytest.approx(factor * acts.rotors[0].largest_thrust_N)
    assert np.abs(G[5]).max() <= LARGEST_CT * (1 + 1e-9)
    assert px4_warnings(acts)[0].startswith("PX4: the platform has rank 4")
    assert len(px4_warnings(acts)) == 1
    # what a set-point exerts does not depend on the factor
    thrusts = acts.rotors[0].largest_thrust_N
    assert set_points(acts)[5] == pytest.approx(4 * thrusts, rel=1e-6)


def test_a_set_point_of_one_is_told_in_newtons() -> None:
    """Against the source of PX4 1.17: the columns of the pseudo-inverse, normalised, and what they exert."""
    design = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    acts = allocation(design)
    text = px4_parameters(acts)
    G = effectiveness(read(text))
    mix = np.linalg.pinv(G)
    roll, pitch = (np.sqrt(np.sum(mix[:, k] ** 2) / (len(mix) / 2)) for k in (0, 1))
    scale = [max(roll, pitch), max(roll, pitch), mix[:, 2].max(), *np.abs(mix[:, 3:]).mean(axis=0)]
    exerted = G @ (mix / scale)
    np.testing.assert_allclose(exerted, np.diag(set_points(acts)), atol=1e-6)
    hover = read(text)["MPC_THR_HOVER"]
    np.testing.assert_allclose(
        exerted @ [0, 0, 0, 0, 0, -hover], [0, 0, 0, 0, 0, -acts.mass_kg * 9.80665], atol=1e-5
    )
    assert f"{set_points(acts)[5]:.4g} along z" in text
    (slow,) = px4_warnings(acts)  # PX4 takes no limit below 2 m/s^2
    assert says(slow, "MPC_ACC_HOR", f"{acts.side_force_N / acts.mass_kg:.2g} m/s^2")
    strong = acts.model_copy(update={"side_force_N": 3.0 * acts.mass_kg})
    assert px4_warnings(strong) == ()
    assert read(px4_parameters(strong))["MPC_ACC_HOR"] == 3.0


def test_what_px4_cannot_exert_is_named_by_its_direction() -> None:
    level = random_design(Topology.from_key("a0"), 7).model_copy(update={"root_orientation_rad": (0.0, 0.0, 0.0)})
    (flat,) = px4_warnings(allocation(level))
    assert "rank 4 of 6 and cannot exert force x, nor force y" in flat
    two = read_json(Design, Path(__file__).parent / "designs" / "small-force.json")
    assert "rank 5 of 6 and cannot exert +0.47 force x -0.88 force y; " in px4_warnings(allocation(two))[0]
    assert flat in px4_parameters(allocation(level))
