"""Brackets in the audit: those that the kit prints, brute force, and both verdicts."""

from typing import Any

import numpy as np
import pytest
import trimesh
from export_cases import drawn_trees, random_design
from older import older_task
from verify_cases import design

from topo_search.export.brackets import MILLIMETRES, TURNS, bracket, connector_turn
from topo_search.model import Design, Status, Task, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.room import bracket_obstacle
from topo_search.report.task_warnings import task_warnings
from verify import audit
from verify.brackets import bracket_hulls
from verify.kinematics import platform
from verify.requirements import Scene

STATED = {"module": {"bracket": {}}}
PAIR = Topology(((-1, -1, -1), (0, 0, 2)))
KINDS = ("bracket-airflow", "bracket-rotor")


def printed(given: Design) -> dict[int, trimesh.Trimesh]:
    """The kit's brackets where they are on the platform, from its centre of mass [m]."""
    at, found = platform(given), {}
    edges = zip(given.topology.edges(), given.hinge_angles_rad, strict=True)
    for (h, i, a, _), alpha in edges:
        mesh = bracket(given.task.module.bracket_sizes, TURNS[a] * alpha)
        mesh.apply_scale(1 / MILLIMETRES)
        pose = np.eye(4)
        pose[:3, :3] = at.R[h] @ connector_turn(a)
        pose[:3, 3] = at.p[h] + given.task.module.connector_distance * at.R[h] @ PORT_DIRECTIONS[a] - at.p_com
        found[i] = mesh.apply_transform(pose)
    return found


@pytest.mark.parametrize("tree", drawn_trees()[1:], ids=lambda tree: tree.key)
def test_they_are_the_hulls_of_those_that_the_kit_prints(tree: Topology) -> None:
    given = random_design(tree, 5, STATED)
    at = platform(given)
    found = bracket_hulls(Scene(given, at))
    for i, mesh in printed(given).items():
        l_arm = given.task.module.arm_length
        corners = found[i].mesh.vertices * l_arm + at.o.mean(axis=0)
        apart = np.linalg.norm(corners[:, None] - mesh.vertices, axis=-1)
        assert apart.min(axis=1).max() < 1e-6  # single precision: each is a corner of what is printed
        inside = [found[i].depth((vertex - at.o.mean(axis=0)) / l_arm) for vertex in mesh.vertices]
        assert min(inside) > -1e-5


@pytest.mark.parametrize("seed", range(4))
def test_clearances_are_those_of_points_on_what_is_printed(seed: int) -> None:
    """Points of the surface are never nearer to air or rotor discs than the audit says, and nearly as near."""
    given = random_design(Topology.from_key("af0000"), seed, STATED)
    at, module, result = platform(given), given.task.module, audit(given)
    rows = {(pair.kind, pair.a, pair.b): pair for pair in result.pairs if pair.kind in KINDS}
    n = given.topology.n
    assert len(rows) == 2 * (n - 1) * n
    air = module.envelope
    eta = np.linspace(0, 1, 301)
    for i, mesh in printed(given).items():
        hull = mesh.convex_hull
        points = np.concatenate([hull.vertices, trimesh.sample.sample_surface(hull, 1500, seed=1)[0]])
        for b in range(n):
            axis = at.o[b] - eta[:, None] * air.length * at.poses.R[b, :, 2]
            gap = np.linalg.norm(points[:, None] - axis, axis=-1) - air.start_radius - eta * air.growth
            pair = rows["bracket-airflow", i, b]
            assert pair.analytic_m <= gap.min() + 1e-6
            if gap.min() > 0.005:
                assert pair.status is Status.CLEAR
                assert pair.analytic_m == pytest.approx(gap.min(), abs=3e-3)
            elif gap.min() < 0:
                assert pair.status is Status.VIOLATED
            own = (points - at.o[b]) @ at.poses.R[b]
            discs = []
            for x, y in module.arm_length / np.sqrt(2) * np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]]):
                beside = np.maximum(np.hypot(own[:, 0] - x, own[:, 1] - y) - module.body.rotor_radius, 0)
                discs.append(np.hypot(beside, np.maximum(np.abs(own[:, 2]) - module.body.rotor_height / 2, 0)))
            least, turning = np.min(discs), rows["bracket-rotor", i, b]
            assert turning.analytic_m <= least + 1e-6
            if least > 0.005:
                assert turning.status is Status.CLEAR
                assert turning.analytic_m == pytest.approx(least, abs=3e-3)


def test_they_count_where_they_are_stated_and_are_not_looked_at_elsewhere() -> None:
    folded = {"hinges": (1.2,), "end_effector": (0.4, 0.0, 0.5)}
    plain = audit(design(PAIR, {"search": {"body_clearance": False}}, **folded))
    large = {"module": {"bracket": {"bolt_circle": 0.12}}, "search": {"body_clearance": False}}
    stated = audit(design(PAIR, large, **folded))
    assert not [pair for pair in plain.pairs if pair.kind in KINDS]
    bad = {pair.kind for pair in stated.pairs if pair.status is Status.VIOLATED} - {
        pair.kind for pair in plain.pairs if pair.status is Status.VIOLATED
    }
    assert bad == set(KINDS)
    assert stated.verdict is Status.VIOLATED
    row = next(pair for pair in stated.pairs if pair.kind == "bracket-rotor")
    assert row.name == "the bracket of module 1 and rotors of module 0"


WIDE_ROTORS = {"body": {"rotor_radius": 0.0675}, "airflow": {"start_radius": 0.05, "spread_angle_deg": 1.0}}


@pytest.mark.parametrize(
    ("module", "obstacle"),
    [
        ({"bracket": {}}, None),
        ({"bracket": {"bolt_circle": 0.03, "wall": 0.002}}, None),
        ({"bracket": {"bolt_circle": 0.08}}, "the airflow"),
        ({"bracket": {"thickness": 0.04}}, "the airflow"),
        ({"bracket": {"bolt_circle": 0.24}}, "the airflow"),
        ({"bracket": {"bolt_circle": 24.0, "bolt_diameter": 3.2, "thickness": 4.0, "wall": 3.0}}, "the centre"),
        ({"bracket": {}, **WIDE_ROTORS}, None),
        ({"bracket": {"bolt_circle": 0.06, "thickness": 0.0005, "wall": 0.0005}, **WIDE_ROTORS}, "the rotors"),
    ],
)
def test_a_bracket_that_fits_at_no_hinge_angle_is_told_from_one_that_fits(
    module: dict[str, Any], obstacle: str | None
) -> None:
    task = design(PAIR, {"module": module}, hinges=(0.0,)).task
    assert bracket_obstacle(task.module) == obstacle
    assert any(warning.path == "module.bracket" for warning in task_warnings(task)) == (obstacle is not None)
    for hinge in (0.0, 0.5, -0.5, 1.5) if obstacle in ("the airflow", "the rotors") else (0.0,):
        bent = audit(design(PAIR, {"module": module}, hinges=(hinge,)))
        assert any(p.kind in KINDS and p.status is not Status.CLEAR for p in bent.pairs) == (obstacle is not None)


def test_brackets_that_are_stated_stay_stated_in_a_design() -> None:
    task = older_task(name="t", modules=2, load_cases=[{"carries_weight": True}], module={"bracket": {}})
    given = task.resolve(2)
    assert given.module.bracket is not None
    assert Task.model_validate_json(given.model_dump_json()).module.bracket == given.module.bracket
