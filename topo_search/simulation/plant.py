"""Simulated plant: the platform with its rod, an end-effector with contact, and an optional wall.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | COM of the simulated platform from the design's COM, which ignores the rod's mass; body axes | (3,) | m |
| m, J | mass, inertia about c, rod included | | kg, kg m^2 |
| B | wrench about c, in body axes, of unit thrusts | (6, N) | N, N m per N |
| T, T_max | thrusts, largest thrust of a rotor | (N,) | N |
| W | thrust of a rotor below which wakes take all of it | (N,) | N |
| tau | time constant of a rotor's thrust | | s |
"""

from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

import mujoco
import numpy as np

from topo_search.export.allocation import largest_thrusts, thrust_matrix
from topo_search.export.hover import Hover
from topo_search.export.mjcf import Physics, mjcf, numbers
from topo_search.export.poses import mass_of, rod_of
from topo_search.model import Array, Design, read_only
from topo_search.model.mesh import rotation_to
from verify.flight.joints import inertia
from verify.kinematics import platform

State = tuple[Array, Array, Array, Array]
"""Position and velocity of the nominal COM in the world, orientation, rates in body axes."""
STEP = 0.001
"""Time step of the simulation [s]."""
LAG = 0.05
"""Time constant of a rotor's thrust [s]."""


@dataclass(frozen=True)
class ModelErrors:
    """Differences between the simulated platform and the controller's model."""

    model: float = 0.0
    """Relative standard deviation of the mass of every body and the thrust of every rotor."""
    noise: float = 1.0
    """Factor on the noise of position, velocity, attitude and rate."""
    seed: int = 0
    wakes: tuple[float, ...] = ()
    """W: the thrust of each rotor below which the wakes of other modules take all of it [N]; empty: no losses."""


@dataclass(frozen=True, eq=False)
class Nominal:
    """The controller's model of the platform."""

    mass: float
    com: Array
    """c."""
    J: Array
    B: Array
    largest_thrust: Array
    """Largest thrust of each rotor, (N,) [N]."""
    least_share: float
    """Smallest thrust of a running rotor over the largest."""
    gravity: float
    arm: float
    """l_arm, the scale of torques [m]."""
    tip: Array
    """End-effector from c, body axes, (3,) [m]."""

    @property
    def weight(self) -> float:
        """m g [N]."""
        return self.mass * self.gravity

    @cached_property
    def hover(self) -> Hover:
        """Forces and torques that can be added to hover."""
        return Hover(self.B, self.largest_thrust, self.least_share, self.weight, self.arm)

    @cached_property
    def side_acceleration(self) -> float:
        """Horizontal acceleration that the rotors can produce in hover, in any direction [m/s^2]."""
        return self.hover.weakest_force()[0] / self.mass

    def about_com(self, at_tip: Array) -> Array:
        """Return a wrench at the end-effector, (6,), as one about c, in the task's attitude."""
        return np.concatenate([at_tip[:3], at_tip[3:] + cross(self.tip, at_tip[:3])])


@dataclass(frozen=True)
class Wall:
    """A plane wall in front of the tip."""

    towards: Array
    """Unit vector into the wall, (3,)."""
    gap: float
    """Travel of the tip from its initial position to contact [m]."""


class Plant:
    """The simulated platform."""

    def __init__(
        self,
        design: Design,
        errors: ModelErrors,
        wall: Wall | None = None,
        lag: float = LAG,
        known: Nominal | None = None,
    ) -> None:
        """Build the MuJoCo model.

        Args:
            design: the design.
            errors: differences from the controller's model.
            wall: the wall, if there is one.
            lag: time constant of the thrusts [s].
            known: the controller's model of the design, if it is at hand.
        """
        self.nominal = nominal(design) if known is None else known
        self.model = mujoco.MjModel.from_xml_string(_world(design, wall, lag))
        rng = np.random.default_rng(errors.seed)
        self.gain = 1.0 + errors.model * rng.standard_normal(self.model.nu)
        self.wakes = np.array(errors.wakes)
        scale = np.maximum(1.0 + errors.model * rng.standard_normal(self.model.nbody), 0.1)
        self.model.body_mass *= scale
        self.model.body_inertia *= scale[:, None]
        self.model.actuator_gainprm[:, 0] = self.gain
        self.data = mujoco.MjData(self.model)
        self.tip_body = self.model.body("end_effector").id
        self.platform_body = self.model.body("platform").id

    def place(self, position: Array, quaternion: Array) -> None:
        """Place the platform at rest with its nominal COM at a position, without changing the thrusts."""
        self.data.qpos[:3] = position - orientation(quaternion) @ self.nominal.com
        self.data.qpos[3:7] = quaternion
        mujoco.mj_forward(self.model, self.data)

    @property
    def R(self) -> Array:
        """Orientation, (3, 3)."""
        return orientation(self.data.qpos[3:7])

    @property
    def state(self) -> State:
        """The platform's state."""
        R, c, omega = self.R, self.nominal.com, self.data.qvel[3:6].copy()
        return self.data.qpos[:3] + R @ c, self.data.qvel[:3] + R @ cross(omega, c), R, omega

    def missing_wrench(self, thrusts: Array) -> Array:
        """Return the wrench about the nominal COM, (6,), that thrusts (N,) [N] lack for hover in this pose."""
        offset = self.data.subtree_com[self.platform_body] - self.state[0]
        weight = -self.model.body_mass.sum() * self.model.opt.gravity
        required = np.concatenate([self.R.T @ weight, self.R.T @ cross(offset, weight)])
        return np.asarray(required - self.nominal.B @ (self.gain * in_wakes(thrusts, self.wakes)))

    def step(self, commanded: Array, at_tip: Array, at_com: Array) -> None:
        """Advance the simulation by STEP.

        Args:
            commanded: commanded thrusts of the rotors, (N,) [N].
            at_tip: wrench of the environment on the end-effector, world axes, (6,).
            at_com: wrench of the environment on the platform's COM, world axes, (6,).
        """
        self.data.ctrl[:] = in_wakes(commanded, self.wakes)
        self.data.xfrc_applied[self.tip_body] = at_tip
        platform = self.platform_body
        arm = self.data.subtree_com[platform] - self.data.xipos[platform]
        self.data.xfrc_applied[platform, :3] = at_com[:3]
        self.data.xfrc_applied[platform, 3:] = at_com[3:] + cross(arm, at_com[:3])
        mujoco.mj_step(self.model, self.data)

    @property
    def contact_force(self) -> Array:
        """Force of the tip on the wall, world axes, (3,) [N]."""
        total, wrench = np.zeros(3), np.zeros(6)
        for k, names in enumerate(self._contacts()):
            if "tip" in names:
                mujoco.mj_contactForce(self.model, self.data, k, wrench)
                sign = 1.0 if names[1] == "tip" else -1.0
                total += sign * (self.data.contact[k].frame.reshape(3, 3).T @ wrench[:3])
        return np.asarray(-total)

    @property
    def struck(self) -> str | None:
        """Name of a body other than the tip that touches the wall, or None."""
        for k, names in enumerate(self._contacts()):
            if "tip" not in names:
                geom = max(self.data.contact[k].geom, key=lambda g: self.model.geom_bodyid[g])
                return str(self.model.body(self.model.geom_bodyid[geom]).name).replace("_", " ")
        return None

    def _contacts(self) -> list[tuple[str, str]]:
        geom, contacts = self.model.geom, self.data.contact[: self.data.ncon]
        return [(geom(contact.geom1).name, geom(contact.geom2).name) for contact in contacts]


def in_wakes(thrusts: Array, wakes: Array) -> Array:
    """Return what wakes leave of thrusts: T - sqrt(W T), since a share goes with 1 / v_i, and v_i with sqrt(T)."""
    return np.maximum(thrusts - np.sqrt(wakes * thrusts), 0.0) if wakes.size else thrusts


def nominal(design: Design, *, rod_mass: bool = True) -> Nominal:
    """Return the controller's model of a design about its own COM; `rod_mass` adds a rod that the task ignores."""
    task, built = design.task, platform(design)
    m, J, c = task.total_mass(design.topology.n), inertia(design, built), np.zeros(3)
    J = (J + J.T) / 2
    is_ignored = task.end_effector.counted_rod is None
    rod = rod_of(design, built) if rod_mass and is_ignored else None
    if rod is not None:
        mass, J_rod, middle = mass_of(rod, design, built)
        c = mass / (m + mass) * middle
        J = J + m * _steiner(c) + J_rod + mass * _steiner(middle - c)
        m += mass
    B = np.ascontiguousarray(thrust_matrix(task, built))  # products of arrays depend on their layout, bit by bit
    B[3:] -= np.cross(c, B[:3].T).T
    return Nominal(
        mass=m,
        com=read_only(c),
        J=read_only(J),
        B=read_only(B),
        largest_thrust=read_only(largest_thrusts(task)),
        least_share=task.min_input / task.module.max_input(task.gravity),
        gravity=task.gravity,
        arm=task.module.arm_length,
        tip=read_only(built.p_e - c),
    )


def orientation(quaternion: Array) -> Array:
    """Return the rotation of a unit quaternion, (3, 3)."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return R.reshape(3, 3)


def cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, (3,), much faster than NumPy."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def _steiner(r: Array) -> Array:
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))


def _world(design: Design, wall: Wall | None, lag: float) -> str:
    """Return the MJCF of the platform with motor lag, rod mass and contacts, and of the wall."""
    root = ElementTree.fromstring(mjcf(design, Physics(motor_lag=lag, rod_mass=True, contacts=True)))
    next(root.iter("option")).set("timestep", numbers(STEP))
    _add_ground(root, design)
    if wall is not None:
        radius = design.task.end_effector.rod_radius
        centre = platform(design).p_e + (radius + wall.gap + 0.01) * wall.towards
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, rotation_to(wall.towards).ravel())
        shape = {"type": "box", "size": numbers(0.25, 0.25, 0.01), "rgba": "0.7 0.75 0.8 0.25"}
        pose = {"pos": numbers(*centre), "quat": numbers(*quaternion)}
        contact = {"solref": "0.01 1", "friction": "0.3 0.005 0.0001", "priority": "1"}
        SubElement(next(root.iter("worldbody")), "geom", {"name": "wall", **shape, **pose, **contact})
    return ElementTree.tostring(root, encoding="unicode")


def _add_ground(root: ElementTree.Element, design: Design) -> None:
    """Add what films show: a ground with squares of 0.2 m, which touches nothing, and light from above."""
    asset, world = next(root.iter("asset")), next(root.iter("worldbody"))
    squares = {"rgb1": "0.72 0.75 0.78", "rgb2": "0.80 0.83 0.86", "width": "128", "height": "128"}
    SubElement(asset, "texture", {"name": "ground", "type": "2d", "builtin": "checker", **squares})
    look = {"texture": "ground", "texuniform": "true", "texrepeat": "2.5 2.5"}
    SubElement(asset, "material", {"name": "ground", **look})
    built = platform(design)
    size = float(np.linalg.norm(np.vstack([built.p, built.end_effector]) - built.p_com, axis=1).max())
    below = numbers(0, 0, built.p_com[2] - 0.3 - size)
    visible = {"size": "0 0 1", "pos": below, "material": "ground", "contype": "0", "conaffinity": "0"}
    SubElement(world, "geom", {"name": "ground", "type": "plane", **visible})
    visual = SubElement(root, "visual")
    SubElement(visual, "headlight", {"ambient": "0.4 0.4 0.4", "diffuse": "0.2 0.2 0.2", "specular": "0 0 0"})
    SubElement(visual, "quality", {"shadowsize": "4096"})
    next(world.iter("light")).set("diffuse", "0.5 0.5 0.5")
