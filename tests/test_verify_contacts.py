"""Where the frames of bolted neighbours may touch: near the connector, and nowhere else."""

import math
from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from suites import few
from verify_cases import design, unit

from topo_search.model import Status, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from verify import audit
from verify.convex import CLIPPING, Polyhedron, box, clip
from verify.requirements import Scene

ANGLES = (-90, -60, -30, 0, 15, 45, 75, 90)
L_C, L_ARM = 0.15, 0.10


def pair(body, angle_deg=0.0, a=0, b=2, **module):
    """Two bolted modules: the design, and its row of rigid parts."""
    chain, task = Topology(((-1, -1, -1), (0, a, b))), {"module": {"body": body, **module}}
    given = design(chain, {**task, "search": {"connectors": "any"}}, hinges=(math.radians(angle_deg),))
    (row,) = [found for found in audit(given).pairs if found.kind == "body"]
    return given, row


def own_frame(*boxes):
    """A frame of boxes, each by its edges and its middle [m]."""
    pieces = [trimesh.creation.box(edges).apply_translation(middle) for edges, middle in boxes]
    frame = [{"vertices": piece.vertices.tolist(), "triangles": piece.faces.tolist()} for piece in pieces]
    return {"frame": frame, "inertia": [1e-3, 1e-3, 2e-3]}


def struts_with_flanges(flange, at=L_C):
    """A cross of struts to all four connectors, each with a plate that ends `at` this distance."""
    ends = [(flange, (at - flange[0] / 2) * e) for e in PORT_DIRECTIONS[::2]]
    sideways = flange[1], flange[0], flange[2]
    ends += [(sideways, (at - flange[0] / 2) * e) for e in PORT_DIRECTIONS[1::2]]
    return own_frame(((2 * at, 0.02, 0.02), (0, 0, 0)), ((0.02, 2 * at, 0.02), (0, 0, 0)), *ends)


# ---- modules


@pytest.mark.parametrize("angle", few(ANGLES, [-90, 0, 75]))
def test_a_hub_that_reaches_into_its_neighbour_is_violated(angle):
    """It is 60 mm past the connector, at every hinge angle inside the neighbour's hub."""
    _, row = pair({"hub": [0.42, 0.02, 0.02]}, angle)
    assert row.status == Status.VIOLATED
    assert row.lower_m is None
    assert row.analytic_m <= row.upper_m < 0


def test_hubs_10_mm_past_the_connectors_are_as_deep_in_each_other():
    """What is past the fitting has to move to the neighbour's end."""
    _, row = pair({"hub": [0.32, 0.3, 0.1], "rotor_radius": 0.01})
    assert row.status == Status.VIOLATED
    assert row.analytic_m == pytest.approx(-0.02, abs=1e-9)


@pytest.mark.parametrize("angle", few(ANGLES, [-90, 0, 75]))
@pytest.mark.parametrize(("a", "b"), few([(0, 2), (3, 0), (1, 1)], 2))
def test_default_modules_stay_clear_by_their_rotors(angle, a, b):
    _, row = pair({}, angle, a, b)
    inside, half = L_C - (L_ARM / math.sqrt(2) + 0.05), math.radians(180 - abs(angle)) / 2
    assert row.status == Status.CLEAR
    if (a - b) % 2 == 0:
        assert row.analytic_m == pytest.approx(2 * (inside * math.sin(half) - 0.01 * math.cos(half)), abs=1e-9)


@pytest.mark.parametrize("angle", few(ANGLES, [-90, 0, 75]))
@pytest.mark.parametrize(
    "hub", few([[0.3, 0.3, 0.04], [0.314, 0.02, 0.02], [0.3, 0.02, 0.02], [0.3, 0.04, 0.055]], 2)
)
def test_hubs_that_end_at_the_connectors_stay_clear(hub, angle):
    """Up to 29 mm from the hinge's axis there are no rotors, and frames may touch up to 30 mm from it."""
    assert pair({"hub": hub}, angle)[1].status == Status.CLEAR


@pytest.mark.parametrize("angle", few(ANGLES, [-90, 0, 75]))
@pytest.mark.parametrize(("a", "b"), [(0, 2), (1, 0)])
def test_meshes_with_flanges_at_the_connectors_stay_clear(a, b, angle):
    assert pair(struts_with_flanges((0.005, 0.05, 0.05)), angle, a, b)[1].status == Status.CLEAR


def test_flanges_past_the_connectors_are_violated_only_beyond_the_fitting():
    for past, status in ((0.007, Status.CLEAR), (0.008, Status.VIOLATED)):
        _, row = pair(struts_with_flanges((0.005, 0.05, 0.05), at=L_C + past))
        assert row.status == status


def test_a_high_hub_may_stand_against_its_neighbour_and_not_fold_into_it():
    body = {"hub": [0.3, 0.1, 0.1], "rotor_radius": 0.01}
    assert pair(body, 0)[1].status == Status.CLEAR
    assert pair(body, 90)[1].status == Status.VIOLATED


def test_a_piece_wholly_past_the_connector_touches_nothing():
    """A bar 10 to 20 mm past a connector: the neighbour's strut ends 50 or 10 mm short of its own."""
    bars = own_frame(((0.2, 0.02, 0.02), (0, 0, 0)), ((0.01, 0.02, 0.02), (L_C + 0.015, 0, 0)))
    assert pair(bars, a=0, b=0)[1].status == Status.CLEAR
    through = own_frame(((0.28, 0.02, 0.02), (0, 0, 0)), ((0.01, 0.02, 0.02), (L_C + 0.015, 0, 0)))
    assert pair({**through}, a=0, b=0)[1].status == Status.VIOLATED


def test_the_audit_states_how_far_frames_may_touch():
    (contact,) = audit(pair({})[0]).allowed_contacts[:1]
    assert contact.parts == (
        "hub and arms, by ports 0 and 2, from 30 mm inside the connector's plane to 7.5 mm past it"
    )
    (contact,) = audit(pair({}, connector_distance=0.2)[0]).allowed_contacts[:1]
    assert contact.parts.endswith("from 40 mm inside the connector's plane to 10 mm past it")


# ---- against inequalities alone


def half_spaces(part):
    """The planes n.x <= b of a box whose corners are in the order of `box`."""
    c = part.vertices.mean(axis=0)
    edges = np.stack([part.vertices[k] - part.vertices[0] for k in (4, 2, 1)])
    lengths = np.linalg.norm(edges, axis=1)
    axes = edges / lengths[:, None]
    return np.vstack([axes, -axes]), np.concatenate([axes @ c, -axes @ c]) + np.tile(lengths / 2, 2)


def room_for_a_ball(*sides):
    """The radius of the largest ball within all half-spaces; negative if there is none."""
    n, b = (np.concatenate(columns) for columns in zip(*sides, strict=True))
    found = linprog([0, 0, 0, -1], A_ub=np.column_stack([n, np.ones(len(n))]), b_ub=b, bounds=[(None, None)] * 4)
    return float(found.x[3])


def forbidden_room(given, ports):
    """The largest ball that is in both frames and, for one of them, not near its connector [l_arm]."""
    modules, most = Scene(given), -math.inf
    frames = [module.parts[:5] for module in modules.modules]
    for one in (0, 1):
        e = modules.R[one] @ PORT_DIRECTIONS[ports[one]]
        along, l_c = float(e @ modules.centres[one]), L_C / L_ARM
        far = [(e[None], np.array([along + 0.8 * l_c])), (-e[None], np.array([-along - 1.05 * l_c]))]
        for A, B, (n, b) in product(frames[one], frames[1 - one], far):
            if (A.vertices @ n[0]).min() < b[0] and math.dist(A.centre, B.centre) < A.radius + B.radius:
                most = max(most, room_for_a_ball(half_spaces(A), half_spaces(B), (n, b)))
    return most


def test_hubs_are_violated_where_and_only_where_they_meet_beyond_the_neighbourhood():
    """Rotors hardly larger than a point, inside the arms, so that frames alone decide."""
    rng, seen = np.random.default_rng(5), set()
    for _ in range(12):
        hub = [*rng.uniform(0.02, 0.4, 2).tolist(), rng.uniform(0.02, 0.15)]
        body = {"hub": hub, "arm_width": rng.uniform(0.01, 0.04), "rotor_radius": 1e-4, "rotor_height": 1e-4}
        a, b = rng.integers(4, size=2).tolist()
        given, row = pair(body, rng.uniform(-90, 90), a, b)
        room = forbidden_room(given, (a, b))
        assert abs(room) > 1e-5  # none of them is close
        assert row.status == (Status.VIOLATED if room > 0 else Status.CLEAR)
        if room > 0:
            assert row.analytic_m <= -2 * L_ARM * room + 1e-9
        seen.add(row.status)
    assert seen == {Status.CLEAR, Status.VIOLATED}


# ---- clipping


def hull(points):
    """The hull of points, with its surface counter-clockwise from outside."""
    found = ConvexHull(points)
    surface = trimesh.Trimesh(found.points, found.simplices, process=True)
    surface.remove_unreferenced_vertices()
    surface.fix_normals()
    return Polyhedron("piece", np.array(surface.vertices), np.array(surface.faces, dtype=np.intp))


def volume(solid):
    """The volume of a surface that is closed, every edge once in either direction."""
    edges = np.concatenate([solid.triangles[:, [k, (k + 1) % 3]] for k in range(3)]).tolist()
    assert len({*map(tuple, edges)}) == len(edges)
    assert {(i, j) for i, j in edges} == {(j, i) for i, j in edges}
    return float(np.sum(np.linalg.det(solid.vertices[solid.triangles])) / 6)


def test_what_a_plane_cuts_a_solid_into_is_all_of_it():
    rng = np.random.default_rng(0)
    for k in range(120):
        solid = hull(rng.normal(size=(rng.integers(4, 40), 3)) * rng.uniform(0.01, 2, 3) + rng.normal(size=3))
        if k % 4 == 0:
            solid = box("piece", rng.normal(size=3), np.diag(rng.uniform(0.01, 2, 3)))
        n = unit(rng) if k % 3 else np.eye(3)[k % 3]
        h = solid.vertices @ n
        b = float(h[0]) if k % 2 else rng.uniform(h.min(), h.max())  # through a corner, or anywhere
        pieces = [clip(solid, n, b), clip(solid, -n, -b)]
        assert sum(volume(piece) for piece in pieces if piece) == pytest.approx(volume(solid), rel=1e-4)
        for piece, side in zip(pieces, (1, -1), strict=True):
            if piece is None or piece is solid:
                continue
            assert (side * (piece.vertices @ n - b)).max() <= 1e-8
            assert min(solid.depth(x) for x in piece.vertices) > -1e-9
            assert min(piece.depth(x) for x in piece.vertices) > -1e-8  # its faces look outwards
            for x in solid.vertices[side * (h - b) <= 0]:
                assert piece.depth(x) > -1e-8


def test_a_plane_beside_a_solid_leaves_all_or_nothing():
    cube = box("cube", np.zeros(3), np.eye(3))
    x = np.array([1.0, 0.0, 0.0])
    for b in (1.0, 2.0, 1.0 - CLIPPING.thinnest / 2):
        assert clip(cube, x, b) is cube
    for b in (-1.0, -2.0, -1.0 + CLIPPING.thinnest / 2):
        assert clip(cube, x, b) is None
    for b in (-1.0 + 2 * CLIPPING.thinnest, 1.0 - 2 * CLIPPING.thinnest):
        assert volume(clip(cube, x, b)) == pytest.approx(4 * (b + 1), rel=1e-9)
