"""Every derivative that the solver is given, against finite differences, with one checker for all constraints.

Central differences with one Richardson step: the error is of fourth order in STEP, and of rounding / STEP.
"""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from nlp_cases import CONE, DISTINCT, FEATURES, HALF_SPACE, LOCAL, TWO_PATHS, push, random_point
from suites import few

from nlp.ipopt import BETA
from nlp.problem import problem
from nlp.starts.random_starts import draw
from topo_search.model import Topology

STEP = 1e-5
"""The sharpest feature of the problem, a clamp, is sqrt(EPSILON) = 1e-3 wide in its own argument."""

CASES = {
    **{name: (fields, "a10" if "rod" in name else "a120") for name, fields in FEATURES.items()},
    "any port": (FEATURES["any port"], "p1380"),
    "any port, several requirements": (
        {"exposure": FEATURES["several requirements"]["exposure"], "search": {"connectors": "any"}},
        "p1b00",
    ),
}


def stated(fields, key):
    topology = Topology.from_key(key)
    task = push(topology.n, **fields)
    return task, topology, problem(task, topology)


def points(task, topology, seed):
    """One point as a solve starts from, moved off symmetry, and one from anywhere."""
    rng = np.random.default_rng(seed)
    start = draw(task, topology, rng).pack()
    yield start + 0.02 * rng.normal(size=start.shape)
    yield random_point(task, topology, rng).pack()


def finite_differences(f, x):
    """The Jacobian of f at x, shape (len(f), len(x))."""
    h = STEP * np.eye(len(x))
    offsets = np.hstack([h, -h, 2 * h, -2 * h])
    values = np.array(f.map(offsets.shape[1])(x[:, None] + offsets))
    ahead, behind, far_ahead, far_behind = np.split(values, 4, axis=1)
    return (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * STEP)


def assert_derivative(f, derivative, x, names):
    """Compare a derivative with finite differences, each row relative to its largest entry."""
    exact, approximate = np.array(derivative(x)), finite_differences(f, x)
    assert np.all(np.isfinite(exact))
    scale = np.maximum(1.0, np.abs(exact).max(axis=1, keepdims=True))
    off = np.abs(exact - approximate) / scale
    row = int(np.argmax(off.max(axis=1)))
    assert off.max() < 1e-7, f"{names[row]}: {off.max()}"


@pytest.mark.parametrize("name", few(CASES, DISTINCT))
def test_jacobian_and_hessian_match_finite_differences(name):
    task, topology, nlp = stated(*CASES[name])
    x = nlp.variables.vector()
    rows = ca.vertcat(nlp.objective, *(c.expression for c in nlp.constraints))
    rows = ca.substitute(rows, nlp.beta, BETA)
    names = ["objective", *(c.name for c in nlp.constraints for _ in range(c.expression.numel()))]
    multipliers = ca.SX.sym("multipliers", rows.numel())
    hessian, gradient = ca.hessian(ca.dot(multipliers, rows), x)
    g, jacobian = ca.Function("g", [x], [rows]), ca.Function("jacobian", [x], [ca.jacobian(rows, x)])
    for seed, at in enumerate(points(task, topology, seed=1)):
        assert_derivative(g, jacobian, at, names)
        signs = np.random.default_rng(seed).normal(size=rows.numel())
        of_lagrangian = [ca.substitute(e, multipliers, ca.DM(signs)) for e in (gradient, hessian)]
        slope, curvature = (ca.Function("lagrangian", [x], [e]) for e in of_lagrangian)
        assert_derivative(slope, curvature, at, [f"Hessian, variable {v}" for v in range(x.numel())])
        assert np.array(curvature(at)) == pytest.approx(np.array(curvature(at)).T, rel=1e-12, abs=1e-12)


CONE_BELOW = {**CONE, "axis": [0.0, 0.0, -1.0]}


@pytest.mark.parametrize("exposure", [[CONE_BELOW], [HALF_SPACE], [CONE], [LOCAL, TWO_PATHS]])
@pytest.mark.parametrize("spread_angle_deg", [0.0, 10.0])
def test_derivatives_stay_finite_where_the_geometry_degenerates(exposure, spread_angle_deg):
    """Parallel axes, envelopes side by side without growth, an end ball in the middle of the cone."""
    topology = Topology.from_key("a1300")
    task = push(4, exposure=exposure, module={"airflow": {"spread_angle_deg": spread_angle_deg}})
    nlp = problem(task, topology)
    x, rows = nlp.variables.vector(), ca.vertcat(*(c.expression for c in nlp.constraints))
    rows = ca.substitute(rows, nlp.beta, BETA)
    hessian, _ = ca.hessian(ca.sum1(rows), x)
    f = ca.Function("f", [x], [rows, ca.jacobian(rows, x), hessian])
    level = random_point(task, topology, np.random.default_rng(0))
    upright = dataclasses.replace(level, root=np.zeros(3), alpha=np.zeros(3), p_E=np.array([0.0, 0.0, 0.5]))
    for values in f(upright.pack()):
        assert np.all(np.isfinite(np.array(values)))
