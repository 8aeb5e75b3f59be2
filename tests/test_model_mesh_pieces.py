"""Meshes as regions: bodies, units and origins, shapes that are not convex or have many corners."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import invoke
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.creation import annulus, box, capsule, cylinder, icosphere

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Design
from topo_search.model.exposure import Local
from topo_search.model.files import to_json, to_toml
from topo_search.model.mesh_file import outer_hull
from topo_search.model.proven import upper_text
from topo_search.model.shape import convex_hull
from topo_search.model.task_file import read_task
from topo_search.report.task_warnings import task_warnings

CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
TASK = """\
name = "case"
modules = 3
[[load_cases]]
carries_weight = true
[module.body]
inertia = [1e-3, 1e-3, 1e-3]
{frame}
[[exposure]]
kind = "local"
solid = true
{region}
"""


def at(x: float, y: float, z: float, edges: Any = (1.0, 1.0, 1.0)) -> trimesh.Trimesh:
    return box(edges).apply_translation([x, y, z])


def region(folder: Path, mesh: trimesh.Trimesh, form: str = "stl", fields: str = "") -> Local:
    (folder / f"mesh.{form}").write_bytes(
        bytes(mesh.export(file_type=form), "ascii") if form == "obj" else mesh.export(file_type=form)
    )
    path = folder / "case.toml"
    path.write_text(TASK.format(frame="", region=f'mesh = "mesh.{form}"\n{fields}'))
    (asked,) = read_task(path).exposure
    assert isinstance(asked, Local)
    return asked


def holds(asked: Local, points: np.ndarray) -> np.ndarray:
    """Whether each point is in one of the pieces."""
    hulls = [convex_hull(corners) for corners in asked.polytopes]
    return np.any([np.all(points @ hull.normals.T <= hull.offsets + 1e-12, axis=1) for hull in hulls], axis=0)


def bounds(asked: Local) -> list[tuple[list[float], list[float]]]:
    return [(corners.min(axis=0).tolist(), corners.max(axis=0).tolist()) for corners in asked.polytopes]


@pytest.mark.parametrize("form", ["stl", "obj"])
def test_bodies_are_pieces_of_one_region(tmp_path: Path, form: str) -> None:
    asked = region(tmp_path, trimesh.util.concatenate([at(0, 0, 0), at(3, 0, 0), at(0, 0, 5)]), form)
    assert asked.vertices is None
    middles = [corners.mean(axis=0).tolist() for corners in asked.polytopes]
    assert middles == [[0, 0, 0], [3, 0, 0], [0, 0, 5]]
    assert asked.mesh_excess is None
    assert holds(asked, np.array([[0.0, 0, 0], [1.5, 0, 0], [3, 0, 0]])).tolist() == [True, False, True]


def test_bodies_that_touch_stay_apart(tmp_path: Path) -> None:
    """The legs of a table have a corner of its top each; objects of an OBJ may even share a face."""
    legs = [at(x, y, -0.55, (0.1, 0.1, 1.0)) for x, y in product((-0.45, 0.45), repeat=2)]
    table = trimesh.util.concatenate([at(0, 0, 0, (1.0, 1.0, 0.1)), *legs])
    asked = region(tmp_path, table)
    assert len(asked.pieces or ()) == 5
    assert not holds(asked, np.array([[0.0, 0.0, -0.5]]))[0]
    stacked = trimesh.util.concatenate([at(0, 0, 0), at(1, 0, 0), at(1, 0, 1)])
    assert len(region(tmp_path, stacked, "obj").pieces or ()) == 3


def test_a_body_in_another_adds_nothing(tmp_path: Path) -> None:
    hollow = trimesh.util.concatenate([at(0, 0, 0), at(0, 0, 0, (0.5, 0.5, 0.5)), at(0, 0, 0)])
    asked = region(tmp_path, hollow, "obj")
    assert asked == region(tmp_path, at(0, 0, 0), "obj")
    assert asked.pieces is None


@pytest.mark.parametrize("loose", ["a face", "a lid", "all faces", "two shells", "half a facet"])
def test_a_surface_that_is_open_keeps_its_whole_hull(tmp_path: Path, loose: str) -> None:
    """What two open shells enclose together is in neither hull."""
    ball = icosphere(3)
    faces = ball.triangles
    upper = faces[:, :, 2].mean(axis=1) > 0.3
    shift = np.where(upper[:, None, None], 1e-4, 0.0)
    open_box = box().triangles[:-2]
    mesh: dict[str, np.ndarray] = {
        "a face": open_box,
        "a lid": np.concatenate([open_box, [[[-3.0, 0, 0], [3, 0, 0], [0, 3, 0]]]]),
        "all faces": box().triangles * (1 + 1e-3 * np.arange(12)[:, None, None]),
        "two shells": faces + shift,
        "half a facet": np.concatenate([box().triangles, [[[2.0, 0, 0], [2, 1, 0], [2, 0, 1]]]]),
    }
    triangles = mesh[loose]
    asked = region(tmp_path, trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False))
    assert asked.pieces is None
    everything = np.random.default_rng(0).dirichlet(np.full(len(triangles) * 3, 0.1), 500) @ triangles.reshape(
        -1, 3
    )
    assert holds(asked, everything * (1 - 1e-6) + 1e-6 * everything.mean(axis=0)).all()
    assert asked.mesh_excess is not None


def test_an_open_body_is_a_piece_beside_closed_ones(tmp_path: Path) -> None:
    pot = trimesh.Trimesh(**trimesh.triangles.to_kwargs(at(9, 0, 0).triangles[:-2]), process=False)
    asked = region(tmp_path, trimesh.util.concatenate([at(0, 0, 0), pot, at(3, 0, 0)]))
    assert sorted(low[0] for low, _ in bounds(asked)) == [-0.5, 2.5, 8.5]
    assert asked.mesh_excess[:2] == (0, 0)


@pytest.mark.parametrize("form", ["stl", "obj"])
def test_scale_and_offset_move_a_mesh(tmp_path: Path, form: str) -> None:
    asked = region(tmp_path, box((200.0, 400.0, 800.0)), form, "scale = 1e-3\noffset = [1.0, 0.0, -2.0]")
    expected = (CUBE * [0.2, 0.4, 0.8] + [1.0, 0.0, -2.0]).tolist()
    assert sorted(map(list, asked.vertices or ())) == pytest.approx(np.array(sorted(expected)), abs=1e-12)
    assert "scale" not in asked.model_dump()


def test_scale_and_offset_move_a_frame(tmp_path: Path) -> None:
    box((200.0, 200.0, 20.0)).export(tmp_path / "frame.stl")
    frame = 'mesh = "frame.stl"\nscale = 1e-3\noffset = [0.0, 0.0, 0.01]'
    path = tmp_path / "case.toml"
    path.write_text(TASK.format(frame=frame, region=""))
    (piece,) = read_task(path).module.body.frame or ()
    assert np.ptp(piece.vertices, axis=0) == pytest.approx([0.2, 0.2, 0.02])
    assert np.mean(piece.vertices, axis=0) == pytest.approx([0.0, 0.0, 0.01], abs=1e-9)
    path.write_text(TASK.format(frame="scale = 1e-3", region=""))
    with pytest.raises(BadInput, match=r"module\.body\.scale: must be left out without a `mesh`"):
        read_task(path)


def test_a_frame_may_have_pieces_that_share_a_corner(tmp_path: Path) -> None:
    trimesh.util.concatenate([at(0, 0, 0, (0.1, 0.1, 0.1)), at(0.1, 0.1, 0.1, (0.1, 0.1, 0.1))]).export(
        tmp_path / "frame.stl"
    )
    path = tmp_path / "case.toml"
    path.write_text(TASK.format(frame='mesh = "frame.stl"', region=""))
    assert len(read_task(path).module.body.frame or ()) == 2


def u_channel() -> trimesh.Trimesh:
    profile = [[0, 0], [1, 0], [1, 1], [0.9, 1], [0.9, 0.1], [0.1, 0.1], [0.1, 1], [0, 1]]
    n = len(profile)
    vertices = [[x, y, z] for z in (0.0, 2.0) for x, y in profile]
    sides = [(i, (i + 1) % n) for i in range(n)]
    walls = [face for i, j in sides for face in ((i, j, n + j), (i, n + j, n + i))]
    caps = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
    ends = [face for a, b, c in caps for face in ((c, b, a), (n + a, n + b, n + c))]
    return trimesh.Trimesh(vertices, walls + ends, process=False)


@pytest.mark.parametrize(
    ("mesh", "least"), [(u_channel(), 0.4), (annulus(0.5, 1.0, 0.2, sections=40), 0.5), (icosphere(2), 0.0)]
)
def test_how_far_a_hull_exceeds_a_body_is_known(tmp_path: Path, mesh: trimesh.Trimesh, least: float) -> None:
    """The lid of a channel 0.8 wide is 0.4 from its walls, that of a ring 0.5 from its hole's edge."""
    (excess,) = region(tmp_path, mesh).mesh_excess or (0.0,)
    assert least <= excess <= least + 0.15


@pytest.mark.parametrize("digits", ["%.6f", "%.5g", "%.3f"])
@pytest.mark.parametrize("seed", range(2))
def test_a_frame_keeps_what_rounding_makes_concave(tmp_path: Path, digits: str, seed: int) -> None:
    """The hull takes the place of each part, and reaches beyond it by about what rounding moved its corners."""
    rng, scale = np.random.default_rng(seed), 1e-3 if digits == "%.3f" else 1.0
    arm = capsule(0.1 / scale, 0.01 / scale, count=[12, 12])
    arm.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    corners = "".join(f"v {' '.join(digits % x for x in corner)}\n" for corner in arm.vertices)
    facets = "".join(f"f {i + 1} {j + 1} {k + 1}\n" for i, j, k in arm.faces)
    (tmp_path / "arm.obj").write_text(corners + facets)
    path = tmp_path / "case.toml"
    path.write_text(TASK.format(frame=f'mesh = "arm.obj"\nscale = {scale}', region=""))
    body = read_task(path).module.body
    assert 1e-8 < body.frame_excess < 3e-6
    (piece,), given = body.frame, np.loadtxt(corners.splitlines(), usecols=(1, 2, 3)) * scale
    hull = convex_hull(np.array(piece.vertices))
    assert (given @ hull.normals.T - hull.offsets).max() < 1e-12
    assert "module.body.frame" in {warning.path for warning in task_warnings(read_task(path))}
    arm.vertices[0] *= 0.9
    arm.export(tmp_path / "arm.obj")
    with pytest.raises(BadInput, match=r"module\.body\.mesh: must have convex pieces, but piece 0 is up to 0\.0"):
        read_task(path)


def test_a_body_far_away_is_no_more_concave_than_its_digits(tmp_path: Path) -> None:
    pipe = cylinder(0.02, 0.5, sections=64).apply_translation([300.0, 0.0, 0.0])
    (excess,) = region(tmp_path, pipe).mesh_excess
    assert 1e-6 < excess < 1e-4


def test_inconsistent_winding_does_not_make_a_body_concave(tmp_path: Path) -> None:
    mesh = box()
    mesh.faces[::3] = mesh.faces[::3, ::-1]
    assert region(tmp_path, mesh).mesh_excess is None


@given(st.integers(0, 10_000), st.sampled_from([1.0, 1e-2, 1e-4]), st.integers(8, 60), st.floats(-3, 3))
@settings(deadline=None, max_examples=25)
def test_a_simplified_hull_contains_the_shape(seed: int, thin: float, most: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points * [1.0, 1.0, thin] @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + away
    corners, excess = outer_hull(points, most)
    assert len(corners) <= most
    outer, inner = convex_hull(corners), convex_hull(points)
    assert np.all(points @ outer.normals.T < outer.offsets)  # strictly: rounded outwards
    assert np.all(rng.dirichlet(np.full(200, 0.05), 200) @ points @ outer.normals.T < outer.offsets)
    lower = (corners @ inner.normals.T - inner.offsets).max()  # a corner is at least that far from the shape
    assert 0 < lower <= excess * (1 + 1e-9)
    assert excess <= np.linalg.norm(corners[:, None] - points, axis=2).min(axis=1).max() + 1e-8


def test_many_corners_are_simplified_and_the_excess_is_said(tmp_path: Path) -> None:
    ball = icosphere(4)
    asked = region(tmp_path, ball)
    assert len(asked.vertices or ()) <= LIMITS.corners
    assert holds(asked, ball.vertices.astype("f4").astype(float)).all()  # as an STL has them
    (excess,) = asked.mesh_excess or ()
    assert np.linalg.norm(asked.corners, axis=1).max() - 1 <= excess <= 0.12
    text = invoke("check", tmp_path / "case.toml")
    output = " ".join(text.output.split())
    assert f"reaches up to {upper_text(excess, 3)} m beyond its mesh" in output
    assert "larger than the mesh" in output


def test_round_bodies_share_the_corners_of_a_region(tmp_path: Path) -> None:
    cans = [cylinder(0.1, 1.0, sections=64).apply_translation([k, 0, 0]) for k in range(40)]
    asked = region(tmp_path, trimesh.util.concatenate(cans))
    assert len(asked.pieces or ()) == 40
    assert len(asked.corners) <= LIMITS.all_corners
    assert holds(asked, np.concatenate([can.vertices for can in cans]).astype("f4").astype(float)).all()
    task = read_task(tmp_path / "case.toml")
    (tmp_path / "again.toml").write_text(to_toml(task))
    assert read_task(tmp_path / "again.toml") == task


def test_the_corners_of_all_regions_are_limited(tmp_path: Path) -> None:
    pieces = [(CUBE + np.array([3 * k, 0, 0])).tolist() for k in range(100)]
    path = tmp_path / "case.toml"
    path.write_text(TASK.format(frame="", region="") + f'[[exposure]]\nkind = "local"\npieces = {pieces}\n' * 3)
    with pytest.raises(BadInput) as refused:
        read_task(path)
    rules = [fault.rule for fault in refused.value.faults]
    assert rules == [
        "must have at most 200 pieces in all, but got 300",
        "must have at most 2,000 corners in all, but got 2,400",
    ]


def test_a_design_keeps_the_pieces_and_their_excess(tmp_path: Path) -> None:
    mesh = trimesh.util.concatenate([u_channel(), at(5, 0, 0)])
    asked = region(tmp_path, mesh)
    from verify_cases import FAN, design

    one = design(FAN, {"exposure": [asked.model_dump()]}, hinges=(-0.6, 0.6))
    assert Design.model_validate_json(to_json(one)) == one
    assert one.task.exposure == (asked,)
