"""The compiled minimum over the candidates is CasADi's, also where envelopes are nearly parallel."""

import casadi as ca
import numpy as np
import pytest

from nlp.assembled.kkt_candidates import smooth_least
from nlp.ipopt import BETA
from nlp.symbols.clearance import log_sum_exp, quadratic_candidates

A = 2.3
M = 400


def printed_form():
    c = ca.SX.sym("c", 3)
    psi = log_sum_exp(quadratic_candidates(A, A, c[0], c[1], c[2], 0.0), BETA)
    hessian, gradient = ca.hessian(psi, c)
    return ca.Function("psi", [c], [psi, gradient, hessian])


def coefficients(det, rng):
    """C, D, E of pairs whose determinant 4 A^2 - C^2 is at least `det` of the one across."""
    C = rng.choice([-2 * A, 2 * A], M) * np.sqrt(1 - rng.uniform(det, 2 * det, M))
    return np.column_stack([C, *rng.normal(0, 2 * A, (2, M))])


@pytest.mark.parametrize(("det", "rounding"), [(0.5, 1e-11), (0.1, 1e-10), (1e-2, 1e-6)])
def test_values_and_derivatives_are_those_of_the_printed_problem(det, rounding):
    c = coefficients(det, np.random.default_rng(3))
    psi, gradient, hessian = smooth_least(c, A, BETA, 2)
    derived = printed_form()
    for r in range(M):
        value, slope, bend = (np.array(result) for result in derived(c[r]))
        assert psi[r] == pytest.approx(value.item(), rel=1e-12, abs=1e-12)
        np.testing.assert_allclose(gradient[r], slope.ravel(), atol=rounding * max(1.0, np.abs(slope).max()))
        np.testing.assert_allclose(hessian[r], bend, atol=rounding * max(1.0, np.abs(bend).max()))


def test_exactly_parallel_envelopes_have_finite_derivatives():
    """The stationary point is a whole line then, and the printed problem's epsilon keeps it from blowing up."""
    c = np.array([[-2 * A, 0.3, -0.3], [2 * A, -1.0, -1.0], [-2 * A, 3.0, 3.0]])
    assert all(np.all(np.isfinite(part)) for part in smooth_least(c, A, BETA, 2))
