"""The audit's own forward kinematics, by hand and against products of rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from verify_cases import FAN

from topo_search.model import Topology
from verify import poses
from verify.kinematics import quarter_turns, rotation


def test_a_flat_row_is_a_row():
    found = poses(FAN, (0.0, 0.0, 0.0), (0.0, 0.0), 0.15)
    assert np.array_equal(found.R, np.broadcast_to(np.eye(3), (3, 3, 3)))
    assert found.p == pytest.approx(np.array([[0, 0, 0], [0.3, 0, 0], [-0.3, 0, 0]]))


def test_the_root_turns_about_z_then_x_then_y():
    psi, alpha_0, alpha_1 = 0.3, -0.4, 0.5
    (R,), _ = poses(Topology(((-1, -1, -1),)), (psi, alpha_0, alpha_1), (), 0.15)
    c, s = np.cos([psi, alpha_0, alpha_1]), np.sin([psi, alpha_0, alpha_1])
    expected_z = [c[0] * s[2] + s[0] * s[1] * c[2], s[0] * s[2] - c[0] * s[1] * c[2], c[1] * c[2]]
    assert R[:, 2] == pytest.approx(expected_z, abs=1e-15)


@given(st.integers(-4, 8))
def test_quarter_turns_are_exact(kappa):
    assert quarter_turns(kappa) == pytest.approx(rotation(2, kappa * math.pi / 2), abs=1e-14)
    assert set(np.unique(quarter_turns(kappa))) <= {-1.0, 0.0, 1.0}
