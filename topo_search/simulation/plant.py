"""What is simulated: the platform with its rod, an end-effector that can touch, a wall if one is asked for.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | COM of the simulated platform from that of the design, which leaves the rod's mass out; body axes | (3,) | m |
| m, J | mass, inertia about c, with the rod | | kg, kg m^2 |
| B | wrench about c, in body axes, of unit thrusts | (6, N) | N, N m per N |
| T, T_max | thrusts, the largest of a rotor | (N,) | N |
| tau | time constant of a rotor's thrust | | s |
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from topo_search.export.allocation import Allocation, allocation
from topo_search.export.mjcf import mjcf
from topo_search.export.poses import poses, rotation_to
from topo_search.export.rod import rod_of
from topo_search.export.xml_text import numbers
from topo_search.model.arrays import Array, read_only
from topo_search.model.design import Design

STEP = 0.001
"""Of the simulation [s]."""
TOUCH = 2
"""Bit of the only geometries that collide: the tip and the wall."""
WALL = 0.25
"""Half the width and height of a wall [m]."""


@dataclass(frozen=True)
class Errors:
    """How the simulated platform differs from the one that the controller knows."""

    model: float = 0.0
    """Standard deviation of every body's mass and of every rotor's thrust, relative."""
    noise: float = 1.0
    """Factor on the noise of position, velocity, attitude and rate."""
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Nominal:
    """What the controller knows."""

    mass: float
    com: Array
    """c."""
    J: Array
    B: Array
    largest_thrust: float
    least_share: float
    """Least thrust of a rotor that runs, over the largest."""
    gravity: float
    arm: float
    """l_arm, the scale of torques [m]."""
    tip: Array
    """End-effector from c, body axes, (3,) [m]."""

    @property
    def weight(self) -> float:
        """m g [N]."""
        return self.mass * self.gravity


@dataclass(frozen=True)
class Wall:
    """A plane that the tip meets."""

    towards: Array
    """Unit vector into the wall, (3,)."""
    gap: float
    """From the tip in the initial pose to where it touches [m]."""


class Plant:
    """The simulated platform."""

    def __init__(self, design: Design, errors: Errors, wall: Wall | None = None) -> None:
        self.nominal = nominal(design)
        self.model = mujoco.MjModel.from_xml_string(_world(design, wall))
        rng = np.random.default_rng(errors.seed)
        self.gain = 1.0 + errors.model * rng.standard_normal(self.model.nu)
        scale = np.maximum(1.0 + errors.model * rng.standard_normal(self.model.nbody), 0.1)
        self.model.body_mass *= scale
        self.model.body_inertia *= scale[:, None]
        self.data = mujoco.MjData(self.model)
        self.thrusts = np.zeros(self.model.nu)
        self.tip_body = self.model.body("end_effector").id
        self.platform_body = self.model.body("platform").id

    def place(self, position: Array, quaternion: Array) -> None:
        """Put the platform at rest with its nominal COM at a position, hovering thrusts not yet on."""
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, quaternion)
        self.data.qpos[:3] = position - R.reshape(3, 3) @ self.nominal.com
        self.data.qpos[3:7] = quaternion
        mujoco.mj_forward(self.model, self.data)

    @property
    def R(self) -> Array:
        """Orientation, (3, 3)."""
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, self.data.qpos[3:7])
        return R.reshape(3, 3)

    @property
    def state(self) -> tuple[Array, Array, Array, Array]:
        """Position and velocity of the nominal COM in the world, orientation, rates in body axes."""
        R, c, omega = self.R, self.nominal.com, self.data.qvel[3:6].copy()
        return self.data.qpos[:3] + R @ c, self.data.qvel[:3] + R @ cross(omega, c), R, omega

    def step(self, commanded: Array, lag: float, at_tip: Array, at_com: Array) -> None:
        """Go on by STEP.

        Args:
            commanded: thrusts that the rotors are told, (N,) [N].
            lag: time constant of the thrusts [s].
            at_tip: wrench of the environment on the end-effector, world axes, (6,).
            at_com: the same on the platform's COM.
        """
        self.thrusts += (commanded - self.thrusts) * (1.0 - math.exp(-STEP / lag))
        self.data.ctrl[:] = self.thrusts * self.gain
        self.data.xfrc_applied[self.tip_body] = at_tip
        platform = self.platform_body
        arm = self.data.subtree_com[platform] - self.data.xipos[platform]
        self.data.xfrc_applied[platform, :3] = at_com[:3]
        self.data.xfrc_applied[platform, 3:] = at_com[3:] + cross(arm, at_com[:3])
        mujoco.mj_step(self.model, self.data)

    @property
    def contact_force(self) -> Array:
        """Force of the tip on the wall, world axes, (3,) [N]."""
        total, found = np.zeros(3), np.zeros(6)
        for k in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, k, found)
            contact = self.data.contact[k]
            sign = 1.0 if self.model.geom(contact.geom2).name == "tip" else -1.0
            total += sign * (contact.frame.reshape(3, 3).T @ found[:3])
        return np.asarray(-total)


def nominal(design: Design) -> Nominal:
    """Return what the controller knows of a design: the model with the rod's mass, about its own COM."""
    acts: Allocation = allocation(design)
    at = poses(design)
    m, J, c = acts.mass_kg, np.array(acts.inertia_kg_m2), np.zeros(3)
    rod = rod_of(design, at)
    if rod is not None:
        m_rod, own, middle = _rod_mass(design)
        c = m_rod / (m + m_rod) * middle
        J = J + m * _spread(c) + own + m_rod * _spread(middle - c)
        m += m_rod
    B = np.array(acts.thrust_matrix)
    B[3:] -= np.cross(c, B[:3].T).T
    return Nominal(
        mass=m,
        com=read_only(c),
        J=read_only(J),
        B=read_only(B),
        largest_thrust=acts.rotors[0].largest_thrust_N,
        least_share=acts.least_input / acts.largest_input,
        gravity=design.task.gravity,
        arm=design.task.module.arm_length,
        tip=read_only(at.p_E - c),
    )


def _rod_mass(design: Design) -> tuple[float, Array, Array]:
    """Return mass, inertia about its middle and middle (from the design's COM) of the rod, a thin tube."""
    at = poses(design)
    rod = rod_of(design, at)
    if rod is None:
        raise ValueError("the design has no rod")
    m = design.task.end_effector.rod_linear_density * rod.length
    v = (rod.end - rod.start) / rod.length
    across = m * rod.length**2 / 12 * (np.eye(3) - np.outer(v, v))
    return m, across + m * rod.radius**2 * np.outer(v, v), (rod.start + rod.end) / 2 - at.p_com


def cross(a: Array, b: Array) -> Array:
    """Return the vector product of two vectors, (3,), much sooner than numpy does."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def _spread(r: Array) -> Array:
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))


def _world(design: Design, wall: Wall | None) -> str:
    """Return the MJCF of the platform with the rod's mass, a tip that touches, and a wall."""
    root = ElementTree.fromstring(mjcf(design))
    option = _found(root, "option")
    option.set("timestep", numbers(STEP))
    platform = _found(root, "worldbody/body[@name='platform']")
    at = poses(design)
    if rod_of(design, at) is not None:
        m, own, middle = _rod_mass(design)
        body = SubElement(platform, "body", name="rod_mass", pos=numbers(*middle))
        moments, axes = np.linalg.eigh(own)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, axes.ravel())
        inertial = {"pos": "0 0 0", "mass": numbers(m), "quat": numbers(*quaternion)}
        SubElement(body, "inertial", {**inertial, "diaginertia": numbers(*_balanced(moments))})
    for geom in root.iter("geom"):
        geom.set("contype", "0")
        geom.set("conaffinity", "0")
    radius = design.task.end_effector.rod_radius
    touching = {
        "contype": str(TOUCH),
        "conaffinity": str(TOUCH),
        "solref": "0.01 1",
        "friction": "0.3 0.005 0.0001",
    }
    tip = _found(root, "worldbody/body[@name='platform']/body[@name='end_effector']")
    SubElement(tip, "geom", {"name": "tip", "type": "sphere", "size": numbers(radius), "mass": "0", **touching})
    if wall is not None:
        centre = at.p_E + (radius + wall.gap + 0.01) * wall.towards
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, rotation_to(wall.towards).ravel())
        shape = {"type": "box", "size": numbers(WALL, WALL, 0.01), "rgba": "0.7 0.75 0.8 0.25"}
        place = {"pos": numbers(*centre), "quat": numbers(*quaternion)}
        SubElement(_found(root, "worldbody"), "geom", {"name": "wall", **shape, **place, **touching})
    SubElement(SubElement(root, "visual"), "global", offwidth="960", offheight="720")
    return ElementTree.tostring(root, encoding="unicode")


def _balanced(moments: Array) -> Any:
    """Return moments of which none exceeds the sum of the others in floating point, as that of a thin rod may."""
    x, y, z = moments
    return min(x, y + z), min(y, x + z), min(z, x + y)


def _found(root: Element, path: str) -> Element:
    found = root.find(path)
    if found is None:
        raise ValueError(f"the model has no {path}")
    return found
