"""The assembled program is the printed problem: values, derivatives and answers, for every feature."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from nlp_cases import (
    CONE,
    DISTINCT,
    FEATURES,
    HALF_SPACE,
    HOVER,
    LOCAL,
    TWO_PATHS,
    push,
    random_point,
    random_tree,
    with_masses,
)
from suites import few

from nlp.assembled.problem import AssembledProblem
from nlp.ipopt import BETA
from nlp.problem import problem
from nlp.requirements import clearances
from nlp.solving import solve
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Topology
from topo_search.model.corners import to_corners
from topo_search.model.task_file import read_task
from topo_search.topologies import sample
from verify import audit

CONE_BELOW = {**CONE, "axis": [0.0, 0.0, -1.0]}
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


@pytest.mark.parametrize("exposure", [[CONE_BELOW], [HALF_SPACE], [CONE], [LOCAL, TWO_PATHS]])
@pytest.mark.parametrize("spread_angle_deg", [0.0, 10.0])
def test_derivatives_stay_finite_where_the_geometry_degenerates(exposure, spread_angle_deg):
    """Parallel axes, envelopes side by side without growth, an end ball in the middle of the cone."""
    topology = Topology.from_key("a1300")
    task = push(4, exposure=exposure, module={"airflow": {"spread_angle_deg": spread_angle_deg}})
    assembled = AssembledProblem(task, topology, clearances(task, topology), BETA)
    level = random_point(task, topology, np.random.default_rng(0))
    x = replace(level, root=np.zeros(3), alpha=np.zeros(3), tip=np.array([0.0, 0.0, 0.5])).pack()
    for values in (
        assembled.constraints(x),
        assembled.jacobian(x),
        assembled.hessian(x, 1.0, np.ones(assembled.rows)),
    ):
        assert np.all(np.isfinite(values))


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
