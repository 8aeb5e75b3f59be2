"""Air speeds of modules with other rotors than an X: the model by hand, its bounds, and the solver's speeds."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nlp_cases import HOVER, as_design, push, random_point, random_tree
from scipy.spatial.transform import Rotation
from test_rotors import SMALL, random_rotors, star
from test_verify_air import attack, blow, some

from nlp import solve
from nlp.air.jets import ROUNDED, find_factors, jet_of, total_speed
from topo_search.compose import fly
from topo_search.model import Design, Module, Status, Topology
from topo_search.model.task_file import read_task
from topo_search.report.design_page import design_page
from topo_search.report.page import render
from topo_search.simulation.campaign import worst_wakes
from verify import audit
from verify.air.bound import case_jets, ingested_wakes
from verify.air.envelope import enclose
from verify.air.jets import speeds, wakes
from verify.requirements import Scene

UNEQUAL = {"rotors": random_rotors(np.random.default_rng(4), alike=False), **SMALL}
UPRIGHT = {"rotors": [{**rotor, "axis": [0.0, 0.0, 1.0]} for rotor in UNEQUAL["rotors"]], **SMALL}
CASES: dict[str, dict[str, Any]] = {
    "hexarotor": {"rotors": star(0.0), **SMALL},
    "leaning": {"rotors": star(15.0), **SMALL},
    "unequal": UNEQUAL,
    "own jets": {"rotors": star(45.0), **SMALL},
    "single": {"rotors": [{"position": [0.0, 0.0, 0.02], "spin": 1}], "body": {"rotor_radius": 0.06}},
}


def module(name: str) -> Module:
    """One of the cases."""
    return Module.model_validate(CASES[name])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", CASES)
def test_no_point_of_a_region_is_above_its_bound(name: str, seed: int) -> None:
    attack(seed, 4_000, module(name))


@pytest.mark.parametrize("name", CASES)
def test_a_ball_bounds_its_points(name: str) -> None:
    rng = np.random.default_rng(3)
    air = some(rng, 3, module(name))
    x, h = rng.normal(0, 4, (300, 3)), 10 ** rng.uniform(-3, 1, 300)
    inside = rng.normal(0, 1, (300, 40, 3))
    inside *= (rng.random((300, 40)) ** 0.3 / np.linalg.norm(inside, axis=2))[..., None]
    at = speeds(air, (x[:, None] + h[:, None, None] * inside).reshape(-1, 3)).reshape(300, 40, 3)
    assert (at <= speeds(air, x, h)[:, None] * (1 + 1e-12)).all()


@pytest.mark.parametrize("name", CASES)
def test_a_turned_ball_bounds_its_arc(name: str) -> None:
    rng, rotors = np.random.default_rng(9), module(name).rotor_table.count
    air = blow(np.zeros((1, 3)), np.eye(3)[None], np.full((1, rotors), 1e5), module(name))
    x, h, angle = rng.normal(0, 2, (1000, 3)), 10 ** rng.uniform(-4, 0, 1000), rng.uniform(0, 1, 1000)
    bound = speeds(air, x, h, (np.hypot(x[:, 0], x[:, 1]) + h) * angle)[:, 0]
    for _ in range(40):
        turned = Rotation.from_rotvec(np.outer(rng.uniform(-1, 1) * angle, [0.0, 0.0, 1.0])).apply(x)
        assert (speeds(air, turned)[:, 0] <= bound * (1 + 1e-12)).all()


def test_by_hand_below_a_leaning_rotor_and_far_below_the_module() -> None:
    """Near, a slipstream is along its rotor's axis; far below, the jet is along the module's."""
    leaning, u = module("leaning"), np.zeros((1, 6))
    u[0, 1] = 1e5
    air = blow(np.zeros((1, 3)), np.eye(3)[None], u, leaning)
    v, R, axis = air.induced[0, 1], air.radii[1], leaning.rotor_table.axes[1]
    below = wakes(air, (air.rotors[0, 1] - R * axis)[None])[0, 0]
    assert below == pytest.approx(-(1 + 1 / math.sqrt(2)) * v * axis)
    s = 20.0
    far = wakes(air, np.array([[0.0, 0.0, -2 * s]]))[0, 0]
    assert np.linalg.norm(far) == pytest.approx(v / math.sqrt(6) * 10.11 / (s + 5.817))


def test_by_hand_far_below_a_rotor_with_its_own_jet() -> None:
    own, u = module("own jets"), np.zeros((1, 6))
    u[0, 2] = 1e5
    air = blow(np.zeros((1, 3)), np.eye(3)[None], u, own)
    axis, R, s = own.rotor_table.axes[2], air.radii[2], 12.0
    below = air.rotors[0, 2] - 2 * R * s * axis
    assert wakes(air, below[None])[0, 0] == pytest.approx(-air.induced[0, 2] * 10.11 / (s + 5.817) * axis)


@pytest.mark.parametrize("name", CASES)
def test_the_far_jet_has_the_momentum_that_is_said(name: str) -> None:
    rotors = module(name).rotor_table
    u = np.zeros((1, rotors.count))
    if not rotors.has_own_jets:
        u[:] = 1e5
    u[0, 0] = 1e5
    one = module(name)
    air = blow(np.zeros((1, 3)), np.eye(3)[None], u / rotors.gains * rotors.sizes**2, one)  # of equal speed
    start, axis = (part[0, 0] for part in air.merged)
    across = np.linalg.svd(axis[None])[2][1:]
    side, depth = np.linspace(-12.0, 12.0, 241), 6.0 * float(air.diameters[0])
    x, y = (part.ravel() for part in np.meshgrid(side, side))
    points = start - depth * axis + np.column_stack([x, y]) @ across
    momentum = (wakes(air, points) ** 2).sum() * (side[1] - side[0]) ** 2
    thrust = 2 * math.pi * (air.radii**2 * air.induced[0] ** 2).sum()
    assert momentum / thrust == pytest.approx(one.jet_momentum, rel=0.02)


@pytest.mark.parametrize("name", CASES)
def test_both_sides_have_the_same_speeds(name: str) -> None:
    rng, n = np.random.default_rng(8), 3
    task = push(n, module=CASES[name], search={"interference": "separation", "body_clearance": False})
    point = random_point(task, random_tree(n, rng), rng)
    point = replace(point, u=np.abs(point.u) * (rng.random(point.u.shape) < 0.8))
    (_, audited), *_ = case_jets(Scene(as_design(point)))
    solved = jet_of(task.module, task.air_density, task.gravity)
    u = point.u[0] / task.module.hover_input(task.gravity)
    numbers = rng.integers(audited.induced.size, size=2000)
    axes = audited.rotor_axes.reshape(-1, 3)[numbers]
    below = audited.rotors.reshape(-1, 3)[numbers] - rng.exponential(3, (2000, 1)) * axes
    x = np.concatenate([rng.normal(0, 6, (2000, 3)), below + rng.normal(0, 0.3, (2000, 3))])
    found = [total_speed(solved, audited.poses, audited.centres, u, at) for at in x]
    np.testing.assert_allclose(found, speeds(audited, x).sum(axis=1), rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_derivatives_of_factors_are_differences(name: str) -> None:
    rng, jet, step = np.random.default_rng(2), jet_of(module(name), 1.2, 9.81), 1e-6
    r, no_dC = len(jet.rotors), np.empty((0, 3))
    for q in rng.normal(0, 2, (200, 3)) - [0.0, 0.0, 2.0]:
        C, dC, above, below = np.empty(r), np.empty((r, 3)), np.empty(r), np.empty(r)
        find_factors(jet, q, ROUNDED, C, dC)
        for a in range(3):
            shift = step * np.eye(3)[a]
            find_factors(jet, q + shift, ROUNDED, above, no_dC)
            find_factors(jet, q - shift, ROUNDED, below, no_dC)
            assert dC[:, a] == pytest.approx((above - below) / (2 * step), rel=1e-4, abs=1e-6)


def test_a_hexarotor_keeps_a_limit_on_air_speed() -> None:
    """The limit holds by the audit's bound, and costs effort."""
    region = {"kind": "local", "radius": 0.1, "geometry": False}
    below = {"position": [0.0, 0.0, -0.6]}
    efforts = []
    for speed in (None, 3.0):
        exposure = [] if speed is None else [{**region, "speed": speed}]
        task = push(2, module=CASES["leaning"], load_cases=[HOVER], exposure=exposure, end_effector=below)
        design = solve(task, Topology.from_key("a10"), starts=range(4), seed=0)
        assert isinstance(design, Design)
        found = audit(design)
        assert found.verdict is Status.CLEAR
        assert found.air is not None
        efforts.append(design.objective)
        if speed is not None:
            assert found.air.cases[0].regions[0].speed_at_most_m_s <= speed
    assert efforts[1] > efforts[0]


def test_wakes_turn_a_rotor_s_plane_and_weigh_the_flow_along_its_axis() -> None:
    """A module above another: what its rotors ingest is the flow along their own, leaning axes."""
    leaning = module("leaning")
    centres = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -12.0]])
    air = blow(centres, np.tile(np.eye(3), (2, 1, 1)), np.full((2, 6), 1e5), leaning)
    through, along = ingested_wakes(air)
    assert not through[0].any()
    tilt = np.linalg.norm(wakes(air.drop(1), air.rotors[1]), axis=2).mean()
    assert through[1].mean() == pytest.approx(tilt, rel=0.1)
    assert along[1] == pytest.approx(through[1] * math.cos(math.radians(15.0)), rel=0.02)


def test_flights_of_other_rotors_have_wakes() -> None:
    design = solve(
        push(2, module=CASES["hexarotor"], search={"interference": "parts"}, load_cases=[HOVER]),
        Topology.from_key("a10"),
        starts=range(2),
        seed=0,
    )
    assert isinstance(design, Design)
    assert len(worst_wakes(design)) == 12


def test_two_modules_of_unequal_rotors_fly_and_their_page_says_what_effort_is() -> None:
    fields = {**CASES["unequal"], "mass": 0.2}
    task = push(2, module=fields, load_cases=[HOVER], search={"interference": "parts"})
    design = solve(task, Topology.from_key("a10"), starts=range(4), seed=0)
    assert isinstance(design, Design)
    flown = fly(design, only=("hover", "gust"))
    assert [result.outcome for result in flown.scenarios] == ["recovered", "recovered"]
    assert "not the sum of squared thrusts" in render(design_page(design, audit(design), "mine.json"))


@pytest.mark.parametrize("fields", [CASES["hexarotor"], UPRIGHT])
def test_an_envelope_of_a_speed_encloses_it(fields: dict[str, Any]) -> None:
    rng, one, thrust = np.random.default_rng(5), Module.model_validate(fields), 8.0
    found = enclose(one, 1.2, thrust, 4.0)
    rotors, l_arm = one.rotor_table, one.arm_length
    inputs = np.full((1, rotors.count), thrust / (one.thrust_coefficient * rotors.gains.sum()))
    air = blow(np.zeros((1, 3)), np.eye(3)[None], inputs, one)
    x = rng.normal(0, 1, (100_000, 3)) * [1.0, 1.0, 4.0] - [0.0, 0.0, 5.0]
    x = x[speeds(air, x)[:, 0] >= 4.0] * l_arm
    assert len(x) > 500
    growth = math.tan(math.radians(found.spread_angle_deg) / 2)
    length = (found.reach_m - found.start_radius_m) / (1 + growth)
    eta = np.linspace(0.0, length, 2001)
    off = np.hypot(np.hypot(x[:, :1], x[:, 1:2]), -x[:, 2:] - eta) - (found.start_radius_m + growth * eta)
    assert off.min(axis=1).max() <= 1e-6


def test_shipped_modules_say_what_air_they_make() -> None:
    for name in ("hexarotor", "h-modquad"):
        assert 0.5 < read_task(name).module.jet_momentum < 2.0
