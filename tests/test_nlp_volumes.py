"""Convex target regions in the solver: the clearance that judges designs has the sign of the audit's."""

import numpy as np
import pytest

from nlp.numbers.geometry import Swept, hull_clearance
from topo_search.model.exposure import Local
from topo_search.model.shape import Hull, convex_hull
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
