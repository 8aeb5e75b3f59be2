r"""Designs whose optimum is known by hand.

One module hovers with u = m_t g / (4 k_f) at every rotor, J = (m_t g)^2 / (4 k_f^2).

Two modules hover, hinged by alpha = 2 phi. For any hinge angle the thrusts s solve s_1 z_1 + s_2 z_2 = m_t g e_z,
and ||s||^2 >= (m_t g)^2 / (2 cos^2 phi), with equality if e_z halves the angle of the axes (the largest eigenvalue
of sum_i z_i z_i^T is 1 + cos alpha = 2 cos^2 phi). So the least |alpha| at which the envelopes clear is best. It is
attained: upright and symmetric, torques balance if p_E, hence the COM, is on the vertical through the hinge. The
envelopes are mirror images; their gap is convex, so its minimum is attained by two mirrored balls, whose gap

    2 (l_c cos phi + eta l_air sin phi - r_air - eta dr_air)

is linear in eta: at phi = 0 it is negative at the far end alone (l_c > r_air), so the far balls touch first:

    l_c cos phi + l_air sin phi = r_air + dr_air,        J = (m_t g)^2 / (8 k_f^2 cos^2 phi).

Hinged the other way, the far ends come nearer until the axes cross.
"""

import math

import numpy as np
import pytest
from nlp_cases import best_design, hover, push

from nlp import lower_bound, solve
from topo_search.model import Infeasible, Topology
from verify.kinematics import platform

ALONE, PAIRS = Topology.from_key("a0"), ["a10", "a20", "a40", "a80"]


def best(task, key="a0", starts=2):
    return best_design(task, Topology.from_key(key), starts)


def least_splay(task):
    """Phi of two modules: the smaller solution of l_c cos phi + l_air sin phi = r_air + dr_air."""
    l_c, air = task.module.connector_distance, task.module.envelope
    return math.asin(air.end_radius / math.hypot(l_c, air.length)) - math.atan2(l_c, air.length)


def test_one_module_hovers_with_equal_rotors():
    task = hover(1)
    design = best(task)
    weight, k_f = task.force_unit(1), task.module.thrust_coefficient
    np.testing.assert_allclose(design.inputs.ravel(), weight / (4 * k_f), rtol=1e-6)
    assert design.objective == pytest.approx(weight**2 / (4 * k_f**2), rel=1e-9)
    assert design.gap == pytest.approx(0.0, abs=1e-9)
    found = platform(design)
    assert found.poses.z[0] == pytest.approx([0, 0, 1], abs=1e-6)
    # the COM, and so the end-effector, is on the vertical through the module, outside of the exclusion ball
    assert found.o[0][:2] == pytest.approx([0, 0], abs=1e-6)
    assert abs(design.end_effector_m[2]) >= task.module.connector_distance


def test_a_free_end_effector_balances_a_roll_torque_by_its_weight():
    """Torque 0.05 l_arm m_t g is the weight of the platform 0.05 l_arm off the vertical: no effort is needed."""
    task = push(1, load_cases=[{"com": {"force": [0, 0, 1], "torque": [0.05, 0, 0]}}])
    design = best(task)
    assert design.objective == pytest.approx(lower_bound(task), rel=1e-8)
    lever = 0.05 * task.module.arm_length
    assert np.linalg.norm(platform(design).p_com[:2]) == pytest.approx(lever, rel=1e-5)


def test_roll_pitch_and_yaw_of_one_module_add_up():
    """The COM at the module: u_q = F / 4 k_f +- tau_x / (4 k_f a) +- tau_y / (4 k_f a) +- tau_z / 4 k_tau."""
    tau = 0.05, -0.03, 0.01
    case = {"com": {"force": [0, 0, 1], "torque": list(tau)}}
    task = push(1, load_cases=[case], end_effector={"position": "com", "exclusion": False})
    module, F = task.module, task.force_unit(1)
    tau_x, tau_y, tau_z = np.array(tau) * task.torque_unit(1)
    k_f, a = module.thrust_coefficient, module.arm_length / math.sqrt(2)
    effort = F**2 / k_f**2 + (tau_x**2 + tau_y**2) / (k_f * a) ** 2 + tau_z**2 / module.torque_coefficient**2
    assert best(task).objective == pytest.approx(effort / 4, rel=1e-7)


def test_a_tilted_force_tilts_the_module():
    task = push(1, load_cases=[{"com": {"force": [0.3, -0.4, 0.6]}}])
    design = best(task)
    assert platform(design).poses.z[0] == pytest.approx(np.array([0.3, -0.4, 0.6]) / math.sqrt(0.61), abs=1e-6)
    assert design.objective == pytest.approx(lower_bound(task), rel=1e-7)


@pytest.mark.parametrize("key", PAIRS)
def test_two_modules_hover_with_the_least_splay(key):
    task = hover(2, search={"margin": 0.0})
    design = best(task, key)
    phi, weight = least_splay(task), task.force_unit(2)
    assert task.module.connector_distance * math.cos(phi) > task.module.start_radius
    assert abs(design.hinge_angles_rad[0]) / 2 == pytest.approx(phi, abs=1e-4)
    expected = weight**2 / (8 * task.module.thrust_coefficient**2 * math.cos(phi) ** 2)
    assert expected * (1 - 1e-9) <= design.objective <= expected * (1 + 2e-5)

    thrust = weight / (2 * math.cos(phi))
    np.testing.assert_allclose(design.inputs * 4 * task.module.thrust_coefficient, thrust, rtol=1e-4)
    found = platform(design)
    assert found.poses.z.sum(axis=0)[:2] == pytest.approx([0, 0], abs=1e-4)
    assert found.poses.p[0, 2] == pytest.approx(found.poses.p[1, 2], abs=1e-4)
    # the COM, and so the end-effector, is on the vertical through the hinge
    assert found.o.sum(axis=0)[:2] == pytest.approx([0, 0], abs=1e-5)
    assert np.linalg.norm(found.o - found.p_e, axis=1).min() >= task.module.connector_distance


def test_a_margin_costs_what_it_should():
    """Half of it to each side of the mirror plane."""
    margin = 0.02
    task = hover(2, search={"margin": margin})
    air, l_c = task.module.envelope, task.module.connector_distance
    phi = math.asin((air.end_radius + margin / 2) / math.hypot(l_c, air.length)) - math.atan2(l_c, air.length)
    expected = task.force_unit(2) ** 2 / (8 * task.module.thrust_coefficient**2 * math.cos(phi) ** 2)
    # the smooth clearance of a positive gap c is c^2 / (2 sum of radii) larger
    assert best(task, "a10").objective == pytest.approx(expected, rel=5e-5)


@pytest.mark.parametrize("distance", [0.16, 0.3])
def test_a_fixed_end_effector_moves_the_module_off_the_com(distance):
    position = [0.0, 0.0, distance]
    task = hover(1, end_effector={"position": position})
    design = best(task)
    m, m_E = task.module.mass, task.end_effector.mass
    assert design.end_effector_m == pytest.approx(np.array(position) * (m + m_E) / m, abs=1e-7)
    assert design.objective == pytest.approx(lower_bound(task), rel=1e-8)


def test_a_module_at_the_com_excludes_an_end_effector_there():
    result = solve(hover(1, end_effector={"position": "com"}), ALONE, starts=range(1), seed=0)
    assert isinstance(result, Infeasible)
    assert result.worst_constraint == "end-effector exclusion of module 0"
    assert result.violation == pytest.approx(0.15)
