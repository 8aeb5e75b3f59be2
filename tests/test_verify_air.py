"""Air speeds: the model against measurements and by hand, its bounds against points, symmetries and extremes."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from topo_search.model import Audit, Design, Module
from topo_search.model.exposure import Allowed
from topo_search.model.files import read_json, to_json
from verify import audit
from verify.air.bound import _rotors, bound_beyond, bound_speed
from verify.air.jets import Jets, jets, speeds, wakes
from verify.bodies import AllowedCone, ConeSphere
from verify.certificate import RoundBody
from verify.hulls import hull

DESIGNS = Path(__file__).parent / "designs"


def blow(centres: np.ndarray, poses: np.ndarray, u: np.ndarray, module: Module | None = None) -> Jets:
    module = module or Module()
    rotors = centres[:, None] + np.einsum("nij,qj->nqi", poses, module.rotor_table.positions)
    return jets(module, 1.2, centres, poses, rotors, u)


def one(u: float = 1.0, module: Module | None = None) -> Jets:
    """Return a level module at the origin whose discs induce `u` m/s."""
    module = module or Module()
    thrust = 2 * 1.2 * math.pi * module.body.rotor_radius**2 * u**2
    return blow(np.zeros((1, 3)), np.eye(3)[None], np.full((1, 4), thrust / module.thrust_coefficient), module)


def some(rng: np.random.Generator, n: int, module: Module | None = None) -> Jets:
    """Return modules of any size, place, attitude and thrust, some of them idle."""
    ratio = rng.choice([3.0, 4.0, 5.0, 6.0, 10 ** rng.uniform(0.2, 3.0)])
    module = module or Module(body={"rotor_radius": 2 * Module().arm_length / ratio})
    rotors = n, module.rotor_table.count
    u = 10 ** rng.uniform(2, 7, rotors) * (rng.random(rotors) < 0.9)
    return blow(rng.normal(0, 3, (n, 3)), Rotation.random(n, random_state=rng).as_matrix(), u, module)


def region(rng: np.random.Generator) -> RoundBody | AllowedCone:
    size, middle = 10 ** rng.uniform(-1, 1), rng.normal(0, 6, 3)
    kind = rng.integers(4)
    if kind == 0:
        return RoundBody(ConeSphere(middle, rng.normal(0, 2, 3) * rng.integers(2), size, 0.0))
    if kind == 1:
        return hull(rng.normal(0, size, (12, 3))).move(middle)
    axis = rng.normal(0, 1, 3)
    return AllowedCone(middle, axis / np.linalg.norm(axis), 90.0 if kind == 2 else rng.uniform(20, 89))


def contains(region: RoundBody | AllowedCone, x: np.ndarray) -> np.ndarray:
    """Return which points are in a region, by formulas of their own."""
    if isinstance(region, AllowedCone):
        away = x - region.apex
        angle = np.arccos(np.clip(away @ region.axis / np.linalg.norm(away, axis=1), -1, 1))
        return angle > math.radians(region.half_angle_deg)
    if isinstance(region, RoundBody):
        o, d = region.body.o, region.body.d
        t = np.clip((x - o) @ d / max(d @ d, 1e-300), 0, 1)
        return np.linalg.norm(x - o - t[:, None] * d, axis=1) < region.body.r
    return (x @ region.normals.T < region.offsets).all(axis=1)


def attack(seed: int, k: int, module: Module | None = None) -> None:
    """Compare a bound with 4 k points: in jets, about discs, all over, and around the fastest point known."""
    rng = np.random.default_rng(seed)
    air, where = some(rng, int(rng.integers(1, 6)), module), region(rng)
    found = bound_speed(air, where)
    assert contains(where, found.point[None] + 0.0)[0]
    assert found.at_least <= found.at_most <= max(1.03 * found.at_least, 1e-6)
    assert speeds(air, found.point[None]).sum() == pytest.approx(found.at_least)
    which = rng.integers(len(air.centres), size=k)
    depth, beside = rng.exponential(4, k), rng.normal(0, 0.7, (k, 2))
    jet = air.centres[which] + np.einsum("kij,kj->ki", air.poses[which], np.column_stack([beside, -depth]))
    numbers = rng.integers(air.induced.size, size=k)
    below = rng.exponential(2, (k, 1)) * rng.integers(2, size=(k, 1)) * air.rotor_axes.reshape(-1, 3)[numbers]
    discs = air.rotors.reshape(-1, 3)[numbers] - below + rng.normal(0, air.radii.max(), (k, 3))
    middle = found.point + rng.normal(0, 1, (k, 3)) * 10 ** rng.uniform(-3, 1, (k, 1))
    everywhere = rng.normal(0, 1, (k, 3)) * 10 ** rng.uniform(0, 3, (k, 1))
    points = np.concatenate([jet, discs, middle, everywhere])
    points = points[contains(where, points)]
    assert len(points) > 20
    assert speeds(air, points).sum(axis=1).max() <= found.at_most


@pytest.mark.parametrize("seed", range(16))
def test_no_point_of_a_region_is_above_its_bound_and_the_bound_is_near(seed: int) -> None:
    attack(seed, 8_000)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 1100))
def test_a_million_points_of_each_of_a_thousand_regions_are_within_its_bound(seed: int) -> None:
    attack(seed, 250_000)


@pytest.mark.parametrize("jet", [{}, {"half_width": 1.0}, {"half_width": 0.01}, {"decay": 1e-3}], ids=str)
def test_the_bound_beyond_a_distance_is_above_all_points_and_near(jet: dict) -> None:
    """The fastest air there is on the axis, beside it in wide jets, and, almost without a jet, drawn in."""
    rng, air = np.random.default_rng(7), one(1.0, Module(airflow={"jet": jet}))
    for distance in (14.5, 40.0, 300.0):
        angle = np.concatenate([rng.uniform(0, math.pi, 4000), rng.exponential(0.02, 4000)])
        x = distance * np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
        largest = speeds(air, np.concatenate([x, 1.01 * x, 1.2 * x, 2 * x])).max()
        assert largest <= bound_beyond(air, np.zeros(3), distance) <= 1.25 * largest
        both = blow(np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.stack([np.eye(3)] * 2), np.full((2, 4), 1e6))
        both = both._replace(decay=air.decay, half_width=air.half_width)
        assert speeds(both, 1.0001 * x).sum(axis=1).max() <= bound_beyond(both, np.zeros(3), distance)


@pytest.mark.parametrize("seed", range(5))
def test_a_ball_bounds_its_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    air = some(rng, 3)
    x, h = rng.normal(0, 5, (300, 3)), 10 ** rng.uniform(-3, 1, 300)
    inside = rng.normal(0, 1, (300, 40, 3))
    inside *= (rng.random((300, 40)) ** 0.3 / np.linalg.norm(inside, axis=2))[..., None]
    at = speeds(air, (x[:, None] + h[:, None, None] * inside).reshape(-1, 3)).reshape(300, 40, 3)
    assert (at <= speeds(air, x, h)[:, None] * (1 + 1e-12)).all()


def test_a_turned_ball_bounds_its_arc() -> None:
    rng, air = np.random.default_rng(9), one()
    x, h, angle = rng.normal(0, 2, (300, 3)), 10 ** rng.uniform(-3, 0, 300), rng.uniform(0, 1, 300)
    bound = speeds(air, x, h, (np.hypot(x[:, 0], x[:, 1]) + h) * angle)[:, 0]
    for _ in range(40):
        inside = x + rng.normal(0, 1, 3) / 3**0.5 * rng.uniform(0, 0.3) * h[:, None]
        turned = Rotation.from_rotvec(np.outer(rng.uniform(-1, 1) * angle, [0.0, 0.0, 1.0])).apply(inside)
        near = np.linalg.norm(inside - x, axis=1) < h
        assert (speeds(air, turned)[near, 0] <= bound[near] * (1 + 1e-12)).all()


def test_the_square_of_the_speed_is_linear_in_the_inputs() -> None:
    rng = np.random.default_rng(11)
    x, first = rng.normal(0, 3, (500, 3)), some(rng, 3)
    second = first._replace(induced=first.induced * rng.uniform(0, 2, (3, 4)))
    both = first._replace(induced=np.hypot(first.induced, second.induced))
    np.testing.assert_allclose(speeds(both, x) ** 2, speeds(first, x) ** 2 + speeds(second, x) ** 2, rtol=1e-9)


def test_speed_is_continuous_also_across_discs() -> None:
    rng = np.random.default_rng(5)
    air = some(rng, 3)
    x = np.concatenate([rng.normal(0, 4, (4000, 3)), (air.rotors[0] + rng.normal(0, 1e-9, (4, 3))).reshape(-1, 3)])
    step = rng.normal(0, 1e-7, x.shape)
    assert np.abs(speeds(air, x + step) - speeds(air, x)).max() < 2e-5 * air.induced.max() / min(
        air.radii.max(), 1.0
    )


def test_turned_moved_and_scaled_copies_agree() -> None:
    rng = np.random.default_rng(2)
    air = some(rng, 4)
    x = rng.normal(0, 4, (500, 3))
    R, p = Rotation.random(random_state=3).as_matrix(), np.array([5.0, -3, 2])
    copy = air._replace(centres=air.centres @ R.T + p, poses=R @ air.poses, rotors=air.rotors @ R.T + p)
    np.testing.assert_allclose(speeds(copy, x @ R.T + p), speeds(air, x), rtol=1e-9, atol=1e-12)
    where = AllowedCone(np.zeros(3), np.array([0.0, 0.0, 1.0]), 70.0)
    moved = AllowedCone(p, R @ where.axis, 70.0)
    assert bound_speed(copy, moved).at_most == pytest.approx(bound_speed(air, where).at_most, rel=0.03)
    faster = air._replace(induced=3 * air.induced)
    np.testing.assert_allclose(speeds(faster, x), 3 * speeds(air, x))


def test_without_thrust_the_air_is_still() -> None:
    air = one(0.0)
    for where in (
        RoundBody(ConeSphere(np.zeros(3), np.zeros(3), 5.0, 0.0)),
        AllowedCone(np.zeros(3), np.eye(3)[2], 60.0),
    ):
        assert bound_speed(air, where).at_most < 1e-5


def test_by_hand_at_a_disc_below_it_and_above() -> None:
    air = one(1.0)
    R = air.radii[0]
    disc = air.rotors[0, 0]
    below = disc - [0, 0, R]  # 1 + 1 / sqrt 2 of the induced speed
    assert speeds(air, disc[None])[0, 0] >= 1.0
    assert wakes(air, below[None])[0, 0] == pytest.approx([0.0, 0.0, -1 - 1 / math.sqrt(2)], rel=1e-12)
    far = np.array([[0.0, 0.0, 400 * R]])
    assert not wakes(air, far).any()
    distance = math.hypot(400 * R, np.linalg.norm(disc) - R)
    assert speeds(air, far)[0, 0] == pytest.approx(
        4 * R**2 / (2 * distance**2), rel=0.01
    )  # a sink of half its flow
    s = 20.0
    assert -wakes(air, np.array([[0.0, 0.0, -2 * s]]))[0, 0, 2] == pytest.approx(10.11 / (s + 5.817), rel=1e-12)
    half = 0.0767 * (s + 5.817) * 2
    assert -wakes(air, np.array([[half, 0.0, -2 * s]]))[0, 0, 2] == pytest.approx(5.055 / (s + 5.817), rel=1e-12)


@pytest.mark.parametrize("ratio", [3.0, 4.0, 5.0, 6.0])
def test_the_jet_keeps_its_momentum_and_its_peak(ratio: float) -> None:
    """Momentum goes from the thrust to the far field's share f; the peak is 2 v_i, and falls from s = 1 on.

    It rises a little where the four jets fill the module's axis.
    """
    module = Module(body={"rotor_radius": 2 * Module().arm_length / ratio})
    air, f = one(1.0, module), module.jet_momentum
    assert f == pytest.approx(0.0605 * ratio**2, rel=1e-3)
    side = (np.arange(120) + 0.5) / 20  # of a quadrant, which has one rotor
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))

    def momentum(s: float) -> float:
        U = wakes(air, np.column_stack([x, y, np.full(x.size, -2 * s)]))[..., 2]
        return 4 * float((U**2).sum()) / 20**2 / (4 * 2 * math.pi * air.radii[0] ** 2)

    for s in (0.5, 0.75, 1.0):
        assert 0.9 < momentum(s) < 1.0
    for s in (1.25, 1.5, 1.75, 2.0, 2.25):
        assert 0.9 * min(1.0, f) < momentum(s) < 1.1 * max(1.0, f)
    for s in (2.5, 3.0, 5.0):
        assert momentum(s) == pytest.approx(f, rel=0.01)
    r, s = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1.2, 61), np.arange(0.02, 4.0, 0.02)))
    over_a_rotor = np.column_stack([r / math.sqrt(2), r / math.sqrt(2), -2 * s])
    between_rotors = np.column_stack([r, 0 * r, -2 * s])
    peaks = np.maximum(*(speeds(air, x).reshape(-1, 61).max(axis=1) for x in (over_a_rotor, between_rotors)))
    assert peaks.max() < 2.0
    assert (peaks[49:] / np.minimum.accumulate(peaks[49:])).max() < 1.16


@pytest.mark.parametrize(
    ("e_mm", "measured", "off_by"),
    [(-125, 0.302, 0.05), (-87.5, 0.194, 0.05), (-62.5, 0.093, 0.08), (-37.5, 0.031, 0.08), (-12.5, 0.0, 0.08)],
)
def test_thrust_lost_below_another_quadrotor(e_mm: float, measured: float, off_by: float) -> None:
    """Neural-Swarm's flights of two Crazyflies, the lower one 0.15 to 0.42 m below: downward force over weight.

    e is the distance of its outermost part from the envelope of the upper one. Far inside, the thrust that rotors
    lose by the model is near the force; at the edge the force has ended where the model has some left. Measured
    forces are our own processing of the logs.
    """
    body = {"rotor_radius": 0.0235, "rotor_height": 0.008, "arm_width": 0.006, "hub": [0.03, 0.03, 0.02]}
    module = Module.model_validate({"mass": 0.034, "arm_length": 0.046, "connector_distance": 0.06, "body": body})
    depth, envelope = 0.285, module.envelope
    edge = envelope.start_radius + depth * envelope.growth / envelope.length
    aside = edge + module.arm_length + module.body.rotor_radius + e_mm / 1000
    centres = np.array([[0.0, 0.0, 0.0], [aside, 0.0, -depth]]) / module.arm_length
    u = np.full((2, 4), module.hover_input(9.81))
    both = blow(centres, np.tile(np.eye(3), (2, 1, 1)), u, module)
    lost = [rotor.thrust_loss for rotor in _rotors(both, [module] * 2, 1.2)]
    assert max(lost[:4]) == 0.0  # of the upper one
    assert np.mean(lost[4:]) == pytest.approx(measured, abs=off_by)


def test_audits_state_the_air_of_every_load_case() -> None:
    design = read_json(Design, DESIGNS / "wall-push.json")
    found = audit(design)
    assert [case.name for case in found.air.cases] == list(design.task.case_labels)
    hover = found.air.cases[1]
    assert [region.name for region in hover.regions] == ["exposure 0 (local)", "exposure 1 (allowed)"]
    for region in hover.regions:
        assert region.speed_m_s <= region.speed_at_most_m_s <= 1.03 * region.speed_m_s
        assert region.estimate_m_s <= region.speed_m_s
    assert hover.tip_m_s <= hover.regions[0].speed_m_s  # the tip is in the ball
    assert len(hover.rotors) == 12
    thin = design.model_copy(update={"task": design.task.model_copy(update={"air_density": 0.3})})
    assert audit(thin).air.cases[1].tip_m_s == pytest.approx(2 * hover.tip_m_s)  # speeds go with 1 / sqrt rho
    older = found.model_copy(update={"air": None})
    assert '"air"' not in to_json(older)
    assert Audit.model_validate_json(to_json(older)) == older


@pytest.mark.parametrize("wake_loss", [0.0, 0.37, 0.8])
def test_a_rotor_in_a_wake_loses_thrust(wake_loss: float) -> None:
    """The share of wake over induced speed through the lower disc; nothing for the upper or for a rotor at rest."""
    u = np.full((2, 4), 1e6)
    u[1] = [1e6, 4e6, 1.0, 0.0]
    both = blow(np.array([[0, 0, 0], [0, 0, -6.0]]), np.stack([np.eye(3)] * 2), u)
    module = Module(wake_loss=wake_loss)
    rotors = list(_rotors(both, [module] * 2, 1.2))
    assert all(rotor.thrust_loss == 0 == rotor.lost_N for rotor in rotors[:4])
    middle = -wakes(both.drop(1), both.rotors[1])[:, 0, 2]
    v = both.induced[1]
    for rotor, at_middle, induced in zip(rotors[4:], middle, v, strict=True):
        assert rotor.ingested_m_s == pytest.approx(at_middle, rel=0.15)
        share = min(1.0, wake_loss * rotor.ingested_m_s / induced) if induced else 0.0
        assert rotor.thrust_loss == pytest.approx(share)
        thrust = module.thrust_coefficient * u[1, rotor.rotor]
        assert rotor.lost_N == pytest.approx(share * thrust)


@pytest.mark.parametrize("seed", range(6))
def test_a_limit_near_the_largest_speed_is_decided(seed: int) -> None:
    rng = np.random.default_rng(seed)
    air, where = some(rng, 3), region(rng)
    largest = bound_speed(air, where)
    if largest.at_least < 1e-3:
        return
    assert bound_speed(air, where, limit=1.01 * largest.at_most).at_most <= 1.01 * largest.at_most
    peak = bound_speed(air, where, limit=1.002 * largest.at_least)
    assert peak.at_most <= 1.002 * largest.at_least or peak.at_least > largest.at_least
    assert bound_speed(air, where, limit=0.99 * largest.at_least).at_least > 0.99 * largest.at_least
    ball_ = ConeSphere(largest.point, np.zeros(3), 0.3, 0.0)
    assert bound_speed(air, where, within=ball_).at_least == pytest.approx(largest.at_least, rel=0.03)
    elsewhere = bound_speed(air, where, within=ConeSphere(largest.point + 50.0, np.zeros(3), 0.3, 0.0))
    assert elsewhere.at_most <= largest.at_most


@pytest.mark.parametrize(("speed", "verdict"), [(4.1, "clear"), (3.8, "violated")])
def test_a_speed_is_required_of_a_region(speed: float, verdict: str) -> None:
    """The wall of wall-push gets 3.9 m/s in hover, 3.1 m/s in the push."""
    design = read_json(Design, DESIGNS / "wall-push.json")
    wall = design.task.exposure[1].model_copy(update={"speed": speed})
    task = design.task.model_copy(update={"exposure": (design.task.exposure[0], wall)})
    found = audit(design.model_copy(update={"task": task}))
    assert found.verdict == verdict
    rows = [row for row in found.residuals if row.unit == "m/s"]
    assert [row.status for row in rows] == ["clear", verdict]
    assert found.air.cases[1].regions[1].limit_m_s == speed
    near = wall.model_copy(update={"speed_within": 0.02})
    task = design.task.model_copy(update={"exposure": (design.task.exposure[0], near)})
    assert audit(design.model_copy(update={"task": task})).verdict == "clear"  # that fast air is farther away


def test_fast_air_over_a_region_without_a_limit_is_named() -> None:
    """Envelopes do not limit speed: the wall gets over 3 m/s, the ball around the tip does not."""
    design = read_json(Design, DESIGNS / "wall-push.json")
    air = audit(design).air
    (fast,) = air.fast
    worst = max(case.regions[1].speed_at_most_m_s for case in air.cases)
    assert (fast.exposure, fast.speed_at_most_m_s) == (1, worst)
    assert fast.case == next(case.name for case in air.cases if case.regions[1].speed_at_most_m_s == worst)
    assert [line for line in air.sentences() if "exposure[1].speed" in line]
    wall = design.task.exposure[1].model_copy(update={"speed": 2.0 * worst})
    task = design.task.model_copy(update={"exposure": (design.task.exposure[0], wall)})
    limited = audit(design.model_copy(update={"task": task})).air
    assert limited.fast == ()
    assert not [line for line in limited.sentences() if "exposure[1].speed" in line]


def test_without_geometry_the_speed_alone_is_asked_for() -> None:
    design = read_json(Design, DESIGNS / "wall-push.json")
    apart = [pair for pair in audit(design).pairs if pair.kind == "allowed"]
    wall = design.task.exposure[1].model_copy(update={"speed": 5.0, "geometry": False})
    task = design.task.model_copy(update={"exposure": (design.task.exposure[0], wall)})
    assert apart
    assert not [p for p in audit(design.model_copy(update={"task": task})).pairs if p.kind == "allowed"]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"speed": 0.0}, "greater than 0"),
        ({"geometry": False}, "`speed` or `solid` must be given"),
        (
            {"speed": 1.0, "speed_within": 0.1, "planes": [{"normal": [1, 0, 0], "offset": 0.2}]},
            "distance of every plane",
        ),
    ],
)
def test_a_speed_that_means_nothing_is_refused(fields: dict, words: str) -> None:
    given = {"kind": "allowed", "planes": [{"normal": [1, 0, 0]}], **fields}
    with pytest.raises(ValueError, match=words):
        Allowed.model_validate(given)


def test_a_thin_pane_is_bounded_as_closely() -> None:
    box = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-5e-4, 5e-4)])
    found = bound_speed(one(), hull(box).move(np.array([3.0, 1.0, -9.0])))
    assert found.at_least <= found.at_most <= 1.03 * found.at_least
