"""Solid regions of every shape, wherever they are, against points on all parts and on the rod."""

import math
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_cases import random_design, with_rod
from nlp_cases import as_point
from numpy.typing import NDArray
from older import older_task
from suites import few

from nlp.evaluation import violations
from nlp.joints import holder
from nlp.requirements import clearances
from nlp.requirements.rod import BestRod
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Status, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.files import to_toml
from verify import audit, choose_mount
from verify.bodies import AllowedCone
from verify.cones import certify_parts_inside, lowest_point
from verify.convex import Cylinder, Polyhedron
from verify.kinematics import platform
from verify.requirements import Scene

Array = NDArray[np.float64]
TREE = Topology.from_key("a300")
RADIUS = 0.005
"""Of the rod [m]."""
SAMPLES = 4001
PLACES = {
    "far": 1.5,
    "beside": 0.2,
    "nearly touching": RADIUS + 1e-4,
    "within a radius": 0.5 * RADIUS,
    "touching": 0.0,
    "within a radius inside": -0.5 * RADIUS,
    "inside": -3 * RADIUS,
    "deep inside": -0.3,
}
"""How far the end-effector is outside a region [m]."""
LONG_REACH = {"end_effector": {"largest_reach": 3.0}}
ACROSS = np.array([0.6, 0.0, 0.8])
BOX = np.array([[-0.1, -0.6, -0.5], [0.1, 0.5, 0.4]])
SHAPES = ("path", "bent path", "slab", "box", "ball", "along", "plane", "cone", "com", "half-space")


def region(shape: str, apart: float) -> dict[str, Any] | None:
    """A region of a shape that the end-effector is so far outside of; None where the shape cannot be there."""
    if apart < -0.1 and shape in ("path", "bent path", "slab"):
        return None
    if shape in ("path", "bent path"):
        start = (0.05 + apart) * ACROSS
        aside = np.array([0.0, 0.4, 0.0])
        points = [start - aside, start + aside]
        if shape == "bent path":
            points.append(start + 0.6 * ACROSS)
        return {"kind": "directional", "radius": 0.05, "polylines": [[point.tolist() for point in points]]}
    if shape == "slab":
        low, high = BOX + np.array([0.1 + apart, 0.0, 0.0])
        corners = [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        return {"kind": "local", "vertices": corners}
    if shape == "plane":
        return {"kind": "allowed", "planes": [{"normal": (3 * ACROSS).tolist(), "offset": 3 * apart}]}
    if shape in ("box", "ball", "along"):  # about the end-effector, or from there
        if apart >= 0:
            return None
        return {
            "box": {"kind": "local", "box": [-2 * apart, 0.4, 0.7]},
            "ball": {"kind": "local", "radius": -apart},
            "along": {"kind": "directional", "radius": -apart, "along": "end_effector", "length": 0.4},
        }[shape]
    cones = {"cone": (50.0, [-1.0, 0.2, 0.3]), "com": (70.0, "com"), "half-space": (90.0, [0.0, -0.4, 1.0])}
    degrees, axis = cones[shape]
    return {"kind": "exterior", "half_angle_deg": degrees, "axis": axis} if apart == 0 else None


def outside(design: Design, asked: dict[str, Any], x: Array) -> Array:
    """How far points, in metres from the end-effector, are outside the nearest piece of a region, (pieces, m)."""
    offset = platform(design).p_e
    if asked["kind"] == "exterior":
        axis = -offset if asked["axis"] == "com" else np.array(asked["axis"])
        d, theta = axis / np.linalg.norm(axis), math.radians(asked["half_angle_deg"])
        along = x @ d
        across = np.linalg.norm(x - np.outer(along, d), axis=1)
        return (along * math.sin(theta) - across * math.cos(theta))[None]
    if asked["kind"] == "allowed":
        (plane,) = asked["planes"]
        n = np.array(plane["normal"])
        return ((plane["offset"] - x @ n) / np.linalg.norm(n))[None]
    if asked["kind"] == "directional":
        end = asked.get("length", 0.0) * offset / np.linalg.norm(offset)
        points = np.array(asked["polylines"][0] if "polylines" in asked else [[0.0, 0.0, 0.0], end])
        found = []
        for a, b in pairwise(points):
            t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            found.append(np.linalg.norm(x - a - np.outer(t, b - a), axis=1) - asked["radius"])
        return np.array(found)
    if "radius" in asked:
        return (np.linalg.norm(x, axis=1) - asked["radius"])[None]
    corners = np.array(asked.get("vertices") or [np.array(asked["box"]) / 2, -np.array(asked["box"]) / 2])
    low, high = corners.min(axis=0), corners.max(axis=0)
    apart = np.linalg.norm(x - np.clip(x, low, high), axis=1)
    return np.where(apart > 0, apart, -np.minimum(x - low, high - x).min(axis=1))[None]


def by_samples(design: Design, asked: dict[str, Any]) -> dict[int, float]:
    """The least clearance of the rod from each piece of a region that it need not reach into, of its samples."""
    at, mount, module = platform(design), design.mount, design.task.module
    port = at.poses.R[mount.module] @ PORT_DIRECTIONS[mount.port]
    start = at.o[mount.module] + module.connector_distance * port - at.p_e
    tip = 2 * RADIUS / float(np.linalg.norm(start))
    x = np.outer(np.linspace(0.0, 1.0, SAMPLES), start)
    found = {}
    for k, here in enumerate(outside(design, asked, x[:1])[:, 0].tolist()):
        if here > 1e-8 - RADIUS:
            kept = x if here > RADIUS + 1e-8 else tip * start + (1 - tip) * x
            found[k] = float(outside(design, asked, kept)[k].min()) - RADIUS
    return found


CASES = [(shape, place) for shape in SHAPES for place, apart in PLACES.items() if region(shape, apart) is not None]


def test_a_rod_that_runs_through_a_solid_path_beside_its_tip_is_violated() -> None:
    text = (Path(__file__).parent / "designs" / "pipe-beside.json").read_text(encoding="utf-8")
    audited = audit(Design.model_validate_json(text))
    (rod,) = (pair for pair in audited.pairs if pair.kind == "rod-region")
    assert audited.verdict == rod.status == Status.VIOLATED
    assert rod.analytic_m == pytest.approx(-0.0546, abs=1e-3)


def surface(part: Polyhedron | Cylinder, rng: np.random.Generator) -> Array:
    """Points on a part, its corners among them."""
    if isinstance(part, Cylinder):
        a = np.linspace(0, 2 * np.pi, 181)
        across = np.linalg.svd(part.axis[None])[2][1:]
        ring = part.disc * np.stack([np.cos(a), np.sin(a)], axis=1) @ across
        t = np.linspace(0, 1, 4)[:, None]
        return np.concatenate(
            [part.vertices[k] + s * ring for k in (0, 1) for s in t] + [part.vertices.mean(axis=0) + ring]
        )
    corners = part.vertices[part.triangles]
    weights = rng.dirichlet(np.ones(3), (len(corners), 150))
    return np.concatenate([part.vertices, np.einsum("fkc,fcx->fkx", weights, corners).reshape(-1, 3)])


@pytest.mark.parametrize(("shape", "place"), few(CASES, CASES[::2]))
def test_rows_are_those_of_points_on_the_parts(shape: str, place: str) -> None:
    asked = region(shape, PLACES[place])
    given = with_rod(random_design(TREE, len(shape), {"exposure": [{**asked, "solid": True}], **LONG_REACH}))
    at, rng = platform(given), np.random.default_rng(0)
    parts = Scene(given, at)
    rows = {(pair.a, pair.segment or 0): pair for pair in audit(given).pairs if pair.kind == "part-region"}
    pieces = len(outside(given, asked, np.zeros((1, 3))))
    assert rows.keys() == set(product(range(3), range(pieces)))
    for (a, k), pair in rows.items():
        points = np.concatenate([surface(part, rng) for part in parts.modules[a].parts]) - parts.tip
        least = outside(given, asked, 0.1 * points)[k].min()
        assert pair.analytic_m <= least + 1e-9 or (least < 0 and pair.analytic_m < 0)
        if least < -1e-9:
            assert pair.status is Status.VIOLATED
            assert pair.upper_m <= -0.0
        elif least > 0.01:
            assert pair.status is Status.CLEAR
            assert -0.01 < pair.analytic_m - least <= 1e-9
            assert 0 < pair.lower_m <= pair.analytic_m + 1e-9


@pytest.mark.parametrize("seed", few(range(3), 1))
@pytest.mark.parametrize(("shape", "place"), few(CASES, CASES[1::2]))
def test_rows_of_rods_are_those_of_dense_samples(shape: str, place: str, seed: int) -> None:
    asked = region(shape, PLACES[place])
    design = with_rod(random_design(TREE, seed, {"exposure": [{**asked, "solid": True}], **LONG_REACH}))
    rows = {pair.segment or 0: pair for pair in audit(design).pairs if pair.kind == "rod-region"}
    dense = by_samples(design, asked)
    assert rows.keys() == dense.keys()
    (limits,) = (one for one in clearances(design.task, TREE) if isinstance(one, BestRod))
    mount = TREE.free_connectors.index((design.mount.module, design.mount.port))
    gaps = limits.best(as_point(design).vectors)[2][mount]
    solved = dict(zip((name for name, *_ in limits.rows()), gaps.tolist(), strict=True))
    for k, row in rows.items():
        clearance, solver = dense[k], design.task.module.arm_length * solved[row.name]
        assert row.lower_m is None or row.lower_m <= clearance + 1e-9
        if clearance > -RADIUS:
            assert clearance - 1e-3 < row.analytic_m <= clearance + 1e-9
            assert solver == pytest.approx(row.analytic_m, abs=1e-9)
        else:  # the axis runs through
            assert row.analytic_m <= 1e-9 - RADIUS
            assert solver <= 1e-9 - RADIUS
        if abs(row.analytic_m) > 1e-6:
            assert row.status is (Status.CLEAR if row.analytic_m > 0 else Status.VIOLATED)


@pytest.mark.parametrize("place", few(PLACES, ["beside", "within a radius inside"]))
def test_solver_and_audit_bolt_the_rod_to_the_same_module(place: str) -> None:
    known = 0
    for shape in SHAPES:
        asked = region(shape, PLACES[place])
        for seed in range(4 if asked else 0):
            design = random_design(TREE, seed, {"exposure": [{**asked, "solid": True}], **LONG_REACH})
            held, mount = holder(as_point(design)), choose_mount(design)
            assert held is None or (mount is not None and held == mount.module)
            known += held is not None
    assert known > 2


def test_a_rod_is_mounted_where_it_keeps_out_of_a_pane() -> None:
    pane = {"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0]}]}
    moved = 0
    for seed in range(12):
        open_air = random_design(TREE, seed, {"exposure": [pane]})
        given = random_design(TREE, seed, {"exposure": [{**pane, "solid": True}]})
        mount = choose_mount(given)
        result = audit(given)
        assert mount == result.assembly.end_effector.mount
        if mount != choose_mount(open_air):
            assert {pair.status for pair in result.pairs if pair.kind == "rod-region"} == {Status.CLEAR}
            moved += 1
    assert moved >= 3


def test_a_wall_right_behind_a_rotor_is_clear_and_one_right_before_it_is_not() -> None:
    for shift, status in ((1e-6, Status.CLEAR), (-1e-6, Status.VIOLATED), (-1e-7, Status.VIOLATED)):
        for degrees in (90.0, 60.0):
            given = random_design(TREE, 3)
            module = Scene(given).modules[0]
            axis = np.array([0.6, 0.0, 0.8])
            cone = AllowedCone(np.zeros(3), axis, degrees)
            least = min(float(cone.s(lowest_point(part, cone))) for part in module.parts)
            if degrees == 90.0:
                found = certify_parts_inside(module, AllowedCone((least - shift) * axis, axis, degrees))
                assert found.status is status
            elif least > 0:
                assert certify_parts_inside(module, cone).status is Status.CLEAR


def test_a_hub_inside_its_own_airflow_stays_out_of_a_solid_region_that_air_may_enter() -> None:
    speck = {"kind": "local", "radius": 0.005, "solid": True, "geometry": False, "speed": 30.0}
    task = older_task(name="t", modules=2, load_cases=[{"carries_weight": True}], exposure=[speck]).resolve(2)
    tree = Topology.from_key("a10")
    point = draw(task, tree, rng=generator(task, tree, 0, 0))
    inside = replace(point, tip=point.poses[1][0])
    amounts = {row.name: row.amount for row in violations(inside)}
    assert amounts["module 0 and solid exposure 0"] > speck["radius"]


def test_a_region_that_is_not_solid_is_written_and_audited_as_before() -> None:
    given = random_design(TREE, 1, {"exposure": [region("slab", 0.0)]})
    kinds = {pair.kind for pair in audit(given).pairs}
    assert "part-region" not in kinds
    assert "solid = true" not in to_toml(given.task)
    solid = older_task(
        **(
            {"name": "t", "modules": 1, "load_cases": [{"carries_weight": True}]}
            | {"exposure": [{**asked, "solid": True} for shape in SHAPES if (asked := region(shape, 0.0))]}
        )
    )
    assert to_toml(solid).count("solid = true") == len(solid.exposure) > 5


def test_a_rod_may_pass_between_two_bodies_but_not_through_their_hull() -> None:
    """Two jaws, 8 cm apart, beside the rod: their hull is in its way, neither of them is."""
    given = with_rod(random_design(TREE, 2))
    at = platform(given)
    start = at.o[given.mount.module] - at.p_e if given.mount else at.p_e
    axis = start / np.linalg.norm(start)
    across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.7 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    frame = np.stack([axis, across, np.cross(axis, across)])
    corners = np.array([[x, y, z] for x in (0.03, 0.05) for y in (0.04, 0.06) for z in (-0.02, 0.02)])
    jaws = [(corners * [1, side, 1] @ frame).tolist() for side in (1, -1)]
    found = {}
    for name, region in {"hull": {"vertices": jaws[0] + jaws[1]}, "jaws": {"pieces": jaws}}.items():
        task = older_task(
            **(given.task.model_dump(mode="json") | {"exposure": [{"kind": "local", "solid": True, **region}]})
        )
        result = audit(given.model_copy(update={"task": task.resolve(3)}))
        found[name] = [(pair.segment, pair.status) for pair in result.pairs if pair.kind == "rod-region"]
    assert found["hull"] == [(None, Status.VIOLATED)]
    assert found["jaws"] == [(0, Status.CLEAR), (1, Status.CLEAR)]
