"""The URDF export, read by pytransform3d and by MuJoCo: frames, masses, inertia, and thrust as the file says."""

import re
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from export_cases import drawn_trees, random_design, rod_ends, with_rod
from numpy.typing import NDArray
from pytransform3d.urdf import UrdfTransformManager
from suites import few

from topo_search.export.urdf import roll_pitch_yaw, urdf
from topo_search.model import Design, Topology
from verify.kinematics import platform, rotation, wrench_map

Array = NDArray[np.float64]

TREES = drawn_trees()


def in_mujoco(design: Design) -> tuple[Any, Any]:
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
    model, data = in_mujoco(design)
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
