"""Air speeds in the solver: the same model as the audit's, rows at points, and limits that designs keep."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from nlp_cases import HOVER, as_design, push, random_point, random_tree
from suites import few

from nlp import prove_impossible, solve
from nlp.air.fastest import TARGET_SHARE, SpeedPoint, fastest
from nlp.air.jets import jet_of, total_speed
from nlp.air.program_rows import SpeedRows
from nlp.assembled.problem import AssembledProblem
from nlp.ipopt import BETA
from nlp.reduced.arrays import to_arrays
from nlp.reduced.descent import Evaluation, evaluate
from nlp.reduced.search import Descent, point_of
from topo_search.model import Design, ResolvedTask, Status, Topology
from verify import audit
from verify.air.bound import case_jets
from verify.air.jets import speeds
from verify.requirements import Scene

REGIONS = [
    {"kind": "local", "radius": 0.2},
    {"kind": "local", "box": [0.5, 0.3, 0.2]},
    {"kind": "directional", "radius": 0.1, "segments": [[0.6, 0.0, 0.0]]},
    {"kind": "directional", "radius": 0.1, "along": "end_effector", "length": 0.5},
    {"kind": "exterior", "half_angle_deg": 60.0},
    {"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0]}], "speed_within": 1.0},
]
BEYOND = {"kind": "allowed", "planes": [{"normal": [1.0, 0.2, 0.0], "offset": 0.3}], "speed_within": 0.4}
SLANTED = {"kind": "exterior", "half_angle_deg": 40.0, "axis": [0.6, 0.0, 0.8], "speed_within": 0.4}
BESIDE = [[0.2, 0.0, 0.0], [0.5, 0.0, 0.0], [0.2, 0.3, 0.0], [0.2, 0.0, 0.3]]


@pytest.mark.parametrize("region", few(REGIONS, REGIONS[::3]), ids=lambda region: f"{region['kind']}{len(region)}")
def test_the_fastest_air_over_a_region_is_what_the_audit_finds(region: dict) -> None:
    """Neither side knows the other's code: the solver climbs, the audit bounds from above."""
    rng = np.random.default_rng(1)
    for n in (1, 3, 5):
        task = push(n, exposure=[{**region, "speed": 1.0}])
        point = random_point(task, random_tree(n, rng), rng)
        point = replace(point, u=np.abs(point.u) + 1e4)
        found = audit(as_design(point)).air
        for at in fastest(point):
            proven = found.cases[at.case].regions[0]
            assert at.speed <= proven.speed_at_most_m_s * (1 + 1e-9)
            assert at.speed >= 0.97 * proven.speed_m_s


@pytest.mark.parametrize("ratio", [1.5, 3.0, 6.0, 30.0])
def test_both_sides_have_the_same_speeds(ratio: float) -> None:
    """All over, in slipstreams that still have a core, and in those that have none."""
    rng, n = np.random.default_rng(8), 3
    task = push(n, module={"body": {"rotor_radius": 0.2 / ratio}})
    point = random_point(task, random_tree(n, rng), rng)
    point = replace(point, u=np.abs(point.u) * (rng.random(point.u.shape) < 0.8))
    scene = Scene(as_design(point))
    (_, audited), *_ = case_jets(scene)
    solved = jet_of(task.module, task.air_density, task.gravity)
    u = point.u[0] / task.module.hover_input(task.gravity)
    discs = audited.rotors.reshape(-1, 3)[rng.integers(4 * n, size=2000)]
    axes = audited.rotor_axes.reshape(-1, 3)[rng.integers(4 * n, size=2000)]
    below = discs - rng.exponential(3, (2000, 1)) * axes + rng.normal(0, 0.5, (2000, 3))
    x = np.concatenate([rng.normal(0, 6, (2000, 3)), below])
    found = [total_speed(solved, audited.poses, audited.centres, u, at) for at in x]
    np.testing.assert_allclose(found, speeds(audited, x).sum(axis=1), rtol=1e-8)


def test_rows_are_the_speeds_at_their_points() -> None:
    rng = np.random.default_rng(3)
    task = push(4, exposure=[{"kind": "local", "radius": 0.2, "speed": 2.0}])
    point = random_point(task, random_tree(4, rng), rng)
    point = replace(point, u=np.abs(point.u) + 1e5)
    points = tuple(SpeedPoint(k, 0, tuple(rng.normal(0, 4, 3))) for k in (0, 1, 2) for _ in range(20))
    stated = SpeedRows(AssembledProblem(task, point.topology, [], BETA), task, points).values(point.pack())
    design = as_design(point)
    scene = Scene(design)
    air = [blown for _, blown in case_jets(scene)]
    for row, at in zip(stated, points, strict=True):
        exact = speeds(air[at.case], (scene.tip + at.from_tip)[None]).sum()
        assert 2.0 * (TARGET_SHARE - row) == pytest.approx(exact, rel=0.06, abs=0.1)  # bends are rounded


@pytest.mark.parametrize("tip", ["free", [0.0, 0.0, -0.6]])
def test_derivatives_of_rows_are_differences(tip: str | list[float]) -> None:
    rng, step = np.random.default_rng(4), 1e-6
    task = push(3, exposure=[{"kind": "local", "radius": 0.2, "speed": 2.0}], end_effector={"position": tip})
    point = random_point(task, random_tree(3, rng), rng)
    x = replace(point, u=np.abs(point.u) + 1e5).pack()
    points = tuple(
        SpeedPoint(k, 0, tuple(rng.normal(0, 4, 3)), module, 1.5, tuple(rng.normal(0, 1, 3)))
        for k in (0, 2)
        for module in (-1, -1, 0, 2)
    )
    rows = SpeedRows(AssembledProblem(task, point.topology, [], BETA), task, points)
    multipliers = rng.normal(size=len(points))

    def dense(pattern: ca.Sparsity, entries: np.ndarray) -> np.ndarray:
        return np.asarray(ca.DM(pattern, entries))

    def gradient(at: np.ndarray) -> np.ndarray:
        return multipliers @ dense(rows.jacobian_pattern, rows.jacobian(at))

    steps = step * np.eye(len(x))
    by_differences = np.array([(rows.values(x + s) - rows.values(x - s)) / (2 * step) for s in steps]).T
    assert dense(rows.jacobian_pattern, rows.jacobian(x)) == pytest.approx(by_differences, rel=1e-4, abs=1e-6)
    by_differences = np.array([(gradient(x + s) - gradient(x - s)) / (2 * step) for s in steps])
    upper = dense(rows.hessian_pattern, rows.hessian(x, multipliers))
    assert upper == pytest.approx(np.triu(by_differences), rel=1e-3, abs=1e-4)


@pytest.mark.parametrize("tip", ["free", [0.0, 0.0, -0.6]])
@pytest.mark.parametrize(
    ("speed", "regions"),
    [(0.03, [REGIONS[0], REGIONS[3]]), (0.1, [REGIONS[1]]), (0.2, REGIONS[4:]), (0.2, [SLANTED]), (0.05, [BEYOND])],
)
def test_derivatives_of_rows_of_the_reduced_search_are_differences(
    tip: str | list[float], speed: float, regions: list[dict]
) -> None:
    """Inputs follow the platform."""
    rng, step = np.random.default_rng(6), 3e-5
    regions = [{**region, "speed": speed} for region in regions]
    task = push(3, exposure=regions, end_effector={"position": tip})
    point = random_point(task, random_tree(3, rng), rng)
    reduced = to_arrays(task, point.topology)
    x, air = point.pack()[: len(reduced.lower)], len(reduced.speeds.case)

    def rows(x: np.ndarray) -> Evaluation:
        return evaluate(reduced, x, np.zeros((len(task.load_cases), 6)), np.ones(len(task.load_cases), bool), 300.0)

    at = rows(x)
    assert at.is_near[-air:].any()
    by_differences = np.array([(rows(x + s).g - rows(x - s).g) / (2 * step) for s in step * np.eye(len(x))]).T
    near = np.flatnonzero(at.is_near[-air:]) + len(at.g) - air
    assert at.J[near] == pytest.approx(by_differences[near], rel=1e-4, abs=1e-5)


@pytest.mark.parametrize("height", [-0.6, 0.2, 0.5])
def test_a_row_of_the_reduced_search_is_at_the_near_side_of_a_ball_that_an_axis_meets(height: float) -> None:
    region = {"kind": "local", "radius": 0.15, "speed": 2.0}
    below = {"position": [0.0, 0.0, height], "rod": "none", "largest_reach": False}
    task, topology = push(1, load_cases=[HOVER], exposure=[region], end_effector=below), Topology.from_key("a0")
    reduced, counting = to_arrays(task, topology), np.ones(1, bool)
    x = np.zeros(len(reduced.lower))
    row = evaluate(reduced, x, np.zeros((1, 6)), counting, 1e4).g[-1]
    (at,) = fastest(point_of(task, topology, reduced, Descent.from_start((0,), x, counting)))
    assert np.exp(-row) == pytest.approx(at.speed / 2.0, rel=0.05)


@pytest.mark.parametrize("geometry", [True, False])
def test_designs_keep_the_air_over_a_region_slow(geometry: bool) -> None:
    """A tip 0.6 m below hovering modules: 6.5 m/s where nothing is asked for."""
    region = {"kind": "local", "radius": 0.1, "geometry": geometry}
    below = {"end_effector": {"position": [0.0, 0.0, -0.6], "rod": "none", "largest_reach": False}}
    efforts = []
    for speed in (20.0, 4.0):
        task = push(4, load_cases=[HOVER], exposure=[{**region, "speed": speed}], **below)
        design = solve(task, Topology.from_key("a5020"), starts=range(4), seed=0)
        assert isinstance(design, Design)
        found = audit(design)
        assert found.verdict == Status.CLEAR
        assert found.air.region_m_s <= speed
        efforts.append(design.objective)
    assert efforts[1] > 1.01 * efforts[0] or geometry


def test_air_within_a_distance_of_the_tip_is_found_where_the_region_is_farther_from_the_jet() -> None:
    region = {
        "kind": "exterior",
        "half_angle_deg": 60.0,
        "axis": [0.0, 0.0, 1.0],
        "speed": 1.0,
        "speed_within": 0.3,
    }
    task = push(1, load_cases=[HOVER], exposure=[region])
    l_arm = task.module.arm_length
    point = random_point(task, random_tree(1, np.random.default_rng(0)), np.random.default_rng(0))
    tip = l_arm * np.array([4.0, 0.0, -6.0])
    point = replace(point, root=np.zeros(3), tip=tip, u=np.full((1, 1, 4), 5e5))
    (at,) = fastest(point)
    assert at.speed >= 0.97 * audit(as_design(point)).air.cases[0].regions[0].speed_m_s > 1.0


@pytest.mark.parametrize("region", [*REGIONS, {"kind": "local", "vertices": BESIDE}], ids=str)
@pytest.mark.parametrize("tip", [{"position": [0.1, 0.0, -0.3]}, {"largest_reach": 0.3}], ids=str)
def test_no_platform_blows_less_over_a_region_than_is_proven(region: dict, tip: dict) -> None:
    """Modules with the thrust of the load case and no more, at random poses, as far away as they may be."""
    rng, n = np.random.default_rng(5), 3

    def of_limit(speed: float) -> ResolvedTask:
        return push(n, load_cases=[HOVER], exposure=[{**region, "speed": speed}], end_effector=tip)

    proof = prove_impossible(of_limit(1e-6))
    assert "exposure[0].speed" in proof.message
    least = proof.violation + 1e-6
    assert prove_impossible(of_limit(1.001 * least)) is None
    for _ in range(3):
        point = random_point(of_limit(1.0), random_tree(n, rng), rng)
        thrusts = rng.dirichlet(np.full(4 * n, 0.3)).reshape(1, n, 4) * point.task.force_unit(n)
        u = np.minimum(thrusts / point.task.module.thrust_coefficient, point.task.max_input)
        if tip.get("largest_reach"):  # as far from the tip as the rod allows
            outwards = point.tip - point.poses[1][0]
            end = point.poses[1][0] + outwards / np.linalg.norm(outwards) * (0.3 + 0.15)
            point = replace(point, tip=end)
        share = u.sum() * point.task.module.thrust_coefficient / point.task.force_unit(n)
        design = as_design(replace(point, u=u / share))
        assert audit(design).air.cases[0].regions[0].speed_at_most_m_s >= least


def test_rotors_at_full_thrust_draw_in_little_more_air_far_away_than_is_proven() -> None:
    case, tip = {"com": {"force": [0.0, 0.0, 2.08]}}, {"position": [3.0, 0.0, 0.0], "largest_reach": False}
    region = {"kind": "local", "radius": 0.01, "speed": 1e-6}
    task = push(1, load_cases=[case], exposure=[region], end_effector=tip)
    least = prove_impossible(task).violation + 1e-6
    rng = np.random.default_rng(0)
    point = random_point(task, random_tree(1, rng), rng)
    u = 2.08 * task.force_unit(1) / task.module.thrust_coefficient / 4
    design = as_design(replace(point, root=np.zeros(3), u=np.full((1, 1, 4), u)))
    assert least <= audit(design).air.cases[0].regions[0].speed_at_most_m_s <= 1.2 * least
