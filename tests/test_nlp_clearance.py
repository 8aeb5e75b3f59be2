r"""The smooth clearance against the exact one, and the solver's own exact one against the audit's.

| symbol | meaning |
|---|---|
| c | exact clearance, the least gap of two balls |
| g | smooth clearance, LSE_beta(f) / (2 s) |
| s, r | sum of the end radii, sum of the start radii |
| f* | least f over the unit square |

From f = gap (distance + radii) follow, with gap >= c everywhere and = c somewhere: c > 0 gives
2 r c <= f* <= c (c + 2 s), and c < 0 gives 2 s c <= f* <= r c. The log-sum-exp takes away log(9) / beta at most and
adds nothing. A clamp is off by sqrt(EPSILON) at most, which matters to second order at a stationary point, and it
leaves [0, 1] by EPSILON / 4 at most; a stationary point is pulled towards zero where A or f_det is of the order of
sqrt(EPSILON) or less, where f is flat. Together `_stray`.
"""

import math

import casadi as ca
import numpy as np
import pytest
from verify_cases import FAMILIES, at_clearance, random_pair

from nlp.ipopt import BETA
from nlp.numbers.geometry import Ball, Swept
from nlp.numbers.geometry import clearance as solvers_clearance
from nlp.symbols.clearance import EPSILON, clearance
from topo_search.model import Module
from verify import bodies
from verify.bodies import clearances

COUNT = 60


def _symbols():
    return ca.SX.sym("o", 3), ca.SX.sym("d", 3), ca.SX.sym("r"), ca.SX.sym("dr")


def _smooth(kind):
    one, other = _symbols(), _symbols()
    second = Ball(other[0], other[2]) if kind == "ball" else Swept(*other)
    return ca.Function("g", [ca.vertcat(*one, *other)], [clearance(Swept(*one), second, ca.SX(BETA))])


SMOOTH = {kind: _smooth(kind) for kind in ("cone-sphere", "ball")}


def columns(pairs):
    return np.array([[*A.o, *A.d, A.r, A.dr, *B.o, *B.d, B.r, B.dr] for A, B in pairs]).T


def smooth(pairs, kind="cone-sphere"):
    return np.array(SMOOTH[kind].map(len(pairs))(columns(pairs))).ravel()


def exact_by_solver(pairs):
    return np.array([float(solvers_clearance(*(Swept(x.o, x.d, x.r, x.dr) for x in pair))) for pair in pairs])


def _stray(A, B):
    """How far clamps and regularisation may move f, over 2 s."""
    w, r = A.o - B.o, A.r + B.r
    quadratic = abs(A.d @ A.d - A.dr**2) + abs(B.d @ B.d - B.dr**2) + 2 * abs(A.d @ B.d + A.dr * B.dr)
    linear = 2 * abs(A.d @ w - r * A.dr) + 2 * abs(B.d @ w + r * B.dr)
    return (2 * EPSILON * (quadratic + linear) + math.sqrt(EPSILON)) / (2 * (r + A.dr + B.dr))


def near_contact(family, seed):
    """Pairs of a family moved to clearances of all sizes and both signs."""
    rng = np.random.default_rng(seed)
    wanted = rng.choice([-1, 1], COUNT) * 10 ** rng.uniform(-6, 0, COUNT)
    pairs = [at_clearance(*random_pair(family, rng), c) for c in wanted]
    return pairs, clearances(pairs).d


TOUCHING = [family for family in FAMILIES if family not in ("nested", "identical", "collinear")]


@pytest.mark.parametrize("family", FAMILIES)
def test_smooth_clearance_is_within_its_bounds(family):
    rng = np.random.default_rng(7)
    far = [random_pair(family, rng) for _ in range(COUNT)]
    near, _ = near_contact(family, seed=8) if family in TOUCHING else ([], None)
    pairs = far + near
    c, g = clearances(pairs).d, smooth(pairs)
    r = np.array([A.r + B.r for A, B in pairs])
    s = r + np.array([A.dr + B.dr for A, B in pairs])
    stray = np.array([_stray(A, B) for A, B in pairs])
    upper = np.where(c > 0, c + c**2 / (2 * s), c * r / (2 * s))
    lower = np.where(c > 0, c * r / s, c) - math.log(9) / (2 * s * BETA)
    assert np.all(g <= upper + stray)
    assert np.all(g >= lower - stray)


def envelopes(rng):
    """Two airflow envelopes of the default module in arm lengths, any way round."""
    module = Module()
    air, l_arm = module.envelope, module.arm_length
    z = rng.normal(size=(2, 3))
    z /= np.linalg.norm(z, axis=1)[:, None]
    if rng.random() < 0.5:  # as neighbours are: nearly parallel, where f is indefinite
        z[1] = z[0] + rng.normal(size=3) * 10 ** rng.uniform(-4, -0.5)
        z[1] /= np.linalg.norm(z[1])
    o = np.zeros(3), rng.normal(size=3) * 3
    size = air.start_radius / l_arm, air.growth / l_arm
    return tuple(bodies.ConeSphere(o[i], -air.length / l_arm * z[i], *size) for i in range(2))


def test_envelopes_that_keep_the_default_margin_are_clear():
    """The margin of 1e-4 m, 1e-3 arm lengths, is more than smoothing can hide; what it costs is under 0.01 arms."""
    rng = np.random.default_rng(3)
    pairs = [at_clearance(*envelopes(rng), c) for c in rng.uniform(-2e-3, 3e-3, 1500)]
    c, g = clearances(pairs).d, smooth(pairs)
    assert np.count_nonzero(g >= 1e-3) > 100
    assert np.count_nonzero(c < 0) > 400
    assert np.all(c[g >= 1e-3] > 5e-4)
    assert np.all(g > c - 0.01)


@pytest.mark.parametrize("family", ["ball", "near ball"])
def test_the_ball_is_a_capsule_without_length(family):
    rng = np.random.default_rng(5)
    pairs = [random_pair("ball", rng) for _ in range(COUNT)]
    if family == "near ball":
        pairs = [at_clearance(A, B, c) for (A, B), c in zip(pairs, rng.uniform(-0.1, 0.1, COUNT), strict=True)]
    c, g = clearances(pairs).d, smooth(pairs, "ball")
    s = np.array([A.r + A.dr + B.r for A, B in pairs])
    r = np.array([A.r + B.r for A, B in pairs])
    stray = np.array([_stray(A, B) for A, B in pairs])
    assert np.all(g <= np.where(c > 0, c + c**2 / (2 * s), c * r / (2 * s)) + stray)
    assert np.all(g >= np.where(c > 0, c * r / s, c) - math.log(3) / (2 * s * BETA) - stray)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_solvers_exact_clearance_has_the_audits_sign(family):
    rng = np.random.default_rng(11)
    pairs = [random_pair(family, rng) for _ in range(COUNT)]
    if family in TOUCHING:
        pairs += near_contact(family, seed=12)[0]
    c, found = clearances(pairs).d, exact_by_solver(pairs)
    s = np.array([A.r + A.dr + B.r + B.dr for A, B in pairs])
    r = np.array([A.r + B.r for A, B in pairs])
    decided = np.abs(c) > 1e-10
    assert np.all(np.sign(found[decided]) == np.sign(c[decided]))
    assert np.all(found >= c - 1e-10)
    assert np.all(found[c > 0] <= (c * (c + 2 * s) / (2 * r))[c > 0] + 1e-10)
