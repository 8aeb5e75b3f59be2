"""The simulated platform: what the controller knows of it is what MuJoCo has."""

import math

import mujoco
import numpy as np
import pytest
from export_cases import (
    drawn_trees,
    exported_inertia,
    inertia_about_com,
    mass_matrix,
    random_design,
    rod_ends,
    with_rod,
)
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from topo_search.model import Design, Topology
from topo_search.simulation.campaign import hover_residual, static_failures
from topo_search.simulation.controller import (
    EFFORT,
    TORQUE_FIRST,
    Allocator,
    Controller,
    PseudoInverseAllocator,
    Reference,
)
from topo_search.simulation.plant import ModelErrors, Plant, Wall, nominal
from verify import audit
from verify.kinematics import platform

Array = NDArray[np.float64]
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("tree", drawn_trees(), ids=lambda tree: tree.key)
def test_mass_inertia_and_wrenches_with_the_rod_are_those_of_mujoco(tree: Topology) -> None:
    design = with_rod(random_design(tree, 3))
    known, plant = nominal(design), Plant(design, ModelErrors())
    plant.place(known.com, LEVEL)
    data, model = plant.data, plant.model
    c = data.body("platform").subtree_com
    start, tip = rod_ends(design) - platform(design).p_com
    rod = design.task.end_effector.rod_linear_density * np.linalg.norm(tip - start)
    m = design.task.total_mass(tree.n)
    np.testing.assert_allclose(known.com, c, atol=1e-12)
    np.testing.assert_allclose(c, rod * (start + tip) / 2 / (m + rod), atol=1e-12)
    M = mass_matrix(model, data)
    assert known.mass == pytest.approx(M[0, 0], rel=1e-12)
    about_com = M[3:, 3:] - known.mass * (c @ c * np.eye(3) - np.outer(c, c))
    turning = exported_inertia(design) - inertia_about_com(design)  # that of points, which the design neglects
    np.testing.assert_allclose(known.J + turning, about_com, atol=1e-12)
    for j in range(model.nu):
        data.ctrl[:] = data.act[:] = np.eye(model.nu)[j]
        mujoco.mj_forward(model, data)
        force, torque = data.qfrc_actuator[:3], data.qfrc_actuator[3:] - np.cross(c, data.qfrc_actuator[:3])
        np.testing.assert_allclose(known.B[:, j], [*force, *torque], atol=1e-12)
    np.testing.assert_allclose(c + known.tip, tip, atol=1e-12)


def test_without_a_rod_it_is_the_model_of_the_search() -> None:
    design = random_design(Topology.from_key("a300"), 4)
    known = nominal(design)
    assert known.mass == design.task.total_mass(3)
    np.testing.assert_allclose(known.J, inertia_about_com(design), atol=1e-13)
    assert not known.com.any()


def test_state_and_loads_are_those_of_the_centre_of_mass(wall_press: Design) -> None:
    plant = Plant(wall_press, ModelErrors())
    known = plant.nominal
    turned = np.zeros(4)
    mujoco.mju_axisAngle2Quat(turned, np.array([0.6, 0.0, 0.8]), 0.7)
    plant.place(np.array([0.1, 0.2, 0.3]), turned)
    np.testing.assert_allclose(plant.state[0], [0.1, 0.2, 0.3], atol=1e-14)
    np.testing.assert_allclose(plant.data.body("platform").subtree_com, [0.1, 0.2, 0.3], atol=1e-12)
    plant.model.opt.gravity[:] = 0
    load = np.array([0.5, -0.2, 0.3, 0.0, 0.0, 0.0])
    for _ in range(100):  # a force on the COM turns nothing
        plant.step(np.zeros(20), np.zeros(6), load)
    _, v, _, omega = plant.state
    np.testing.assert_allclose(v, 0.1 * load[:3] / known.mass, rtol=1e-6)
    np.testing.assert_allclose(omega, 0, atol=1e-9)
    tip = plant.R @ known.tip
    plant.step(np.zeros(20), load, np.zeros(6))  # one at the tip does, about its lever
    turning = np.linalg.solve(known.J, plant.R.T @ np.cross(tip, load[:3]))
    np.testing.assert_allclose(plant.state[3], 0.001 * turning, rtol=1e-3, atol=1e-9)


def test_a_wall_feels_the_force_of_the_tip(wall_press: Design) -> None:
    towards = np.array([0.6, 0.8, 0.0])
    plant = Plant(wall_press, ModelErrors(), Wall(towards, 0.0))
    plant.model.opt.gravity[:] = 0
    plant.model.dof_damping[:3] = 50.0
    plant.model.dof_damping[3:] = 1e4  # held upright
    plant.place(plant.nominal.com, LEVEL)
    push = np.concatenate([1.5 * towards, np.zeros(3)])
    for _ in range(2000):
        plant.step(np.zeros(20), np.zeros(6), push)
    np.testing.assert_allclose(plant.contact_force, 1.5 * towards, rtol=1e-2, atol=1e-2)


def test_errors_of_the_model_are_drawn_by_the_seed(wall_press: Design) -> None:
    exact, first, again, other = (
        Plant(wall_press, ModelErrors(e, 1.0, s)) for e, s in ((0, 1), (0.05, 1), (0.05, 1), (0.05, 2))
    )
    assert np.all(exact.gain == 1)
    np.testing.assert_array_equal(first.gain, again.gain)
    assert np.abs(first.gain - other.gain).max() > 0.01
    assert 0.02 < np.std(first.gain) < 0.1
    assert first.model.body_mass.sum() != exact.model.body_mass.sum()


def test_thrusts_are_the_least_squares_within_limits(wall_press: Design) -> None:
    known = nominal(wall_press)
    rng = np.random.default_rng(3)
    scale = np.repeat([1.0, TORQUE_FIRST / known.arm], 3) / known.weight
    A = np.vstack([scale[:, None] * known.B * known.largest_thrust, math.sqrt(EFFORT) * np.eye(20)])
    for k in range(20):
        wrench = known.weight * (rng.uniform(-0.6, 0.6, 6) * np.repeat([1.0, known.arm], 3) + [0, 0, 1, 0, 0, 0])
        allocator = Allocator(known)
        upper = np.ones(20)
        if k % 2:
            dead = int(rng.integers(20))
            allocator.stop_rotor(dead)
            upper[dead] = 1e-12
        T, missing = allocator.thrusts(wrench)
        best = lsq_linear(A, np.append(scale * wrench, np.zeros(20)), (0, upper), method="bvls")
        np.testing.assert_allclose(T / known.largest_thrust, best.x, atol=1e-6)
        np.testing.assert_allclose(missing, wrench - known.B @ T, atol=1e-12)


def test_px4_multiplies_by_the_pseudo_inverse_and_cuts_off(wall_press: Design) -> None:
    known = nominal(wall_press)
    rule, full = PseudoInverseAllocator(known), known.largest_thrust
    for wrench in ([0.0, 0.0, known.weight, 0.0, 0.0, 0.0], [5.0, -4.0, known.weight, 0.1, 0.3, -0.2]):
        plain = np.linalg.pinv(known.B) @ wrench
        T, missing = rule.thrusts(np.array(wrench))
        np.testing.assert_allclose(T, np.clip(plain, 0, full), atol=1e-9)
        np.testing.assert_allclose(missing, wrench - known.B @ T, atol=1e-9)
    rule.stop_rotor(3)
    T, missing = rule.thrusts(np.array([0.0, 0.0, known.weight, 0.0, 0.0, 0.0]))
    assert T[3] == 0
    np.testing.assert_allclose(missing, 0, atol=1e-9)


def test_the_controller_asks_for_hover_at_rest_and_for_a_way_back_elsewhere(wall_press: Design) -> None:
    known = nominal(wall_press)
    controller = Controller(known, 0.005)
    here = Reference(np.zeros(3), np.zeros(6), np.zeros(3))
    still = np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3)
    np.testing.assert_allclose(controller.wrench(still, here), [0, 0, known.weight, 0, 0, 0], atol=1e-12)
    away = np.array([0.1, 0.0, 0.0]), np.zeros(3), np.eye(3), np.zeros(3)
    assert controller.wrench(away, here)[0] == pytest.approx(-known.mass * 9 * 0.1)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array([math.cos(0.05), 0.0, math.sin(0.05), 0.0]))
    tilted = np.zeros(3), np.zeros(3), R.reshape(3, 3), np.zeros(3)
    asked = controller.wrench(tilted, here)
    np.testing.assert_allclose(R.reshape(3, 3) @ asked[:3], [0, 0, known.weight], atol=1e-12)
    np.testing.assert_allclose(asked[3:], known.J @ [0.0, -64 * math.sin(0.1), 0.0], atol=1e-12)


def test_authority_in_hover_tells_a_weak_design_from_a_strong_one(solved_push: Design, wall_press: Design) -> None:
    weak, strong = nominal(solved_push), nominal(wall_press)
    assert weak.hover.weakest_force()[0] / weak.weight < 0.02
    assert strong.hover.weakest_force()[0] / strong.weight > 0.2
    force, d = strong.hover.weakest_force()
    allocator = Allocator(strong)
    for share, possible in ((0.99, True), (1.05, False)):
        wrench = np.array([*(share * force * d[:2]), strong.weight, 0, 0, 0])
        missing = np.abs(allocator.thrusts(wrench)[1]).max() / strong.weight
        assert (missing < 1e-3) == possible
    assert static_failures(strong, None).survive == 20
    judged = audit(solved_push).flight.rotors_out_hover
    assert static_failures(nominal(solved_push, rod_mass=False), None) == judged
    assert judged.hover_only > 0
    assert hover_residual(strong)[0] < 1e-4


def test_rotors_that_never_stop_do_not_stop_unless_they_are_dead(wall_press: Design) -> None:
    module = wall_press.task.module.model_copy(update={"min_input": 0.35})
    design = wall_press.model_copy(update={"task": wall_press.task.model_copy(update={"module": module})})
    known = nominal(design)
    assert known.least_share == pytest.approx(0.35, rel=1e-12)
    allocator = Allocator(known)
    allocator.stop_rotor(7)
    hover = np.array([0, 0, known.weight, 0, 0, 0.0])
    T, _ = allocator.thrusts(hover)
    freely, _ = Allocator(nominal(wall_press)).thrusts(hover)
    assert freely.min() < 0.35 * known.largest_thrust[0]
    assert T[7] == 0
    assert np.delete(T, 7).min() >= 0.35 * known.largest_thrust[0] * (1 - 1e-9)
    assert known.hover.weakest_force()[0] <= nominal(wall_press).hover.weakest_force()[0]
