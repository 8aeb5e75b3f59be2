"""Derivatives of the printed problem, which CasADi writes, are numbers where the geometry degenerates."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from nlp_cases import CONE, HALF_SPACE, LOCAL, TWO_PATHS, push, random_point

from nlp.ipopt import BETA
from nlp.problem import problem
from topo_search.model import Topology

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
    upright = dataclasses.replace(level, root=np.zeros(3), alpha=np.zeros(3), tip=np.array([0.0, 0.0, 0.5]))
    for values in f(upright.pack()):
        assert np.all(np.isfinite(np.array(values)))
