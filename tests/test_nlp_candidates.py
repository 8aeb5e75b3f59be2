"""The compiled minimum over the candidates is CasADi's, also where envelopes are nearly parallel."""

import numpy as np

from nlp.assembled.kkt_candidates import smooth_least
from nlp.ipopt import BETA

A = 2.3


def test_exactly_parallel_envelopes_have_finite_derivatives():
    """The stationary point is a whole line then, and the printed problem's epsilon keeps it from blowing up."""
    c = np.array([[-2 * A, 0.3, -0.3], [2 * A, -1.0, -1.0], [-2 * A, 3.0, 3.0]])
    assert all(np.all(np.isfinite(part)) for part in smooth_least(c, A, BETA, 2))
