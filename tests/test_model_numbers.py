"""What the default module and the load cases come to, by hand and by a second route."""

import math

import numpy as np
import pandas as pd
import pytest
from older import older_task

from topo_search.model import LoadCase, Module, Status, Task, Wrench, ten_wrenches
from topo_search.model.airflow import Airflow
from topo_search.model.body import Body
from topo_search.model.exposure import Directional, Exterior, Local
from topo_search.model.files import to_json
from topo_search.model.task_file import read_task
from topo_search.topologies import sample


def test_the_default_module() -> None:
    module = Module()
    assert (module.mass, module.thrust_coefficient, module.torque_coefficient) == (0.24, 3.87e-7, 3.1e-9)
    assert (module.arm_length, module.connector_distance, module.start_radius) == (0.10, 0.15, 0.10)
    assert module.reach == pytest.approx(math.sqrt(2), rel=1e-15)  # 20 * 0.1 / sqrt(2)
    # 0.24 * 9.81 / (4 * 3.87e-7) = 2.3544 / 1.548e-6
    assert module.hover_input(9.81) == pytest.approx(1_520_930.2325581396, rel=1e-14)
    assert module.max_input(9.81) == pytest.approx(2.5 * 1_520_930.2325581396, rel=1e-14)


def test_the_default_envelope_ends_at_its_reach() -> None:
    envelope = Module().envelope
    # (1.41421356 - 0.1) / (1 + tan 5 deg), tan 5 deg = 0.0874886635
    assert envelope.length == pytest.approx(1.2084848, abs=1e-7)
    assert envelope.growth == pytest.approx(0.1057287, abs=1e-7)
    assert envelope.end_radius == pytest.approx(0.2057287, abs=1e-7)
    assert envelope.length + envelope.start_radius + envelope.growth == pytest.approx(Module().reach, rel=1e-15)


def test_lengths_left_out_scale_with_the_arm() -> None:
    double = Module(arm_length=0.2)
    assert double.start_radius == 0.2
    assert double.reach == pytest.approx(2 * Module().reach, rel=1e-15)
    given = Module(arm_length=0.2, airflow=Airflow(start_radius=0.1, spread_angle_deg=0, reach=1.0))
    assert (given.envelope.length, given.envelope.growth) == (0.9, 0.0)
    resolved = Module().resolve()
    assert resolved.airflow.start_radius == 0.10
    assert resolved.airflow.reach == Module().reach
    assert resolved.envelope == Module().envelope


def boxes_and_discs(module: Module, cells: int) -> tuple[float, np.ndarray]:
    """Sum over small cells of hub, arms and discs: volume, and the integrals of y^2+z^2, x^2+z^2, x^2+y^2."""
    body, l_arm = module.body, module.arm_length
    middle = (np.arange(cells) + 0.5) / cells - 0.5

    def box(edges: tuple[float, float, float]) -> tuple[np.ndarray, float]:
        points = np.stack(np.meshgrid(*(middle * edge for edge in edges), indexing="ij"), -1).reshape(-1, 3)
        return points, math.prod(edges) / len(points)

    parts = [box(body.hub)]
    for q in range(4):
        angle = math.pi / 4 + q * math.pi / 2
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        turn = np.array([[out[0], -out[1], 0.0], [out[1], out[0], 0.0], [0.0, 0.0, 1.0]])
        points, volume = box((l_arm, body.arm_width, body.arm_width))
        parts.append(((points + np.array([l_arm / 2, 0.0, 0.0])) @ turn.T, volume))
        points, volume = box((2 * body.rotor_radius, 2 * body.rotor_radius, body.rotor_height))
        inside = np.hypot(points[:, 0], points[:, 1]) < body.rotor_radius
        parts.append((points[inside] + l_arm * out, volume))
    total = sum(len(points) * volume for points, volume in parts)
    squares = sum((points**2).sum(axis=0) * volume for points, volume in parts)
    return total, squares.sum() - squares


@pytest.mark.parametrize("hub", [(0.08, 0.08, 0.04), (0.12, 0.05, 0.03)])
def test_the_inertia_of_the_shapes_is_their_integral(hub: tuple[float, float, float]) -> None:
    module = Module(body=Body(hub=hub))
    volume, moments = boxes_and_discs(module, cells=60)
    np.testing.assert_allclose(module.inertia, module.mass / volume * moments, rtol=2e-3)
    assert Module(body=Body(inertia=(1e-3, 1e-3, 2e-3))).inertia == (1e-3, 1e-3, 2e-3)


def test_units_of_weight() -> None:
    task = read_task("push")
    weight = (5 * 0.24 + 0.048) * 9.81
    assert task.total_mass(5) == pytest.approx(1.248, rel=1e-15)
    assert task.force_unit(5) == pytest.approx(weight, rel=1e-15)
    assert task.torque_unit(5) == pytest.approx(0.1 * weight, rel=1e-15)
    push_x, push_y, hover = task.resolve(5).load_cases
    np.testing.assert_allclose(push_x.at_end_effector.force, [weight / 2, 0, weight / 2], rtol=1e-15)
    np.testing.assert_allclose(push_y.at_end_effector.force, [0, weight / 2, weight / 2], rtol=1e-15)
    np.testing.assert_allclose(hover.at_com.force, [0, 0, weight], rtol=1e-15)
    assert hover.end_effector is None
    assert hover.at_end_effector == Wrench()


def test_torques_are_in_arm_lengths() -> None:
    case = LoadCase(end_effector=Wrench(torque=(1.0, 0.0, -2.0)), weight=3.0).to_si(10.0, 2.0)
    assert case == LoadCase(units="SI", end_effector=Wrench(torque=(2.0, 0.0, -4.0)), weight=3.0)
    assert case.to_si(10.0, 2.0) == case


def test_derived_defaults_of_the_search() -> None:
    task = read_task("push")
    assert task.body_clearance == pytest.approx(0.30, rel=1e-15)  # 2 (0.10 + 0.05)
    assert task.separation == 0.20
    airflow_alone = read_task("push", ("search.body_clearance=false",))
    assert airflow_alone.body_clearance is None
    assert airflow_alone.resolve(5).search.body_clearance is False
    ablation = read_task("push", ("search.interference=separation",))
    assert ablation.body_clearance is None
    assert ablation.resolve(5).search.separation == 0.20
    assert read_task("push", ("module.body.rotor_radius=0.08",)).body_clearance == pytest.approx(0.36)


@pytest.mark.parametrize("seed", [0, 1, 4, 12345])
def test_ten_wrenches_can_be_drawn_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = [-0.2, -0.2, 0.8, -0.2, -0.2, -0.2], [0.2, 0.2, 1.2, 0.2, 0.2, 0.2]
    rows = rng.uniform(low, high, size=(9, 6))
    cases = ten_wrenches(seed)
    assert len(cases) == 10
    drawn = [[*case.at_end_effector.force, *case.at_end_effector.torque] for case in cases[:9]]
    np.testing.assert_array_equal(drawn, rows)
    assert {(case.units, case.weight, case.com) for case in cases[:9]} == {("weight", 1.0, None)}
    assert cases[9] == LoadCase(com=Wrench(force=(0.0, 0.0, 1.0)))


def test_ten_wrenches_in_si() -> None:
    task = read_task("ten-wrenches", ("task_seed=7",))
    rows = np.random.default_rng(7).uniform([-0.2, -0.2, 0.8] + [-0.2] * 3, [0.2, 0.2, 1.2] + [0.2] * 3, (9, 6))
    weight = (10 * 0.24 + 0.048) * 9.81
    for row, case in zip(rows, task.resolve(10).load_cases, strict=False):
        np.testing.assert_allclose(case.at_end_effector.force, row[:3] * weight, rtol=1e-14)
        np.testing.assert_allclose(case.at_end_effector.torque, row[3:] * 0.1 * weight, rtol=1e-14)
    assert task.module.connector_distance == 0.22
    # parallel neighbours clear each other: 2 l_c > 2 (r_air + dr_air)
    assert task.module.connector_distance > task.module.envelope.end_radius


def test_sizes_of_a_task() -> None:
    task = read_task("push", ("modules=[4, 6]",))
    assert list(task.sizes) == [4, 5, 6]
    with pytest.raises(ValueError, match=r"must be one number here, but got \[4, 6\]"):
        _ = task.n
    assert [task.resolve(n).n for n in task.sizes] == [4, 5, 6]
    assert list(read_task("push").sizes) == [5]


@pytest.mark.parametrize("requirement", [Exterior(), Directional(along="end_effector", length=1.0)])
@pytest.mark.parametrize("distance", [0.0, 0.0099, 0.0101])
def test_a_direction_along_p_e_needs_a_tenth_of_an_arm(requirement: Exterior, distance: float) -> None:
    hover = LoadCase(com=Wrench(force=(0.0, 0.0, 1.0)))
    data = {
        "name": "t",
        "modules": 2,
        "load_cases": [hover],
        "exposure": [requirement],
        "end_effector": {"position": [0.0, distance, 0.0]},
    }
    if distance > 0.01:
        assert older_task(data).exposure == (requirement,)
    else:
        with pytest.raises(ValueError, match="takes its direction from p_E"):
            older_task(data)


def test_the_gravest_status_counts() -> None:
    assert Status.worst([]) == Status.CLEAR
    assert Status.worst([Status.UNDECIDED, Status.CLEAR, Status.VIOLATED]) == Status.VIOLATED
    assert Status.worst(list(Status)) == Status.INCONSISTENT


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("push", []),
        ("push-local", [Local(radius=0.15)]),
        ("push-directional", [Directional(radius=0.15, segments=((1.0, 0.0, 0.0),))]),
        ("push-two-paths", [Directional(radius=0.15, segments=((1.0, 0.0, 0.0), (1.0, 1.0, -1.0)))]),
        ("push-exterior-60", [Exterior(half_angle_deg=60.0)]),
        ("push-exterior-90", [Exterior(half_angle_deg=90.0)]),
        ("ten-wrenches", []),
        ("ten-wrenches-local", [Local(radius=0.15)]),
        ("ten-wrenches-directional", [Directional(radius=0.15, segments=((1.0, 0.0, 0.0),))]),
        ("ten-wrenches-exterior-60", [Exterior(half_angle_deg=60.0)]),
    ],
)
def test_the_shipped_examples_are_the_papers_tasks(name: str, kinds: list[object]) -> None:
    task = read_task(name)
    assert list(task.exposure) == kinds
    base = read_task("ten-wrenches" if name.startswith("ten") else "push")
    assert task.model_copy(update={"name": base.name, "exposure": ()}) == base


def test_numbers_and_tables_of_pandas_are_taken_as_plain_ones():
    table = pd.DataFrame({"x": [1.0, 0.0], "y": [0, 1], "z": [0.0, 0.0]})
    plain = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert Wrench(force=table.iloc[0], torque=[*table.y, np.int64(2)]) == Wrench(force=plain[0], torque=(0, 1, 2))
    assert Directional(kind="directional", radius=table.x.max(), segments=table).segments == plain
    assert read_task("push").replace(modules=[np.int64(3), np.int64(4)]).modules == (3, 4)
    assert sample(np.int64(4), np.int64(2), np.int64(7)) == sample(4, 2, 7)


def test_numbers_of_numpy_are_taken_as_plain_ones():
    paths = [np.array([1.0, 0.0, 0.0]), np.array([0, 1, 0])]
    tool = read_task("push").end_effector.replace(position=np.array([0.5, 0.0, 0.25]), mass=np.float32(0.5))
    task = read_task("push").replace(
        modules=np.int64(3),
        gravity=np.float32(9.5),
        end_effector=tool,
        exposure=[{"kind": "directional", "radius": np.float64(0.25), "segments": paths}],
    )
    again = read_task("push", ("modules=3", "gravity=9.5", "end_effector={position=[0.5, 0, 0.25], mass=0.5}"))
    (asked,) = task.exposure
    assert (asked.radius, asked.segments) == (0.25, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    assert Task.model_validate_json(to_json(task)) == task
    assert (task.sizes, task.gravity, task.end_effector.position) == (again.sizes, 9.5, again.end_effector.position)
