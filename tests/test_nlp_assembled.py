"""The assembled program is the printed problem: values, derivatives and answers, for every feature."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from nlp_cases import DISTINCT, FEATURES, HOVER, push, random_point, random_tree, with_masses
from suites import few

from nlp import program
from nlp.assembled.problem import AssembledProblem
from nlp.assembled.terms import derived_rows
from nlp.evaluation import correct, violations, worst
from nlp.ipopt import BETA, OPTIONS
from nlp.numbers.point import Point
from nlp.problem import problem
from nlp.program import AssembledProgram
from nlp.requirements import clearances, variable_bounds
from nlp.solve import solve
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Topology
from topo_search.model.corners import to_corners
from topo_search.model.files import read_task
from topo_search.topologies import sample
from verify import audit

CASES = {
    **{name: (fields, "a10" if "rod" in name else "a120") for name, fields in FEATURES.items()},
    "push": (FEATURES["push"], "a1300"),
    "several requirements": (FEATURES["several requirements"], "a1300"),
    "any port": (FEATURES["any port"], "p1380"),
    "two modules": ({}, "a10"),
    "one module": ({}, "a0"),
}


def dense(pattern, entries):
    return np.array(ca.DM(pattern, entries))


@pytest.mark.parametrize("name", few(CASES, {*DISTINCT[::3], "one module"}))
def test_values_and_derivatives_are_those_of_the_page(name):
    fields, key = CASES[name]
    topology = Topology.from_key(key)
    assert_printed(push(topology.n, **fields), topology)


@pytest.mark.parametrize("heavy", [False, True], ids=["", "joints and a rod"])
@pytest.mark.parametrize("position", ["free", [0.1, -0.2, 0.3]])
def test_angular_accelerations_take_torque_by_the_inertia(position, heavy):
    tip, flight = {"mass": 0.1, "position": position}, {"angular_acceleration": [30.0, 0.0, 20.0]}
    task, topology = push(4, load_cases=[HOVER], end_effector=tip, flight=flight), Topology.from_key("a1300")
    assert_printed(to_corners(with_masses(task, topology) if heavy else task), topology)


def assert_printed(task, topology):
    printed = problem(task, topology)
    assembled = AssembledProblem(task, topology, clearances(task, topology), BETA)
    rng = np.random.default_rng(5)
    variables = printed.variables.vector()
    rows = ca.vertcat(*(constraint.expression for constraint in printed.constraints))
    multipliers = ca.SX.sym("multipliers", rows.numel())
    hessian, _ = ca.hessian(2.5 * printed.objective + ca.dot(multipliers, rows), variables)
    jacobian = ca.jacobian(rows, variables)
    results = [printed.objective, ca.gradient(printed.objective, variables), rows, jacobian, hessian]
    derived = ca.Function("printed", [variables, printed.beta, multipliers], results)
    for _ in range(3):
        x = random_point(task, topology, rng).pack()
        weight = rng.normal(size=rows.numel())
        f, df, g, dg, _ = (np.array(value) for value in derived(x, BETA, weight))
        own = assembled.constraints(x)
        order, own_order = np.argsort(g.ravel()), np.argsort(own)  # the rows are the same, their order is not
        scale = max(1.0, np.abs(dg).max())
        assert assembled.objective(x) == pytest.approx(f.item(), rel=1e-12)
        np.testing.assert_allclose(assembled.gradient(x), df.ravel(), atol=1e-12)
        np.testing.assert_allclose(own[own_order], g.ravel()[order], atol=1e-10)
        own_jacobian = dense(assembled.jacobian_pattern, assembled.jacobian(x))
        np.testing.assert_allclose(own_jacobian[own_order], dg[order], atol=1e-10 * scale)
        page_weight = np.empty_like(weight)
        page_weight[order] = weight[own_order]
        H = np.array(derived(x, BETA, page_weight)[4])
        own_hessian = dense(assembled.hessian_pattern, assembled.hessian(x, 2.5, weight))
        np.testing.assert_allclose(own_hessian, np.triu(H), atol=1e-9 * max(1.0, np.abs(H).max()))


def solve_printed(start):
    """Where Ipopt ends from a start on the printed problem, as one CasADi graph."""
    printed = problem(start.task, start.topology)
    nlp = {
        "x": printed.variables.vector(),
        "p": printed.beta,
        "f": printed.objective,
        "g": ca.vertcat(*(row.expression for row in printed.constraints)),
    }
    lower, upper = (
        np.repeat(
            [getattr(row, side) for row in printed.constraints],
            [row.expression.numel() for row in printed.constraints],
        )
        for side in ("lower", "upper")
    )
    least, most = variable_bounds(start.task, start.topology, start.alpha)
    solver = ca.nlpsol("printed", "ipopt", nlp, OPTIONS)
    x = solver(x0=start.pack(), p=BETA, lbx=least, ubx=most, lbg=lower, ubg=upper)["x"]
    return Point.unpack(start.task, start.topology, np.asarray(x, dtype=float).ravel())


@pytest.mark.parametrize("name", few(["60 degree cone", "push", "two paths", "paper root", "no body clearance"], 1))
def test_ipopt_reaches_what_it_reaches_on_the_printed_problem(name, monkeypatch):
    """With every row, one round without move limits and the same options, it takes the same steps on both."""
    for room, value in {"NEAR_ENVELOPE": np.inf, "NEAR_PARTS": np.inf}.items():
        monkeypatch.setattr(f"nlp.requirements.modules.{room}", value)
    limits = program.LIMITS._replace(bold=np.inf, rounds=1)
    options = program.ROUND_OPTIONS._replace(near_start={})
    for name_, value in {"LIMITS": limits, "ROUND_OPTIONS": options}.items():
        monkeypatch.setattr(f"nlp.program.{name_}", value)
    topology = Topology.from_key("a11210")
    task = push(5, **FEATURES[name])
    assembled, efforts = AssembledProgram(task, topology), []
    for start in range(3):
        point = draw(task, topology, generator(task, topology, start, 0))
        ends = [correct(solve_printed(point)), correct(assembled.solve(point).point)]
        met = [worst(violations(end)).met for end in ends]
        efforts += [[np.sum(end.u**2) for end in ends]] if all(met) else []
    assert efforts
    np.testing.assert_allclose(*np.array(efforts).T, rtol=1e-6)


def test_exactly_parallel_envelopes_have_finite_derivatives():
    """The stationary point is a whole line then, and the printed problem's epsilon keeps it from blowing up."""
    (airflow,) = clearances(push(2), Topology.from_key("a10"))[0].formulas
    (pair,) = derived_rows(airflow, BETA)
    z = np.array([0.0, 0.0, 1.0])
    y = np.array([[[0.3, 0.0, 0.2], z, z], [[0.0, 0.1, 1.0], z, -z], [[2.0, 0.0, 0.0], z, z]])
    assert all(np.all(np.isfinite(part)) for part in pair(y))


def test_twenty_modules_are_solved_and_every_pair_is_clear():
    """Far pairs are left out of the program, but all 190 are judged."""
    task = read_task("ten-wrenches", ("modules=20", "search.body_clearance=false")).resolve(20)
    topology = sample(20, 1, 0)[0]
    start = draw(task, topology, generator(task, topology, 0, 0))
    assert 0 < len(clearances(task, topology)[0].restrict(start.vectors).subjects) < 150
    design = solve(task, topology, starts=range(2), seed=0)
    assert isinstance(design, Design)
    judged = audit(design)
    assert judged.verdict == "clear"
    assert sum(pair.kind == "airflow" for pair in judged.pairs) == 190


def test_a_random_tree_of_thirty_modules_has_exact_derivatives():
    """Central differences along random directions; the graph would take minutes to build."""
    rng = np.random.default_rng(8)
    topology = random_tree(30, rng)
    task = push(30, exposure=FEATURES["several requirements"]["exposure"], search={"connectors": "any"})
    some = [replace(asked, subjects=asked.subjects[::7]) for asked in clearances(task, topology)]
    assembled = AssembledProblem(task, topology, some, BETA)
    x = draw(task, topology, rng).pack()
    weight = rng.normal(size=assembled.rows)
    jacobian = ca.DM(assembled.jacobian_pattern, assembled.jacobian(x))
    upper = ca.DM(assembled.hessian_pattern, assembled.hessian(x, 1.0, weight))
    hessian = upper + upper.T - ca.diag(ca.diag(upper))

    def slope(y):
        by_rows = ca.DM(assembled.jacobian_pattern, assembled.jacobian(y)).T @ weight
        return assembled.gradient(y) + np.array(by_rows).ravel()

    for _ in range(3):
        d = rng.normal(size=x.shape) * 1e-7  # clearances bend so sharply that ten times the step would show
        change = (assembled.constraints(x + d) - assembled.constraints(x - d)) / 2
        np.testing.assert_allclose(np.array(jacobian @ d).ravel(), change, atol=1e-10)
        bend = (slope(x + d) - slope(x - d)) / 2
        scale = np.abs(bend).max()
        np.testing.assert_allclose(np.array(hessian @ d).ravel(), bend, atol=1e-4 * scale)
