"""Geometry first: hinges are placed where no envelopes overlap."""

import math
import subprocess
import sys

import numpy as np
import pytest
from nlp_cases import push

from nlp.evaluation import violations
from nlp.numbers.geometry import Swept, largest_turn, poses, root_rotation, rotation
from nlp.numbers.geometry import clearance as vectorised
from nlp.numbers.point import Point
from nlp.requirements.balances import required_wrenches, wrench_matrix
from nlp.starts.random_starts import DRAWING, draw, generator, root_of
from nlp.starts.tabu_search import Rules, clearance
from nlp.starts.untangling import CLEAR, lever, shorten_lever, untangle
from topo_search.model import Topology
from topo_search.topologies import sample
from verify.bodies import ConeSphere, clearances

FREE = np.array([[-1.0, 1.0]])
"""Folds that hinges may have."""


def least_clearance(task, topology, alpha):
    """The least clearance of all pairs of envelopes, by the audit's closed form [m]."""
    R, p = poses(topology, np.eye(3), alpha, task.module.connector_distance)
    air = task.module.envelope
    bodies = [
        ConeSphere(p_i, -air.length * R_i[:, 2], air.start_radius, air.growth)
        for R_i, p_i in zip(R, p, strict=True)
    ]
    pairs = [(bodies[i], bodies[j]) for i in range(topology.n) for j in range(i)]
    return float(np.min(clearances(pairs).d))


def test_a_hundred_modules_are_freed_of_overlaps():
    task = push(100, module={"connector_distance": 0.3}, search={"body_clearance": False})
    topology = sample(100, 1, seed=0)[0]
    flat = np.zeros(99)
    assert least_clearance(task, topology, flat) < 0.0
    alpha = untangle(task, topology, flat, np.random.default_rng(0))
    assert least_clearance(task, topology, alpha) >= CLEAR * task.module.arm_length - 1e-9


def test_hinges_are_turned_back_where_there_is_room():
    """A straight chain needs no bend at all; what stays is less than the step between the angles tried."""
    task = push(10, module={"connector_distance": 0.3}, search={"body_clearance": False})
    chain = Topology(((-1, -1, -1), *((h, 0, 2) for h in range(9))))
    bent = np.full(9, -0.5)
    alpha = untangle(task, chain, bent, np.random.default_rng(0))
    assert np.mean(np.abs(alpha)) < 0.1
    assert least_clearance(task, chain, alpha) >= CLEAR * task.module.arm_length - 1e-9


def test_body_clearance_is_kept_between_modules_that_are_not_bolted():
    task = push(8, module={"connector_distance": 0.22})
    topology = sample(8, 1, seed=1)[0]
    alpha = untangle(task, topology, np.zeros(7), np.random.default_rng(0))
    _, p = poses(topology, np.eye(3), alpha, task.module.connector_distance)
    for i in range(8):
        for j in range(i):
            if (j, i) not in topology.bolted:
                assert np.linalg.norm(p[i] - p[j]) >= task.centre_distance


def test_no_hinge_is_turned_to_where_rotors_touch():
    """Rotors as high as these meet at 52 degrees; there some hinge of this tree ends, which would turn farther."""
    task = push(10, module={"body": {"rotor_height": 0.12}})
    limit = largest_turn(task)
    assert limit == pytest.approx(math.pi - 2 * math.atan2(0.0601, 0.15 - 0.1 / math.sqrt(2) - 0.0501))
    alpha = untangle(task, sample(10, 1, seed=1)[0], np.zeros(9), np.random.default_rng(0))
    assert np.abs(alpha).max() == limit


def test_in_the_ablation_only_centres_count():
    """Flat platforms overlap with their airflow but not with their centres: nothing is turned away."""
    task = push(4, module={"connector_distance": 0.22}, search={"interference": "separation"})
    topology = sample(4, 1, seed=0)[0]
    alpha = np.full(3, 0.01)
    assert np.all(np.abs(untangle(task, topology, alpha, np.random.default_rng(0))) <= alpha)


def random_axes(count, rng):
    z = rng.normal(size=(count, 3))
    return z / np.linalg.norm(z, axis=1)[:, None]


@pytest.mark.parametrize("growth", [0.0, 1.0, 11.9])
@pytest.mark.parametrize("axes", ["any", "parallel", "opposite"])
def test_the_compiled_clearance_is_the_vectorised_one(axes, growth):
    rng = np.random.default_rng(5)
    w, z_i, z_j = 5.0 * rng.normal(size=(500, 3)), random_axes(500, rng), random_axes(500, rng)
    if axes != "any":
        z_j = z_i if axes == "parallel" else -z_i
    rules = Rules(
        required=1e3,
        airflow=True,
        balls=np.empty((0, 4)),
        length=12.0,
        start_radius=1.0,
        growth=growth,
        min_distance=-np.inf,
        bolted_pairs=False,
        turn=1.0,
        folds=np.array([[-1.0, 1.0]]),
    )
    one, other = Swept(w, -12.0 * z_i, 1.0, growth), Swept(np.zeros(3), -12.0 * z_j, 1.0, growth)
    compiled = [clearance(rules, tuple(w[k].tolist()), z_i[k], z_j[k]) for k in range(500)]
    np.testing.assert_allclose(compiled, vectorised(one, other), atol=1e-9)


def test_modules_in_any_order_are_placed():
    """Breadth first, so that what hangs on a module is not one run of numbers."""
    joints = [(-1, -1, -1), (0, 0, 2), (0, 1, 3), (0, 2, 0), (1, 0, 1), (2, 0, 1), (3, 1, 2), (4, 0, 1), (5, 0, 3)]
    topology = Topology((*joints, (6, 0, 2)))
    task = push(10, module={"connector_distance": 0.22}, search={"body_clearance": False})
    rng = np.random.default_rng(4)
    alpha = rng.uniform(-1.0, 1.0, 9)
    assert least_clearance(task, topology, alpha) < 0.0
    alpha = untangle(task, topology, alpha, rng)
    assert least_clearance(task, topology, alpha) >= CLEAR * task.module.arm_length - 1e-9


def test_small_platforms_load_no_compiled_code():
    code = """
import sys
import nlp
from nlp.starts.random_starts import draw, generator
from topo_search.model import Topology
from topo_search.model.task_file import read_task
task, topology = read_task("push").resolve(7), Topology.from_key("a1111110")
draw(task, topology, generator(task, topology, 0, 0))
sys.exit("numba" in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


# ---- Starts of large platforms whose airflow a cone must hold: hinges placed for it, the end-effector at its
# apex.


def cone(half_angle_deg=60.0, axis="com"):
    return {"kind": "exterior", "half_angle_deg": half_angle_deg, "axis": axis}


def conical(n, **fields):
    search = {"body_clearance": False, **fields.pop("search", {})}
    fields = {"module": {"connector_distance": 0.22}, "exposure": [cone()], **fields}
    return push(n, search=search, **fields)


def in_cone(start):
    return [check.scaled for check in violations(start) if "exterior" in check.name]


@pytest.mark.parametrize("half_angle", [math.radians(60), None], ids=["cone", "no cone"])
@pytest.mark.parametrize("number", range(3))
def test_hinges_turned_for_their_lever_have_a_shorter_one_and_no_overlaps(number, half_angle):
    task, topology = conical(16), sample(16, 3, seed=1)[number]
    rng = np.random.default_rng(number)
    placed = untangle(task, topology, np.zeros(15), rng)
    clear = CLEAR * task.module.arm_length - 1e-9
    assert least_clearance(task, topology, placed) >= clear
    alpha = shorten_lever(task, topology, placed, half_angle, rng)
    assert lever(task, topology, alpha, half_angle) < lever(task, topology, placed, half_angle)
    assert least_clearance(task, topology, alpha) >= clear
    assert np.all(np.abs(alpha) <= np.pi / 2)


def test_the_lever_of_a_straight_chain():
    """All thrust is left, and the outermost balls at the rotors' height ask for most."""
    task, chain = conical(9), Topology(((-1, -1, -1), *((h, 0, 2) for h in range(8))))
    l_c, r = task.module.connector_distance, task.module.envelope.start_radius
    half_angle = math.radians(60)
    expected = (8 * l_c * math.cos(half_angle) + r) / math.sin(half_angle)
    assert lever(task, chain, np.zeros(8), half_angle) == pytest.approx(expected)
    assert lever(task, chain, np.zeros(8), None) == pytest.approx(l_c)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"exposure": [cone(75.0), cone(60.0)]},
        {"exposure": [cone(60.0, [0.0, 0.6, -0.8])]},
        {"end_effector": {"stand_off": 0.8}},
        {"search": {"root": "paper"}},
        {"search": {"margin": 0.01}},
    ],
    ids=["com axis", "two cones", "fixed axis", "stand-off", "paper root", "margin"],
)
def test_every_cone_holds_all_airflow_at_the_start(fields):
    task, topology = conical(10, **fields), sample(10, 1, seed=2)[0]
    for index in range(2):
        start = draw(task, topology, generator(task, topology, index, 0))
        names = [check.name for check in violations(start) if check.scaled > 0.0]
        assert not [name for name in names if not name.startswith("load case")]
        nearest = max(in_cone(start)) * task.module.arm_length
        if not task.end_effector.stand_off:
            assert nearest == pytest.approx(-task.search.margin, abs=1e-9)


@pytest.mark.parametrize("weights", [(1.0, 1.0), (1.0, 0.01)])
def test_the_platform_is_turned_to_where_the_wrenches_cost_least(weights):
    forces = ([0.5, 0.0, 0.5], [0.0, 0.5, 0.5])
    cases = [{"end_effector": {"force": f}, "weight": weight} for f, weight in zip(forces, weights, strict=True)]
    task, topology = conical(10, load_cases=cases), sample(10, 1, seed=0)[0]
    start = draw(task, topology, generator(task, topology, 0, 0))
    force = np.array(weights) @ np.array(forces)

    def effort(point):
        u = np.linalg.lstsq(wrench_matrix(point), required_wrenches(point).T, rcond=None)[0]
        return np.sum(u**2, axis=0) @ np.array(weights)

    efforts = []
    for k in range(DRAWING.turns):
        turn = rotation(force / np.linalg.norm(force), 2 * np.pi * k / DRAWING.turns)
        root = root_of(task, turn @ root_rotation(start.root))
        p_E = turn @ start.tip  # the origin is the root's centre
        efforts.append(effort(Point(task, topology, root, start.alpha, p_E, start.u)))
    assert min(efforts) == pytest.approx(efforts[0], rel=1e-9)
    assert max(efforts) > 1.01 * efforts[0]


def test_a_fixed_end_effector_stays_where_it_is():
    task = conical(8, end_effector={"position": [0.0, 0.0, 1.0]})
    topology = sample(8, 1, seed=0)[0]
    start = draw(task, topology, generator(task, topology, 0, 0))
    np.testing.assert_allclose(start.tip - start.p_COM, [0.0, 0.0, 1.0], atol=1e-12)
