"""The rod to the end-effector: which connectors it may start from, what blocks it, which mount is chosen."""

import numpy as np
import pytest
from verify_cases import changed, design, fan, unit

from topo_search.model import BadInput, Design, Mount, Status, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.files import validate
from topo_search.topologies import sample
from verify import audit, choose_mount
from verify.assembly import free_connectors
from verify.kinematics import platform, poses
from verify.requirements import Scene

ONE = Topology(((-1, -1, -1),))


def connectors(given):
    return free_connectors(Scene(given))


def by_points(given, module, port):
    """What a rod touches, from points in it beyond its fitting, tested against boxes and cylinders by hand."""
    rng = np.random.default_rng(0)
    task, found = given.task, platform(given)
    body, l_arm, r = task.module.body, task.module.arm_length, task.end_effector.rod_radius
    c = found.o[module] + task.module.connector_distance * found.poses.R[module] @ PORT_DIRECTIONS[port]
    path = found.p_e - c
    along = rng.uniform(0, 1, 1000)
    across = np.array([unit(rng) for _ in along]) * (0.999 * r * rng.uniform(0, 1, 1000) ** (1 / 3))[:, None]
    touched = set()
    for i, (R, o) in enumerate(zip(found.poses.R, found.o, strict=True)):
        beyond = along * np.linalg.norm(path) > (2 * r if i == module else 0.0)
        x = ((c + along[:, None] * path + across)[beyond] - o) @ R
        if np.any(np.all(np.abs(x) <= np.array(body.hub) / 2, axis=1)):
            touched.add((i, "hub"))
        for q, (delta_x, delta_y) in enumerate([(1, -1), (-1, -1), (-1, 1), (1, 1)]):
            u = np.array([delta_x, delta_y, 0.0]) / np.sqrt(2)
            v = np.array([-u[1], u[0], 0.0])
            s, t, z = x @ u, x @ v, x[:, 2]
            w = body.arm_width / 2
            if np.any((s >= 0) & (s <= l_arm) & (np.abs(t) <= w) & (np.abs(z) <= w)):
                touched.add((i, f"arm {q}"))
            if np.any((np.hypot(s - l_arm, t) <= body.rotor_radius) & (np.abs(z) <= body.rotor_height / 2)):
                touched.add((i, f"rotor {q}"))
    return touched


def random_platform(rng):
    topology = sample(int(rng.integers(2, 7)), 1, seed=int(rng.integers(1000)))[0]
    hinges = tuple(rng.uniform(-1.5, 1.5, topology.n - 1).tolist())
    tip = tuple((rng.uniform(0.1, 0.6) * unit(rng)).tolist())
    return design(topology, {"end_effector": {"rod_radius": 0.008}}, hinges=hinges, end_effector=tip)


def test_what_blocks_a_rod_is_what_its_points_lie_in():
    rng = np.random.default_rng(1)
    blocked = free = 0
    for _ in range(10):
        given = random_platform(rng)
        for connector in connectors(given):
            touched = by_points(given, connector.module, connector.port)
            named = {(obstacle.module, obstacle.part) for obstacle in connector.blocked_by}
            assert {module for module, _ in touched} <= {module for module, _ in named}
            # One part is named of each module, the deepest; it may be missed by points where it is barely touched.
            blocked += bool(touched)
            free += not named
    assert blocked > 15
    assert free > 15


def test_clear_rods_are_clear_by_their_rows_and_blocked_ones_are_violated():
    rng = np.random.default_rng(2)
    seen = {True: 0, False: 0}
    for _ in range(3):
        given = random_platform(rng)
        for connector in connectors(given)[::2]:
            mount = Mount(module=connector.module, port=connector.port)
            result = audit(changed(given, mount=mount.model_dump()))
            statuses = {pair.a: pair.status for pair in result.pairs if pair.kind == "rod"}
            violated = {a for a, status in statuses.items() if status == Status.VIOLATED}
            assert set(statuses.values()) <= {Status.CLEAR, Status.VIOLATED}
            assert violated == {obstacle.module for obstacle in connector.blocked_by}
            sheet = result.assembly.end_effector
            assert sheet.mount == mount
            blown = [pair for pair in result.pairs if pair.kind == "rod-airflow"]
            through = {pair.b for pair in blown if pair.status != Status.CLEAR}
            assert (sheet.note is None) == (not violated and not through)
            chosen = next(one for one in sheet.connectors if (one.module, one.port) == (mount.module, mount.port))
            assert set(chosen.in_airflow_of) == through
            assert sheet.clear_rod == (not violated and not through)
            seen[not violated] += 1
    assert min(seen.values()) >= 2


def test_a_rod_straight_above_a_module_is_as_long_as_pythagoras_says():
    given = design(ONE, {}, hinges=(), end_effector=(0.0, 0.0, 0.36))
    result = audit(given).assembly.end_effector
    assert result.mount == Mount(module=0, port=0)
    assert result.rod.length_m == pytest.approx(np.hypot(0.15, 0.36), rel=1e-12)
    assert result.rod.mass_kg == pytest.approx(0.045 * 0.39, rel=1e-12)
    assert result.rod.direction == pytest.approx([-0.15 / 0.39, 0.0, 0.36 / 0.39], abs=1e-12)
    assert [c.length_m for c in result.connectors] == pytest.approx([0.39] * 4, rel=1e-12)
    assert choose_mount(given) == result.mount


def test_no_rod_passes_through_the_hub_of_its_own_module():
    given = design(ONE, {}, hinges=(), end_effector=(-0.3, 0.0, 0.0))
    found = {c.port: [obstacle.part for obstacle in c.blocked_by] for c in connectors(given)}
    assert {port: found[port] for port in (1, 2, 3)} == {2: [], 1: ["rotor 2"], 3: ["rotor 1"]}
    (part,) = found[0]
    assert part == "hub" or part.startswith("arm")


def test_the_direction_in_the_module_is_the_one_in_the_world_turned_back():
    given = fan(root=(0.4, 0.3, -0.2))
    sheet = audit(given).assembly.end_effector
    R = platform(given).poses.R[sheet.mount.module]
    assert R @ np.array(sheet.rod.direction_in_module) == pytest.approx(sheet.rod.direction, abs=1e-12)
    start = platform(given).poses.p[sheet.mount.module] + 0.15 * R @ PORT_DIRECTIONS[sheet.mount.port]
    tip = start + sheet.rod.length_m * np.array(sheet.rod.direction)
    assert tip == pytest.approx(given.end_effector_m, abs=1e-12)


def test_that_no_rod_reaches_is_a_note_and_not_a_violation():
    walls = {"module": {"body": {"hub": [0.28, 0.28, 0.5], "rotor_radius": 0.005, "rotor_height": 0.001}}}
    task = {**walls, "end_effector": {"exclusion": False}}
    result = audit(design(ONE, task, hinges=(), end_effector=(0.0, 0.0, 0.1)))
    sheet = result.assembly.end_effector
    assert (sheet.mount, sheet.rod) == (None, None)
    assert "no straight rod" in sheet.note
    assert all(connector.blocked_by for connector in sheet.connectors)
    assert not [pair for pair in result.pairs if pair.kind == "rod"]
    assert result.verdict == Status.CLEAR


def test_without_body_clearance_a_blocked_rod_is_told_and_does_not_count():
    given = design(ONE, {}, hinges=(), end_effector=(-0.2, 0.0, 0.0))
    blocked = changed(given, mount={"module": 0, "port": 0})
    assert audit(blocked).verdict == Status.VIOLATED
    literal = {**blocked.task.model_dump(mode="json"), "search": {"body_clearance": False}}
    result = audit(changed(blocked, task=literal))
    assert result.verdict == Status.CLEAR
    assert [pair.status for pair in result.pairs if pair.kind == "rod"] == [Status.VIOLATED]


def test_a_connector_at_the_end_effector_needs_no_rod():
    given = design(ONE, {}, hinges=(), end_effector=(0.15, 0.0, 0.0))
    sheet = audit(given).assembly.end_effector
    assert sheet.mount == Mount(module=0, port=0)
    assert sheet.rod.length_m == pytest.approx(0.0, abs=1e-15)
    assert sheet.note is None


def test_a_rod_of_two_radii_is_all_fitting():
    for length, rows in ((0.0099, 0), (0.0101, 1)):
        given = design(ONE, {}, hinges=(), end_effector=(0.15 + length, 0.0, 0.0))
        parts = Scene(given)
        rod = parts.straight_rod(Mount(module=0, port=0))
        assert (rod.body_beside(0) is not None) == bool(rows)


@pytest.mark.parametrize("mount", [{"module": 0, "port": 0}, {"module": 3, "port": 0}, {"module": 1, "port": 4}])
def test_a_mount_is_a_free_connector(mount):
    data = {**fan().model_dump(mode="json"), "mount": mount}
    with pytest.raises(BadInput, match="mount"):
        validate(Design, data, "given")


def test_turning_the_platform_as_a_whole_turns_the_rod_with_it():
    rng = np.random.default_rng(3)
    for _ in range(5):
        given = random_platform(rng)
        root = tuple(rng.uniform(-1.5, 1.5, 3).tolist())
        R = poses(ONE, root, (), 0.15).R[0]
        turned = changed(given, root_orientation_rad=root, end_effector_m=(R @ given.end_effector_m).tolist())
        one, other = connectors(given), connectors(turned)
        assert [c.length_m for c in other] == pytest.approx([c.length_m for c in one], rel=1e-9)
        assert {(c.module, c.port, c.blocked_by) for c in other} == {(c.module, c.port, c.blocked_by) for c in one}
