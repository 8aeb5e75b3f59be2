"""Convex target regions in the solver: the smooth form against the exact one, and designs that keep out."""

import casadi as ca
import numpy as np
import pytest
from nlp_cases import BOX, WEDGE, best_design, push

from nlp.ipopt import BETA
from nlp.numbers.geometry import Swept, hull_clearance
from nlp.symbols.clearance import ConeSphere, hull_clearances
from topo_search.model import Local, Status, Topology
from topo_search.model.shape import Hull, convex_hull
from verify import audit
from verify.bodies import ConeSphere as Body
from verify.hulls import approach, hull

LENGTH, R_0, DR = 11.7, 1.0, 1.02


def regions() -> list[Hull]:
    rng = np.random.default_rng(3)
    shapes = [Local(box=(4.0, 4.0, 2.0)).corners, rng.normal(size=(8, 3)) * 2, rng.normal(size=(20, 3)) + 1.0]
    return [convex_hull(shape) for shape in shapes]


def placed(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    o, z = rng.normal(size=(count, 3)) * 4, rng.normal(size=(count, 3))
    return o, -LENGTH * z / np.linalg.norm(z, axis=1, keepdims=True)


@pytest.mark.parametrize("number", range(3))
def test_the_solvers_numbers_have_the_sign_of_the_audits(number: int) -> None:
    region, rng = regions()[number], np.random.default_rng(number)
    o, d = placed(rng, 200)
    at = rng.normal(size=3)
    gaps = hull_clearance(Swept(o + at, d, R_0, DR), at, region)
    exact = np.array([approach(Body(a, b, R_0, DR), hull(region.corners)).d for a, b in zip(o, d, strict=True)])
    assert np.array_equal(gaps > 0, exact > 0)
    assert np.all(gaps >= exact - 1e-12)
    assert 20 < np.sum(exact > 0) < 180


@pytest.mark.parametrize("number", range(3))
def test_the_smooth_form_tells_clear_from_not(number: int) -> None:
    region, rng = regions()[number], np.random.default_rng(10 + number)
    o, d, origin = (ca.SX.sym(name, 3) for name in ("o", "d", "origin"))
    rows = hull_clearances(ConeSphere(o, d, R_0, DR), origin, region, ca.SX(BETA))
    smooth = ca.Function("smooth", [o, d, origin], [rows])
    clear = 0
    for a, b in zip(*placed(rng, 200), strict=True):
        at = rng.normal(size=3)
        value, outside = (float(row) for row in ca.vertsplit(smooth(a + at, b, at)))
        exact = approach(Body(a, b, R_0, DR), hull(region.corners)).d
        # f is (distance + radius) times the gap, over twice the largest radius; the log-sum-exp and the clamps
        # take a little more.
        if exact > 0.02:
            clear += 1
            assert value > 0
            assert outside > 0
            assert value <= exact * (1 + exact) + 1e-6
        elif exact < -0.02:
            assert min(value, outside) < 0
    assert clear > 20


@pytest.mark.parametrize("name", ["box", "wedge"])
def test_designs_keep_out_and_touch(name: str) -> None:
    """A region that the best design without it would blow into: the airflow ends up on its surface."""
    task = push(5, exposure=[BOX if name == "box" else WEDGE], search={"body_clearance": False})
    design = best_design(task, Topology.from_key("a11210"), 4)
    result = audit(design)
    assert result.verdict is Status.CLEAR
    regions_cleared = [pair for pair in result.pairs if pair.kind == "local"]
    assert len(regions_cleared) == 5
    assert all(pair.status is Status.CLEAR for pair in regions_cleared)
