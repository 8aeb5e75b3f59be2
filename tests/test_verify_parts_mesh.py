"""A module's own frame from a mesh file: convex pieces, exactly as they are, or the reason why not."""

import json

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError
from verify_cases import changed, fan

from topo_search.model import BadInput, Design, Status
from topo_search.model.files import read_json, to_json
from topo_search.model.mesh_file import ConvexPiece
from topo_search.model.task_file import read_task
from verify import audit
from verify.parts import module_parts

INERTIA = [1e-3, 1e-3, 2e-3]
TASK = """
name = "own-frame"
modules = 3
[module.body]
mesh = "{mesh}"
inertia = [1e-3, 1e-3, 2e-3]
[[load_cases]]
com = {{ force = [0.0, 0.0, 1.0] }}
"""


def hub_and_arms(module):
    """The surfaces of hub and arms [m]; arms share corners, so they are made unequal where the hub hides it."""
    frame, _ = module_parts(module)
    return [
        trimesh.Trimesh((1 + 0.01 * k) * module.arm_length * part.vertices, part.triangles)
        for k, part in enumerate(frame)
    ]


def task_with(folder, mesh, name="frame.stl"):
    mesh.export(folder / name)
    (folder / "task.toml").write_text(TASK.format(mesh=name))
    return read_task(folder / "task.toml")


def with_frame(given, task):
    data = given.task.model_dump(mode="json")
    return changed(given, task={**data, "module": task.module.model_dump(mode="json")})


@pytest.mark.parametrize("name", ["frame.stl", "frame.obj"])
def test_hub_and_arms_from_a_mesh_are_judged_like_hub_and_arms(tmp_path, name):
    shape = {"module": {"body": {"hub": [0.27, 0.25, 0.04], "rotor_radius": 0.03, "inertia": INERTIA}}}
    plain = fan(shape, end_effector=(0.02, 0.03, 0.3))
    module = plain.task.module
    task = task_with(tmp_path, trimesh.util.concatenate(hub_and_arms(module)), name)
    assert len(task.module.body.frame) == 5
    body = module.body.model_copy(update={"frame": task.module.body.frame})
    meshed = with_frame(plain, task.model_copy(update={"module": module.model_copy(update={"body": body})}))
    rows, same = ([pair for pair in audit(of).pairs if pair.kind in ("body", "rod")] for of in (plain, meshed))
    assert [(p.kind, p.a, p.b, p.status) for p in rows] == [(p.kind, p.a, p.b, p.status) for p in same]
    assert [p.analytic_m for p in rows] == pytest.approx([p.analytic_m for p in same], abs=1e-7)


def test_a_design_with_a_frame_stands_alone(tmp_path):
    task = task_with(tmp_path, trimesh.creation.icosphere(2, radius=0.05))
    given = with_frame(fan(), task)
    path = tmp_path / "design.json"
    path.write_text(to_json(given))
    again = read_json(Design, path)
    assert again == given
    assert "mesh" not in json.loads(path.read_text())["task"]["module"]["body"]
    result = audit(again)
    assert {pair.status for pair in result.pairs if pair.kind == "body"} == {Status.CLEAR}


def test_balls_as_meshes_are_as_far_apart_as_their_corners_allow():
    ball = trimesh.creation.icosphere(3, radius=0.16)
    piece = {"vertices": ball.vertices.tolist(), "triangles": ball.faces.tolist()}
    task = {"module": {"body": {"frame": [piece], "inertia": INERTIA, "rotor_radius": 0.001}}}
    rows = [pair for pair in audit(fan(task)).pairs if pair.kind == "body" and pair.a == 1]
    (row,) = rows
    a, b = np.array([[-1, 0], [1, 0]])
    assert row.status == Status.CLEAR
    apart = 4 * 0.15 * np.cos(0.3) ** 2 - 0.32 * np.linalg.norm(a - b) / 2
    assert apart - 1e-9 <= row.analytic_m <= apart + 0.005


@pytest.mark.parametrize(
    ("mesh", "rule"),
    [
        (trimesh.creation.annulus(0.02, 0.05, 0.01), "convex pieces"),
        (
            trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3]]),
            "closed",
        ),
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "closed"),
    ],
)
def test_what_is_no_union_of_convex_bodies_is_refused(tmp_path, mesh, rule):
    with pytest.raises(BadInput, match=rule) as refused:
        task_with(tmp_path, mesh)
    assert "module.body.mesh" in str(refused.value)


def test_a_surface_that_is_inside_out_is_the_same_body(tmp_path):
    ball = trimesh.creation.icosphere(1)
    task = task_with(tmp_path, ball)
    ball.invert()
    assert task_with(tmp_path, ball) == task


def test_a_needle_whose_faces_are_all_slivers_is_refused_by_the_rule():
    sections, thin, turns = 830, 4e-8, np.arange(3) * (2 * np.pi / 3)
    ring = np.stack([0 * turns, thin * np.cos(turns), thin * np.sin(turns)], axis=1)
    vertices = np.concatenate([ring + np.array([x, 0.0, 0.0]) for x in np.linspace(0.0, 0.1, sections + 1)])
    sides = [(3 * k + i, 3 * k + (i + 1) % 3, 3) for k in range(sections) for i in range(3)]
    triangles = [half for a, b, on in sides for half in ((a, b, a + on), (b, b + on, a + on))]
    triangles += [(2, 1, 0), (3 * sections, 3 * sections + 1, 3 * sections + 2)]
    with pytest.raises(ValidationError) as refused:
        ConvexPiece(vertices=vertices.tolist(), triangles=triangles)
    (fault,) = refused.value.errors()
    assert fault["msg"].startswith("must be convex")


@pytest.mark.parametrize(
    ("mesh", "content", "rule"),
    [
        ("none.stl", None, "must be a file that can be read"),
        ("frame.step", b"", "must be an .stl or .obj file"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, mesh, content, rule):
    if content is not None:
        (tmp_path / mesh).write_bytes(content)
    (tmp_path / "task.toml").write_text(TASK.format(mesh=mesh))
    with pytest.raises(BadInput, match=rule):
        read_task(tmp_path / "task.toml")


def test_a_frame_needs_its_inertia(tmp_path):
    trimesh.creation.box((0.1, 0.1, 0.02)).export(tmp_path / "frame.stl")
    (tmp_path / "task.toml").write_text(TASK.format(mesh="frame.stl").replace("inertia", "# "))
    with pytest.raises(BadInput, match="inertia: must be given"):
        read_task(tmp_path / "task.toml")
