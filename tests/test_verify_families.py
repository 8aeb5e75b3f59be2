"""Thin regions, walls along an axis, coplanar discs, rotors and rods in airflow: no wrong verdict, none missing."""

import numpy as np
import pytest
from suites import few
from verify_airflow_families import BESIDE, SCALES_BESIDE
from verify_families import JUDGED, SCALES_OF, brute_approach

from nlp.numbers.geometry import Swept, hull_clearance
from topo_search.model import Status
from topo_search.model.shape import convex_hull
from verify.bodies import ConeSphere
from verify.certificate import FLOOR, RoundBody, certify_pairs
from verify.hulls import approach, hull

WALL = np.array([(x, y, z) for x in (-5.0, 5.0) for y in (-5.0, 5.0) for z in (-0.05, 0.05)])
"""1 m by 1 m by 10 mm, in arms of 0.1 m."""


FAMILIES = {**JUDGED, **BESIDE}
SIZES = {**SCALES_OF, **SCALES_BESIDE}


@pytest.mark.parametrize("draws", few([2, 4], 1))
@pytest.mark.parametrize(("family", "scale"), [(name, scale) for name in FAMILIES for scale in SIZES[name]])
def test_no_verdict_is_wrong_or_missing(family: str, scale: float, draws: int) -> None:
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(draws):
        for judged in FAMILIES[family](scale, rng):
            status, d = judged.certificate.status, judged.d
            right = Status.CLEAR if d > 0 else Status.VIOLATED
            assert status in ((right, Status.UNDECIDED) if abs(d) <= FLOOR else (right,))
            if judged.exact:
                assert judged.certificate.analytic == pytest.approx(d, abs=1e-11 * (100 + scale))
            lower, upper = judged.certificate.lower, judged.certificate.upper
            assert status != Status.CLEAR or 0 < lower <= d + 1e-9 * scale <= upper + 2e-9 * scale
            assert status != Status.VIOLATED or (lower is None and d - 1e-9 * scale <= upper < 0)
            seen.add(status)
    assert {Status.CLEAR, Status.VIOLATED} <= seen


@pytest.mark.parametrize("degrees", [1.0, 2.0, 4.0])
def test_a_ball_that_has_left_a_wall_may_be_deeper_in_it(degrees: float) -> None:
    """The default envelope along a wall: where its axis leaves the wall its balls are smaller than later on."""
    angle = np.radians(degrees)
    u = np.array([np.cos(angle), 0.0, np.sin(angle)])
    body = ConeSphere(-4.0 * u, 12.0 * u, 1.0, 12.0 * np.tan(np.radians(5.0)))
    d = brute_approach(body, WALL)
    (found,) = certify_pairs([(RoundBody(body), hull(WALL))])
    assert found.status == Status.VIOLATED
    assert found.analytic == pytest.approx(d, abs=1e-9)
    assert approach(body, hull(WALL)).eta > 4.0 / 12.0 + 0.05 / (12.0 * np.sin(angle))
    swept = Swept(body.o[None], body.d[None], body.r, body.dr)
    gap = hull_clearance(swept, np.zeros(3), convex_hull(WALL)).item()
    assert d - 1e-12 <= gap < -(1.0 + np.tan(np.radians(5.0)) * (4.0 + 0.05 / np.sin(angle)))
