"""The audit's own forward kinematics, by hand and against products of rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from verify_cases import FAN, fan

from topo_search.model import Topology
from topo_search.model.layout import ROTOR_SPINS
from verify import poses
from verify.kinematics import platform, quarter_turns, rotation

angles = st.floats(-math.pi / 2, math.pi / 2)


def test_a_flat_row_is_a_row():
    found = poses(FAN, (0.0, 0.0, 0.0), (0.0, 0.0), 0.15)
    assert np.array_equal(found.R, np.broadcast_to(np.eye(3), (3, 3, 3)))
    assert found.p == pytest.approx(np.array([[0, 0, 0], [0.3, 0, 0], [-0.3, 0, 0]]))


def test_a_hinge_folds_half_of_the_step():
    # From the +x port by a quarter turn about y: x goes to -z, so the second half of the step points down.
    chain = Topology(((-1, -1, -1), (0, 0, 2)))
    R, p = poses(chain, (0.0, 0.0, 0.0), (math.pi / 2,), 0.15)
    assert p[1] == pytest.approx([0.15, 0.0, -0.15])
    assert R[1][:, 2] == pytest.approx([1.0, 0.0, 0.0])
    # From the +y port about x: y goes to z.
    R, p = poses(Topology(((-1, -1, -1), (0, 1, 3))), (0.0, 0.0, 0.0), (math.pi / 2,), 0.15)
    assert p[1] == pytest.approx([0.0, 0.15, 0.15])
    assert R[1][:, 2] == pytest.approx([0.0, -1.0, 0.0])


def test_the_root_turns_about_z_then_x_then_y():
    psi, alpha_0, alpha_1 = 0.3, -0.4, 0.5
    (R,), _ = poses(Topology(((-1, -1, -1),)), (psi, alpha_0, alpha_1), (), 0.15)
    c, s = np.cos([psi, alpha_0, alpha_1]), np.sin([psi, alpha_0, alpha_1])
    expected_z = [c[0] * s[2] + s[0] * s[1] * c[2], s[0] * s[2] - c[0] * s[1] * c[2], c[1] * c[2]]
    assert R[:, 2] == pytest.approx(expected_z, abs=1e-15)


@given(angles, st.integers(0, 3), st.integers(0, 3))
def test_joined_ports_are_at_one_point_and_face_each_other(alpha, a, b):
    R, p = poses(Topology(((-1, -1, -1), (0, a, b))), (0.1, 0.2, 0.3), (alpha,), 1.0)
    port = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    assert p[0] + R[0] @ port[a] == pytest.approx(p[1] + R[1] @ port[b], abs=1e-12)
    assert R[0] @ port[a] @ (R[1] @ port[b]) == pytest.approx(-math.cos(alpha), abs=1e-12)
    assert R[0][:, 2] @ R[1][:, 2] == pytest.approx(math.cos(alpha), abs=1e-12)


@given(st.integers(-4, 8))
def test_quarter_turns_are_exact(kappa):
    assert quarter_turns(kappa) == pytest.approx(rotation(2, kappa * math.pi / 2), abs=1e-14)
    assert set(np.unique(quarter_turns(kappa))) <= {-1.0, 0.0, 1.0}


@given(st.lists(angles, min_size=4, max_size=4), st.tuples(angles, angles, angles))
def test_turning_the_root_turns_everything(hinges, root):
    tree = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (0, 3, 0), (3, 2, 1)))
    still, turned = poses(tree, (0, 0, 0), hinges, 0.15), poses(tree, root, hinges, 0.15)
    assert turned.p == pytest.approx(still.p @ turned.R[0].T, abs=1e-14)
    assert np.allclose(turned.R, turned.R[0] @ still.R, rtol=0, atol=1e-14)
    assert turned.z == pytest.approx(turned.R @ [0, 0, 1], abs=0)


def test_the_platform_balances_about_its_centre_of_mass():
    given_design = fan(end_effector=(0.1, 0.2, 0.7))
    found, task = platform(given_design), given_design.task
    moments = task.module.mass * found.o.sum(axis=0) + task.end_effector.mass * found.p_e
    assert moments == pytest.approx(np.zeros(3), abs=1e-15)
    assert found.p_e - found.o[0] == pytest.approx([0.1, 0.2, 0.7], abs=1e-15)


def test_rotors_sit_on_the_arms_and_neighbours_turn_against_each_other():
    found = platform(fan(hinges=(0.0, 0.0)))
    arms = found.rotors[0] - found.o[0]
    assert np.linalg.norm(arms, axis=1) == pytest.approx([0.1] * 4)
    assert arms[:, :2] == pytest.approx(0.1 / math.sqrt(2) * np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]]))
    assert ROTOR_SPINS.tolist() == [-1, 1, -1, 1]
