"""Bodies and designs for the tests and benchmarks of the audit, and what fails in one."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from older import older_task

from topo_search.model import Audit, Design, Status, Topology
from verify.bodies import ConeSphere, clearances
from verify.kinematics import objective, platform, required_wrench, wrench_map

Array = NDArray[np.float64]

FAMILIES = (
    *("generic", "parallel", "antiparallel", "nearly parallel", "thin", "fat", "growth as large as length"),
    *("collinear", "crossing", "capsule", "ball", "nested", "identical"),
)


GAPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1.1e-7, 1e-9)
"""Clearances at which pairs nearly touch, in arm lengths: the last is under the floor of what can be decided."""
SCALES = (0.1, 1.0, 10.0)
"""Sizes of the bodies, while the tolerances stay what they are in arm lengths."""


def unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_pair(family: str, rng: np.random.Generator) -> tuple[ConeSphere, ConeSphere]:
    """Two cone-spheres of a family, in arm lengths, anywhere from deep inside each other to far apart."""
    L, r = rng.uniform(1, 14, 2), rng.uniform(0.3, 2, 2)
    dr = L * np.tan(np.radians(rng.uniform(0, 40, 2)))
    u, v = unit(rng), unit(rng)
    o = rng.normal(size=3) * 10 ** rng.uniform(-1, 1.5)
    if family == "parallel":
        v = u
    elif family == "antiparallel":
        v = -u
    elif family == "nearly parallel":
        v = u + 10 ** rng.uniform(-12, -2) * v
        v /= np.linalg.norm(v)
    elif family == "thin":
        r, dr = 1e-3 * r, 1e-3 * dr
    elif family == "fat":
        dr = L * (1 - 10 ** rng.uniform(-12, -1, 2))
    elif family == "growth as large as length":
        dr = L.copy()
    elif family == "collinear":
        v, o = u * rng.choice([-1, 1]), u * rng.uniform(-40, 40)
    elif family == "crossing":
        r, dr = 0.1 * r, 0.1 * dr
        o = rng.random() * L[0] * u - rng.random() * L[1] * v + rng.uniform(0, 3) * np.cross(u, v)
    elif family == "capsule":
        dr[1] = 0.0
    elif family == "ball":
        L[1] = dr[1] = 0.0
    elif family == "nested":
        o, v, L[1] = rng.random() * L[0] * u, unit(rng), 0.1
        r[1], dr[1] = 0.01, 0.005
    elif family == "identical":
        return ConeSphere(o, L[0] * u, r[0], dr[0]), ConeSphere(o, L[0] * u, r[0], dr[0])
    return ConeSphere(np.zeros(3), L[0] * u, r[0], dr[0]), ConeSphere(o, L[1] * v, r[1], dr[1])


def brute_clearance(pairs: list[tuple[ConeSphere, ConeSphere]]) -> Array:
    """The least distance of two balls' surfaces by golden section in golden section: slow, but without cases."""

    def stack(side: int, name: str) -> Array:
        return np.array([getattr(pair[side], name) for pair in pairs])

    o, d_A, d_B = stack(0, "o") - stack(1, "o"), stack(0, "d"), stack(1, "d")
    r, dr_A, dr_B = stack(0, "r") + stack(1, "r"), stack(0, "dr"), stack(1, "dr")

    def f(eta: Array, gamma: Array) -> Array:
        apart = np.linalg.norm(o + eta[:, None] * d_A - gamma[:, None] * d_B, axis=-1)
        return np.asarray(apart - r - eta * dr_A - gamma * dr_B)

    def golden(g: Any) -> Array:
        shrink = (math.sqrt(5) - 1) / 2
        lo, hi = np.zeros(len(pairs)), np.ones(len(pairs))
        for _ in range(60):
            left, right = hi - shrink * (hi - lo), lo + shrink * (hi - lo)
            go_left = g(left) < g(right)
            lo, hi = np.where(go_left, lo, left), np.where(go_left, right, hi)
        return np.minimum.reduce([g((lo + hi) / 2), g(np.zeros(len(pairs))), g(np.ones(len(pairs)))])

    return golden(lambda eta: golden(lambda gamma: f(eta, gamma)))


FAN = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0)))
"""Three modules in a row along x, the root in the middle."""

HOVER = {"com": {"force": [0.0, 0.0, 1.0]}}

FREE_ABOVE = [
    {"kind": "local", "radius": 0.15},
    {"kind": "directional", "radius": 0.1, "segments": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.2]]},
    {"kind": "directional", "radius": 0.1, "along": "end_effector", "length": 2.0},
    {"kind": "exterior", "half_angle_deg": 60.0},
    {"kind": "exterior", "half_angle_deg": 90.0, "axis": [0.0, 0.1, -1.0]},
]
"""Every kind of exposure, which the fan keeps."""


def design(
    topology: Topology,
    task: dict[str, Any],
    *,
    hinges: tuple[float, ...],
    root: tuple[float, float, float] = (0.0, 0.0, 0.0),
    end_effector: tuple[float, float, float] = (0.0, 0.0, 0.6),
) -> Design:
    """A design with the least rotor inputs that produce every load case; nothing else is asked of it."""
    n, point = topology.n, {"rod": "none", "largest_reach": False}
    task = {**task, "end_effector": {**point, **task.get("end_effector", {})}}
    resolved = older_task({"name": "case", "modules": n, "load_cases": [HOVER], **task}).resolve(n)
    draft = Design(
        task=resolved,
        topology=topology,
        root_orientation_rad=root,
        hinge_angles_rad=hinges,
        end_effector_m=end_effector,
        rotor_speeds_squared=tuple((0.0,) * (4 * n) for _ in resolved.load_cases),
        objective=0.0,
    )
    found = platform(draft)
    A = wrench_map(found, resolved.module)
    u = [np.linalg.lstsq(A, required_wrench(case, found.p_e))[0] for case in resolved.load_cases]
    draft = changed(draft, rotor_speeds_squared=[row.tolist() for row in u])
    return changed(draft, objective=objective(draft))


def fan(task: dict[str, Any] | None = None, **given: Any) -> Design:
    """A platform of three modules that lean outwards; clear unless the task asks for what it cannot do."""
    return design(FAN, task or {}, **{"hinges": (-0.6, 0.6), **given})


def changed(given: Design, **fields: Any) -> Design:
    """The design of a file in which some fields were overwritten."""
    return Design.model_validate({**given.model_dump(mode="json"), **fields})


def failing(result: Audit) -> set[str]:
    """The kinds and names of everything that is not clear."""
    kinds = {pair.kind for pair in result.pairs if pair.status != Status.CLEAR}
    return kinds | {row.name for row in result.residuals if row.status != Status.CLEAR}


def at_clearance(A: ConeSphere, B: ConeSphere, d: float) -> tuple[ConeSphere, ConeSphere]:
    """The pair with B moved along the witness until the clearance is d."""
    for _ in range(60):
        found, eta, gamma = (float(column[0]) for column in clearances([(A, B)]))
        w = B.centre(gamma) - A.centre(eta)
        if abs(found - d) < 1e-14 or not w.any():
            break
        B = B.move((d - found) * w / np.linalg.norm(w))
    return A, B


def nearly_touching(family: str, scale: float, rng: np.random.Generator) -> list[tuple[ConeSphere, ConeSphere]]:
    """A pair of a family as drawn, then moved apart and together by every gap."""
    A, B = (
        ConeSphere(scale * body.o, scale * body.d, scale * body.r, scale * body.dr)
        for body in random_pair(family, rng)
    )
    return [(A, B), *(at_clearance(A, B, sign * gap) for gap in GAPS for sign in (1, -1))]
