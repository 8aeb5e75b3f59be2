"""Linear programs of the audit: against HiGHS and brute force, and what is left when the points prove nothing."""

from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import verify.flight.programs
from topo_search.model import Indices
from verify.flight.balls import Polytopes, largest_balls
from verify.flight.programs import GAP, Bounds, SimplexResult, find_solutions, greatest, least_inputs, solve

Array = NDArray[np.float64]


def drawn(rng: np.random.Generator, k: int, N: int) -> tuple[Array, Bounds]:
    """Equations with columns as rotors have them: four at a time are alike, and some bounds fixed."""
    M = np.repeat(rng.normal(size=(k, (N + 3) // 4)), 4, axis=1)[:, :N]
    M[k // 2 :] += rng.normal(size=(k - k // 2, N))
    low = np.where(rng.random(N) < 0.2, 0.1, 0.0)
    return M, Bounds(low, np.where(rng.random(N) < 0.1, low, 1.0))


def by_highs(c: Array, M: Array, m: Array, box: Bounds) -> Any:
    return linprog(-c, A_eq=M, b_eq=m, bounds=np.stack([box.low, box.high], axis=1))


@pytest.mark.parametrize("seed", range(30))
def test_greatest_values_are_those_of_highs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k, N = int(rng.integers(1, 7)), int(rng.integers(8, 60))
    M, box = drawn(rng, k, N)
    c = rng.normal(size=(12, N))
    m = rng.uniform(box.low, box.high, size=(12, N)) @ M.T
    found = greatest(c, M, m, box)
    assert np.all((found.v >= box.low) & (found.v <= box.high))
    assert np.abs(found.v @ M.T - m).max() < 1e-9
    assert np.all(found.upper - found.attained <= GAP)
    expected = [-by_highs(*row, box).fun for row in zip(c, [M] * 12, m, strict=True)]
    assert np.abs(found.attained - expected).max() < 1e-7


@pytest.mark.parametrize("seed", range(30))
def test_equations_have_a_solution_where_highs_has_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    N = int(rng.integers(8, 40))
    M, box = drawn(rng, 6, N)
    m = rng.uniform(box.low - 0.4, box.high + 0.4, size=(20, N)) @ M.T
    found = find_solutions(M, m, box)
    assert np.all(found.yes ^ found.no)
    expected = [by_highs(np.zeros(N), M, row, box).status == 0 for row in m]
    assert found.yes.tolist() == expected
    assert np.abs(found.v[found.yes] @ M.T - m[found.yes]).max(initial=0.0) <= 1e-6


def test_the_audits_tolerance_decides_what_is_next_to_impossible() -> None:
    M, box = np.eye(2), Bounds(np.zeros(2), np.ones(2))
    found = find_solutions(
        M, np.array([[1.0, 0.5], [1 + 5e-7, 0.5], [1 + 2e-6, 0.5], [-5e-7, 1.0], [-2e-6, 1.0]]), box
    )
    assert found.yes.tolist() == [True, True, False, True, False]
    assert found.no.tolist() == [False, False, True, False, True]


def test_wrong_points_prove_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    M, box = drawn(rng, 3, 12)
    c, m = rng.normal(size=(5, 12)), rng.uniform(box.low, box.high, size=(5, 12)) @ M.T
    right = greatest(c, M, m, box)

    def wrong(c: Array, M: Any, m: Array, low: Array, high: Array, bases: Indices | None, _: Any) -> SimplexResult:
        drawn = rng.integers(0, c.shape[1], m.shape)
        return (rng.uniform(low, high), rng.normal(size=m.shape), rng.normal(size=m.shape), drawn)

    monkeypatch.setattr(verify.flight.programs, "solve", wrong)
    by_highs_alone = greatest(c, M, m, box)
    assert np.allclose(by_highs_alone.attained, right.attained, atol=1e-7)
    assert np.all(by_highs_alone.upper >= right.attained - 1e-9)
    assert np.all(find_solutions(M, m, box).yes)
    assert np.all(find_solutions(M, m + 100, box).no)

    class Nothing:
        status = 4

    monkeypatch.setattr("scipy.optimize.linprog", lambda *_, **__: Nothing())
    unproven = greatest(c, M, m, box)
    assert np.all(unproven.attained == -np.inf)
    assert np.all(unproven.upper >= right.attained - 1e-9)
    undecided = find_solutions(M, m, box)
    assert not undecided.yes.any()
    assert not undecided.no.any()


@pytest.mark.parametrize("seed", range(10))
def test_any_basis_is_one_to_start_from(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M, box = drawn(rng, 4, 30)
    c, m = rng.normal(size=(8, 30)), rng.uniform(box.low, box.high, size=(8, 30)) @ M.T
    cold = greatest(c, M, m, box)
    other = greatest(c + 0.1 * rng.normal(size=c.shape), M, m, box)
    bases = np.array([rng.permutation(34)[:4] for _ in c])
    for start in (cold.bases, other.bases, bases):
        assert np.allclose(greatest(c, M, m, box, start).attained, cold.attained, atol=1e-9)
    limits = (np.broadcast_to(x, c.shape) for x in (box.low, box.high))
    *_, again = solve(c, [M], m, *limits, cold.bases, [0, len(c)])
    assert np.array_equal(again, cold.bases)


def test_a_wrench_at_the_very_edge_is_reached_without_highs(monkeypatch: pytest.MonkeyPatch) -> None:
    """All inputs at a limit: what the others make up for is exactly what is missing, but for rounding."""
    monkeypatch.setattr("scipy.optimize.linprog", None)
    rng = np.random.default_rng(3)
    A, box = rng.normal(size=(6, 20)), Bounds(np.zeros(20), np.ones(20))
    d = rng.normal(size=(50, 6))
    edge = (d @ A > 0).astype(float)
    assert np.all(find_solutions(A, edge @ A.T, box).yes)
    assert np.all(find_solutions(A, 1.001 * edge @ A.T - 0.001 * A.sum(axis=1) / 2, box).no)


def polytope(C: Array, M: Array, g: Array, m: Array, box: Bounds) -> Array:
    """All vertices of {C v - g : M v = m} by brute force: every choice of basic variables and bounds."""
    k, N = M.shape
    found = []
    for basic in combinations(range(N), k):
        others = [j for j in range(N) if j not in basic]
        if abs(np.linalg.det(M[:, basic])) < 1e-12:
            continue
        v = np.empty((2 ** len(others), N))
        v[:, others] = list(product(*((box.low[j], box.high[j]) for j in others)))
        v[:, basic] = np.linalg.solve(M[:, basic], (m - v[:, others] @ M[:, others].T).T).T
        found.append(v[np.all((v >= box.low - 1e-12) & (v <= box.high + 1e-12), axis=1)])
    return np.asarray(np.concatenate(found) @ C.T - g)


@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_the_largest_ball_is_that_of_all_vertices(D: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    N, k = 9, 6 - D
    A = rng.normal(size=(6, N))
    C, M, box = A[:D], A[D:], Bounds(np.zeros(N), np.ones(N))
    v = rng.uniform(0.2, 0.8, N)
    g, m = C @ v, M @ v
    ((ball,),) = largest_balls([Polytopes(C, M, g[None], m[None])], box)
    hull = ConvexHull(polytope(C, M, g, m, box))
    assert -hull.equations[:, D].max() == pytest.approx(ball.lower, abs=1e-7)
    assert ball.lower <= ball.upper <= ball.lower + 1e-7
    assert np.linalg.norm(ball.weakest) == pytest.approx(1)
    assert k == len(M)


def test_a_flat_polytope_has_no_ball() -> None:
    rng = np.random.default_rng(1)
    C = np.outer([1.0, 2.0, 2.0], rng.uniform(size=8)) / 3  # all along one line
    M, v = rng.normal(size=(3, 8)), np.full(8, 0.5)
    ((ball,),) = largest_balls([Polytopes(C, M, (C @ v)[None], (M @ v)[None])], Bounds(np.zeros(8), np.ones(8)))
    assert ball.lower == 0
    assert ball.upper < 1e-7
    assert abs(ball.weakest @ [1.0, 2.0, 2.0]) < 1e-6


def test_a_centre_on_the_edge_has_no_ball() -> None:
    C, M = np.eye(3), np.zeros((1, 3))
    polytope = Polytopes(C, M, np.array([[0.5, 1.0, 0.5]]), np.zeros((1, 1)))
    ((ball,),) = largest_balls([polytope], Bounds(np.zeros(3), np.ones(3)))
    assert (ball.lower, ball.weakest.tolist()) == (0.0, [0.0, 1.0, 0.0])
    assert ball.upper < 1e-7


@pytest.mark.parametrize("seed", range(20))
def test_least_inputs_are_the_nearest_to_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, box = drawn(rng, 6, 24)
    u = rng.uniform(box.low, box.high)
    for p in (2.0, 1.5):
        v, at_least = least_inputs(A, A @ u, box, p)
        assert np.abs(A @ (v - u)).max() <= 1e-9
        assert np.all((v >= box.low) & (v <= box.high))
        # optimal: no feasible direction descends; the best one is a linear program
        slopes = np.sign(v) * np.abs(v) ** (p - 1)
        best = linprog(slopes, A_eq=A, b_eq=A @ v, bounds=np.stack([box.low, box.high], axis=1))
        assert best.fun == pytest.approx(slopes @ v, abs=1e-7)
        assert np.sum(np.abs(v) ** p) == pytest.approx(at_least, abs=1e-7)
        assert at_least <= np.sum(np.abs(u) ** p)


def test_there_are_no_least_inputs_of_what_is_impossible() -> None:
    A = np.random.default_rng(2).normal(size=(6, 12))
    assert least_inputs(A, np.full(6, 100.0), Bounds(np.zeros(12), np.ones(12)))[0] is None
