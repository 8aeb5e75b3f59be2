"""What a controller is told of a platform, against MuJoCo and against the audit."""

import csv
import io

import mujoco
import numpy as np
import pytest
from export_cases import OWN_FRAME, drawn_trees, in_mujoco, inertia_about_com, mass_matrix, random_design

from topo_search.export.allocation import Allocation, allocation
from topo_search.export.mjcf import mjcf
from topo_search.model import Design, Topology
from topo_search.model.files import to_json
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
    np.testing.assert_allclose(acts.inertia_kg_m2, M[3:, 3:], atol=1e-13)
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


def test_inputs_of_a_design_times_the_matrix_are_its_load_cases(solved_push: Design) -> None:
    acts, task, n = allocation(solved_push), solved_push.task, solved_push.topology.n
    units = np.repeat([task.force_unit(n), task.torque_unit(n)], 3)
    p_E = np.array(solved_push.end_effector_m) - acts.com_m
    for u, case in zip(solved_push.inputs, task.load_cases, strict=True):
        f_E, f_C = np.array(case.at_end_effector.force), np.array(case.at_com.force)
        tau = np.cross(p_E, f_E) + case.at_end_effector.torque + case.at_com.torque
        off = acts.matrix @ u.ravel() - np.concatenate([f_E + f_C, tau])
        assert np.abs(off / units).max() < 1e-6
