"""The contract of every kind of exposure: solver, audit and brute force agree on every clearance."""

import ast
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from nlp_cases import (
    BELOW,
    BENT,
    BOX,
    CONE,
    CONE_DOWN,
    HALF_SPACE,
    HALF_SPACE_DOWN,
    LOCAL,
    OUTWARDS,
    PIECES,
    TWO_PATHS,
    WEDGE,
    WIDE_AT_REGIONS,
    as_design,
    best_design,
    push,
    random_point,
    random_tree,
)
from suites import few

import topo_search
from topo_search.export.poses import shapes
from topo_search.model import Design, Topology
from topo_search.model.exposure import EXPOSURE_KINDS, Allowed, AnyExposure
from topo_search.model.files import to_json
from topo_search.model.shape import Shape
from topo_search.report.task_facts import facts
from verify import audit
from verify.kinematics import platform

KINDS = {
    "ball": LOCAL,
    "box": BOX,
    "convex region": WEDGE,
    "pieces": PIECES,
    "paths": TWO_PATHS,
    "bent paths": BENT,
    "path along p_E": OUTWARDS,
    "cone": CONE,
    "fixed cone": CONE_DOWN,
    "half-space": HALF_SPACE,
    "fixed half-space": HALF_SPACE_DOWN,
    "planes": BELOW,
}
FINE = np.linspace(0.0, 1.0, 401)


def random_design(kind, seed):
    rng = np.random.default_rng(seed)
    task = push(2, exposure=[KINDS[kind]], module=WIDE_AT_REGIONS if seed == 1 else {})
    return random_point(task, random_tree(2, rng, aligned=True), rng)


def exposed(found):
    return [pair for pair in found.pairs if pair.kind in EXPOSURE_KINDS]


def brute_force(point, kind):
    """The least clearance of sampled balls of every envelope from the region as its fields say it, in metres."""
    asked, air, (R, p) = KINDS[kind], point.task.module.region_envelope, point.poses
    centres = p[:, None] - FINE[:, None] * air.length * R[:, None, :, 2] - point.tip
    radii = air.start_radius + FINE * air.growth
    if "planes" in asked:
        normals = np.array([plane["normal"] for plane in asked["planes"]])
        lengths = np.linalg.norm(normals, axis=1)
        offsets = np.array([plane["offset"] for plane in asked["planes"]])
        return ((offsets - centres @ normals.T) / lengths - radii[:, None]).min(axis=1)
    gaps = []
    for path in asked["polylines"]:
        for start, end in pairwise(path):
            on_path = np.array(start) + FINE[:, None] * np.subtract(end, start)
            apart = np.linalg.norm(centres[:, :, None] - on_path, axis=-1)
            gaps.append(apart.min(axis=2) - radii - asked["radius"])
    return np.stack(gaps, axis=-1).min(axis=1)


@pytest.mark.parametrize("kind", ["bent paths", "planes"])
@pytest.mark.parametrize("seed", range(2))
def test_the_audit_agrees_with_brute_force(kind, seed):
    point = random_design(kind, seed)
    sampled = brute_force(point, kind)
    for pair in exposed(audit(as_design(point))):
        assert pair.analytic_m == pytest.approx(sampled[pair.a, pair.segment], abs=2e-3)
        assert pair.analytic_m <= sampled[pair.a, pair.segment] + 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_a_plane_means_normal_x_at_most_offset_whatever_the_length_of_its_normal(seed):
    rng = np.random.default_rng(seed)
    normal, offset = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3), rng.normal()
    plane = {"normal": normal.tolist(), "offset": offset * float(np.linalg.norm(normal))}
    task = push(2, exposure=[{"kind": "allowed", "planes": [plane]}])
    (kept,), (cone,) = task.exposure[0].planes, task.exposure[0].shapes
    assert np.array(kept.normal) * np.linalg.norm(normal) == pytest.approx(normal)
    assert kept.offset == pytest.approx(offset)
    assert normal @ np.array(cone.apex) == pytest.approx(plane["offset"])
    assert Allowed.model_validate_json(task.exposure[0].model_dump_json()) == task.exposure[0]


def test_a_plane_through_the_end_effector_is_the_half_space_of_a_cone():
    out = np.array(HALF_SPACE_DOWN["axis"])
    point = random_design("fixed half-space", 5)
    plane = {"kind": "allowed", "planes": [{"normal": (-out).tolist()}]}
    both = push(2, exposure=[HALF_SPACE_DOWN, plane])
    cone, allowed = (
        [pair for pair in exposed(audit(as_design(point).model_copy(update={"task": both}))) if pair.kind == name]
        for name in ("exterior", "allowed")
    )
    for one, other in zip(cone, allowed, strict=True):
        assert one.analytic_m == pytest.approx(other.analytic_m, abs=1e-12)
        assert one.status == other.status


def test_a_polyline_of_one_piece_from_the_end_effector_is_a_segment():
    end = [0.6, -0.2, 0.3]
    forms = ({"segments": [end]}, {"polylines": [[[0.0, 0.0, 0.0], end]]}, {"polylines": [[end, [0.0, 0.0, 0.0]]]})
    point = random_design("paths", 6)
    rows = []
    for form in forms:
        task = push(2, exposure=[{"kind": "directional", "radius": 0.15, **form}])
        design = as_design(point).model_copy(update={"task": task})
        rows.append([pair.analytic_m for pair in exposed(audit(design))])
    np.testing.assert_allclose(rows[1:], [rows[0]] * 2, atol=1e-12)


@pytest.mark.parametrize("kind", few(["pieces", "bent paths", "planes"], 1))
def test_designs_are_found_and_certified(kind):
    task = push(5, exposure=[KINDS[kind]])
    design = best_design(task, Topology.from_key("a11210"), 4)
    found = audit(design)
    assert found.verdict == "clear"
    assert {pair.status for pair in exposed(found)} == {"clear"}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_told_drawn_and_stored(kind):
    point = random_design(kind, 7)
    design = as_design(point)
    assert Design.model_validate_json(to_json(design)) == design
    at = platform(design)
    for _, shape in shapes(design.task, at.p_e):
        assert len(shape.mesh(1.0).faces) > 0
    assert len(next(rows[0][1] for _, rows in facts(point.task) if rows[0][0] == "requirement 0")) > 10
    for pair in exposed(audit(design)):
        gap = math.dist(*pair.closest_m)
        if pair.analytic_m > 0:
            assert gap == pytest.approx(pair.analytic_m, abs=1e-9)
        assert math.isfinite(gap)


ROOT = Path(topo_search.__file__).parents[1]


def names_one(node, classes, strings):
    """Return whether a node of the code is one of some classes or strings."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.alias(name=name):
            return name in classes
        case ast.Constant(value=str(text)):
            return text in strings
    return False


def files_that_name(classes, strings=()):
    files = [file for package in ("nlp", "topo_search", "verify") for file in (ROOT / package).rglob("*.py")]
    nodes = {str(file.relative_to(ROOT)): ast.walk(ast.parse(file.read_text(encoding="utf-8"))) for file in files}
    return {file for file in nodes if any(names_one(node, classes, strings) for node in nodes[file])}


def test_few_files_name_a_kind():
    classes = {kind.__name__ for kind in get_args(AnyExposure)}
    naming = files_that_name(classes, EXPOSURE_KINDS)
    assert naming == {"topo_search/model/exposure.py", "verify/requirements.py"}
    assert classes <= set(topo_search.__all__)
    template = (ROOT / "topo_search/model/template.toml").read_text(encoding="utf-8")
    assert re.findall(r'^# kind = "(\w+)"', template, re.MULTILINE) == list(EXPOSURE_KINDS)


def test_of_those_that_use_shapes_only_the_solver_names_one():
    model, solver = (
        ("shape", "exposure"),
        ("requirements/exposure", "air/fastest", "bounds/reach", "starts/random_starts"),
    )
    expected = {f"topo_search/model/{name}.py" for name in model} | {f"nlp/{name}.py" for name in solver}
    assert files_that_name({shape.__name__ for shape in Shape.__subclasses__()}) == expected


def test_a_piece_is_judged_like_a_region_of_its_own():
    point = random_design("pieces", 3)
    apart = push(2, exposure=[{"kind": "local", "vertices": points} for points in PIECES["pieces"]])
    alone = exposed(audit(as_design(point).model_copy(update={"task": apart})))
    together = exposed(audit(as_design(point)))
    assert [pair.analytic_m for pair in together] == [pair.analytic_m for pair in alone]
    assert [(pair.a, pair.b, pair.segment) for pair in together] == [(pair.a, 0, pair.b) for pair in alone]
