"""What the page draws the picture in 3-D from: copies, arrows of load cases, steps of assembly, numbers."""

import numpy as np
import pytest
from report_cases import design as random_design
from scipy.spatial import ConvexHull
from verify_cases import design, fan

from topo_search.model import Audit, Design, LoadCase, Status, Topology, Wrench
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.report.design_page import design_page
from topo_search.report.page import render
from topo_search.report.scene import figure, meshes, ring, scene, shared_meshes, straight_arrow
from topo_search.report.view import arrows, force_polytope, longest_arrow, metres_per_newton, view
from topo_search.report.wording import closest
from verify import audit
from verify.kinematics import platform


@pytest.fixture(scope="module")
def audited() -> tuple[Design, Audit]:
    made = random_design(Topology.from_key("af0000"), "push-two-paths")
    return made, audit(made)


def with_cases(*cases: LoadCase) -> Design:
    made = random_design(Topology.from_key("a300"), "push")
    inputs = [list(made.rotor_speeds_squared[0])] * len(cases)
    return Design.model_validate(
        {
            **made.model_dump(),
            "task": {**made.task.model_dump(), "load_cases": cases},
            "rotor_speeds_squared": inputs,
        }
    )


def test_a_figure_has_the_parts_of_the_page(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    at = platform(made)
    shared = meshes(made.task.module, sides=24)
    parts = list(scene(made, at, closest(found), found.assembly))
    assert {part.mesh for part in parts if isinstance(part.mesh, str)} <= {*shared_meshes(made)}
    drawn = figure(made, at, closest(found), found.assembly).data
    assert [trace.name for trace in drawn] == [part.name for part in parts]
    (frames,) = (trace for trace in drawn if trace.name == "modules")
    corners = [shared["modules"].vertices @ R.T + p for R, p in zip(at.R, at.p, strict=True)]
    np.testing.assert_allclose(np.column_stack([frames.x, frames.y, frames.z]), np.concatenate(corners), atol=1e-6)


@pytest.mark.parametrize("kind", ["local", "airflow", "part-region"])
def test_of_a_violated_pair_both_volumes_stand_out(kind: str) -> None:
    """Airflow that enters the ball, other airflow, or a rotor in the wall."""
    made = random_design(Topology.from_key("a300"), "wall-push", end_effector_m=[0.1, 0.0, 0.0])
    found = audit(made)
    worst = min((pair for pair in found.pairs if pair.kind == kind), key=lambda pair: pair.analytic_m)
    assert worst.status == Status.VIOLATED
    parts = list(scene(made, platform(made), worst))
    marked = [part for part in parts if part.kind == "violated"]
    assert {part.name for part in marked} == {"violated pair"}
    modules = [module for part in marked if part.mesh == "airflow" for module in part.modules]
    assert modules == {"local": [worst.a], "airflow": [worst.a, worst.b], "part-region": []}[kind]
    regions = {part.kind for part in parts} & {"regions", "walls"}
    assert regions == {"local": {"walls"}, "airflow": {"regions", "walls"}, "part-region": {"regions"}}[kind]
    assert "closest" not in {part.kind for part in parts}
    assert len(figure(made, platform(made), worst, None).data) == len(parts)


def test_joints_meet_where_two_modules_are_bolted_together(audited: tuple[Design, Audit]) -> None:
    made, _ = audited
    at = platform(made)
    halves = [part for part in scene(made, at) if part.kind == "joints"]
    ends: dict[int, list[np.ndarray]] = {}
    for part in halves:
        port = PORT_DIRECTIONS[int(part.mesh.split()[1])]
        for module, step in zip(part.modules, part.steps, strict=True):
            reach_of_port = made.task.module.connector_distance * port
            ends.setdefault(step, []).append(at.p[module] + at.R[module] @ reach_of_port)
    assert sorted(ends) == list(range(1, made.topology.n))
    for one, other in ends.values():
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_rings_are_on_the_rotors_that_turn_so() -> None:
    """Front right and rear left turn counter-clockwise, as in PX4."""
    module = random_design(Topology.from_key("a300"), "push").task.module
    for name, fronts in (("counter-clockwise rotors", -1), ("clockwise rotors", 1)):
        corners = meshes(module, sides=24)[name].vertices
        assert np.all(np.sign(corners[corners[:, 0] > 0][:, 1]) == fronts)


def test_an_arrow_begins_and_ends_where_it_says() -> None:
    start, direction = np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.0, -0.8])
    mesh, end = straight_arrow(start, direction, 0.5, 0.025)
    np.testing.assert_allclose(end, [0.4, 0.2, -0.1])
    along = (mesh.vertices - start) @ direction
    assert (along.min(), along.max()) == pytest.approx((0.0, 0.5))


def test_a_torque_turns_by_the_right_hand_rule() -> None:
    axis = np.array([0.0, -0.6, 0.8])
    mesh, beside = ring(np.zeros(3), axis, 0.3, 0.025)
    assert abs(beside @ axis) < 1e-12
    head = mesh.vertices[len(mesh.vertices) - 1 :: -1][:11].mean(axis=0)
    turned = np.arctan2(np.cross(beside, head) @ axis, beside @ head)
    assert -np.pi / 2 < turned < 0  # past three quarters of a full turn


def test_the_largest_force_has_the_longest_arrow() -> None:
    made = with_cases(
        LoadCase(units="SI", end_effector=Wrench(force=(3.0, 0.0, 4.0), torque=(0.0, 0.2, 0.0))),
        LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, 2.5))),
        LoadCase(units="SI", com=Wrench()),
    )
    at = platform(made)
    first, second, nothing = arrows(made, at)
    (force, end), (torque, _) = first["labels"]
    assert (force, torque, second["labels"][0][0]) == ("5 N", "0.2 N m", "2.5 N")
    assert "force 5 N, along [0.6, 0, 0.8], at the end-effector; torque 0.2 N m" in first["description"]
    lengths = [
        float(np.linalg.norm(np.array(tip) - start))
        for tip, start in ((end, at.end_effector), (second["labels"][0][1], at.p_com))
    ]
    assert lengths[0] == pytest.approx(2 * lengths[1], rel=1e-3)
    assert lengths[0] == pytest.approx(longest_arrow(made, at), rel=1e-3)
    assert (nothing["description"], nothing["parts"]) == ("nothing", [])


def test_an_assembly_has_a_step_for_each_module_and_the_rod(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    steps = view(made, platform(made), found)["steps"]
    assert len(steps) == made.topology.n + 1
    for (h, i, *_), step in zip(made.topology.edges(), steps[1:-1], strict=True):
        assert f"of module {i} to port" in step
        assert f"of module {h};" in step
    mount = found.assembly.mount
    assert ("rod" in steps[-1]) == (mount is None or f"of module {mount.module}" in steps[-1])
    assert "no straight rod is known" in view(made, platform(made), None)["steps"][-1]


def test_the_pointer_tells_a_modules_least_clearance(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    told = view(made, platform(made), found)["modules"]
    assert len(told) == made.topology.n
    least = min(found.pairs, key=lambda pair: pair.analytic_m)
    assert any(f": {least.name}" in text for text in told)
    for i, text in enumerate(told):
        assert text.startswith(f"module {i}\n")
        assert ("largest joint moment" in text) == (i > 0)


def test_throttles_are_shares_of_the_largest_input(audited: tuple[Design, Audit]) -> None:
    made, _ = audited
    found = np.array(view(made, platform(made), None)["throttle"])
    assert found.shape == (len(made.task.load_cases), 5, 4)
    np.testing.assert_allclose(found, made.inputs / made.task.module.max_input(9.81), atol=1e-4)


@pytest.mark.parametrize(("number", "listed"), [(12, False), (13, True)])
def test_many_load_cases_are_a_list(number: int, listed: bool) -> None:
    cases = [LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, 1.0 + k))) for k in range(number)]
    made = with_cases(*cases)
    assert len(view(made, platform(made), None)["cases"]) == number
    assert ("<select data-cases" in render(design_page(made, audit(made), "mine.json"))) == listed


def test_a_push_while_hovering_has_its_contact_plane_across_the_force() -> None:
    tip = Wrench(force=(2.0, 0.0, 0.0))
    weight = Wrench(force=(0.0, 0.0, random_design(Topology.from_key("a300"), "push").task.force_unit(3)))
    made = with_cases(
        LoadCase(units="SI", name="push", end_effector=tip, com=weight), LoadCase(units="SI", end_effector=tip)
    )
    at = platform(made)
    push, other = arrows(made, at)
    assert push["name"] == "load case 0 (push)"
    (plane,) = (part.mesh for part in push["parts"] if part.kind == "contact")
    low, high = plane.vertices.min(axis=0), plane.vertices.max(axis=0)
    assert high[0] - low[0] < 0.01 < high[1] - low[1]
    assert (low[0] + high[0]) / 2 == pytest.approx(at.end_effector[0], abs=1e-3)
    assert all(part.kind != "contact" for part in other["parts"])


# ---- The forces that can be added at the tip: against the audit's reserves and wrenches, and closed forms.


@pytest.fixture(scope="module")
def able() -> Design:
    """A platform of five modules that lean every way and can hover."""
    return design(
        Topology.from_key("af0000"),
        {"module": {"max_thrust_to_weight": 4.0}},
        hinges=(-0.5, 0.6, 0.5, -0.6),
        end_effector=(0.1, 0.05, 0.3),
    )


def test_the_nearest_facet_is_the_reserve_that_the_audit_proves(able: Design) -> None:
    found, flight = force_polytope(able, platform(able)), audit(able).flight
    assert found is not None
    vertices, _ = found
    reserve = flight.hover.force_reserve_N
    assert reserve > 0.1
    hull = ConvexHull(vertices)
    assert 0.99 * reserve < -hull.equations[:, 3].max() <= reserve * (1 + 1e-9)  # not all vertices are
    assert 0.99 * reserve < (vertices @ np.array(flight.hover.force_weakest)).max() <= reserve * (1 + 1e-6)


@pytest.mark.parametrize(
    "made",
    [
        design(Topology.from_key("a0"), {}, hinges=(), end_effector=(0.0, 0.0, 0.6)),  # a line
        fan(),  # all lean in one plane
        design(Topology.from_key("a0"), {}, hinges=(), root=(0.0, 1.0, 0.0)),  # cannot hover
    ],
)
def test_forces_without_a_volume_are_none(made: Design) -> None:
    assert force_polytope(made, platform(made)) is None


def test_the_picture_has_the_scale_of_the_arrows(able: Design) -> None:
    at, found = platform(able), audit(able)
    shown = view(able, at, found, forces=True)
    assert shown["forces"]
    assert not view(able, at, found)["forces"]
    value = shown["forces"]
    assert "in any direction" in value["description"]
    assert [part["kind"] for part in value["parts"]] == ["forces", "forces"]
    scale = metres_per_newton(able, at)
    (force,) = (case.at_com.force for case in able.task.load_cases)
    tip, start = np.array(shown["cases"][0]["labels"][0][1]), at.p_com
    assert np.linalg.norm(tip - start) == pytest.approx(scale * np.linalg.norm(force), rel=1e-3)
