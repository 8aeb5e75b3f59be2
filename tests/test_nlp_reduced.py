"""The compiled reduced problem against the printed problem: every kind of row, the inputs, and all derivatives."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from nlp_cases import BOX, DISTINCT, FEATURES, HOVER, WEDGE, push, random_point, random_tree, with_masses
from scipy.optimize import lsq_linear, minimize_scalar, nnls
from suites import few

from nlp.names import ROD
from nlp.numbers.point import Point
from nlp.problem import problem
from nlp.reduced.arrays import rows, to_arrays
from nlp.reduced.clearance import hull_gap
from nlp.reduced.descent import evaluate
from nlp.requirements import clearances, exposure_clearances
from nlp.requirements import row_kinds as s
from nlp.requirements.balances import required_wrenches, wrench_matrix
from nlp.requirements.rod import BestRod
from nlp.units import Units
from topo_search.model import LoadCase, Topology
from topo_search.model.corners import to_corners

SHARP = 1e8
"""Sharpness at which the printed problem's smooth minimum is the least of its candidates."""
RHO = 300.0


def unknowns(task, topology, point):
    """The point's reduced unknowns."""
    count = len(to_arrays(task, topology).lower)
    return point.pack()[:count]


def evaluated(task, topology, x, rho=RHO):
    stated = to_arrays(task, topology)
    K = len(task.load_cases)
    return evaluate(stated, x, np.zeros((K, 6)), np.ones(K, dtype=bool), rho)


def printed_gaps(task, topology):
    """The printed problem's clearances by name, dimensionless, at nearly infinite sharpness: a function of x."""
    printed = problem(task, topology)
    u = np.zeros(task.rotor_count * len(task.load_cases))
    stated = [c for c in printed.constraints if "load case" not in c.name]
    rows_of = ca.Function("rows", [printed.variables.vector(), printed.beta], [c.expression for c in stated])

    def gaps(x):
        values = rows_of.call([np.concatenate([x, u]), SHARP])
        return {c.name: np.asarray(value).ravel() for c, value in zip(stated, values, strict=True)}

    return gaps


def lengths_of(row, stated):
    """The least and the largest R, the length by which the printed problem divides a square."""
    body, obstacle, _ = row.search_row
    start, growth = obstacle[1:] if isinstance(obstacle, s.AirflowObstacle) else (0.0, 0.0)
    end = start + growth
    if isinstance(body, s.PartsBody):
        return end + stated.parts[:, 3].min(), end + stated.parts[:, 3].max()
    if isinstance(body, s.EnvelopeBody | s.JetBody):
        end += body.radius + body.growth
    R = end + obstacle.radius if isinstance(obstacle, s.CapsuleObstacle) else end or obstacle.distance
    return R, R


def exact_gaps(task, topology, point):
    """The exact clearances by their names; of rods those of the one that keeps the margin, as in the search."""
    found = {}
    for requirement in clearances(task, topology):
        names = [name for name, *_ in requirement.rows()]
        gaps = requirement.gaps(point.vectors)
        if isinstance(requirement, BestRod):
            _, best, of_rods = requirement.best(point.vectors, requirement.margin)
            gaps = of_rods[best]
        found |= dict(zip(names, gaps.ravel().tolist(), strict=True))
    return found


def of_best_rod(listed, found):
    """The least finite gap of each limit of rods, all of one rod."""
    least, numbers = {}, set()
    for row, g in zip(listed, found, strict=True):
        if isinstance(row.search_row.body, s.RodBody) and math.isfinite(g):
            least[row.name] = min(g, least.get(row.name, math.inf))
            numbers.add(row.search_row.body.number)
    assert len(numbers) == any(isinstance(row.search_row.body, s.RodBody) for row in listed)
    return least


def as_length(value, R):
    """g of f = 2 R value."""
    return math.sqrt(max(0.0, 2 * R * value + R * R)) - R


def awkward_points(task, topology, rng):
    """Random points, and hinges at zero or a right angle: parallel axes, folded modules, deep overlap."""
    yield random_point(task, topology, rng)
    for angles in (
        np.zeros,
        lambda m: np.full(m, math.pi / 2),
        lambda m: rng.choice([-1.0, 0.0, 1.0], m) * math.pi / 2,
    ):
        point = random_point(task, topology, rng)
        yield Point(task, topology, point.root, angles(topology.n - 1), 0.2 * point.tip, point.u)


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT[::3]))
def test_clearances_are_those_of_the_printed_problem(name):
    rng = np.random.default_rng(1)
    task = push(3, **FEATURES[name])
    for _ in range(2):
        topology = random_tree(3, rng, aligned=True)
        stated, listed = to_arrays(task, topology), list(rows(task, topology))
        gaps_of = printed_gaps(task, topology)
        for point in awkward_points(task, topology, rng):
            x = unknowns(task, topology, point)
            found = evaluated(task, topology, x).g
            printed, exact = gaps_of(x), exact_gaps(task, topology, point)
            assert {row.name for row in listed} == set(printed)
            of_rods = of_best_rod(listed, found)
            for limit, g in of_rods.items():
                assert g == pytest.approx(exact[limit], abs=1e-9) or max(g, exact[limit]) < 0  # deep in a hull
                if of_rods.keys() == {ROD}:
                    largest = task.largest_reach(3) / task.module.arm_length
                    assert printed[ROD][0] == pytest.approx(g - g * g / (2 * largest), abs=1e-6)
                if min(of_rods.values()) > 0.05:
                    assert min(printed[limit]) > 0
            for row, g in zip(listed, found, strict=True):
                values, (body, obstacle, _) = printed[row.name], row.search_row
                if isinstance(body, s.RodBody):
                    continue
                if isinstance(body, s.PartsBody) and not isinstance(obstacle, s.AirflowObstacle):
                    assert g == pytest.approx(exact[row.name], abs=1e-6)
                    assert (min(values) > 0) == (g > 0) or abs(g) < 0.05
                    continue
                if isinstance(obstacle, s.HullObstacle):
                    assert (g > 0) == (exact[row.name] > 0) or abs(g) < 1e-6
                    assert g < 0 or values[1] > 0.0  # the centre is outside
                    assert (g > 0) == (min(values) > 0) or abs(g) < 0.05
                    continue
                if isinstance(obstacle, s.ConeObstacle):
                    assert g == pytest.approx(values[int(obstacle.end)], abs=1e-4)
                    continue
                least, most = sorted(as_length(values[0], R) for R in lengths_of(row, stated))
                assert least - 3e-5 <= g
                assert g <= most + 3e-5 or (math.isinf(g) and least > 8.0)


TURNING = {"load_cases": [HOVER], "flight": {"angular_acceleration": [40.0, 30.0, 20.0]}}


@pytest.mark.parametrize("position", ["free", [0.1, -0.2, 0.3]])
def test_derivatives_with_masses_of_joints_and_a_rod_are_those_of_the_values(position):
    topology = Topology.from_key("a1300")
    task = with_masses(push(4, **TURNING, end_effector={"position": position}), topology)
    assert_derivatives(to_corners(task), topology)


@pytest.mark.parametrize("name", few([*FEATURES, "accelerations"], {*DISTINCT, "accelerations"}))
def test_derivatives_are_those_of_the_values(name):
    assert_derivatives(to_corners(push(3, **FEATURES.get(name, TURNING))))


def assert_derivatives(task, topology=None):
    """At points of a topology, by default of random ones."""
    rng, h = np.random.default_rng(2), 1e-6
    for _ in range(3):
        tree = topology or random_tree(3, rng, aligned=True)
        x = unknowns(task, tree, random_point(task, tree, rng))
        here = evaluated(task, tree, x)
        for l in range(len(x)):
            step = h * np.eye(len(x))[l]
            up, down = evaluated(task, tree, x + step), evaluated(task, tree, x - step)
            assert here.dV[l] == pytest.approx((up.V - down.V) / (2 * h), rel=1e-5, abs=1e-5)
            slopes = (up.g[here.is_near] - down.g[here.is_near]) / (2 * h)
            np.testing.assert_allclose(here.J[here.is_near, l], slopes, atol=2e-5)


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0, 5.0, 100.0])
def test_inputs_are_the_least_ones_in_reach_and_out_of_reach(factor):
    rng = np.random.default_rng(3)
    cases = [
        {
            "end_effector": {"force": (factor * rng.normal(size=3)).tolist(), "torque": [0.0, factor, 0.0]},
            "com": {"force": [0.0, 0.0, 1.0], "torque": (factor * rng.normal(size=3)).tolist()},
            "weight": weight,
        }
        for weight in (1.0, 0.01)
    ]
    task = push(3, load_cases=cases)
    topology = random_tree(3, rng)
    for _ in range(5):
        point = random_point(task, topology, rng)
        found = evaluated(task, topology, unknowns(task, topology, point)).V
        assert found == pytest.approx(by_least_squares(point), rel=1e-6)


def by_least_squares(point):
    """The least effort and price of residuals, of the exact evaluation's wrenches moved to the COM."""
    task, n = point.task, point.topology.n
    unit = Units.of(task)
    A, b = wrench_matrix(point) * unit.input, required_wrenches(point)
    shift = np.eye(6)
    x, y, z = point.p_COM
    shift[3:, :3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    scale = np.repeat([1 / task.force_unit(n), 1 / task.torque_unit(n)], 3)
    weights = np.array([case.weight for case in task.load_cases])
    total = 0.0
    for b_k, weight in zip(b, weights, strict=True):
        c = 2 * weight / (4 * n * weights.sum())
        rows_of = np.vstack([math.sqrt(c / 2) * np.eye(4 * n), math.sqrt(RHO) * (scale[:, None] * (shift @ A))])
        asked = np.concatenate([np.zeros(4 * n), math.sqrt(RHO) * scale * (shift @ b_k)])
        least = lsq_linear(
            rows_of, asked, (task.min_thrust_to_weight, task.max_thrust_to_weight), tol=1e-14, method="bvls"
        )
        total += 2 * least.cost
    return total


def test_a_case_of_next_to_no_weight_still_has_inputs():
    cases = [LoadCase(com={"force": (0.0, 0.0, 1.0)}), LoadCase(com={"force": (0.1, 0.0, 1.0)}, weight=1e-15)]
    task = push(2, load_cases=[case.model_dump() for case in cases])
    topology = random_tree(2, np.random.default_rng(0))
    here = evaluated(task, topology, np.array([0.1, 0.2, 0.0, 0.3, 5.0, 0.0, 0.0]), rho=1e4)
    assert np.isfinite(here.V)
    assert np.all(np.isfinite(here.mu))


def outside(P, corners):
    """The distance of a point from the hull of corners, by least squares over their mixtures."""
    heavy = 1e4  # what the mixture's sum is held to one with
    mixed = np.vstack([corners.T, heavy * np.ones(len(corners))])
    weights, _ = nnls(mixed, np.append(P, heavy))
    return np.linalg.norm(corners.T @ (weights / weights.sum()) - P)


@pytest.mark.parametrize("region", [BOX, WEDGE], ids=["box", "wedge"])
def test_an_envelope_and_a_hull_are_as_far_apart_as_their_nearest_points(region):
    rng, compared = np.random.default_rng(4), 0
    (formula,) = next(exposure_clearances(push(1, exposure=[region]))).formulas
    hull = formula.search_rows()[0].obstacle.hull
    a, b = hull.corners[hull.edges].transpose(1, 0, 2)
    d, r_0, dr = np.array([0.3, -1.0, 4.0]), 0.7, 0.5
    for _ in range(40):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        w, axis = rng.normal(size=3) * 3, turn @ d
        g, _, *slope = hull_gap(tuple(w), tuple(axis), r_0, dr, hull.planes, np.column_stack([a, b - a]))

        def f(at, w=w, axis=axis):
            return outside(w + at * axis, hull.corners) ** 2 - (r_0 + at * dr) ** 2

        grid = np.linspace(0.0, 1.0, 101)
        apart = [outside(w + at * axis, hull.corners) for at in grid]
        k = int(np.argmin([f(at) for at in grid]))
        bounds = grid[max(0, k - 1)], grid[min(100, k + 1)]
        least = min(
            minimize_scalar(f, bounds=bounds, method="bounded", options={"xatol": 1e-10}).fun, f(0.0), f(1.0)
        )
        R = r_0 + dr
        if min(apart) > 1e-3:
            assert g == pytest.approx(math.sqrt(least + R * R) - R, abs=1e-6)
            step = 1e-6 * rng.normal(size=3)
            moved, *_ = hull_gap(tuple(w + step), tuple(axis), r_0, dr, hull.planes, np.column_stack([a, b - a]))
            assert moved - g == pytest.approx(slope @ step, abs=1e-10)
            compared += 1
        elif min(apart) < 1e-6:
            assert g <= -R
            height = hull.planes[:, :3] @ np.array([w, w + axis]).T - hull.planes[:, 3:]
            assert g == pytest.approx(height.min(axis=1).max() - R, abs=1e-12)
    assert compared > 10


@pytest.mark.parametrize("region", [BOX, WEDGE], ids=["box", "wedge"])
def test_an_axis_in_a_hull_leaves_it_by_the_row_that_it_has(region):
    """Deep inside, where the printed problem has no slope that leads out: going uphill ends outside."""
    task, topology = push(1, exposure=[region]), Topology.from_key("a0")
    stated = to_arrays(task, topology)
    place = next(r for r, kind in enumerate(stated.rows.obstacles.kind) if kind == s.HULL)
    rng, entered = np.random.default_rng(4), 0
    for _ in range(20):
        x = unknowns(task, topology, random_point(task, topology, rng))
        x[3:6] = rng.normal(size=3) * 0.3  # p'_E, about which the region is, next to the module
        here = evaluated(task, topology, x)
        entered += here.g[place] < -task.module.envelope.end_radius / task.module.arm_length
        for _ in range(200):
            if here.g[place] >= 0:
                break
            slope = here.J[place]
            x = x + 0.05 * slope / np.linalg.norm(slope)
            here = evaluated(task, topology, x)
        assert here.g[place] >= 0
    assert entered > 5
