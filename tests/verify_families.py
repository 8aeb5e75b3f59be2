"""Families of nasty pairs for the tests and benchmarks of the audit, each with a value from elsewhere.

| family | pair | value |
|---|---|---|
| any hulls | an envelope or a ball, and a box or the hull of random points | golden section, least squares |
| thin hulls | an envelope and a squashed hull, down to a millionth of its size | the same |
| walls along an axis | an envelope and a wall at a few degrees to its axis | the same |
| coplanar discs | two rotor discs side by side, or one above the edge of the other | by hand |

Lengths are in arms. Every pair comes as drawn and moved to nearly touch or just overlap, by `GAPS`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from verify_cases import GAPS, unit

from verify.bodies import ConeSphere
from verify.certificate import Certificate, RoundBody, certify_pairs
from verify.compounds import Compound, certify_compounds
from verify.convex import cylinder
from verify.hulls import HullBody, approach, hull

Array = NDArray[np.float64]

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True)
class Judged:
    """A certificate and what is true."""

    certificate: Certificate
    d: float
    """Clearance from elsewhere, its sign alone where `exact` is false."""
    exact: bool = True


def distance(x: Array, corners: Array) -> float:
    """The distance of a point from the hull of corners (Lawson and Hanson's least distance programming)."""
    Y = corners - x
    size = np.abs(Y).max()
    A = np.concatenate([Y.T / size, np.ones((1, len(Y)))])
    weights, _ = nnls(A, np.array([0.0, 0.0, 0.0, 1.0]))
    return float(np.linalg.norm(Y.T @ (weights / weights.sum())))


def golden(f: Callable[[float], float]) -> float:
    """Where a convex function of [0, 1] is least, by golden section."""
    shrink = (np.sqrt(5) - 1) / 2
    lo, hi = 0.0, 1.0
    left, right = hi - shrink * (hi - lo), lo + shrink * (hi - lo)
    f_left, f_right = f(left), f(right)
    for _ in range(60):
        if f_left < f_right:
            hi, right, f_right = right, left, f_left
            left = hi - shrink * (hi - lo)
            f_left = f(left)
        else:
            lo, left, f_left = left, right, f_right
            right = lo + shrink * (hi - lo)
            f_right = f(right)
    return min((0.0, 1.0, (lo + hi) / 2), key=f)


def brute_approach(body: ConeSphere, corners: Array) -> float:
    """The least distance of a ball's surface from the hull of corners, by golden section: it is convex."""

    def f(eta: float) -> float:
        return distance(body.centre(eta), corners) - body.radius(eta)

    return f(golden(f))


def rotation(rng: np.random.Generator) -> Array:
    """Return any rotation."""
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(Q * np.sign(np.linalg.det(Q)))


def thin_hull(scale: float, rng: np.random.Generator) -> tuple[ConeSphere, HullBody]:
    """An envelope and a hull of random points, squashed along one direction."""
    R, thin = rotation(rng), 10 ** rng.uniform(-5.5, -1)
    corners = rng.normal(size=(rng.integers(5, 20), 3)) * rng.uniform(0.3, 10) * [1.0, 1.0, thin] @ R.T
    L = rng.uniform(0.5, 14)
    o = rng.normal(size=3) * rng.uniform(0, 10)
    body = ConeSphere(o, L * unit(rng), rng.uniform(0.1, 2), L * np.tan(np.radians(rng.uniform(0, 30))))
    return _scaled(body, scale), hull(scale * corners)


def any_hull(scale: float, rng: np.random.Generator) -> tuple[ConeSphere, HullBody]:
    """An envelope or a ball and a box or a hull of random points, from nested to far apart."""
    if rng.random() < 0.5:
        corners = CUBE * rng.uniform(0.1, 3, 3) + rng.normal(size=3)
    else:
        corners = rng.normal(size=(rng.integers(4, 25), 3)) * rng.uniform(0.3, 2, 3)
    L = rng.choice([0.0, rng.uniform(0.5, 14)])
    o = rng.normal(size=3) * rng.uniform(0, 5)
    body = ConeSphere(o, L * unit(rng), rng.uniform(0.1, 2), L * rng.uniform(0, 0.6))
    return _scaled(body, scale), hull(scale * corners)


def wall_along_an_axis(scale: float, rng: np.random.Generator) -> tuple[ConeSphere, HullBody]:
    """An envelope and a wall at up to six degrees to its axis: it may leave the wall and grow deeper into it."""
    R, edge = rotation(rng), rng.uniform(2, 20)
    half = np.array([edge, edge * rng.uniform(0.3, 1), 10 ** rng.uniform(-3, -0.5)]) / 2
    L, angle = rng.uniform(0.5, 14), np.radians(rng.uniform(-6, 6))
    u = R @ [np.cos(angle), 0.0, np.sin(angle)]
    o = R @ (half * rng.uniform(-1.3, 1.3, 3)) - rng.uniform(0, L) * u
    body = ConeSphere(o, L * u, rng.uniform(0.1, 2), L * np.tan(np.radians(rng.uniform(2, 30))))
    return _scaled(body, scale), hull(scale * CUBE * half @ R.T)


def _scaled(body: ConeSphere, scale: float) -> ConeSphere:
    return ConeSphere(scale * body.o, scale * body.d, scale * body.r, scale * body.dr)


def moved_to(body: ConeSphere, region: HullBody, d: float) -> ConeSphere | None:
    """The body moved along the witness until the clearance is d."""
    for _ in range(60):
        found = approach(body, region)
        w = body.centre(found.eta) - found.x
        if not w.any():
            return None
        if abs(found.d - d) < 1e-14:
            break
        body = body.move((d - found.d) * w / np.linalg.norm(w))
    return body


def _judged_hulls(
    draw: Callable[[float, np.random.Generator], tuple[ConeSphere, HullBody]],
) -> Callable[[float, np.random.Generator], Iterator[Judged]]:
    def judge(scale: float, rng: np.random.Generator) -> Iterator[Judged]:
        body, region = draw(scale, rng)
        near = [moved_to(body, region, sign * gap) for gap in GAPS for sign in (1, -1)]
        for each in [body, *near]:
            if each is not None:
                yield Judged(
                    certify_pairs([(RoundBody(each), region)])[0], brute_approach(each, region.mesh.vertices)
                )

    return judge


def coplanar_discs(scale: float, rng: np.random.Generator) -> Iterator[Judged]:
    """Two equal discs whose axes are parallel, at one height or not, rim to rim."""
    R = rotation(rng)
    radius = scale * rng.uniform(0.2, 2)
    height = radius * 10 ** rng.uniform(-2, 0)
    lift = rng.choice([0.0, rng.uniform(-0.9, 0.9) * height])
    middle = rng.normal(size=3) * 10 ** rng.uniform(-1, 1.5)
    for gap in GAPS:
        for sign in (1, -1):
            apart = R @ [2 * radius + sign * gap, 0.0, lift]
            if 2 * radius + sign * gap <= 0:
                continue
            one = cylinder("one", middle, R[:, 2], radius, height)
            other = cylinder("other", middle + apart, R[:, 2], radius, height)
            pair = Compound((one,), one), Compound((other,), other)
            yield Judged(certify_compounds([pair], [False])[0], sign * gap, exact=sign > 0)


JUDGED: dict[str, Callable[[float, np.random.Generator], Iterator[Judged]]] = {
    "any hulls": _judged_hulls(any_hull),
    "thin hulls": _judged_hulls(thin_hull),
    "walls along an axis": _judged_hulls(wall_along_an_axis),
    "coplanar discs": coplanar_discs,
}

SCALES_OF = {
    "any hulls": (1.0,),
    "thin hulls": (1e-3, 1.0, 1e3),
    "walls along an axis": (1e-3, 1.0, 1e3),
    "coplanar discs": (1e-3, 1.0, 1e2),
}
"""Sizes of the bodies; rigid parts of more than a hundred arms are bad input."""
