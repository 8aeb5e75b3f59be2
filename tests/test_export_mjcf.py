"""The MJCF export, measured in MuJoCo itself: wrenches, masses, kinematics, hovering, pushing."""

import itertools
import re
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from export_cases import (
    BLOCK,
    OWN_FRAME,
    WEDGE,
    drawn_trees,
    exported_inertia,
    in_mujoco,
    mass_matrix,
    random_design,
    rod_ends,
    with_rod,
)
from nlp_cases import FEATURES
from numpy.typing import NDArray
from pytransform3d.urdf import UrdfTransformManager
from suites import few

import nlp
from topo_search.export.mjcf import Physics, mjcf
from topo_search.export.urdf import roll_pitch_yaw, urdf
from topo_search.model import Design, LoadCase, Topology
from topo_search.model.task_file import read_task
from verify.kinematics import platform, rotation, wrench_map

Array = NDArray[np.float64]

SOLVED = {
    "push": ("a3020", "push", ("modules=4",)),
    "a half-space": ("a70010", "push-exterior-90", ()),
    "any port": ("pa900", "push", ("modules=4", 'search.connectors="any"')),
    "torques": ("a3020", "ten-wrenches", ("modules=4", "module.torque_coefficient=3e-8")),
}


@pytest.fixture(scope="module", params=SOLVED)
def solved(request: pytest.FixtureRequest) -> Design:
    """A finished design."""
    key, name, settings = SOLVED[request.param]
    topology = Topology.from_key(key)
    design = nlp.solve(read_task(name, settings).resolve(topology.n), topology, starts=range(4), seed=1)
    assert isinstance(design, Design)
    return design


def at_load_case(design: Design, k: int, *, gravity: bool) -> tuple[Any, Any]:
    model, data = in_mujoco(mjcf(design))
    if not gravity:
        model.opt.gravity[:] = 0
    mujoco.mj_resetDataKeyframe(model, data, model.key(f"load_case_{k}").id)
    mujoco.mj_forward(model, data)
    return model, data


def wrench_about_com(case: LoadCase, p_E: Array) -> Array:
    """What a load case asks of all rotors together."""
    f_E, tau_E, f_C, tau_C = (
        np.array(vector)
        for wrench in (case.at_end_effector, case.at_com)
        for vector in (wrench.force, wrench.torque)
    )
    return np.concatenate([f_E + f_C, tau_E + np.cross(p_E, f_E) + tau_C])


def test_a_platform_that_pushes_against_its_load_stays_at_rest(solved: Design) -> None:
    for k, case in enumerate(solved.task.load_cases):
        model, data = at_load_case(solved, k, gravity=False)
        for body, wrench in (("end_effector", case.at_end_effector), ("platform", case.at_com)):
            # MuJoCo applies it at the body's own centre of mass; both points coincide with their frames
            data.body(body).xfrc_applied[:] = np.negative([*wrench.force, *wrench.torque])
        for _ in range(500):
            mujoco.mj_step(model, data)
        assert data.time == pytest.approx(1)
        np.testing.assert_allclose(data.qpos, [0, 0, 0, 1, 0, 0, 0], atol=1e-6)


def test_it_hovers_under_gravity(solved: Design) -> None:
    hover = len(solved.task.load_cases) - 1
    assert solved.task.load_cases[hover].com is not None
    model, data = at_load_case(solved, hover, gravity=True)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert data.time == pytest.approx(2)
    np.testing.assert_allclose(data.qpos, [0, 0, 0, 1, 0, 0, 0], atol=1e-6)


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_poses_wrenches_masses_and_inertia_are_those_of_the_audit(topology: Topology) -> None:
    design = random_design(topology, 3, {"module": {"joint_mass": 0.03}})
    task, module = design.task, design.task.module
    at = platform(design)
    model, data = at_load_case(design, 0, gravity=False)
    for i in range(topology.n):
        body = data.body(f"module_{i}")
        np.testing.assert_allclose(body.xpos, at.o[i], atol=1e-14)
        np.testing.assert_allclose(body.xmat.reshape(3, 3), at.poses.R[i], atol=1e-14)
        for q in range(4):
            np.testing.assert_allclose(data.site(f"module_{i}_rotor_{q}").xpos, at.rotors[i, q], atol=1e-14)
    np.testing.assert_allclose(data.site("end_effector").xpos, at.p_e, atol=1e-14)
    np.testing.assert_allclose(data.qfrc_actuator, wrench_map(at, module) @ design.inputs[0].ravel(), atol=1e-12)

    np.testing.assert_allclose(data.body("platform").subtree_com, 0, atol=1e-14)
    M = mass_matrix(model, data)
    m_t = task.total_mass(topology.n)
    np.testing.assert_allclose(M[:3, :3], m_t * np.eye(3), atol=1e-13)
    np.testing.assert_allclose(M[:3, 3:], 0, atol=1e-13)
    np.testing.assert_allclose(M[3:, 3:], exported_inertia(design), atol=1e-13)


@pytest.mark.parametrize("masses", [{}, {"joint_mass": 0.03}], ids=["joints without mass", "joints"])
def test_every_body_has_a_mass_and_an_inertia_as_other_readers_ask(masses: dict[str, float]) -> None:
    task = {"module": masses, "end_effector": {"mass": 0.0}}
    design = with_rod(random_design(Topology.from_key("a300"), 3, task))
    bodies = ElementTree.fromstring(mjcf(design)).findall("worldbody//body")
    inertials = [body.find("inertial") for body in bodies]
    assert len(bodies) == 1 + 3 + 2 + 1
    assert all(float(inertial.attrib["mass"]) > 0 for inertial in inertials)
    assert all(min(map(float, inertial.attrib["diaginertia"].split())) >= 1e-9 for inertial in inertials)
    total = sum(float(inertial.attrib["mass"]) for inertial in inertials)
    model, _ = in_mujoco(mjcf(design))
    assert total == pytest.approx(model.body("platform").subtreemass[0], rel=1e-12)
    assert total == pytest.approx(design.task.total_mass(3), rel=1e-12)
    for link in ElementTree.fromstring(urdf(design)).findall("link/inertial"):
        mass, turning = float(link.find("mass").attrib["value"]), float(link.find("inertia").attrib["ixx"])
        assert turning >= 1e-9 or mass == 0.0


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_the_rod_runs_from_its_connector_to_the_end_effector_and_weighs_nothing(topology: Topology) -> None:
    design = with_rod(random_design(topology, 3))
    model, data = at_load_case(design, 0, gravity=False)
    start, tip = rod_ends(design) - platform(design).p_com
    rod, radius, half = data.geom("rod"), *model.geom("rod").size[:2]
    assert radius == design.task.end_effector.rod_radius
    assert 2 * half == pytest.approx(np.linalg.norm(tip - start), rel=1e-12)
    np.testing.assert_allclose(rod.xpos, (start + tip) / 2, atol=1e-14)
    np.testing.assert_allclose(np.abs(rod.xmat.reshape(3, 3)[:, 2] @ (tip - start)), 2 * half, rtol=1e-12)
    assert model.body("platform").subtreemass == pytest.approx(design.task.total_mass(topology.n), rel=1e-14)
    assert data.ncon == 0


def test_a_rotor_that_runs_keeps_to_its_least_and_largest_input() -> None:
    design = random_design(Topology.from_key("a10"), 0, {"module": {"min_input": 0.2}})
    model, data = in_mujoco(mjcf(design))
    data.ctrl[:] = [100, -100, 0, 0, 0, 0, 0, 0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.actuator_force, np.array([1, *[0.2] * 7]) * 2.5 * 0.24 * 9.81 / 4, rtol=1e-15)


def test_parts_are_those_of_the_task_and_never_touch_each_other() -> None:
    design = random_design(Topology.from_key("af0000"), 1, {"module": {"body": {"hub": [0.06, 0.05, 0.04]}}})
    model, data = at_load_case(design, 0, gravity=False)
    shapes = [model.geom(g).size for g in range(9)]
    np.testing.assert_allclose(shapes[0], [0.03, 0.025, 0.02])
    for q in range(4):
        np.testing.assert_allclose(shapes[1 + 2 * q], [0.05, 0.01, 0.01])
        np.testing.assert_allclose(shapes[2 + 2 * q][:2], [0.05, 0.01])
        rotor, arm = data.geom(2 + 2 * q), data.geom(1 + 2 * q)
        np.testing.assert_allclose(rotor.xpos, data.site(f"module_0_rotor_{q}").xpos, atol=1e-15)
        along = arm.xmat.reshape(3, 3)[:, 0]
        np.testing.assert_allclose(data.body("module_0").xpos + 0.1 * along, rotor.xpos, atol=1e-15)
    assert data.ncon == 0  # drawn at random, arms reach through each other


def test_a_frame_of_the_modules_own_is_where_its_pieces_are() -> None:
    design = random_design(Topology.from_key("a300"), 2, {"module": {"body": OWN_FRAME}})
    model, data = at_load_case(design, 0, gravity=False)
    at = platform(design)
    for i, k in itertools.product(range(3), range(2)):
        body = data.body(f"module_{i}")
        (geom,) = (
            g
            for g in range(model.ngeom)
            if model.geom_bodyid[g] == body.id and model.geom_dataid[g] == model.mesh(f"frame_{k}").id
        )
        mesh = model.mesh(f"frame_{k}")
        own = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
        found = own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        right = (WEDGE, BLOCK)[k] @ at.poses.R[i].T + at.o[i]
        apart = np.linalg.norm(found[:, None] - right, axis=-1)
        assert apart.min(axis=0).max() < 1e-6  # single precision
        assert apart.min(axis=1).max() < 1e-6
    assert not any(model.geom(g).type == mujoco.mjtGeom.mjGEOM_BOX for g in range(model.ngeom))


@pytest.mark.parametrize(
    "task",
    [
        {"end_effector": {"mass": 0.0}},
        {"module": {"body": {"inertia": [0.1, 0.7, 0.8]}}},  # a plate: 0.1 + 0.7 < 0.8 in floating point
        {"name": "two--dashes"},  # which a comment in XML may not hold
        {"module": {"thrust_coefficient": 1e-12, "torque_coefficient": 1e-14}},  # inputs of 1e12 rad^2/s^2
        FEATURES["tilted rotors"],
    ],
)
def test_odd_but_valid_tasks_load(task: dict[str, Any]) -> None:
    design = random_design(Topology.from_key("a300"), 2, task)
    _, data = at_load_case(design, 0, gravity=False)
    expected = wrench_map(platform(design), design.task.module) @ design.inputs[0].ravel()
    np.testing.assert_allclose(data.qfrc_actuator, expected, atol=1e-12)


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_the_rod_has_its_mass_where_it_is_asked_for(topology: Topology) -> None:
    design = with_rod(random_design(topology, 3))
    model, data = in_mujoco(mjcf(design, Physics(rod_mass=True)))
    ends = rod_ends(design) - platform(design).p_com
    length = np.linalg.norm(ends[1] - ends[0])
    m, rod = design.task.total_mass(topology.n), 0.045 * length
    np.testing.assert_allclose(
        data.body("platform").subtree_com, rod * ends.mean(axis=0) / (m + rod), rtol=0, atol=1e-14
    )
    M = mass_matrix(model, data)
    assert M[0, 0] == pytest.approx(m + rod, rel=1e-14)
    # a tube as two rings of points, exact by Gauss, about the origin, where the design has its centre of mass
    v = (ends[1] - ends[0]) / length
    side = np.linalg.svd(v[None])[2][1:]
    angles, along = np.arange(8) * np.pi / 4, length * (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3))
    ring = 0.005 * np.einsum("ka,kx->ax", [np.cos(angles), np.sin(angles)], side)
    points = (ends[0] + along[:, None, None] * v + ring).reshape(-1, 3)
    J = np.einsum("nx,nx->", points, points) * np.eye(3) - points.T @ points
    np.testing.assert_allclose(M[3:, 3:], exported_inertia(design) + rod * J / len(points), rtol=0, atol=1e-12)


def test_thrust_lags_and_a_keyframe_begins_with_what_it_holds() -> None:
    design = random_design(Topology.from_key("a300"), 2)
    model, data = in_mujoco(mjcf(design, Physics(motor_lag=0.04)))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    expected = wrench_map(platform(design), design.task.module) @ design.inputs[0].ravel()
    np.testing.assert_allclose(data.qfrc_actuator, expected, atol=1e-12)
    held = data.act.copy()
    data.ctrl[:] = 0.0
    for _ in range(20):  # 40 ms
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.act, held / np.e, rtol=1e-12)


def test_the_tip_touches_and_the_rod_does_so_before_it() -> None:
    design = with_rod(random_design(Topology.from_key("a300"), 2))
    model, data = in_mujoco(mjcf(design, Physics(contacts=True)))
    ends = rod_ends(design) - platform(design).p_com
    tip, before = model.geom("tip"), model.geom("rod_contact")
    np.testing.assert_allclose(data.geom("tip").xpos, ends[1], atol=1e-14)
    assert (tip.size[0], before.size[0]) == (0.005, 0.005)
    v = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    np.testing.assert_allclose(data.geom("rod_contact").xpos, (ends[0] + ends[1] - 0.01 * v) / 2, atol=1e-14)
    assert (model.geom("rod").contype, model.geom("rod").conaffinity) == (0, 0)
    assert model.body("platform").subtreemass == pytest.approx(design.task.total_mass(3), rel=1e-14)
    assert data.ncon == 0


# ---- The URDF export, read by pytransform3d and by MuJoCo: frames, masses, inertia, and thrust as the file says.


TREES = drawn_trees()


def floating(design: Design) -> tuple[Any, Any]:
    """The file's own bodies, floating, without gravity."""
    spec = mujoco.MjSpec.from_string(urdf(design))
    spec.compiler.fusestatic = False
    spec.option.gravity = [0, 0, 0]
    spec.body("module_0").add_freejoint()
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("topology", few(TREES, TREES[::4]), ids=lambda tree: tree.key)
def test_frames_are_where_the_audit_has_them(topology: Topology) -> None:
    design = random_design(topology, 5)
    at = platform(design)
    frames = UrdfTransformManager()
    frames.load_urdf(urdf(design))

    def in_platform(link: str) -> Array:
        return np.asarray(frames.get_transform(link, "centre_of_mass"))

    for i in range(topology.n):
        if i:  # the root's link has the axes of W
            np.testing.assert_allclose(in_platform(f"module_{i}")[:3, :3], at.poses.R[i], atol=1e-13)
        np.testing.assert_allclose(in_platform(f"module_{i}")[:3, 3], at.o[i], atol=1e-13)
        for q in range(4):
            rotor = in_platform(f"module_{i}_rotor_{q}")
            np.testing.assert_allclose(rotor[:3, :3], at.poses.R[i], atol=1e-13)
            np.testing.assert_allclose(rotor[:3, 3], at.rotors[i, q], atol=1e-13)
    np.testing.assert_allclose(in_platform("end_effector")[:3, 3], at.p_e, atol=1e-13)
    np.testing.assert_allclose(in_platform("module_0")[:3, :3], np.eye(3), atol=1e-13)


@pytest.mark.parametrize("inertia", [[1e-3, 1e-3, 2e-3], [1.3e-3, 0.9e-3, 2.2e-3], [0.7, 3.1, 3.8]])
@pytest.mark.parametrize("topology", few(TREES, TREES[::4]), ids=lambda tree: tree.key)
def test_a_flat_body_loads_however_it_is_turned(topology: Topology, inertia: list[float]) -> None:
    """Its largest moment is the sum of the others, which MuJoCo checks without tolerance."""
    text = urdf(random_design(topology, 3, {"module": {"body": {"inertia": inertia}}}))
    mujoco.MjModel.from_xml_string(text)
    for origin in ElementTree.fromstring(text).findall("link/inertial/origin"):
        assert not any(map(float, origin.attrib["rpy"].split()))  # some readers ignore the turn of a tensor


@pytest.mark.parametrize("topology", few(TREES, TREES[::4]), ids=lambda tree: tree.key)
def test_thrust_applied_as_the_file_says_gives_the_wrench_of_the_audit(topology: Topology) -> None:
    design = random_design(topology, 7)
    text = urdf(design)
    k_f, k_tau = (float(re.search(rf"(\S+) u \[{unit}\]", text)[1]) for unit in ("N", "N m"))  # type: ignore[index]
    model, data = floating(design)
    pulled = np.zeros(6)
    for i in range(topology.n):
        for q in range(4):
            link, u = data.body(f"module_{i}_rotor_{q}"), design.inputs[0, i, q]
            z = link.xmat.reshape(3, 3)[:, 2]
            torque = (-1) ** (q + 1) * k_tau * u * z
            mujoco.mj_applyFT(model, data, k_f * u * z, torque, link.xpos, link.id, pulled)
    force, about_root = pulled[:3], pulled[3:]
    about_com = about_root - np.cross(data.body("centre_of_mass").xpos, force)
    expected = wrench_map(platform(design), design.task.module) @ design.inputs[0].ravel()
    np.testing.assert_allclose([*force, *about_com], expected, atol=1e-11)


@pytest.mark.parametrize("topology", few(TREES, TREES[::4]), ids=lambda tree: tree.key)
def test_the_rod_runs_from_its_connector_to_the_end_effector(topology: Topology) -> None:
    design = with_rod(random_design(topology, 8))
    frames = UrdfTransformManager()
    frames.load_urdf(urdf(design))
    (rod,) = (part for part in frames.visuals if part.frame.startswith("visual:end_effector"))
    start, tip = rod_ends(design)
    assert (rod.radius, rod.length) == (0.005, pytest.approx(np.linalg.norm(tip - start), rel=1e-12))
    pose = frames.get_transform(rod.frame, "module_0")  # the axes of W
    ends = pose[:3, 3] + np.outer([-rod.length / 2, rod.length / 2], pose[:3, 2])
    np.testing.assert_allclose(ends, [start, tip], atol=1e-13)


@pytest.mark.parametrize("kappa", range(4))
@pytest.mark.parametrize("alpha", [-np.pi / 2, np.pi / 2, 0, 1e-9 - np.pi / 2])
def test_roll_pitch_and_yaw_where_they_are_singular(alpha: float, kappa: int) -> None:
    R = rotation(1, alpha) @ rotation(2, kappa * np.pi / 2)
    roll, pitch, yaw = roll_pitch_yaw(R)
    np.testing.assert_allclose(rotation(2, yaw) @ rotation(1, pitch) @ rotation(0, roll), R, atol=1e-14)


def test_every_part_is_seen_and_collides() -> None:
    design = random_design(Topology.from_key("a300"), 1)
    robot = ElementTree.fromstring(urdf(design))
    materials = {material.get("name") for material in robot.findall("material")}
    for i in range(3):
        (link,) = robot.findall(f"link[@name='module_{i}']")
        seen, hit = link.findall("visual"), link.findall("collision")
        assert len(seen) == len(hit) == 9
        assert {part.find("material").get("name") for part in seen} <= materials  # type: ignore[union-attr]
