"""Poses of a design by hand, and by a second route."""

import math
from typing import Any

import numpy as np
import pytest

from topo_search.export.poses import poses
from topo_search.model import Design, Topology
from topo_search.model.files import read_task
from topo_search.model.layout import PORT_DIRECTIONS
from verify.kinematics import rotation


def design(key: str, *settings: str, name: str = "push", seed: int | None = None, **given: Any) -> Design:
    """Return a design with the given numbers; what is left out is zero, or drawn if there is a seed."""
    topology = Topology.from_key(key)
    n = topology.n
    task = read_task(name, (f"modules={n}", *settings)).resolve(n)
    rng = np.random.default_rng(seed)
    drawn = seed is not None
    numbers: dict[str, Any] = {
        "root_orientation_rad": rng.uniform(-1, 1, 3).tolist() if drawn else [0.0] * 3,
        "hinge_angles_rad": rng.uniform(-1.5, 1.5, n - 1).tolist() if drawn else [0.0] * (n - 1),
        "end_effector_m": rng.uniform(-1, 1, 3).tolist() if drawn else [0.0] * 3,
        "rotor_speeds_squared": [[1e6] * (4 * n)] * len(task.load_cases),
        "objective": 1.0,
    }
    return Design.model_validate({"task": task, "topology": topology, **numbers, **given})


def test_rotations_turn_the_right_way() -> None:
    x, y, z = np.eye(3)
    np.testing.assert_allclose(rotation(0, math.pi / 2) @ y, z, atol=1e-15)
    np.testing.assert_allclose(rotation(1, math.pi / 2) @ z, x, atol=1e-15)
    np.testing.assert_allclose(rotation(2, math.pi / 2) @ x, y, atol=1e-15)


def test_one_module_sits_at_the_origin() -> None:
    at = poses(design("a0", end_effector_m=[0.0, 0.0, 0.6]))
    np.testing.assert_array_equal(at.p, [[0, 0, 0]])
    np.testing.assert_array_equal(at.R, [np.eye(3)])
    np.testing.assert_allclose(at.p_com, [0, 0, 0.6 * 0.048 / 0.288], rtol=1e-15)
    np.testing.assert_allclose(at.p_E, [0, 0, 0.6 * 0.24 / 0.288], rtol=1e-15)


def test_two_modules_by_hand() -> None:
    at = poses(design("a10", hinge_angles_rad=[math.pi / 6]))
    # the child hangs on +x of the root and is turned about y by 30 degrees: its x axis falls below the horizon
    np.testing.assert_allclose(at.p[1], [0.15 + 0.15 * math.sqrt(3) / 2, 0, -0.075], atol=1e-15)
    np.testing.assert_allclose(at.z[1], [0.5, 0, math.sqrt(3) / 2], atol=1e-15)
    at = poses(design("a20", hinge_angles_rad=[math.pi / 6]))
    np.testing.assert_allclose(at.p[1], [0, 0.15 + 0.15 * math.sqrt(3) / 2, 0.075], atol=1e-15)
    np.testing.assert_allclose(at.z[1], [0, -0.5, math.sqrt(3) / 2], atol=1e-15)


def test_a_flat_cross_lies_on_the_grid() -> None:
    at = poses(design("af0000"))
    np.testing.assert_allclose(at.p, 0.3 * np.vstack([np.zeros(3), PORT_DIRECTIONS]), atol=1e-15)
    np.testing.assert_allclose(at.p_com, 0, atol=1e-15)


@pytest.mark.parametrize("key", ["a1111110", "pf0080", "af0000", "p1990", "a31200", "pf8888"])
@pytest.mark.parametrize("seed", range(3))
def test_the_two_connectors_of_a_joint_meet(key: str, seed: int) -> None:
    drawn = design(key, seed=seed)
    at = poses(drawn)
    l_c = drawn.task.module.connector_distance
    np.testing.assert_allclose(at.R @ at.R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), at.R.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(at.R), 1, rtol=1e-14)
    for (h, i, a, b), alpha in zip(drawn.topology.edges(), drawn.hinge_angles_rad, strict=True):
        np.testing.assert_allclose(
            at.p[h] + l_c * at.R[h] @ PORT_DIRECTIONS[a], at.p[i] + l_c * at.R[i] @ PORT_DIRECTIONS[b], atol=1e-14
        )
        # the hinge axis is common to both, and the thrust axes are alpha apart
        axis = at.R[h] @ ([0, 1, 0] if a % 2 == 0 else [1, 0, 0])
        np.testing.assert_allclose(axis @ at.z[i], 0, atol=1e-14)
        assert math.atan2(axis @ np.cross(at.z[h], at.z[i]), at.z[h] @ at.z[i]) == pytest.approx(alpha, abs=1e-12)


def test_the_end_effector_position_is_relative_to_the_centre_of_mass() -> None:
    at = poses(design("af0000", seed=1))
    masses = [*[0.24] * 5, 0.048]
    np.testing.assert_allclose(at.p_com, np.average([*at.p, at.end_effector], axis=0, weights=masses), rtol=1e-12)
    np.testing.assert_allclose(at.p_com + at.p_E, at.end_effector, atol=1e-15)
