"""Meshes that are proven to lie inside or outside a body."""

import math

import numpy as np
import pytest
from verify_cases import FAMILIES, random_pair, unit

from verify.bodies import ConeSphere
from verify.cones import lathe
from verify.meshes import ConvexMesh, box_below, encloses, icosphere, inner_mesh, lies_within, outer_mesh


def volume(mesh: ConvexMesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.einsum("fx,fx->", a, np.cross(b, c)) / 6)


def directed_edges(mesh: ConvexMesh) -> list[tuple[int, int]]:
    return [(t[k], t[(k + 1) % 3]) for t in mesh.triangles.tolist() for k in range(3)]


@pytest.mark.parametrize("level", range(5))
def test_icospheres_have_eulers_counts_and_a_quartering_gap(level):
    sphere = icosphere(level)
    f = 20 * 4**level
    assert (len(sphere.vertices), len(sphere.edges), len(sphere.triangles)) == (f // 2 + 2, 3 * f // 2, f)
    assert np.linalg.norm(sphere.vertices, axis=1) == pytest.approx(np.ones(f // 2 + 2))
    gap = 1 - sphere.inradius
    assert gap < 0.21 / 3.0**level
    for start, end, left, right in sphere.edges.tolist():
        shared = {start, end}
        assert shared <= set(sphere.triangles[left].tolist()) & set(sphere.triangles[right].tolist())


@pytest.mark.parametrize("family", FAMILIES)
def test_meshes_prove_themselves_in_every_family(family):
    rng = np.random.default_rng(5)
    for _ in range(15):
        for body in random_pair(family, rng):
            for level in (0, 1, 2):
                for n in (None, unit(rng)):
                    assert encloses(outer_mesh(body, level, n), body)
                    assert lies_within(inner_mesh(body, level, n), body)


@pytest.mark.parametrize("family", FAMILIES)
def test_meshes_are_closed_convex_and_ordered_by_volume(family):
    rng = np.random.default_rng(6)
    for _ in range(5):
        body = random_pair(family, rng)[0]
        inner, outer = inner_mesh(body, 2), outer_mesh(body, 2)
        L, r, R = float(np.linalg.norm(body.d)), body.r, body.r + body.dr
        for mesh in (inner, outer):
            edges = directed_edges(mesh)
            assert len(edges) == len(set(edges))
            assert {(j, i) for i, j in edges} == set(edges)
            assert sorted(set(mesh.triangles.ravel().tolist())) == list(range(len(mesh.vertices)))
            assert len(mesh.vertices) - len(edges) // 2 + len(mesh.triangles) == 2
        if R - r >= L:
            exact = 4 / 3 * math.pi * R**3
        else:  # two caps and the frustum between their circles of contact
            sin = (R - r) / L
            cos, h = math.sqrt(1 - sin * sin), L - sin * (R - r)
            caps = math.pi / 3 * (r**3 * (1 - sin) ** 2 * (2 + sin) + R**3 * (1 + sin) ** 2 * (2 - sin))
            a, b = r * cos, R * cos
            exact = caps + math.pi * h / 3 * (a * a + a * b + b * b)
        assert volume(inner) < exact < volume(outer) < 1.12 * volume(inner)


def test_a_turned_mesh_touches_its_body():
    rng = np.random.default_rng(7)
    for family in FAMILIES:
        body, n = random_pair(family, rng)[0], unit(rng)
        support = body.support(n[None])[0]
        assert 0 <= (outer_mesh(body, 1, n).vertices @ n).max() - support < 1e-10
        assert 0 <= support - (inner_mesh(body, 1, n).vertices @ n).max() < 1e-10


def test_the_check_finds_a_dent_and_a_bump():
    body = ConeSphere(np.array([1.0, 2.0, 3.0]), np.array([0.0, 4.0, 0.0]), 1.0, 0.3)
    outer, inner = outer_mesh(body, 2), inner_mesh(body, 2)
    dented, bumped = outer.vertices.copy(), inner.vertices.copy()
    for mesh, by in ((dented, -0.05), (bumped, 1e-6)):
        tip = np.argmax(mesh[:, 1])  # a corner on the far ball, beyond all of the rest
        mesh[tip] += by * (mesh[tip] - body.o)
    assert not encloses(ConvexMesh(dented, outer.triangles), body)
    assert not lies_within(ConvexMesh(bumped, inner.triangles), body)


def test_a_nearly_vanishing_capsule_still_has_a_mesh():
    for length in (0.0, 1e-300, 1e-15, 1e-9, 1e-6):
        body = ConeSphere(np.zeros(3), np.array([length, 0.0, 0.0]), 1.5, 0.0)
        assert encloses(outer_mesh(body, 2), body)
        assert lies_within(inner_mesh(body, 2), body)


def test_a_box_fills_one_side_of_a_plane():
    rng = np.random.default_rng(8)
    for _ in range(20):
        x, m = rng.normal(size=3), unit(rng)
        box = box_below(x, m, 3.0)
        assert volume(box) == pytest.approx(3.0 * 6.0 * 6.0)
        assert np.sort((box.vertices - x) @ m) == pytest.approx([-3.0] * 4 + [0.0] * 4, abs=1e-14)
        across = box.vertices - x - np.outer((box.vertices - x) @ m, m)
        assert np.linalg.norm(across, axis=1) == pytest.approx([3.0 * math.sqrt(2)] * 8)


@pytest.mark.parametrize("theta", [0.05, 0.4, math.pi / 3, 1.5, math.pi / 2])
def test_a_lathed_polytope_holds_the_ball_and_touches_where_asked(theta):
    sides = 24
    radial, axial, azimuth = lathe(theta, sides)
    vertices = np.stack([radial * np.cos(azimuth), radial * np.sin(azimuth), axial], axis=1)
    directions = np.random.default_rng(9).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert (vertices @ directions.T).max(axis=0).min() >= 1
    touching = [math.cos(theta), 0.0, -math.sin(theta)]
    assert (vertices @ touching).max() == pytest.approx(1.0, abs=1e-11)
