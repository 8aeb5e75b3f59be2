"""The forces that can be added at the tip: against the audit's reserves and wrenches, and closed forms."""

import numpy as np
import pytest
from report_cases import design as random_design
from scipy.spatial import ConvexHull
from verify_cases import FAN, design, fan

from topo_search.export.allocation import thrust_matrix
from topo_search.model import Design, Topology
from topo_search.report.view import force_polytope, metres_per_newton, view
from verify import audit
from verify.kinematics import platform, wrench_map


@pytest.fixture(scope="module")
def able() -> Design:
    """A platform of five modules that lean every way and can hover."""
    return design(
        Topology.from_key("af0000"),
        {"module": {"max_thrust_to_weight": 4.0}},
        hinges=(-0.5, 0.6, 0.5, -0.6),
        end_effector=(0.1, 0.05, 0.3),
    )


def test_wrenches_of_inputs_are_those_of_the_audit() -> None:
    made = random_design(Topology.from_key("a31040"), "push")
    module = made.task.module
    B = module.thrust_coefficient * thrust_matrix(module, platform(made))
    np.testing.assert_allclose(B, wrench_map(platform(made), module), rtol=1e-12, atol=1e-20)


def test_the_nearest_facet_is_the_reserve_that_the_audit_proves(able: Design) -> None:
    found, flight = force_polytope(able, platform(able)), audit(able).flight
    assert found is not None
    vertices, _ = found
    reserve = flight.hover.force_reserve_N
    assert reserve > 0.1
    hull = ConvexHull(vertices)
    assert 0.99 * reserve < -hull.equations[:, 3].max() <= reserve * (1 + 1e-9)  # not all vertices are
    weakest = np.array(flight.hover.force_weakest)
    assert 0.99 * reserve < (vertices @ weakest).max() <= reserve * (1 + 1e-6)


def test_all_thrust_at_once_is_the_highest_vertex() -> None:
    """One module that carries its tip at its own centre: only its thrust can change, and no torque."""
    made = design(Topology.from_key("a0"), {}, hinges=(), end_effector=(0.0, 0.0, 0.6))
    assert force_polytope(made, platform(made)) is None  # a line


def test_modules_that_lean_in_one_plane_have_no_volume_of_forces() -> None:
    assert FAN.n == 3
    made = fan()
    assert force_polytope(made, platform(made)) is None


def test_what_cannot_hover_has_none() -> None:
    made = design(Topology.from_key("a0"), {}, hinges=(), root=(0.0, 1.0, 0.0))
    assert force_polytope(made, platform(made)) is None


def test_the_picture_has_the_scale_of_the_arrows(able: Design) -> None:
    at, found = platform(able), audit(able)
    shown = view(able, at, found, forces=True)
    assert shown["forces"]
    assert not view(able, at, found)["forces"]
    value = shown["forces"]
    assert "can be added in every direction" in value["told"]
    assert [part["kind"] for part in value["parts"]] == ["forces", "forces"]
    scale = metres_per_newton(able, at)
    (force,) = (case.at_com.force for case in able.task.load_cases)
    tip, start = np.array(shown["cases"][0]["ends"][0][1]), at.p_com
    assert np.linalg.norm(tip - start) == pytest.approx(scale * np.linalg.norm(force), rel=1e-3)
