"""The poses as symbols, as the solver's numbers, compiled, and as the audit's: four routes to one platform."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import trees

from nlp.numbers import geometry
from nlp.numbers.geometry import root_angles, root_rotation
from nlp.numbers.kinematics import chain
from nlp.symbols import platform
from topo_search.model import Topology
from verify import poses as audited_poses

L_C = 1.7


def symbolic_poses(topology, root, alpha, l_c):
    """R and p of all modules from the symbols of the problem."""
    root_x, alpha_x = ca.SX.sym("root", 3), ca.SX.sym("alpha", topology.n - 1)
    modules = platform.poses(topology, root_x, alpha_x, [l_c] * topology.n)
    f = ca.Function("poses", [root_x, alpha_x], [ca.horzcat(*(ca.horzcat(m.R, m.p) for m in modules))])
    blocks = np.array(f(root, alpha)).T.reshape(topology.n, 4, 3)
    return blocks[:, :3].transpose(0, 2, 1), blocks[:, 3]


def compiled_poses(topology, root, alpha, l_c):
    """R and p of all modules from the compiled chain."""
    ports = np.array([0, *(a for _, _, a, _ in topology.edges())])
    theta = np.concatenate([root, alpha])
    return chain(theta, np.array(topology.parents), ports, np.array(topology.kappas), np.full(topology.n, l_c))[:2]


def angles_of(topology, rng):
    """Root and hinge angles, the root's beyond their ranges too: the problem leaves them free."""
    return rng.uniform(-7.0, 7.0, 3), rng.uniform(-math.pi / 2, math.pi / 2, topology.n - 1)


@settings(max_examples=25, deadline=None)
@given(trees(most=12), st.integers(0, 2**32))
def test_four_kinematics_agree(topology, seed):
    root, alpha = angles_of(topology, np.random.default_rng(seed))
    R, p = geometry.poses(topology, root_rotation(root), alpha, L_C)
    for route in (symbolic_poses, compiled_poses, audited_poses):
        other_R, other_p = route(topology, root, alpha, L_C)
        np.testing.assert_allclose(other_R, R, rtol=0, atol=1e-12)
        np.testing.assert_allclose(other_p, p, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kappa", range(4))
@pytest.mark.parametrize("a", range(4))
def test_a_joint_by_hand(a, kappa):
    """A hinge of +90 deg at a port on x turns about y, so that the child's half step goes to -z from +x."""
    joint = Topology(((-1, -1, -1), (0, a, (a + 2 - kappa) % 4)))
    R, p = symbolic_poses(joint, np.zeros(3), np.array([math.pi / 2]), 1.0)
    half_step, thrust_axis = {
        0: ([0, 0, -1], [1, 0, 0]),
        1: ([0, 0, 1], [0, -1, 0]),
        2: ([0, 0, 1], [1, 0, 0]),
        3: ([0, 0, -1], [0, -1, 0]),
    }[a]
    port = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    assert p[1] == pytest.approx(port[a] + half_step, abs=1e-15)
    assert R[1][:, 2] == pytest.approx(thrust_axis, abs=1e-15)
    # the port that is bolted is where the joint is, whatever its number
    assert p[1] + R[1] @ port[joint.joints[1][2]] == pytest.approx(port[a], abs=1e-15)


@given(st.tuples(*[st.floats(-20.0, 20.0)] * 3))
def test_root_angles_give_the_rotation_back_in_their_ranges(root):
    R = root_rotation(root)
    psi, alpha_0, alpha_1 = angles = root_angles(R)
    assert abs(psi) <= math.pi
    assert abs(alpha_0) <= math.pi / 2
    assert abs(alpha_1) <= math.pi
    np.testing.assert_allclose(root_rotation(angles), R, rtol=0, atol=1e-12)
