"""How far the end-effector may be from the connector of its rod: default, solver, audit and proofs agree."""

import math
from pathlib import Path

import numpy as np
import pytest
from nlp_cases import BESIDE_A_DECK, LOCAL, PUSH, as_design, as_point, hover, push, random_point, random_tree
from older import older_task
from suites import few

from nlp import solve
from nlp.bounds.proofs import prove_impossible
from nlp.bounds.reach import _displacements, _poses
from nlp.evaluation import violations, worst
from nlp.numbers.point import Point
from nlp.reduced import reason_against
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from verify import audit

DESIGNS = Path(__file__).parent / "designs"
ROD = "reach of the end-effector's rod"
ONE = Topology.from_key("a0")
FOUR = Topology.from_key("a2300")
CONE_OF_FORCES = {"axis": [1, 0, 0], "half_angle_deg": 20.0, "force": 5.0}


def nearest(design):
    """The distance from the end-effector to the nearest free connector [m], as the audit measures it."""
    return audit(design).assembly.end_effector.connectors[0].length_m


def bent(length, *, force, torque, fields):
    """The deflection of a clamped tube's tip [m], by integrating moment over stiffness twice."""
    rod = {"rod_radius": 0.005, "rod_linear_density": 0.045, "rod_modulus": 70e9, "mass": 0.048, **fields}
    inner = math.sqrt(rod["rod_radius"] ** 2 - rod["rod_linear_density"] / 1600 / math.pi)
    stiffness = rod["rod_modulus"] * math.pi / 4 * (rod["rod_radius"] ** 4 - inner**4)
    left = np.linspace(length, 0.0, 20001)  # from the clamp to the tip
    moment = (force + 9.81 * rod["mass"]) * left + torque + rod["rod_linear_density"] * 9.81 * left**2 / 2
    return np.trapezoid(moment * left, -left) / stiffness


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"rod_radius": 0.008, "rod_linear_density": 0.08},
        {"rod_deflection": 0.02},
    ],
)
def test_by_default_it_ends_where_the_rod_bends_too_far(fields):
    case = {"units": "SI", "carries_weight": True, "end_effector": {"force": [2.0, 0, 0], "torque": [0, 0, 0.3]}}
    table = {"name": "t", "modules": [4, 9], "load_cases": [case, {"carries_weight": True}], "end_effector": fields}
    task = older_task(table)
    for n in (4, 9):
        reach = task.resolve(n).end_effector.largest_reach
        deflection = fields.get("rod_deflection", 0.005)
        assert bent(reach, force=2.0, torque=0.3, fields=fields) == pytest.approx(deflection, rel=1e-6)
    pushes = older_task({**table, "load_cases": [{**case, "cone": CONE_OF_FORCES}]})
    assert pushes.largest_reach(4) < task.largest_reach(4)  # up to 5 N


def test_by_default_it_is_at_most_four_widths_of_the_platform_and_a_rod_is_asked_for():
    for fields in ({"rod_deflection": 100.0}, {"rod_linear_density": 0.0}):
        task = older_task(name="t", modules=[4, 9], load_cases=PUSH, end_effector=fields)
        assert task.resolve(4).end_effector.largest_reach == pytest.approx(4 * 2 * 0.15 * 2)
        assert task.resolve(9).end_effector.largest_reach == pytest.approx(4 * 2 * 0.15 * 3)
        assert task.resolve(4).end_effector.rod == "straight"


@pytest.mark.parametrize("exposure", few([[{"kind": "local", "box": [0.1, 0.1, 0.1]}], []], 1))
def test_the_solver_keeps_within_reach(exposure):
    free = push(4, exposure=exposure)
    assert reason_against(free) is None
    plain = solve(free, FOUR, starts=range(4), seed=0)
    assert isinstance(plain, Design)
    asked = 0.95 * nearest(plain)
    short = solve(push(4, exposure=exposure, end_effector={"largest_reach": asked}), FOUR, starts=range(4), seed=0)
    assert isinstance(short, Design)
    assert short.objective > plain.objective * (1 - 1e-9)
    assert 0.9 * asked < nearest(short) <= asked
    assert audit(short).verdict == "clear"


@pytest.mark.parametrize("seed", few(range(20), 5))
def test_the_evaluation_measures_what_the_audit_does(seed):
    rng = np.random.default_rng(seed)
    topology = random_tree(int(rng.integers(1, 7)), rng)
    asked = rng.uniform(0.1, 1.0)
    point = random_point(push(topology.n, end_effector={"largest_reach": asked}), topology, rng)
    (found,) = (check for check in violations(point) if check.name == ROD)
    assert asked + found.amount == pytest.approx(nearest(as_design(point)), abs=1e-12)


@pytest.mark.parametrize("starts", few([range(4), range(3, 6)], 1))
def test_the_rod_keeps_out_of_a_solid_path_beside_its_tip(starts):
    """The design in the file is the best one of a solver that does not know of it: its rod runs through."""
    given = Design.model_validate_json((DESIGNS / "pipe-beside.json").read_text(encoding="utf-8"))
    through = "the end-effector's rod and solid exposure 0, segment 0"
    assert worst(violations(as_point(given))).name == through
    for tree in (given.topology, Topology.from_key("a300")):
        found = solve(given.task, tree, starts=starts, seed=0)
        assert isinstance(found, Design)
        assert {pair.name: pair.status for pair in audit(found).pairs}[through] == "clear"
        assert audit(found).verdict == "clear"


def test_what_keeps_every_connector_away_is_proven_and_named():
    for fields, field in (
        ({"end_effector": {"stand_off": 0.8, "largest_reach": 0.6}}, "end_effector.largest_reach"),
        ({"exposure": [{**LOCAL, "radius": 20.0}], "end_effector": {"largest_reach": None}}, "exposure[0], a ball"),
        ({"end_effector": {"position": [3.0, 0.0, 0.0], "largest_reach": 0.5}}, "end_effector.position"),
    ):
        found = prove_impossible(push(3, **fields))
        assert isinstance(found, Infeasible)
        assert found.worst_constraint == ROD
        assert field in found.message


@pytest.mark.parametrize("seed", few(range(40), 4))
def test_no_proof_stands_against_a_platform_within_its_reach(seed):
    """A platform drawn at random, and a task that asks for just so much."""
    rng = np.random.default_rng(seed)
    topology = random_tree(int(rng.integers(1, 6)), rng, aligned=True)
    point = random_point(hover(topology.n), topology, rng)
    offset = (point.tip - point.p_COM).tolist()
    stand_off = float(np.linalg.norm(point.poses[1] - point.tip, axis=1).min()) * (1 - 1e-9)
    reach = nearest(as_design(point)) * (1 + 1e-9)
    for place in ({"stand_off": stand_off}, {"position": offset}):
        asked = hover(topology.n, end_effector={**place, "exclusion": False, "largest_reach": reach})
        found = prove_impossible(asked, topology)
        assert found is None or found.worst_constraint != ROD


def random_region(rng, size):
    """Any kind of region near the end-effector."""
    points, normal = size * rng.normal(size=(6, 3)), rng.normal(size=3)
    return [
        {"kind": "local", "radius": size},
        {"kind": "local", "box": (size * rng.uniform(0.3, 2.0, 3)).tolist()},
        {"kind": "local", "vertices": (points + rng.choice([0.0, 2.0]) * points[0]).tolist()},
        {"kind": "directional", "radius": size, "segments": points[:2].tolist()},
        {"kind": "directional", "radius": size, "along": "end_effector", "length": size},
        {"kind": "directional", "radius": size, "polylines": points[:4].reshape(2, 2, 3).tolist()},
        {"kind": "exterior", "half_angle_deg": float(rng.uniform(10.0, 90.0)), "axis": normal.tolist()},
        {"kind": "allowed", "planes": [{"normal": normal.tolist(), "offset": float(rng.uniform(-1.0, 0.3))}]},
    ][rng.integers(8)]


@pytest.mark.parametrize("seed", few(range(40), 4))
def test_no_proof_stands_against_a_platform_whose_airflow_keeps_out(seed):
    """Platforms and regions drawn at random: those that are clear ask for just the reach that they have."""
    rng, clear, close = np.random.default_rng(seed), 0, 0
    while clear < 5:
        n, size = int(rng.integers(1, 4)), float(rng.uniform(0.02, 0.6))
        air = {"spread_angle_deg": float(rng.uniform(0.0, 20.0)), "reach": float(rng.uniform(0.1, 1.0))}
        fields = {"module": {"airflow": air}, "exposure": [random_region(rng, size)]}
        topology = random_tree(n, rng, aligned=True)
        point = random_point(hover(n, **fields), topology, rng)
        if any(check.amount > 0 for check in violations(point) if check.name.startswith("exposure")):
            continue
        R, p = point.poses
        connectors = [p[i] + 0.15 * R[i] @ PORT_DIRECTIONS[port] for i, port in topology.free_connectors]
        clear, reach = clear + 1, float(np.linalg.norm(connectors - point.tip, axis=1).min())
        for share in (1 + 1e-9, 0.1):
            asked = {"exclusion": False, "largest_reach": share * reach}
            found = prove_impossible(hover(n, **fields, end_effector=asked), topology)
            refuted = found is not None and found.worst_constraint == ROD
            assert not refuted or share < 1
            close += refuted
    assert close  # of a tenth of the reach some are


@pytest.mark.parametrize(
    ("region", "size"),
    [
        ({"kind": "local", "radius": 0.4}, 0.4),
        ({"kind": "local", "box": [0.8, 1.0, 1.2]}, 0.4),
        ({"kind": "directional", "radius": 0.4, "segments": [[0.0, 0.0, 0.3]]}, 0.4),
        ({"kind": "directional", "radius": 0.4, "polylines": [[[0.2, 0.0, 0.1], [0.2, 0.0, -0.4]]]}, 0.2),
        ({"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0], "offset": -0.4}]}, 0.4),
    ],
)
def test_the_proof_about_a_region_is_sharp(region, size):
    """One module beside a region that a jet of its envelope's width at the module just clears."""
    task = hover(1, module={"airflow": {"spread_angle_deg": 0.0}}, exposure=[region])
    r, l_c = task.module.region_envelope.start_radius, task.module.connector_distance
    for beyond in (1e-5, -1e-5):
        reach = size + r - l_c + beyond
        asked = hover(
            1,
            module={"airflow": {"spread_angle_deg": 0.0}},
            exposure=[region],
            end_effector={"largest_reach": reach},
        )
        found, drawn = prove_impossible(asked), random_point(asked, ONE, np.random.default_rng(0))
        assert (found is None) == (beyond > 0)
        point = Point(asked, ONE, np.zeros(3), drawn.alpha, np.array([l_c + reach, 0.0, 0.0]), drawn.u)
        gaps = [-check.amount for check in violations(point) if check.name.startswith("exposure")]
        assert min(gaps) == pytest.approx(beyond, rel=1e-3)


def test_the_proof_is_sharp():
    """One module whose end-effector is straight out from a connector, and a straight row of them."""
    m, m_E = 0.24, 0.048
    for n in (1, 3):
        share = (n * m + m_E) / (n * m)
        p_E = (n * 0.15 + 0.4) / share  # 0.4 m beyond the last connector
        for reach, possible in ((0.4 + 1e-5, True), (0.4 - 1e-5, False)):
            found = prove_impossible(hover(n, end_effector={"position": [p_E, 0, 0], "largest_reach": reach}))
            assert (found is None or found.worst_constraint != ROD) == possible


@pytest.mark.parametrize("turns", [(), (2,), (1, 3), (2, 1, 2)])
@pytest.mark.parametrize("length", [0.0, 0.1, 1.2])
def test_distances_change_by_no_more_than_a_box_of_hinge_angles_allows(turns, length):
    """Distances of points of two modules' axes, at corners of boxes of hinge angles against their middles."""
    rng, l_c, hinges = np.random.default_rng(8), 0.15, len(turns) + 1
    pairs, h = np.array(np.triu_indices(hinges + 1, 1)), rng.uniform(0.01, 0.3, hinges)
    middle = rng.uniform(-1.5, 1.5, (400, hinges))
    depths = length * rng.uniform(0, 1, (hinges + 1, 400, 1)).round()
    distances = []
    for alpha in (middle, middle + h * rng.choice([-1.0, 1.0], middle.shape)):
        z, p = _poses(turns, alpha, l_c)
        x = p - depths * z
        distances.append(np.linalg.norm(x[pairs[0]] - x[pairs[1]], axis=2))
    changes = np.abs(distances[1] - distances[0])
    assert np.all(changes <= _displacements(pairs, h, l_c, length) + 1e-12)


def beside_a_deck(reach):
    end_effector = {"mass": 0.15, "largest_reach": reach}
    return older_task({**BESIDE_A_DECK, "name": "deck", "modules": 4, "end_effector": end_effector}).resolve(4)


def test_a_longer_reach_loses_no_design():
    """Neither from the same starts nor where the design of the shorter reach is carried over."""
    tree = Topology.from_key("a7000")
    short, long = (solve(beside_a_deck(reach), tree, starts=range(4), seed=0) for reach in (0.8, 4.0))
    assert isinstance(short, Design)
    carried = solve(beside_a_deck(4.0), tree, starts=range(0), seed=0, near=[short])
    for found in (long, carried):
        assert isinstance(found, Design)
        assert found.objective <= short.objective * (1 + 5e-4)


def test_a_design_carried_over_is_never_lost():
    """A descent from there ends in one that costs 1e-4 more."""
    task, tree = beside_a_deck(0.8), Topology.from_key("a3040")
    source = solve(task, tree, starts=range(8), seed=0)
    assert isinstance(source, Design)
    again = solve(task, tree, starts=range(0), seed=0, near=[source])
    assert isinstance(again, Design)
    assert again.objective <= source.objective * (1 + 1e-9)
    assert audit(again).verdict == audit(source).verdict
