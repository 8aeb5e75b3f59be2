"""What python-fcl gets wrong, by name: each test fails if the audit falls into the trap again."""

import ast
import pathlib
import pickle

import fcl
import numpy as np
import pytest
from verify_cases import at_clearance, fan, random_pair

import verify.meshes
from topo_search.model import Status
from verify import audit
from verify.bodies import ConeSphere, ball
from verify.certificate import RoundBody, certify_pairs
from verify.meshes import ConvexMesh, FclPolytope, inner_mesh, outer_mesh

DOWN = np.array([0.0, 0.0, -1.0])


def envelope(x: float, y: float, axis=DOWN) -> ConeSphere:
    return ConeSphere(np.array([x, y, 0.0]), 12.1 * np.array(axis), 1.0, 1.06)


def judged(A: ConeSphere, B: ConeSphere) -> Status:
    return certify_pairs([(RoundBody(A), RoundBody(B))])[0].status


def test_only_the_query_that_is_right_is_used():
    used = set()
    for path in pathlib.Path(verify.meshes.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "fcl":
                used.add(node.attr)
    assert used == {"Convex", "CollisionObject", "Transform", "collide", "CollisionRequest", "CollisionResult"}


def test_requests_are_left_at_their_defaults():
    # A request may name another solver: `distance` ignores that, and in `collide` INDEP misses thin pairs.
    tree = ast.parse(pathlib.Path(verify.meshes.__file__).read_text(encoding="utf-8"))
    requests = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in {"CollisionRequest", "CollisionResult"}
    ]
    assert len(requests) == 2
    assert not any(request.args or request.keywords for request in requests)


def test_distance_of_convex_bodies_is_not_reported():
    # On a grid of parallel envelopes fcl.distance is too large by parts of an arm.
    for gap in np.arange(4.2, 9.0, 0.3):
        for x, y in ((gap, 0.0), (0.0, gap), (gap, gap)):
            A, B = envelope(0.0, 0.0), envelope(x, y)
            exact = float(np.hypot(x, y) - 2 * 2.06)
            (certificate,) = certify_pairs([(RoundBody(A), RoundBody(B))])
            assert certificate.status == Status.CLEAR
            assert certificate.lower <= exact + 1e-9
            assert certificate.upper == pytest.approx(exact, abs=1e-9)


def test_a_body_inside_another_is_found():
    # A surface inside another surface does not touch it: meshes as BVH would call this clear.
    outer, inside = envelope(0.0, 0.0), ball(np.array([0.1, 0.0, -6.0]), 0.05)
    assert judged(outer, inside) == judged(inside, outer) == Status.VIOLATED


def test_identical_bodies_overlap():
    assert judged(envelope(0.0, 0.0), envelope(0.0, 0.0)) == Status.VIOLATED


def test_thin_bodies_are_found():
    rng = np.random.default_rng(31)
    for _ in range(40):
        A, B = random_pair("thin", rng)
        for gap, status in ((1e-5, Status.CLEAR), (-1e-5, Status.VIOLATED)):
            assert judged(*at_clearance(A, B, gap)) == status


def test_bodies_far_from_the_origin_keep_their_verdict():
    rng = np.random.default_rng(32)
    for far in (0.0, 1e2, 1e4):
        shift = np.array([far, -far, far])
        for gap, status in ((1e-6, Status.CLEAR), (-1e-6, Status.VIOLATED)):
            A, B = at_clearance(*random_pair("generic", rng), gap)
            assert judged(A.move(shift), B.move(shift)) == status


def test_an_arm_is_a_thousand_of_fcl_s_lengths_long(monkeypatch):
    # Its tolerances are absolute: of bodies an arm long it would not see a gap of 1e-6.
    given = []
    convex = fcl.Convex
    monkeypatch.setattr(fcl, "Convex", lambda *arguments: given.append(arguments[0]) or convex(*arguments))
    mesh = inner_mesh(ball(np.array([2.0, 0.0, 0.0]), 1.0), 1)
    FclPolytope(mesh)
    assert np.array_equal(given[0], 1e3 * mesh.vertices)


def test_what_leaves_the_process_holds_no_fcl_object():
    # They cannot be pickled; each worker process makes its own.
    with pytest.raises(TypeError):
        pickle.dumps(FclPolytope(inner_mesh(ball(np.zeros(3), 1.0), 1)))
    result = audit(fan())
    assert pickle.loads(pickle.dumps(result)) == result


def test_queries_remember_nothing():
    A, B, C = (FclPolytope(outer_mesh(ball(np.array([x, 0.0, 0.0]), 1.0), 2)) for x in (0.0, 1.0, 9.0))
    for _ in range(3):
        assert A.overlaps(B)
        assert not A.overlaps(C)
        assert not C.overlaps(B)
        assert B.overlaps(A)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e12])
def test_coordinates_that_give_nonsense_are_refused(bad):
    mesh = inner_mesh(ball(np.zeros(3), 1.0), 1)
    vertices = mesh.vertices.copy()
    vertices[3, 1] = bad
    with pytest.raises(ValueError, match="finite and within"):
        FclPolytope(ConvexMesh(vertices, mesh.triangles))


def test_faces_are_packed_with_their_counts(monkeypatch):
    given = []
    convex = fcl.Convex
    monkeypatch.setattr(fcl, "Convex", lambda *arguments: given.append(arguments) or convex(*arguments))
    mesh = outer_mesh(envelope(0.0, 0.0), 2)
    FclPolytope(mesh)
    ((vertices, count, faces),) = given
    assert count == len(mesh.triangles)
    assert faces.reshape(-1, 4)[:, 0].tolist() == [3] * count
    assert faces.reshape(-1, 4)[:, 1:].max() == len(vertices) - 1
