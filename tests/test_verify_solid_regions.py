"""Solid regions in the audit, against points on the surfaces of all parts, and both verdicts."""

from pathlib import Path

import numpy as np
import pytest
from export_cases import random_design, with_rod
from numpy.typing import NDArray

from topo_search.model import Audit, Design, Status, Task, Topology
from topo_search.model.files import to_toml
from verify import audit, choose_mount
from verify.bodies import Cone
from verify.convex import Cylinder, Polyhedron
from verify.kinematics import platform
from verify.parts import rigid_parts
from verify.parts_in_cone import certify_parts_inside, lowest_point

Array = NDArray[np.float64]
TREE = Topology.from_key("a300")
SLAB = [[x, y, z] for x in (0.0, 0.3) for y in (-0.6, 0.5) for z in (-0.4, 0.7)]
REGIONS = {
    "half-space": {"kind": "exterior", "half_angle_deg": 90.0, "axis": [-1.0, 0.2, 0.3]},
    "cone": {"kind": "exterior", "half_angle_deg": 55.0, "axis": [-1.0, 0.2, 0.3]},
    "com": {"kind": "exterior", "half_angle_deg": 70.0, "axis": "com"},
    "slab": {"kind": "local", "vertices": SLAB},
    "ball": {"kind": "local", "radius": 0.3},
    "box": {"kind": "local", "box": [0.4, 0.7, 0.5]},
    "path": {"kind": "directional", "radius": 0.1, "segments": [[0.6, 0.0, 0.1]]},
}


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


def inside(design: Design, region: dict, points: Array) -> Array:
    """How far points (from p_E, in metres) are inside a region; a lower bound of the distance outside."""
    if region["kind"] == "exterior":
        axis = -platform(design).p_e if region["axis"] == "com" else np.array(region["axis"])
        d = axis / np.linalg.norm(axis)
        theta = np.radians(region["half_angle_deg"])
        along = points @ d
        return np.linalg.norm(points - np.outer(along, d), axis=1) * np.cos(theta) - along * np.sin(theta)
    if region["kind"] == "directional":
        end = np.array(region["segments"][0])
        t = np.clip(points @ end / (end @ end), 0, 1)
        return region["radius"] - np.linalg.norm(points - np.outer(t, end), axis=1)
    if "radius" in region:
        return region["radius"] - np.linalg.norm(points, axis=1)
    low, high = np.min(SLAB, axis=0), np.max(SLAB, axis=0)
    if "box" in region:
        high = np.array(region["box"]) / 2
        low = -high
    outside = np.linalg.norm(points - np.clip(points, low, high), axis=1)
    return np.where(outside > 0, -outside, np.minimum(points - low, high - points).min(axis=1))


def rows(result: Audit, kind: str) -> dict[int, object]:
    return {pair.a: pair for pair in result.pairs if pair.kind == kind}


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("seed", range(6))
def test_rows_are_those_of_points_on_the_parts(name: str, seed: int) -> None:
    region = REGIONS[name]
    given = with_rod(random_design(TREE, seed, {"exposure": [{**region, "solid": True}]}))
    at, rng = platform(given), np.random.default_rng(seed)
    parts, found = rigid_parts(given, at), rows(audit(given), "part-region")
    assert set(found) == {0, 1, 2}
    for a, module in enumerate(parts.modules):
        points = np.concatenate([surface(part, rng) for part in module.parts]) - parts.p_E
        deepest = inside(given, region, 0.1 * points).max()
        pair = found[a]
        assert pair.analytic_m <= -deepest + 1e-9 or (deepest > 0 and pair.analytic_m < 0)
        if deepest > 1e-9:
            assert pair.status is Status.VIOLATED
            assert pair.upper_m <= -0.0
        elif deepest < -0.01:
            assert pair.status is Status.CLEAR
            assert -0.01 < pair.analytic_m + deepest <= 1e-9
            assert 0 < pair.lower_m <= pair.analytic_m + 1e-9


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("seed", range(6))
def test_the_rod_keeps_out_but_for_its_tip(name: str, seed: int) -> None:
    region = REGIONS[name]
    given = with_rod(random_design(TREE, seed, {"exposure": [{**region, "solid": True}]}))
    result, at = audit(given), platform(given)
    found = [pair for pair in result.pairs if pair.kind == "rod-region"]
    if name in ("ball", "box", "path"):
        assert not found
        return
    (pair,) = found
    parts = rigid_parts(given, at)
    assert given.mount is not None
    ports = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    i, port = given.mount.module, given.mount.port
    start = 0.1 * (parts.centres[i] + 1.5 * parts.R[i] @ ports[port] - parts.p_E)
    length, r = np.linalg.norm(start), given.task.end_effector.rod_radius
    axis = np.linspace(0, 1 - 2 * r / length, 3001)[:, None]
    deepest = inside(given, region, start * (1 - axis)).max()
    assert pair.analytic_m == pytest.approx(-deepest - r, abs=2e-3) or (deepest > 0 and pair.analytic_m <= -r)
    if abs(deepest + r) > 1e-3:
        assert pair.status is (Status.VIOLATED if deepest + r > 0 else Status.CLEAR)


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
            module = rigid_parts(given, platform(given)).modules[0]
            axis = np.array([0.6, 0.0, 0.8])
            cone = Cone(np.zeros(3), axis, degrees)
            least = min(float(cone.s(lowest_point(part, cone))) for part in module.parts)
            if degrees == 90.0:
                found = certify_parts_inside(module, Cone((least - shift) * axis, axis, degrees))
                assert found.status is status
            elif least > 0:
                assert certify_parts_inside(module, cone).status is Status.CLEAR


def test_a_region_that_is_not_solid_is_written_and_audited_as_before() -> None:
    given = random_design(TREE, 1, {"exposure": [REGIONS["slab"]]})
    kinds = {pair.kind for pair in audit(given).pairs}
    assert "part-region" not in kinds
    assert "solid" not in to_toml(given.task)
    solid = Task.model_validate(
        {"name": "t", "modules": 1, "load_cases": [{"carries_weight": True}]}
        | {"exposure": [{**region, "solid": True} for region in REGIONS.values()]}
    )
    assert to_toml(solid).count("solid = true") == len(REGIONS)


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
        task = Task.model_validate(
            given.task.model_dump(mode="json") | {"exposure": [{"kind": "local", "solid": True, **region}]}
        )
        result = audit(given.model_copy(update={"task": task.resolve(3)}))
        found[name] = [(pair.segment, pair.status) for pair in result.pairs if pair.kind == "rod-region"]
    assert found["hull"] == [(None, Status.VIOLATED)]
    assert found["jaws"] == [(0, Status.CLEAR), (1, Status.CLEAR)]
