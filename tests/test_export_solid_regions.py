"""Solid regions in the model for MuJoCo: things fall on them, the platform pushes against them, nothing bursts."""

import itertools
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from commands import invoke
from export_cases import in_mujoco, random_design, with_rod
from numpy.typing import NDArray
from older import older_task

from topo_search.export.mjcf import POINT, Physics, mjcf
from topo_search.model import Design, Mount, Topology
from topo_search.model.files import to_json
from topo_search.simulation.plant import ModelErrors, Plant, Wall
from verify.kinematics import platform

Array = NDArray[np.float64]
TOUCHED = Physics(contacts=True, solid_regions=True)
RADIUS = 0.02
"""Of the ball that is dropped [m]."""
FRUSTUM = [[x, y, 0.0] for x, y in itertools.product((-0.2, 0.2), repeat=2)] + [
    [x, y, 0.07] for x, y in itertools.product((-0.1, 0.1), repeat=2)
]


def beside(design: Design, *regions: dict[str, Any]) -> Design:
    """The design with other regions at its target."""
    stated = design.task.model_dump(mode="json") | {"exposure": [{"solid": True, **region} for region in regions]}
    return design.model_copy(update={"task": older_task(stated).resolve(design.topology.n)})


def ahead() -> Design:
    """A level module with a rod that leads obliquely to an end-effector ahead of all parts."""
    drawn = random_design(Topology.from_key("a0"), 2)
    level = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": ()}
    mount = Mount(module=0, port=0)
    return drawn.model_copy(update={**level, "end_effector_m": (0.5, 0.1, -0.15), "mount": mount})


def names(model: Any, data: Any) -> list[set[str]]:
    """What touches, by the names of geometries and, where they have none, of their bodies."""
    return [
        {model.geom(g).name or model.body(model.geom_bodyid[g]).name for g in contact.geom}
        for contact in data.contact[: data.ncon]
    ]


@pytest.mark.parametrize(
    ("region", "above", "rests_at"),
    [
        ({"kind": "allowed", "planes": [{"normal": [0.0, 0.0, -2.0], "offset": 0.05}]}, 0.0, -0.025 + RADIUS),
        ({"kind": "local", "box": [0.2, 0.3, 0.1]}, 0.0, 0.05 + RADIUS),
        ({"kind": "local", "radius": 0.15}, 0.0, 0.15 + RADIUS),
        ({"kind": "local", "vertices": FRUSTUM}, 0.05, 0.07 + RADIUS),
        ({"kind": "local", "pieces": [FRUSTUM, [[x + 0.5, y, z] for x, y, z in FRUSTUM]]}, 0.55, 0.07 + RADIUS),
        ({"kind": "directional", "radius": 0.1, "segments": [[0.5, 0.0, 0.0]]}, 0.25, 0.1 + RADIUS),
        ({"kind": "exterior", "half_angle_deg": 60.0, "axis": [0.0, 0.0, 1.0]}, 0.0, RADIUS / np.sin(np.pi / 3)),
        ({"kind": "exterior", "half_angle_deg": 90.0, "axis": [0.0, 0.0, 1.0]}, 0.3, RADIUS),
    ],
    ids=["plane", "box", "ball", "hull", "pieces", "path", "cone", "half-space"],
)
def test_a_ball_that_falls_on_a_region_comes_to_rest_on_it(region, above, rests_at) -> None:
    design = beside(random_design(Topology.from_key("a300"), 2), region)
    root = ElementTree.fromstring(mjcf(design, TOUCHED))
    world = root.find("worldbody")
    world.remove(world.find("body[@name='platform']"))
    for of_platform in ("actuator", "keyframe", "contact"):
        for one in root.findall(of_platform):
            root.remove(one)
    p_E = platform(design).p_e
    start = p_E + np.array([above, 0.0, rests_at + 0.02])
    ball = ElementTree.SubElement(world, "body", name="ball", pos=" ".join(map(str, start)))
    ElementTree.SubElement(ball, "freejoint")
    ElementTree.SubElement(ball, "geom", type="sphere", size=str(RADIUS), mass="0.1")
    ElementTree.SubElement(ball, "inertial", pos="0 0 0", mass="0.1", diaginertia="1e-5 1e-5 1e-5")
    model, data = in_mujoco(ElementTree.tostring(root, encoding="unicode"))
    rises = 0.0
    for _ in range(500):
        mujoco.mj_step(model, data)
        rises = max(rises, data.qvel[2])
    np.testing.assert_allclose(data.qpos[:3] - p_E, [above, 0.0, rests_at], rtol=0, atol=1e-3)
    assert rises < np.sqrt(2 * 9.81 * 0.02) / 3  # of the speed that it comes down with
    assert np.abs(data.qvel).max() < 1e-2


@pytest.mark.parametrize(
    "wall",
    [
        {"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0]}, {"normal": [0.0, 0.0, -1.0], "offset": 2.0}]},
        {"kind": "exterior", "half_angle_deg": 90.0, "axis": [-1.0, 0.0, 0.0]},
        {"kind": "exterior", "half_angle_deg": 89.0, "axis": [-1.0, 0.0, 0.0]},
        {"kind": "local", "vertices": list(itertools.product((0.0, 0.1), (-0.3, 0.3), (-0.3, 0.3)))},
    ],
    ids=["plane", "half-space", "cone", "pane"],
)
def test_the_tip_begins_on_a_wall_at_rest_and_is_held_by_it(wall) -> None:
    design = beside(ahead(), wall)
    model, data = in_mujoco(mjcf(design, TOUCHED))
    model.opt.gravity[:] = 0
    for _ in range(200):
        mujoco.mj_step(model, data)
        assert np.abs(data.qvel).max() < 1e-3
    assert all("tip" in touching for touching in names(model, data))
    model.dof_damping[:3] = 50.0
    model.dof_damping[3:] = 1e4  # held upright
    tip = model.body("end_effector").id
    data.xfrc_applied[tip, :3] = [1.5, 0.0, 0.0]
    for _ in range(2000):
        mujoco.mj_step(model, data)
    found = np.zeros(6)
    held = np.zeros(3)
    for k, touching in enumerate(names(model, data)):
        assert "tip" in touching
        assert any(name.startswith("exposure_0") for name in touching)
        mujoco.mj_contactForce(model, data, k, found)
        held += data.contact[k].frame.reshape(3, 3).T @ found[:3]
    assert abs(held[0]) == pytest.approx(1.5, rel=1e-2)
    assert data.qpos[0] < 1e-3


def test_the_rod_reaches_into_what_it_ends_in_and_modules_do_not() -> None:
    design = beside(
        with_rod(random_design(Topology.from_key("a300"), 2)),
        {"kind": "local", "radius": 0.05},
        {"kind": "local", "box": [0.1, 0.1, 0.1]},
        {"kind": "directional", "radius": 0.05, "segments": [[0.2, 0.0, 0.0]]},
        {"kind": "allowed", "planes": [{"normal": [1.0, 0.0, 0.0], "offset": -0.01}]},
    )
    model, data = in_mujoco(mjcf(design, TOUCHED))
    at = platform(design)
    for onto in (np.zeros(3), at.p_e - at.o[0]):  # as it is; with the first module's centre at the end-effector
        data.qpos[:3] = onto
        mujoco.mj_forward(model, data)
        assert not any({"tip", "rod_contact", "rod"} & touching for touching in names(model, data))
    regions = {name for touching in names(model, data) for name in touching if name.startswith("exposure")}
    assert regions == {"exposure_0", "exposure_1", "exposure_2_0", "exposure_3_0"}
    assert {"module_0"} <= set().union(*names(model, data))


def test_the_tip_is_a_point_only_where_it_begins_on_a_region() -> None:
    drawn = with_rod(random_design(Topology.from_key("a300"), 2))
    for region, size in (({"kind": "local", "radius": 0.05}, 0.005), ({"kind": "exterior"}, POINT)):
        model = mujoco.MjModel.from_xml_string(mjcf(beside(drawn, region), TOUCHED))
        assert model.geom("tip").size[0] == size


def test_what_is_not_solid_or_not_asked_for_is_not_there(wall_press: Design) -> None:
    drawn = random_design(Topology.from_key("a300"), 2)
    places = beside(drawn, {"kind": "exterior", "solid": False}, {"kind": "local", "solid": False})
    assert "exposure_" not in mjcf(places, TOUCHED).split("-->")[1]
    solid = beside(wall_press, {"kind": "exterior", "half_angle_deg": 90.0, "axis": [-1.0, 0.0, 0.0]})
    assert "exposure_" not in mjcf(solid, Physics(contacts=True))
    plant = Plant(solid, ModelErrors(), Wall(np.array([1.0, 0.0, 0.0]), 0.03))  # its wall is the only one
    touching = np.flatnonzero((plant.model.geom_bodyid == 0) & (plant.model.geom_contype > 0))
    static = {plant.model.geom(g).name for g in touching}
    assert static == {"wall"}


def test_the_command_writes_them(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    made = beside(random_design(Topology.from_key("a300"), 2), {"kind": "exterior"})
    (tmp_path / "mine.json").write_text(to_json(made))
    words = ("export", "mine.json", "--contacts", "--out", "mine.mjcf")
    invoke(*words)
    text = (tmp_path / "mine.mjcf").read_text()
    assert "Bodies `exposure_K` are the task's solid regions" in text
    assert mujoco.MjModel.from_xml_string(text).body("exposure_0").geomnum[0] == 48


def pipe(x: float, z: float) -> dict[str, Any]:
    """A path across, 5 cm in radius."""
    return {"kind": "directional", "radius": 0.05, "polylines": [[[x, -0.5, z], [x, 0.5, z]]]}


def frustum(z: float) -> dict[str, Any]:
    """A frustum that stands somewhere above the end-effector."""
    return {"kind": "local", "vertices": (np.array(FRUSTUM) + np.array([0.0, 0.0, z])).tolist()}


def ceiling(z: float) -> dict[str, Any]:
    """All that is above a plane."""
    return {"kind": "allowed", "planes": [{"normal": [0.0, 0.0, 1.0], "offset": z}]}


@pytest.mark.parametrize(
    ("region", "where"),
    [
        (pipe(-0.3, 0.0), "beside"),
        (pipe(0.0, 0.05), "on"),
        (pipe(0.0, 0.04), "inside"),
        ({"kind": "directional", "radius": 0.05, "along": "end_effector", "length": 0.3}, "inside"),
        ({"kind": "local", "radius": 0.05}, "inside"),
        (frustum(0.02), "beside"),
        (frustum(-0.02), "inside"),
        ({"kind": "exterior", "half_angle_deg": 60.0}, "on"),
        (ceiling(0.02), "beside"),
        (ceiling(-0.01), "inside"),
    ],
)
def test_contacts_are_left_out_only_where_the_end_effector_is_inside(region, where) -> None:
    design = beside(with_rod(random_design(Topology.from_key("a300"), 2)), region)
    model = mujoco.MjModel.from_xml_string(mjcf(design, TOUCHED))
    assert model.nexclude == (where == "inside")
    assert (model.geom("tip").size[0] == POINT) == (where == "on")


def test_a_rod_through_a_pipe_beside_its_tip_touches_it() -> None:
    text = (Path(__file__).parent / "designs" / "pipe-beside.json").read_text(encoding="utf-8")
    model, data = in_mujoco(mjcf(Design.model_validate_json(text), TOUCHED))
    assert {"rod_contact", "exposure_0_0"} in names(model, data)
