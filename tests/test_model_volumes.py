"""Target regions other than balls: what a task file says, what it leaves in a design, and what is refused."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from verify_cases import FAN, design

from topo_search.model import BadInput, Design
from topo_search.model.exposure import Local
from topo_search.model.files import to_json, to_toml
from topo_search.model.shape import convex_hull
from topo_search.model.task_file import read_task

TASK = """\
name = "case"
modules = 3
[[load_cases]]
com = {{ force = [0.0, 0.0, 1.0] }}
[[exposure]]
kind = "local"
{region}
"""
CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))


def written(folder: Path, region: str) -> Path:
    path = folder / "case.toml"
    path.write_text(TASK.format(region=region))
    return path


def region(folder: Path, text: str) -> Local:
    (asked,) = read_task(written(folder, text)).exposure
    assert isinstance(asked, Local)
    return asked


def test_a_ball_is_what_it_was(tmp_path: Path) -> None:
    assert region(tmp_path, "") == Local(radius=0.15)
    assert region(tmp_path, "radius = 0.2").radius == 0.2
    assert Local().model_dump() == {"kind": "local", "radius": 0.15}


def test_a_box_is_centred_with_its_edges_along_the_axes(tmp_path: Path) -> None:
    box = region(tmp_path, "box = [0.4, 0.2, 0.6]")
    assert sorted(map(tuple, box.corners)) == sorted(map(tuple, CUBE * [0.2, 0.1, 0.3]))
    assert box.model_dump(mode="json") == {"kind": "local", "box": [0.4, 0.2, 0.6]}


def test_a_mesh_is_looked_for_beside_the_task_and_the_design_stands_alone(tmp_path, monkeypatch):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "cube.stl").write_bytes(trimesh.creation.box((0.25, 0.25, 0.25)).export(file_type="stl"))
    task = read_task(written(tmp_path, 'mesh = "shapes/cube.stl"'))
    (tmp_path / "shapes" / "cube.stl").unlink()
    monkeypatch.chdir(Path(__file__).parent)
    (tmp_path / "again.toml").write_text(to_toml(task))
    assert read_task(tmp_path / "again.toml") == task
    one = design(FAN, {"exposure": [task.exposure[0].model_dump()]}, hinges=(-0.6, 0.6))
    assert Design.model_validate_json(to_json(one)) == one
    assert '"mesh":' not in to_json(one)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('mesh = "case.toml"', "exposure[0].mesh: must be an .stl or .obj file"),
        ('mesh = "flat.obj"', "exposure[0].mesh: must be the mesh of a body with a volume"),
        ('mesh = "many.obj"', "exposure[0].mesh: must have at most 100 bodies, but has 101"),
        ('mesh = "cube.obj"\nscale = 0.0', "exposure[0].scale: must be greater than 0"),
        ('mesh = "cube.obj"\noffset = [1.0, 2.0]', "exposure[0].offset: must be a list of three numbers"),
        ("pieces = [[[0.0, 0.0, 0.0]]]", "exposure[0].pieces[0]: must span a volume"),
        ('mesh = "cube.obj"\npieces = [[[0.0, 0.0, 0.0]]]', "exposure[0]: must have one of"),
        ("box = [1.0, 1e-7, 1.0]", "exposure[0].box: must not be thinner than a millionth"),
        ("box = [1.0, 1.0, 1.0]\nradius = 0.2", "exposure[0]: must have one of"),
        ("vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]", "exposure[0].vertices: must span a volume"),
        ("edges = [1.0, 1.0, 1.0]", "exposure[0].edges: unknown field"),
    ],
)
def test_what_is_no_region_is_refused_with_the_reason(tmp_path: Path, text: str, rule: str) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n")
    cube = trimesh.creation.box()
    cube.export(tmp_path / "cube.obj")
    trimesh.util.concatenate([cube.copy().apply_translation([2 * k, 0, 0]) for k in range(101)]).export(
        tmp_path / "many.obj"
    )
    with pytest.raises(BadInput) as refused:
        read_task(written(tmp_path, text))
    (fault,) = refused.value.faults
    assert str(fault).startswith(rule)


@given(st.integers(0, 10_000), st.integers(4, 40))
def test_the_hull_of_points_is_closed_convex_and_holds_them(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    hull = convex_hull(points)
    assert np.all(points @ hull.normals.T <= hull.offsets + 1e-12)
    # Euler: corners - edges + faces = 2, where every face is a triangle.
    assert len(hull.corners) - len(hull.edges) + len(hull.triangles) == 2
    turned = np.linalg.det(hull.corners[hull.triangles] - points.mean(axis=0))
    assert np.all(turned > 0)  # counter-clockwise from outside
    assert np.allclose(convex_hull(hull.corners).corners, hull.corners)


def test_a_box_has_twelve_edges_and_no_diagonals() -> None:
    hull = convex_hull(Local(box=(0.3, 1.0, 2.0)).corners)
    lengths = np.linalg.norm(np.diff(hull.corners[hull.edges], axis=1), axis=2).ravel()
    assert sorted(lengths.round(9)) == [0.3] * 4 + [1.0] * 4 + [2.0] * 4
    assert len(hull.triangles) == 12
