"""Families of rotors, frames and rods beside airflow for the tests and benchmarks of the audit.

| family | pair | value |
|---|---|---|
| rotor against airflow | the rotors, then hub and arms, of a module anywhere, and an envelope | golden section |
| rod against airflow | a rod, thin or shorter than thick, and an envelope | one inside another |

The distance of a point from a disc or box is a closed form. Every pair comes as drawn and moved to nearly touch or
just overlap, by `GAPS`; of a module it is one of its rotors, or hub and arms, that does.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from verify_cases import GAPS, at_clearance, brute_clearance, unit
from verify_families import Judged, golden, rotation

from verify.beside_airflow import BesideAirflow, certify_beside
from verify.bodies import ConeSphere
from verify.certificate import RoundBody, certify_pairs
from verify.compounds import Compound
from verify.convex import Convex, box, cylinder
from verify.parts import bounding_box

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
ARMS = np.array([[1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]) / np.sqrt(2)
FRAME = 5
"""Hub and arms."""


def module(scale: float, rng: np.random.Generator) -> tuple[Convex, ...]:
    """Return hub, arms and rotors of a module as large as `scale`, from thin discs to towers."""
    width, radius = scale * 10 ** rng.uniform(-2, -0.3), scale * 10 ** rng.uniform(-1.3, 0)
    height = scale * 10 ** rng.uniform(-3, 0)
    hub = box("hub", np.zeros(3), np.diag(scale * 10 ** rng.uniform(-2, 0, 3)))
    arms = [
        box(f"arm {k}", scale * e / 2, np.stack([scale * e, width * np.cross(UP, e), width * UP]) / 2)
        for k, e in enumerate(ARMS)
    ]
    return (hub, *arms, *(cylinder(f"rotor {k}", scale * e, UP, radius, height) for k, e in enumerate(ARMS)))


def envelope(scale: float, rng: np.random.Generator) -> ConeSphere:
    """Return an envelope near the origin, with any spread."""
    L = scale * 10 ** rng.uniform(-1, 1.2)
    growth = L * np.tan(np.radians(rng.choice([0.0, rng.uniform(0, 45)])))
    o = scale * rng.normal(size=3) * rng.uniform(0, 4)
    return ConeSphere(o, L * unit(rng), scale * 10 ** rng.uniform(-1, 0.5), growth)


def nearest_point(part: Convex, p: Array) -> Array:
    """Return the point of an upright disc or of a box nearest to p."""
    q = p - part.centre
    if part.disc > 0:
        half = np.ptp(part.vertices[:, 2]) / 2
        rho = np.hypot(q[0], q[1])
        across = q[:2] * min(1.0, part.disc / rho) if rho > 0 else q[:2]
        return np.asarray(part.centre + np.array([*across, np.clip(q[2], -half, half)]))
    size = np.linalg.norm(part.half, axis=1)
    axes = part.half / size[:, None]
    return np.asarray(part.centre + np.clip(axes @ q, -size, size) @ axes)


def approach(part: Convex, body: ConeSphere) -> tuple[float, Array]:
    """Return the clearance and the way from the part to the axis, by golden section: it is convex."""

    def f(eta: float) -> float:
        P = body.centre(eta)
        return float(np.linalg.norm(P - nearest_point(part, P)) - body.radius(eta))

    eta = golden(f)
    P = body.centre(eta)
    return f(eta), P - nearest_point(part, P)


def moved_to(part: Convex, body: ConeSphere, d: float) -> ConeSphere | None:
    """Return the envelope moved along the way from the part until the clearance is d; None if it has no way."""
    for _ in range(30):
        found, way = approach(part, body)
        length = np.linalg.norm(way)
        if not length:
            return None
        if abs(found - d) < 1e-14:
            break
        body = body.move((d - found) * way / length)
    return body


def rotor_against_airflow(scale: float, rng: np.random.Generator) -> Iterator[Judged]:
    """Judge rotors, and hub and arms, of one module against an envelope at many places."""
    own, drawn = module(scale, rng), envelope(scale, rng)
    part = own[rng.integers(len(own))]
    near = [moved_to(part, drawn, sign * gap) for gap in GAPS for sign in (1, -1)]
    bodies = [drawn, *(body for body in near if body is not None)]
    R, centre = rotation(rng), scale * rng.normal(size=3) * 10 ** rng.uniform(-1, 1)
    placed = Compound(own, bounding_box(own), FRAME).place(R, centre)
    asked = [
        BesideAirflow("rotor-airflow", 0, 1, placed, against, segment)
        for against in (RoundBody(body).place(R, centre) for body in bodies)
        for segment in (*range(placed.rotors), None)
    ]
    certificates = iter(certify_beside(asked))
    for body in bodies:
        for group in (*([rotor] for rotor in own[FRAME:]), own[:FRAME]):
            yield Judged(next(certificates), min(approach(each, body)[0] for each in group))


def rod_against_airflow(scale: float, rng: np.random.Generator) -> Iterator[Judged]:
    """Judge a rod against an envelope at many places."""
    airflow = envelope(scale, rng)
    length, radius = scale * 10 ** rng.uniform(-2, 1.5), scale * 10 ** rng.uniform(-3, -0.5)
    start = airflow.centre(rng.uniform()) + scale * rng.normal(size=3) * rng.uniform(0, 4)
    rod = ConeSphere(start, length * unit(rng), radius, 0.0)
    pairs = [(rod, airflow), *(at_clearance(rod, airflow, sign * gap) for gap in GAPS for sign in (1, -1))]
    certificates = certify_pairs([(RoundBody(one), RoundBody(other)) for one, other in pairs])
    values: Sequence[float] = brute_clearance(pairs).tolist()
    for certificate, d in zip(certificates, values, strict=True):
        yield Judged(certificate, d)


BESIDE: dict[str, Callable[[float, np.random.Generator], Iterator[Judged]]] = {
    "rotor against airflow": rotor_against_airflow,
    "rod against airflow": rod_against_airflow,
}

SCALES_BESIDE = {"rotor against airflow": (1e-3, 1.0, 1e2), "rod against airflow": (1e-3, 1.0, 1e2)}
"""Sizes of the modules."""
