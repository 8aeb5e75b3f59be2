"""Rigid parts: distances of convex solids, what bolted and other neighbours may do, and proofs that hold."""

import math
from itertools import product

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial import ConvexHull
from verify_cases import changed, design, fan, unit

from topo_search.model import Module, Status, Topology
from verify import audit, kinematics
from verify.compounds import Compound, certify_compounds, proximities
from verify.convex import Cylinder, Polyhedron, SweptBall, box, capsule, cylinder
from verify.gjk import Nearest, cores, nearest
from verify.hulls import hull
from verify.parts import bounding_box, module_parts
from verify.requirements import Scene

UP = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)
STILL = np.eye(3)
CHAIN = Topology(((-1, -1, -1), (0, 0, 2)))


def rotation(rng):
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def one(solid):
    return Compound((solid,), solid)


def certificate(A, B):
    (found,) = certify_compounds([(one(A), one(B))], [False])
    return found


def random_solid(rng):
    size = rng.uniform(0.05, 1.0, 3)
    kind = rng.integers(3)
    if kind == 0:
        return box("box", ORIGIN, np.diag(size))
    if kind == 1:
        return cylinder("cylinder", ORIGIN, UP, size[0], size[1])
    return capsule("capsule", -size[0] * UP, size[0] * UP, 0.3 * size[1])


def projected(solid, x):
    """The point of a solid nearest to x, from the formulas of its kind."""
    if isinstance(solid, SweptBall):
        start, path = solid.vertices[0], solid.vertices[1] - solid.vertices[0]
        foot = start + np.clip((x - start) @ path / (path @ path), 0, 1) * path
        return foot + (x - foot) * min(1.0, solid.ball / max(np.linalg.norm(x - foot), 1e-300))
    c = solid.vertices.mean(axis=0)
    if isinstance(solid, Cylinder):
        along = (x - c) @ solid.axis
        across = x - c - along * solid.axis
        half = np.linalg.norm(solid.vertices[1] - solid.vertices[0]) / 2
        across *= min(1.0, solid.disc / max(np.linalg.norm(across), 1e-300))
        return c + np.clip(along, -half, half) * solid.axis + across
    edges = np.stack([solid.vertices[k] - solid.vertices[0] for k in (4, 2, 1)])
    lengths = np.linalg.norm(edges, axis=1)
    return c + np.clip(edges @ (x - c) / lengths, -lengths / 2, lengths / 2) @ (edges / lengths[:, None])


# ---- distances


def test_distances_are_those_of_alternating_projections():
    """Von Neumann's projections between two convex sets converge to their nearest points, without any support."""
    rng = np.random.default_rng(0)
    for _ in range(15):
        A = random_solid(rng).place(rotation(rng), ORIGIN)
        B = random_solid(rng).place(rotation(rng), rng.uniform(2.0, 4.0) * unit(rng))
        found = certificate(A, B)
        y = B.centre
        for _ in range(300):
            x = projected(A, y)
            y = projected(B, x)
        assert found.status == Status.CLEAR
        assert found.lower - 1e-12 <= found.analytic <= found.upper + 1e-12
        assert np.linalg.norm(x - y) >= found.lower - 1e-12
        assert found.analytic == pytest.approx(np.linalg.norm(x - y), abs=1e-4)


@pytest.mark.parametrize(
    ("A", "B", "d"),
    [
        (cylinder("", ORIGIN, UP, 0.5, 0.2), cylinder("", 0.5 * UP, UP, 0.5, 0.2), 0.3),  # one above the other
        (cylinder("", ORIGIN, UP, 0.5, 0.2), cylinder("", np.array([3.0, 4.0, 0.0]), UP, 0.5, 0.2), 4.0),  # beside
        (
            cylinder("", ORIGIN, UP, 0.5, 0.2),
            cylinder("", np.array([3.0, 4.0, 2.0]), UP, 0.5, 0.2),
            math.hypot(4, 1.8),
        ),
        (
            cylinder("", ORIGIN, UP, 0.5, 2.0),
            cylinder("", np.array([0, 2.0, 0]), np.array([1.0, 0, 0]), 0.5, 2),
            1.0,
        ),
        (box("", ORIGIN, np.eye(3)), box("", np.array([3.0, 4.0, 0.0]), np.eye(3)), math.hypot(1, 2)),
        (box("", ORIGIN, np.eye(3)), box("", np.array([3.0, 4.0, 5.0]), np.eye(3)), math.hypot(1, 2, 3)),
        (box("", ORIGIN, np.eye(3)), capsule("", 3 * UP, 5 * UP, 0.5), 1.5),
        (box("", ORIGIN, np.eye(3)), capsule("", np.array([-9.0, 0, 2]), np.array([9.0, 0, 2]), 0.25), 0.75),
        # overlaps: how far one must move
        (box("", ORIGIN, np.eye(3)), box("", np.array([1.9, 0.0, 0.0]), np.eye(3)), -0.1),
        (box("", ORIGIN, np.eye(3)), capsule("", 1.2 * UP, 5 * UP, 0.5), -0.3),
        (cylinder("", ORIGIN, UP, 0.5, 0.2), cylinder("", 0.15 * UP, UP, 0.5, 0.2), -0.05),
        (cylinder("", ORIGIN, UP, 0.5, 2.0), cylinder("", np.array([0.9, 0.0, 0.0]), UP, 0.5, 2.0), -0.1),
    ],
)
def test_closed_forms(A, B, d):
    for found in (certificate(A, B), certificate(B, A)):
        assert found.analytic == pytest.approx(d, abs=1e-9)
        assert found.status == (Status.CLEAR if d > 0 else Status.VIOLATED)
        assert found.upper >= found.analytic - 1e-12
        assert (found.lower is None) == (d < 0)


@pytest.mark.parametrize("s", [0.0, 1e-3, 0.2])
def test_a_solid_inside_another_is_found(s):
    """Surfaces alone would be apart here."""
    rng = np.random.default_rng(1)
    outer = box("", ORIGIN, np.eye(3))
    for inner in (box("", s * UP, 0.1 * np.eye(3)), cylinder("", s * UP, unit(rng), 0.1, 0.1)):
        for A, B in ((inner, outer), (outer, inner)):
            found = certificate(A, B)
            assert found.status == Status.VIOLATED
            assert found.upper < -0.05


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6, -1e-6, -1e-4, -1e-2])
def test_near_contact_is_decided(gap):
    rng = np.random.default_rng(3)
    for _ in range(12):
        A, B = random_solid(rng).place(rotation(rng), ORIGIN), random_solid(rng).place(rotation(rng), ORIGIN)
        away = 5.0 * unit(rng)
        (found,) = proximities([(one(A), one(B.place(STILL, away)))], [False])
        B = B.place(STILL, away - (found.d - gap) * found.normals[found.a, found.b])
        result = certificate(A, B)
        assert result.status == (Status.CLEAR if gap > 0 else Status.VIOLATED)
        if gap > 0:
            assert result.analytic == pytest.approx(gap, abs=1e-9)
        else:  # another direction may be a shorter way out
            assert gap - 1e-8 <= result.analytic <= result.upper < 0


def test_the_clearance_of_unions_is_the_least_of_their_parts():
    rng = np.random.default_rng(4)
    for _ in range(10):
        sides = []
        for k in range(2):
            parts = tuple(
                random_solid(rng).place(rotation(rng), 6.0 * k * UP + rng.normal(size=3))
                for _ in range(rng.integers(1, 5))
            )
            sides.append(Compound(parts, bounding_box(parts)))
        (whole,) = certify_compounds([tuple(sides)], [False])
        each = [certificate(a, b) for a in sides[0].parts for b in sides[1].parts]
        assert whole.analytic == pytest.approx(min(c.analytic for c in each), abs=1e-8)
        assert whole.lower == pytest.approx(min(c.lower for c in each), abs=1e-8)


def test_a_search_that_ends_early_proves_no_more_than_its_planes(monkeypatch):
    """Points that are not nearest claim too much; the gap between planes across them is true all the same."""

    def ends_early(A, B, towards, enough=np.inf):
        x_A, x_B = A.support(towards), B.support(-towards)
        return Nearest(x_A, x_B, x_A - x_B, np.zeros(len(towards), dtype=bool))

    rng, claims = np.random.default_rng(6), 0
    for _ in range(15):
        A = random_solid(rng).place(rotation(rng), ORIGIN)
        B = random_solid(rng).place(rotation(rng), rng.uniform(2.0, 4.0) * unit(rng))
        true = certificate(A, B).upper
        with monkeypatch.context() as patched:
            patched.setattr("verify.compounds.nearest", ends_early)
            found = certificate(A, B)
        claims += found.analytic > true + 1e-3
        assert found.lower is None or found.lower <= true + 1e-12
    assert claims > 5


def test_bounds_hold_the_parts():
    parts = Scene(fan())
    rng = np.random.default_rng(5)
    for body, own, centre in zip(parts.modules, parts.bodies, parts.centres, strict=True):
        for part in body.parts:
            for _ in range(20):
                u = unit(rng)
                assert part.support(u) <= body.bounds.support(u) + 1e-12
                assert part.support(u) - u @ centre <= own.reach + 1e-12


# ---- platforms


def test_bolted_neighbours_may_not_touch_with_rotors():
    turning = {"module": {"body": {"rotor_radius": 0.081}}}
    (body,) = [pair for pair in audit(design(CHAIN, turning, hinges=(0.0,))).pairs if pair.kind == "body"]
    assert body.status == Status.VIOLATED
    assert body.analytic_m == pytest.approx(2 * (0.15 - 0.1 / math.sqrt(2) - 0.081), abs=1e-7)


def test_real_parts_that_touch_are_named_and_count_with_body_clearance():
    folded = fan(hinges=(1.5, -1.5), task={"module": {"connector_distance": 0.09}})
    result = audit(folded)
    touching = {(pair.a, pair.b) for pair in result.pairs if pair.kind == "body" and pair.status == Status.VIOLATED}
    assert touching
    assert result.verdict == Status.VIOLATED
    for pair in result.pairs:
        if pair.status == Status.VIOLATED and pair.kind == "body":
            assert pair.lower_m is None
            assert pair.analytic_m <= pair.upper_m < 0


def test_without_body_clearance_parts_that_touch_are_told_and_do_not_count():
    wide = {"module": {"body": {"rotor_radius": 0.081}}}
    touching = fan(wide)
    literal = {**touching.task.model_dump(mode="json"), "search": {"body_clearance": False}}
    result = audit(changed(touching, task=literal))
    assert {pair.status for pair in result.pairs if pair.kind == "body" and pair.b == 1} == {Status.VIOLATED}
    assert result.verdict == Status.CLEAR
    assert audit(touching).verdict == Status.VIOLATED


@pytest.mark.parametrize("width", [1e-11, 1e-13])
def test_parts_too_thin_for_a_proof_are_refused(width):
    """The sides of arms as thin as that have no direction, and hub and rotors do not hide them."""
    body = {"arm_width": width, "hub": [1e-9, 1e-9, 1e-9], "rotor_radius": 1e-9, "rotor_height": 1e-9}
    with pytest.raises(
        ValidationError, match=r"body.arm_width\n +must be between 1e-05 and 10, 0.0001 and 100 arm lengths"
    ):
        fan(task={"module": {"body": body}})


def test_parts_out_of_range_are_undecided():
    result = audit(fan(task={"module": {"connector_distance": 1e7}}))
    assert {pair.status for pair in result.pairs if pair.kind == "body"} == {Status.UNDECIDED}


@pytest.mark.parametrize("hinged", [False, True])
def test_solids_overlap_only_where_they_have_a_common_point(hinged):
    """Hubs and rotors along common axes: the points that a search meets then often lie in one plane."""
    rng = np.random.default_rng(0)
    disc = cylinder("disc", np.array([0.7, 0.7, 0.0]), UP, 0.5, 0.2)
    hub = box("hub", ORIGIN, np.diag([1.5, 1.5, 0.4]))
    discs, hubs = [], []
    for _ in range(2000):
        R = rotation(rng)
        H = kinematics.rotation(1, rng.uniform(-1.5, 1.5)) if hinged else STILL
        p = 1.5 * (STILL + H)[:, 0] if hinged else rng.integers(-3, 4, 3) * rng.choice([0.5, 0.75, 1.0])
        discs.append(disc.place(R, ORIGIN))
        hubs.append(hub.place(R @ H, R @ p))
    towards = np.array([B.centre - A.centre for A, B in zip(discs, hubs, strict=True)])
    found = nearest(cores(discs), cores(hubs), towards)
    assert 100 < found.overlap.sum() < 400
    x = (found.x_A + found.x_B)[found.overlap] / 2
    assert np.linalg.norm(found.v[found.overlap], axis=1).max() < 1e-9
    for k, point in zip(np.flatnonzero(found.overlap), x, strict=True):
        assert min(discs[k].depth(point), hubs[k].depth(point)) > -1e-9


# ---- what keeps real parts apart


def facing(distance, tilt):
    """Two modules of the default shape, rotor towards rotor, each tilted by as much towards the other's top."""
    modules = []
    frame, rotors = module_parts(Module())
    bounds = bounding_box(frame + rotors)
    for side in (-1.0, 1.0):
        R = kinematics.rotation(1, -side * tilt) @ kinematics.rotation(2, math.pi / 4)
        p = np.array([side * distance / 2, 0.0, 0.0])
        modules.append(Compound(tuple(part.place(R, p) for part in frame + rotors), bounds.place(R, p)))
    (found,) = certify_compounds([tuple(modules)], [False])
    return found


def test_at_the_default_body_clearance_only_the_rims_of_facing_rotors_can_touch():
    """0.30 m is twice the reach in the plane of the rotors; a rim is farther out by its half height."""
    reach = math.hypot(1.5, 0.1)
    assert module_parts(Module())[1][0].reach == pytest.approx(reach, rel=1e-12)
    tilt = math.atan2(0.1, 1.5)
    assert facing(3.0, 0.0).analytic == pytest.approx(0.0, abs=1e-9)
    touching = facing(3.0, tilt)
    assert touching.status == Status.VIOLATED
    assert touching.analytic == pytest.approx(3.0 - 2 * reach, abs=1e-6)
    assert facing(2 * reach + 1e-6, tilt).status == Status.CLEAR


def prism(rng: np.random.Generator) -> Polyhedron:
    """A random box, or a random prism or hull of points, turned at random."""
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    if (form := rng.integers(3)) == 1:
        ring = rng.normal(size=(int(rng.integers(3, 7)), 2))
        corners = np.array([(*point, z) for point in ring for z in (-1.0, 1.0)])
    elif form == 2:
        corners = rng.normal(size=(int(rng.integers(4, 15)), 3))
    mesh = hull((corners * rng.uniform(0.05, 2.0, 3)) @ rotation(rng).T + 0.3 * rng.normal(size=3)).mesh
    return Polyhedron("prism", mesh.vertices, mesh.triangles)


@pytest.mark.parametrize("capsules", [0, 1])
def test_the_depth_of_overlapping_parts_is_that_of_the_origin_in_their_difference(capsules: int) -> None:
    """Against the facets of the hull of all differences of vertices."""
    rng, seen = np.random.default_rng(capsules), 0
    while seen < 60:
        A, B = prism(rng), prism(rng)
        if capsules:
            B = capsule("rod", *(0.5 * rng.normal(size=(2, 3))), radius=0.1)
        differences = (A.vertices[:, None] - B.vertices[None]).reshape(-1, 3)
        facets = ConvexHull(differences).equations
        if (depth := -float(facets[:, 3].max())) <= 1e-3:  # apart, or the rod's axis is
            continue
        seen += 1
        (found,) = proximities([(one(A), one(B))], [False])
        assert -found.d == pytest.approx(depth + B.ball, rel=1e-9)
